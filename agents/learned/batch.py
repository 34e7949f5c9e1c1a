"""A training batch as tensors: scenes of equally many people, who is inside, and the state of everyone for a critic."""

from typing import NamedTuple

import gymnasium
import numpy as np
import torch
from torch import Tensor

from crowd_env import CrowdEnv

# What the columns of a person are divided by; the same as in `crowd_env.envs.global_state.StateLayout`, whose state is of one
# environment alone, but for route and exits: position [10 m], velocity [2 m/s], radius [0.3 m], mass [80 kg], ...
_BODY = {"radius": 0.3, "mass": 80.0, "desired_speed": 2.0, "relaxation_time": 0.5, "response_time": 5.0}
STATE_WIDTH = 4 + len(_BODY) + 1


class Decided(NamedTuple):
    """A decision step of E scenes of N people."""

    observation: Tensor  # (E, N, D)  after the step; of the new episode where one has ended
    inside: Tensor  # (E, N) bool, after the step
    state: Tensor  # (E, N, F)  of everyone after the step, zeros for those who are out
    reward: Tensor  # (E, N)
    left: Tensor  # (E, N) bool, got out in the step
    cut: Tensor  # (E, N) bool, still inside when the episode ended
    episode: Tensor  # (E, 1)  how many have ended so far


class SceneBatch:
    """The scenes of a `CrowdEnv` made with ``autoreset=True``, all of equally many people, with a discrete action.

    Parameters
    ----------
    env : the batch.
    seed : of its first episodes.
    with_state : read the state of everyone, which a centralised critic takes; else it is empty.

    Raises
    ------
    ValueError
        If scenes have different numbers of people, or actions are not discrete.
    """

    def __init__(self, env: CrowdEnv, seed: int, *, with_state: bool = False) -> None:
        people = set(np.diff(env.env_start).tolist())
        if len(people) > 1:
            raise ValueError(f"scenes have {sorted(people)} people; they must all have as many")
        space = env.single_action_space
        if not isinstance(space, gymnasium.spaces.Discrete):
            raise ValueError(f"action {env.action_kind.name!r} is not discrete; take one such as 'speeds'")
        self.env, self.with_state, self.choices = env, with_state, int(space.n)
        self.shape = (env.num_envs, people.pop())
        self.rule = int(np.asarray(env.action_kind.neutral))
        self._corner = np.array([place.geometry.bounds[:2] for place in env.scenario_of_env])[env.env_of_person]
        observation, _ = env.reset(seed)
        self._ended = torch.zeros(env.num_envs, 1, dtype=torch.int64)
        self.now = self._decided(observation, np.zeros(env.num_people), *np.zeros((2, env.num_people), dtype=np.bool_))

    def step(self, action: Tensor) -> Decided:
        """Let everyone act, (E, N) choices, and return what came of it."""
        step = self.env.step(action.numpy().reshape(-1))
        self._ended = self._ended + torch.from_numpy(step.info["finished"])[:, None]
        self.now = self._decided(step.observation, step.reward, step.terminated, step.truncated)
        return self.now

    def _decided(self, observation: np.ndarray, reward: np.ndarray, left: np.ndarray, cut: np.ndarray) -> Decided:
        parts = (observation, self.env.active, self._state(), reward.astype(np.float32), left, cut)
        found = [torch.from_numpy(part).reshape(*self.shape, *part.shape[1:]) for part in parts]
        return Decided._make([*found, self._ended])

    def _state(self) -> np.ndarray:
        """Return the state (P, F) of everyone."""
        if not self.with_state:
            return np.zeros((self.env.num_people, 0), dtype=np.float32)
        crowd, bodies = self.env.simulation.state, self.env.simulation.bodies
        columns = [(crowd.position - self._corner) / 10.0, crowd.velocity / 2.0]
        columns += [getattr(bodies, name)[:, None] / scale for name, scale in _BODY.items()]
        state = np.hstack([*columns, np.ones((len(crowd.position), 1))]).astype(np.float32)
        state[~crowd.active] = 0.0
        return state
