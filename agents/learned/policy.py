"""A trained stable-baselines3 model as a policy, with what it needs to know of the environment it was trained in."""

import json
import os
import zipfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3 import PPO

from crowd_env import CrowdEnv, ObservationLayout

# Member of the model's zip file that says what the observations and actions mean.
_SIDECAR = "crowd_env.json"


class LearnedPolicy:
    """A shared policy network, applied to every pedestrian; takes the most likely action.

    Parameters
    ----------
    model : a stable-baselines3 model with the observations and actions of ``env_options``.
    env_options : frame, action and observation layout it was trained with.
    name : what tables call it.
    """

    def __init__(self, model: Any, env_options: dict[str, Any], name: str = "learned") -> None:
        self.model = model
        self.env_options = env_options
        self.name = name

    def reset(self, env_mask: np.ndarray) -> None:
        """Nothing to forget."""

    def act(self, observation: np.ndarray, layout: ObservationLayout, rng: np.random.Generator) -> np.ndarray | None:
        """Return the mean action of the network.

        Raises
        ------
        ValueError
            If the observations are not laid out as in training.
        """
        if layout != self.env_options["observation"]:
            raise ValueError(
                f"policy {self.name!r} was trained on other observations: {self.env_options['observation']}"
            )
        action, _ = self.model.predict(observation, deterministic=True)
        return action

    def save(self, path: str | Path) -> None:
        """Write the model and its environment options to one zip file, whole or not at all."""
        path = Path(path)
        part = path.with_name(f".{path.name}.part.zip")
        # Without what holds the training environment: the rollout buffer and how it is made.
        self.model.save(part, exclude=["rollout_buffer_class", "rollout_buffer_kwargs"])
        options = {**self.env_options, "observation": asdict(self.env_options["observation"])}
        with zipfile.ZipFile(part, "a") as archive:
            archive.writestr(_SIDECAR, json.dumps(options))
        os.replace(part, path)

    @classmethod
    def load(cls, path: str | Path, name: str = "learned") -> "LearnedPolicy":
        """Read what `save` wrote.

        Raises
        ------
        ValueError
            If the file is missing or no such model.
        """
        try:
            with zipfile.ZipFile(path) as archive:
                options = json.loads(archive.read(_SIDECAR))
            options["observation"] = ObservationLayout(**options["observation"])
            model = PPO.load(path, device="cpu")
        except Exception as error:  # zip, JSON, pickle and torch each have errors of their own
            raise ValueError(f"{path} is not a policy saved by train.py: {error}") from None
        return cls(model, options, name)


def env_options_of(env: CrowdEnv) -> dict[str, Any]:
    """Return what a policy trained in ``env`` must know of it."""
    return {"frame": env.frame, "action": env.action_kind, "observation": env.layout}
