"""Where training goes on from: weights, the state of the optimizer, and counters; numbers alone, no pickled objects."""

from pathlib import Path
from typing import Any

import torch

from crowd_env.core.files.atomic import written

_FORMAT = "crowd_env checkpoint 1"


def write_checkpoint(path: Path, model: Any) -> None:
    """Write what `read_checkpoint` needs, whole or not at all."""
    content = {
        "format": _FORMAT,
        "policy": model.policy.state_dict(),
        "optimizer": model.policy.optimizer.state_dict(),
        "steps": int(model.num_timesteps),
        "updates": int(model._n_updates),
    }
    with written(path) as part:
        torch.save(content, part)


def read_checkpoint(path: Path, model: Any) -> None:
    """Put a checkpoint into an equal model.  Only numbers are read: a file with anything else in it is refused.

    Raises
    ------
    ValueError
        If the file is missing, damaged, or of another network.
    """
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
        if content["format"] != _FORMAT:
            raise ValueError(f"its format is {content['format']!r}")
        model.policy.load_state_dict(content["policy"])
        model.policy.optimizer.load_state_dict(content["optimizer"])
        model.num_timesteps, model._n_updates = int(content["steps"]), int(content["updates"])
    except Exception as error:  # zip, pickle and torch each have errors of their own
        said = str(error).strip().split("\n")[0]
        raise ValueError(f"{path} is not a checkpoint of this training: {said}") from None
