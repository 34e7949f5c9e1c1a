"""What a training run has learned, copied to where shipped policies lie, with a card that says how it was trained."""

import re
from collections.abc import Mapping
from pathlib import Path

from crowd_env.core.files.atomic import write_bytes
from crowd_env.core.files.json_file import read_json, write_json

from .evaluation.trained_run import RESULTS
from .networks import NETWORK, network_digest
from .plain import Plain
from .pretrained import FOLDER
from .tasks import make_task
from .tasks.presets import ALL_PLACES
from .trained import NUMBERS, load_trained

_GENERALIST = "generalist"
_FROM_RESULTS = ("config", "spent", "validation", "confirmation")


def ship(run: Path, name: str, *, replace: bool = False) -> Path:
    """Copy the network of a run into the folder of shipped policies, with its card; return the path of the network.

    The card holds the task and the digest of the weights, every parameter of the run, what was spent (steps, seconds, CPU
    seconds), and the figures on validation draws.  What it reaches on held-out draws says its submission to the task.

    Parameters
    ----------
    run : folder that train.py wrote.
    name : TASK/POLICY, or generalist.
    replace : a shipped policy of that name.

    Raises
    ------
    ValueError
        If the run is not finished, was trained or judged for another task or another version of it, or the name is taken.
    """
    task, path = _place(name)
    if path.exists() and not replace:
        raise ValueError(f"{name} is shipped already; give --replace, or another name")
    network = run / NETWORK
    found = load_trained(network)
    _check_task(network, found.trained.get("task"), task)
    results = _results(run / RESULTS)
    _check_task(run / RESULTS, results["task"], task)
    digest = network_digest(network)
    if results["network"] != digest:
        raise ValueError(
            f"{run / RESULTS} is about another network than {network}: judge it with train.py --resume {run.name}"
        )
    card = {
        "policy": name,
        "network": digest,
        "task": task,
        **{key: results[key] for key in _FROM_RESULTS},
    }
    # The card first: a policy is listed as soon as its network lies there, and then both do.
    write_json(path.with_suffix(".json"), card)
    write_bytes(path, network.read_bytes())
    return path


def _place(name: str) -> tuple[Plain, Path]:
    """Return the identity of the task of a name, and where its network is kept."""
    if name == _GENERALIST:
        return dict(ALL_PLACES), FOLDER / f"{name}{NUMBERS}"
    task, _, policy = name.partition("/")
    if not re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", policy):
        raise ValueError(
            f"--as {name}: it must be TASK/POLICY, the policy of small letters, digits and hyphens, or generalist"
        )
    return make_task(task).identity(), FOLDER / task / f"{policy}{NUMBERS}"


def _results(path: Path) -> Plain:
    """Return what a finished run has written about itself."""
    found = read_json(path)
    for key in ("task", "network", *_FROM_RESULTS):
        if not isinstance(found, dict) or key not in found:
            raise ValueError(f"{path} lacks {key!r}: it was not written by this version of train.py")
    return found


def _check_task(path: Path, noted: object, present: Plain) -> None:
    """Raise ValueError unless a file was made for this very task."""
    if noted == present:
        return
    if not isinstance(noted, Mapping):
        raise ValueError(f"{path} was made for no task; train with --task {present['name']}")
    if noted.get("name") != present["name"]:
        raise ValueError(f"{path} was made for task {noted.get('name')}, not {present['name']}")
    raise ValueError(
        f"{path} was made for version {noted.get('version')} of {present['name']} (digest {noted.get('digest')}), "
        f"which is at version {present['version']} now (digest {present.get('digest')}): train again"
    )
