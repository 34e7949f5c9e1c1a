"""A torch module as a policy, as it is at one moment of its training."""

import copy
from typing import Any

import numpy as np
import torch
from torch import nn

from crowd_env import CrowdEnv, ObservationLayout


class ModulePolicy:
    """A network shared by everyone that takes the choice with the largest output: the likeliest, or the one worth most.

    Parameters
    ----------
    module : observations (P, D) -> outputs (P, A); a copy is kept.
    env : what it was trained in, with a discrete action.
    """

    name = "learned"

    def __init__(self, module: nn.Module, env: CrowdEnv) -> None:
        self.module = copy.deepcopy(module).eval()
        self.env_options: dict[str, Any] = {"frame": env.frame, "action": env.action_kind, "observation": env.layout}

    def reset(self, env_mask: np.ndarray) -> None:
        """Nothing to forget."""

    @torch.no_grad()
    def act(self, observation: np.ndarray, layout: ObservationLayout, rng: np.random.Generator) -> np.ndarray:
        """Return the choices (P,) with the largest output.

        Raises
        ------
        ValueError
            If the observations are not laid out as in training.
        """
        if layout != self.env_options["observation"]:
            raise ValueError(f"policy {self.name!r} was trained on other observations")
        choices: np.ndarray = self.module(torch.from_numpy(observation)).argmax(dim=-1).numpy()
        return choices
