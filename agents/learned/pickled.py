"""Files of stable-baselines3.  Opening one unpickles it, which runs whatever code is in it: open trusted files alone."""

import json
import zipfile
from pathlib import Path
from typing import Any

import gymnasium
from stable_baselines3 import PPO

from ..networks import Network
from .export import network_of

# Member of the file that says what observations and actions mean; a network cannot be used without it.
_SIDECAR = "crowd_env.json"


def read_pickled(path: Path) -> tuple[Network, dict[str, Any]]:
    """Return the network of a file and the facts that `crowd_env.agents.trained` reads.

    Raises
    ------
    ValueError
        If the file is no PPO model with the options of its environment beside it.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            options = json.loads(archive.read(_SIDECAR))
        model = PPO.load(path, device="cpu")
        network = network_of(model)
        if "observation" in options:
            action = {"kind": options["action"], "frame": options["frame"]}
            return network, {"kind": "policy", "observation": options["observation"], "action": action}
        space = model.action_space
        if not isinstance(space, gymnasium.spaces.MultiDiscrete):
            raise ValueError("its actions are no choices of exits")
        return network, {"kind": "controller", "choices": space.nvec.tolist(), "options": options}
    except Exception as error:  # zip, JSON, pickle and torch each have errors of their own
        raise ValueError(f"{path} is not a model saved by crowd_env: {error}") from None
