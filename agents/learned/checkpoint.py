"""Checkpoints, from which training is resumed: weights, state of the optimizer, and steps; only numbers, no pickled objects."""

from pathlib import Path

import torch
from stable_baselines3 import PPO

from crowd_env.core.files.atomic import written

_FORMAT = "crowd_env checkpoint 1"
_PARTS = {"policy": "policy", "optimizer": "policy.optimizer"}  # name in files -> name in stable-baselines3


def write_checkpoint(path: Path, model: PPO) -> None:
    """Write a checkpoint, whole or not at all."""
    parameters = model.get_parameters()
    content = {name: parameters[part] for name, part in _PARTS.items()}
    with written(path) as part:
        torch.save({"format": _FORMAT, **content, "steps": model.num_timesteps}, part)


def read_checkpoint(path: Path, model: PPO) -> None:
    """Load a checkpoint into a model of the same network.  A file that holds more than numbers is refused.

    Raises
    ------
    ValueError
        If the file is missing, damaged, or of another network.
    """
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
        if content["format"] != _FORMAT:
            raise ValueError(f"its format is {content['format']!r}")
        model.set_parameters({part: content[name] for name, part in _PARTS.items()}, device="cpu")
        model.num_timesteps = int(content["steps"])
    except Exception as error:  # zip, pickle and torch each have errors of their own
        reason = str(error).strip().split("\n")[0]
        raise ValueError(f"{path} is not a checkpoint of this training: {reason}") from None
