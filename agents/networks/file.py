"""The file of a network: one ``.safetensors`` with float32 tensors and, in its header, the facts about them.

The format (https://github.com/huggingface/safetensors) holds only numbers and text.  The metadata of the header holds the facts
as one JSON text.  So weights and their meaning cannot be separated, and one atomic write suffices.
"""

import hashlib
import json
from pathlib import Path

import numpy as np
from safetensors import safe_open
from safetensors.numpy import save

from crowd_env.core.checks import known
from crowd_env.core.files.atomic import write_bytes

from ..plain import Plain
from .network import MLP, BetaMLP, BetweenMLP, Network

NETWORK = "best.safetensors"  # file in the folder of a training
# Kind, as files name it -> network.
NETWORKS: dict[str, type[Network]] = {one.kind: one for one in (MLP, BetaMLP, BetweenMLP)}
FORMAT, VERSION = "crowd_env network", 2
_FACTS = "crowd_env"  # key of the metadata
_MOST_BYTES = 2**28  # of a file: a hundred times the networks made here


def write_network(path: Path, network: Network, facts: Plain) -> None:
    """Write a network and its facts, whole or not at all."""
    settings = {"kind": network.kind, **network.settings()}
    header = {"format": FORMAT, "version": VERSION, **facts, "network": settings}
    # The library reads raw memory: it would write an array of another order wrongly.
    tensors = {name: np.ascontiguousarray(one, dtype=np.float32) for name, one in network.tensors().items()}
    write_bytes(path, save(tensors, {_FACTS: json.dumps(header, allow_nan=False)}))


def read_network(path: Path) -> tuple[Network, Plain]:
    """Read the file of a network and return network and facts; nothing in the file is executed.

    Raises
    ------
    ValueError
        If the file is missing, or holds no network of this format.
    """
    try:
        size = path.stat().st_size
        if size > _MOST_BYTES:
            raise ValueError(f"it has {size} bytes; at most {_MOST_BYTES} are read")
        with safe_open(path, framework="numpy") as file:
            facts = json.loads((file.metadata() or {}).get(_FACTS, "null"))
            if not isinstance(facts, dict) or facts.get("format") != FORMAT:
                raise ValueError("it does not say what it is")
            if facts.get("version") != VERSION:
                raise ValueError(f"it has version {facts.get('version')!r}; this program reads version {VERSION}")
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - no mapping
        odd = [name for name, one in tensors.items() if one.dtype != np.float32]
        if odd:
            raise ValueError(f"its tensor {odd[0]} is of {tensors[odd[0]].dtype}, not of float32")
        settings = dict(facts["network"])
        kind = settings.pop("kind")
        return NETWORKS[known("kind of network", kind, NETWORKS)].of(tensors, settings), facts
    except OSError as error:
        raise ValueError(f"cannot read the network {path}: {error.strerror or error}") from None
    except Exception as error:  # a damaged file fails in many places: header, JSON, shapes
        reason = f"it does not say its {error}" if isinstance(error, KeyError) else error
        raise ValueError(f"{path} is not a network saved by a training: {reason}") from None


def network_digest(path: Path) -> str:
    """Return the hash that identifies a network in results and cards."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
