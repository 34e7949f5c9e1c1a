"""Gymnasium: one controller moves everybody.  One room as an Env, many rooms as a natively batched VectorEnv.

For one agent per pedestrian see `crowd_env.parallel_env` (PettingZoo) and `crowd_env.adapters.sb3` (parameter sharing).
"""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from crowd_env.env import CrowdEnv, Step
from crowd_env.scenario import Scenario
from crowd_env.state import as_grid


def _spaces(env: CrowdEnv) -> tuple[gymnasium.spaces.Box, gymnasium.Space]:
    """Return the spaces of one room: the rows of all its pedestrians together."""
    sizes = np.diff(env.env_start)
    if (sizes != sizes[0]).any():
        raise ValueError("a Gymnasium batch needs the same number of people in every scenario; use CrowdEnv otherwise")
    people = int(sizes[0])
    single = env.single_action_space
    observation = gymnasium.spaces.Box(-1.0, 1.0, (people, env.layout.size), np.float32)
    if isinstance(single, gymnasium.spaces.Discrete):
        return observation, gymnasium.spaces.MultiDiscrete([int(single.n)] * people)
    return observation, gymnasium.spaces.Box(-1.0, 1.0, (people, 2), np.float32)


def _per_room(env: CrowdEnv, step: Step) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the mean reward, terminated (all out) and truncated of each room (E,)."""
    reward = as_grid(step.reward, env.num_envs).mean(axis=1)
    truncated = as_grid(step.truncated, env.num_envs).any(axis=1)
    return reward, np.logical_and(step.info["finished"], ~truncated), np.asarray(truncated)


class CrowdGymEnv(gymnasium.Env):
    """One room, one controller for all N people.

    Observation (N, D) and action (N, 2) (or N choices of 9) are the rows of `CrowdEnv`, which see; reward is the mean over
    the N people.  Terminated when everyone is out, truncated at the time limit.  ``info["active"]`` (N,) is true for those
    who are inside.

    Parameters
    ----------
    scenario : name in ``SCENARIOS`` or a Scenario.
    render_mode : None or "rgb_array".
    options : everything else `CrowdEnv` takes.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}

    def __init__(self, scenario: str | Scenario = "room-v0", *, render_mode: str | None = None, **options: Any) -> None:
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"unknown render_mode {render_mode!r}; known: None, rgb_array")
        for name in ("num_envs", "autoreset"):
            if name in options:
                raise ValueError(f"this is one room; {name} belongs to CrowdEnv or crowd_env.make_vec")
        self.env = CrowdEnv(scenario, num_envs=1, **options)
        self.observation_space, self.action_space = _spaces(self.env)
        self.render_mode = render_mode
        self._canvas: Any = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an evacuation; the same seed gives the same people in the same places."""
        super().reset(seed=seed)
        # Without a seed the episode follows from Gymnasium's own generator, so that one seed fixes a whole series.
        draw = int(self.np_random.integers(2**31)) if seed is None else seed
        observation, info = self.env.reset([draw])
        return observation, {**info, "active": self.env.active.copy()}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Advance by one decision step."""
        step = self.env.step(action)
        reward, terminated, truncated = _per_room(self.env, step)
        info = {**step.info, "active": self.env.active.copy()}
        return step.observation, float(reward[0]), bool(terminated[0]), bool(truncated[0]), info

    def render(self) -> np.ndarray | None:
        """Return a frame (H, W, 3) uint8, None without a render mode."""
        if self.render_mode is None:
            return None
        from crowd_env.rendering.live import draw_env

        frame, self._canvas = draw_env(self.env, self._canvas)
        return frame


class CrowdVectorEnv(VectorEnv):
    """Many rooms in one array, stepped together; each row is what `CrowdGymEnv` gives.

    A room that has finished starts anew in the same step: its row shows the first observation of the next episode and
    ``info["final_obs"]`` the last of the old one, where ``info["_final_obs"]`` is true.

    Parameters
    ----------
    scenario : name in ``SCENARIOS``, a Scenario, or several with the same number of people, dealt out in turn.
    num_envs : number of rooms E.
    options : everything else `CrowdEnv` takes.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": []}

    def __init__(
        self,
        scenario: str | Scenario | Sequence[str | Scenario] = "room-v0",
        *,
        num_envs: int = 1,
        render_mode: None = None,
        **options: Any,
    ) -> None:
        if render_mode is not None:
            raise ValueError("a batch is not rendered; make one environment with a render_mode instead")
        if "autoreset" in options:
            raise ValueError(
                "a VectorEnv always restarts a finished room in the same step; autoreset belongs to CrowdEnv"
            )
        self.env = CrowdEnv(scenario, num_envs=num_envs, autoreset=True, **options)
        self.render_mode = None
        self.num_envs = num_envs
        self.single_observation_space, self.single_action_space = _spaces(self.env)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self, *, seed: int | Sequence[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start all rooms anew; ``seed`` as in `CrowdEnv.reset`."""
        observation, info = self.env.reset(seed)
        return as_grid(observation, self.num_envs), {**info, "active": as_grid(self.env.active.copy(), self.num_envs)}

    def step(self, actions: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Advance every room by one decision step."""
        flat = np.asarray(actions).reshape(self.env.num_people, *np.shape(actions)[2:])
        step = self.env.step(flat)
        reward, terminated, truncated = _per_room(self.env, step)
        info = {**step.info, "active": as_grid(self.env.active.copy(), self.num_envs)}
        final = info.pop("final_observation", None)
        if final is not None:
            info["final_obs"], info["_final_obs"] = as_grid(final, self.num_envs), step.info["finished"]
        return as_grid(step.observation, self.num_envs), reward, terminated, truncated, info


def make_vec(
    scenario: str | Scenario | Sequence[str | Scenario] = "room-v0", num_envs: int = 1, **options: Any
) -> CrowdVectorEnv:
    """Return many rooms as a natively batched Gymnasium VectorEnv; see `CrowdVectorEnv`."""
    return CrowdVectorEnv(scenario, num_envs=num_envs, **options)
