"""Gymnasium: one controller that sends people to exits and along routes, ``crowd_env/Routing-v0``.

The people walk by themselves; for a controller that moves every single body see `crowd_env.gymnasium_env`.
"""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from crowd_env.routing_batch import RoutingBatch
from crowd_env.routing_layout import RoutingLayout
from crowd_env.scenario import Scenario

_DEFAULT = "two-exit-hall-v0"


def _spaces(batch: RoutingBatch) -> tuple[gymnasium.spaces.Box, gymnasium.spaces.MultiDiscrete]:
    return gymnasium.spaces.Box(0.0, 1.0, (batch.layout.size,), np.float32), gymnasium.spaces.MultiDiscrete(
        batch.choices
    )


class RoutingEnv(gymnasium.Env):
    """One evacuation and one controller that says, region by region, which exit or route to take.

    Observation
        (D,) float32 in [0, 1], columns as ``layout`` says, see `RoutingLayout`.
    Action
        MultiDiscrete.  One entry a decision region: the number, in ``layout.routes``, of the exit or route that everyone who
        is in that region now is told to take.  People keep to what they were told last, also in other regions; where nobody
        is told anything, they take the exit that was nearest at the start.  Then one entry a controlled door: 1 opens it, 0
        closes it.
    Reward
        A weighted sum of two terms in seconds, each in ``info["reward/<name>"]``: ``mean`` is minus the time that everyone
        spent inside during the interval, averaged over all N people of the scenario; ``last`` is minus the time during which
        anyone was inside.  With the weights a and b an evacuation returns

            -(a * mean exit time + b * exit time of the last person),

        not discounted, to the hundredth of a second; who never gets out counts until the end.
    Termination
        Terminated when everyone is out; truncated at the first decision at or after the time limit, or when the exits are
        blocked (`Scenario.blocked_after`).  ``info["metrics"]`` then holds the `EpisodeMetrics` as a dict;
        ``info["inside"]`` is the number of people inside.

    Parameters
    ----------
    scenario : name in ``SCENARIOS`` or a Scenario; its options may follow by name.
    interval : s between decisions, a whole number of physics steps.
    regions : names of the scenario's regions to decide in; if none, the cells of a grid.
    grid : columns and rows of that grid over the bounding box; cells without floor are left out.
    routes : names of exits and of the scenario's routes to choose from; if none, all of them.
    doors : names of the doors to open and close; the others are left to the scenario.
    reward : weights of the terms, by default 0.1 each.
    rules : whether the scenario's control rules act as well.
    scheme, dt, time_limit, threads : as for `CrowdEnv`.
    render_mode : None or "rgb_array".

    Raises
    ------
    ValueError
        If any of these is unknown, out of range, or does not fit together.

    Examples
    --------
    >>> env = gymnasium.make("crowd_env/Routing-v0", grid=(4, 1))
    >>> observation, info = env.reset(seed=0)
    >>> observation, reward, terminated, truncated, info = env.step([0, 1, 1, 1])  # the left quarter west, the others east
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 5}

    def __init__(self, scenario: str | Scenario = _DEFAULT, *, render_mode: str | None = None, **options: Any) -> None:
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"unknown render_mode {render_mode!r}; known: None, rgb_array")
        if "num_envs" in options:
            raise ValueError("this is one evacuation; for several at once use RoutingVectorEnv or gymnasium.make_vec")
        self.batch = RoutingBatch(scenario, **options)
        self.observation_space, self.action_space = _spaces(self.batch)
        self.render_mode = render_mode
        self._canvas: Any = None

    @property
    def layout(self) -> RoutingLayout:
        """What the columns of the observation and the numbers of an action mean."""
        return self.batch.layout

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an evacuation; the same seed gives the same people in the same places."""
        super().reset(seed=seed)
        # Without a seed the episode follows from Gymnasium's own generator, so that one seed fixes a whole series.
        draw = int(self.np_random.integers(2**31)) if seed is None else seed
        return self.batch.reset([draw])[0], {"inside": self.batch.env.num_people}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Tell people where to go and let them walk for one interval."""
        observation, reward, terminated, truncated, info = self.batch.step(np.asarray(action)[None])
        told: dict[str, Any] = {name: values[0].item() for name, values in info.items() if name != "metrics"}
        if info["metrics"]:
            told["metrics"] = info["metrics"][0]._asdict()
        return observation[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), told

    def render(self) -> np.ndarray | None:
        """Return a frame (H, W, 3) uint8, None without a render mode."""
        if self.render_mode is None:
            return None
        from crowd_env.rendering.live import draw_env

        frame, self._canvas = draw_env(self.batch.env, self._canvas)
        return frame


class RoutingVectorEnv(VectorEnv):
    """Many evacuations in one array, each with its own controller's action; each row is what `RoutingEnv` gives.

    One that has ended starts anew in the same step: its row shows the first observation of the next episode and
    ``info["final_obs"]`` the last of the old one, where ``info["_final_obs"]`` is true; ``info["metrics"]`` holds
    {row: EpisodeMetrics} of the evacuations that have ended.  Every value in ``info`` is about the step just made, also for
    rows that have started anew.

    Parameters
    ----------
    scenario : name in ``SCENARIOS`` or a Scenario.
    num_envs : number of evacuations E.
    options : everything else `RoutingEnv` takes.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": []}

    def __init__(
        self, scenario: str | Scenario = _DEFAULT, *, num_envs: int = 1, render_mode: None = None, **options: Any
    ) -> None:
        if render_mode is not None:
            raise ValueError("a batch is not rendered; make one environment with a render_mode instead")
        self.batch = RoutingBatch(scenario, num_envs=num_envs, **options)
        self.render_mode = None
        self.num_envs = num_envs
        self.single_observation_space, self.single_action_space = _spaces(self.batch)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    @property
    def layout(self) -> RoutingLayout:
        """What the columns of the observation and the numbers of an action mean."""
        return self.batch.layout

    def reset(
        self, *, seed: int | Sequence[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Start all evacuations anew; ``seed`` as in `CrowdEnv.reset`."""
        observation = self.batch.reset(seed)
        return observation, {"inside": np.full(self.num_envs, self.batch.env.num_people // self.num_envs)}

    def step(self, actions: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Tell people where to go and let them walk for one interval."""
        observation, reward, terminated, truncated, info = self.batch.step(actions)
        over = terminated | truncated
        if over.any():
            info["final_obs"], info["_final_obs"] = observation.copy(), over
            observation[over] = self.batch.reset(mask=over)[over]
        return observation, reward, terminated, truncated, info
