"""Gymnasium: one controller that sends people to exits and along routes, ``crowd_env/Routing-v0``.

The people walk by themselves; for a controller that moves every single body see `crowd_env.envs.gymnasium_env`.
"""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from crowd_env.envs.client_input import as_numbers, check_options
from crowd_env.envs.routing.batch import RoutingBatch
from crowd_env.envs.routing.layout import RoutingLayout
from crowd_env.envs.vector_env import Advanced, BatchVectorEnv, as_autoreset_mode
from crowd_env.scenarios.scenario import Scenario
from crowd_env.state import Bools

_DEFAULT = "two-exit-hall-v0"


def _spaces(batch: RoutingBatch) -> tuple[gymnasium.spaces.Box, gymnasium.spaces.MultiDiscrete]:
    """Return the spaces of observations and actions; ValueError if every action would be the same."""
    if (batch.choices == 1).all():
        doors = ", ".join(batch.scenario.geometry.doors) or "none"
        raise ValueError(
            f"scenario {batch.scenario.name!r}: there is nothing to choose, with one route ({batch.layout.routes[0]}) and no "
            f"door to control (known doors: {doors}); take a scenario with two exits, more routes or a door"
        )
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
        check_options(options)
        super().reset(seed=seed)
        # Without a seed the episode follows from Gymnasium's own generator, so that one seed fixes a whole series.
        draw = int(self.np_random.integers(2**31)) if seed is None else seed
        return self.batch.reset([draw])[0], {"inside": self.batch.env.num_people}

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Tell people where to go and let them walk for one interval.

        Raises
        ------
        ValueError
            If the action is not one of the choices, or before the first `reset`.
        """
        one = as_numbers(action, self.action_space.shape or (), "the action")
        observation, reward, terminated, truncated, info = self.batch.step(one[None])
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


class RoutingVectorEnv(BatchVectorEnv):
    """Many evacuations in one array, each with its own controller's action; each row is what `RoutingEnv` gives.

    Infos and restarts are those of `BatchVectorEnv`, which see: an evacuation that has ended begins anew in the same step
    unless ``autoreset_mode`` says otherwise.

    Parameters
    ----------
    scenario : name in ``SCENARIOS`` or a Scenario.
    num_envs : number of evacuations E.
    autoreset_mode : "SameStep", "NextStep" or "Disabled".
    options : everything else `RoutingEnv` takes.

    Raises
    ------
    ValueError
        If any of these is unknown, out of range, or does not fit together.
    """

    metadata = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": []}

    def __init__(
        self,
        scenario: str | Scenario = _DEFAULT,
        *,
        num_envs: int = 1,
        render_mode: None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        **options: Any,
    ) -> None:
        if render_mode is not None:
            raise ValueError("a batch is not rendered; make one environment with a render_mode instead")
        mode = as_autoreset_mode(autoreset_mode)
        self.batch = RoutingBatch(scenario, num_envs=num_envs, **options)
        inside = np.full(num_envs, self.batch.env.num_people // num_envs)
        super().__init__(num_envs, *_spaces(self.batch), {"inside": inside}, mode)

    @property
    def layout(self) -> RoutingLayout:
        """What the columns of the observation and the numbers of an action mean."""
        return self.batch.layout

    def _begin(self, seed: int | Sequence[int] | None, mask: Bools | None) -> np.ndarray:
        return self.batch.reset(seed, mask)

    def _advance(self, actions: np.ndarray) -> Advanced:
        observation, reward, terminated, truncated, info = self.batch.step(actions)
        metrics = info.pop("metrics")
        final = None
        if self.autoreset_mode is AutoresetMode.SAME_STEP and metrics:
            over = terminated | truncated
            final, observation = observation, np.where(over[:, None], self.batch.reset(mask=over), observation)
        return Advanced(observation, final, reward, terminated, truncated, info, metrics)
