"""Gymnasium: one controller moves everybody.  One room as an Env, many rooms as a natively batched VectorEnv.

For one agent per pedestrian see `crowd_env.envs.parallel` (PettingZoo) and `crowd_env.adapters.sb3` (parameter sharing).
"""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from crowd_env.envs.client_input import as_numbers, check_options
from crowd_env.envs.crowd import CrowdEnv, Step
from crowd_env.envs.vector_env import Advanced, BatchVectorEnv, as_autoreset_mode
from crowd_env.scenarios.scenario import Scenario
from crowd_env.state import Bools, as_grid


def _spaces(env: CrowdEnv) -> tuple[gymnasium.spaces.Box, gymnasium.Space]:
    """Return the spaces of one room: the rows of all its pedestrians together."""
    sizes = np.diff(env.env_start)
    if (sizes != sizes[0]).any():
        raise ValueError("a Gymnasium batch needs the same number of people in every scenario; use CrowdEnv otherwise")
    people = int(sizes[0])
    observation = gymnasium.spaces.Box(-1.0, 1.0, (people, env.layout.size), np.float32)
    return observation, batch_space(env.single_action_space, people)


def _per_room(env: CrowdEnv, step: Step) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the mean reward, terminated (all out) and truncated of each room (E,)."""
    reward = as_grid(step.reward, env.num_envs).mean(axis=1)
    truncated = as_grid(step.truncated, env.num_envs).any(axis=1)
    return reward, np.logical_and(step.info["finished"], ~truncated), np.asarray(truncated)


def _told(env: CrowdEnv, step: Step, active: Bools) -> dict[str, Any]:
    """Return what there is to tell of each room: terms of the reward and who is inside (E, N), diagnostics (E,)."""
    terms = {name: values for name, values in step.info.items() if name.startswith("reward/")}
    told: dict[str, Any] = {name: as_grid(values, env.num_envs) for name, values in terms.items()}
    return {**told, "active": as_grid(active, env.num_envs), "diagnostics": step.info["diagnostics"]._asdict()}


class CrowdGymEnv(gymnasium.Env):
    """One room, one controller for all N people.

    Observation (N, D) and action (N, 2) (or N choices of 9) are the rows of `CrowdEnv`, which see; reward is the mean over
    the N people.  An action of None lets everyone follow the rule.  Terminated when everyone is out, truncated at the time
    limit.

    The info of a step holds the terms of the reward, unweighted, as ``reward/<name>`` (N,); ``active`` (N,), who is inside;
    ``diagnostics``, a dictionary of what the contact solver did; and in the last step of an episode ``metrics``, the fields of
    `EpisodeMetrics` as a dictionary.  That of a reset holds ``active``.

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
        check_options(options)
        super().reset(seed=seed)
        # Without a seed the episode follows from Gymnasium's own generator, so that one seed fixes a whole series.
        draw = int(self.np_random.integers(2**31)) if seed is None else seed
        observation, _ = self.env.reset([draw])
        return observation, {"active": self.env.active.copy()}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Advance by one decision step.

        Raises
        ------
        ValueError
            If the action is malformed or not finite, or before the first `reset`.
        """
        if action is not None:
            action = as_numbers(action, self.action_space.shape or (), "the action")
        step = self.env.step(action)
        reward, terminated, truncated = _per_room(self.env, step)
        told = _told(self.env, step, self.env.active.copy())
        info: dict[str, Any] = {name: values[0] for name, values in told.items() if name != "diagnostics"}
        info["diagnostics"] = {name: values[0].item() for name, values in told["diagnostics"].items()}
        for metrics in step.info["metrics"].values():
            info["metrics"] = metrics._asdict()
        return step.observation, float(reward[0]), bool(terminated[0]), bool(truncated[0]), info

    def render(self) -> np.ndarray | None:
        """Return a frame (H, W, 3) uint8, None without a render mode."""
        if self.render_mode is None:
            return None
        from crowd_env.rendering.live import draw_env

        frame, self._canvas = draw_env(self.env, self._canvas)
        return frame


class CrowdVectorEnv(BatchVectorEnv):
    """Many rooms in one array, stepped together; each row is what `CrowdGymEnv` gives.

    Infos and restarts are those of `BatchVectorEnv`, which see: a room that has finished begins anew in the same step unless
    ``autoreset_mode`` says otherwise.

    Parameters
    ----------
    scenario : name in ``SCENARIOS``, a Scenario, or several with the same number of people, dealt out in turn.
    num_envs : number of rooms E.
    autoreset_mode : "SameStep", "NextStep" or "Disabled".
    options : everything else `CrowdEnv` takes.

    Raises
    ------
    ValueError
        If any of these is unknown, out of range, or does not fit together.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": []}

    def __init__(
        self,
        scenario: str | Scenario | Sequence[str | Scenario] = "room-v0",
        *,
        num_envs: int = 1,
        render_mode: None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        **options: Any,
    ) -> None:
        if render_mode is not None:
            raise ValueError("a batch is not rendered; make one environment with a render_mode instead")
        if "autoreset" in options:
            raise ValueError("autoreset belongs to CrowdEnv; a VectorEnv takes autoreset_mode")
        mode = as_autoreset_mode(autoreset_mode)
        self.env = CrowdEnv(scenario, num_envs=num_envs, autoreset=mode is AutoresetMode.SAME_STEP, **options)
        observation, action = _spaces(self.env)
        everyone = np.ones((num_envs, self.env.num_people // num_envs), dtype=np.bool_)
        super().__init__(num_envs, observation, action, {"active": everyone}, mode)

    def _begin(self, seed: int | Sequence[int] | None, mask: Bools | None) -> np.ndarray:
        return as_grid(self.env.reset(seed, mask)[0], self.num_envs)

    def _advance(self, actions: np.ndarray) -> Advanced:
        step = self.env.step(actions.reshape(self.env.num_people, *actions.shape[2:]))
        reward, terminated, truncated = _per_room(self.env, step)
        final = step.info.get("final_observation")
        active = self.env.active.copy()
        if final is not None:  # where a room began anew nobody was inside in the end
            active[step.info["finished"][self.env.env_of_person]] = False
        return Advanced(
            as_grid(step.observation, self.num_envs),
            None if final is None else as_grid(final, self.num_envs),
            reward,
            terminated,
            truncated,
            _told(self.env, step, active),
            step.info["metrics"],
        )


def make_vec(
    scenario: str | Scenario | Sequence[str | Scenario] = "room-v0", num_envs: int = 1, **options: Any
) -> CrowdVectorEnv:
    """Return many rooms as a natively batched Gymnasium VectorEnv; see `CrowdVectorEnv`."""
    return CrowdVectorEnv(scenario, num_envs=num_envs, **options)
