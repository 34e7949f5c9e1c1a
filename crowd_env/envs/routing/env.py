"""Gymnasium: one controller that sends people to exits and along routes, ``crowd_env/routing-v0``.

The people walk by themselves; for a controller that moves every single body see `crowd_env.envs.gymnasium_env`.
"""

from functools import partial
from typing import Any, Literal

from gymnasium.vector import AutoresetMode

from crowd_env.core.arrays.state import Bools
from crowd_env.envs.arguments import Place
from crowd_env.envs.controlled import BatchVectorEnv, SingleEnv
from crowd_env.envs.routing.batch import RoutingBatch
from crowd_env.envs.settings import answers_unknown


class RoutingEnv(SingleEnv):
    """One evacuation and one controller that chooses, region by region, the exit or route to take.

    Observation
        (D,) float32 in [0, 1]: the terms in `crowd_env.envs.routing.terms.TERMS`, in the columns that ``layout`` defines.
    Action
        MultiDiscrete.  One entry a decision region: the number, in ``layout.routes``, of the exit or route that everyone in
        that region is sent along.  People keep to the route that they were last sent along, also in other regions; before
        that, they take the exit that was nearest at the start.  Then one entry a controlled door: 1 opens it, 0 closes it.
        A route to exits that others' doors close is not taken, unless all are closed; where there are such doors,
        ``info["action_mask"]`` is 0 for it, with the choices of all entries one after the other.
    Reward
        A weighted sum of terms, each in ``info["reward/<name>"]``: ``mean`` [s] is minus the time that
        everyone spent inside during the interval, averaged over all N people of the scenario; ``last`` [s] is minus the time
        during which anyone was inside.  With the weights a and b an evacuation returns

            -(a * mean exit time + b * exit time of the last person),

        not discounted, to the hundredth of a second; people that never get out count until the end.
    Termination
        Terminated when everyone is out; truncated at the first decision at or after the time limit, or when the exits are
        blocked (`Scenario.blocked_after`).  ``info["metrics"]`` then holds the `EpisodeMetrics` as a dict;
        ``info["inside"]`` is the number of people inside.

    Parameters
    ----------
    scenario : as `CrowdEnv` takes it; by default "two-exit-hall-v0".
    people, physics, walking, time_limit : as `CrowdEnv` takes them.
    signs : whether the scenario's control rules act as well.
    interval : s between decisions, a whole number of physics steps.
    regions : names of the scenario's regions to decide in; by default the storeys and stairs of a building, elsewhere a grid.
    grid : columns and rows of that grid over the bounding box, by default (4, 2); cells without floor are left out.
    routes : names of exits and of the scenario's routes to choose from; if none, all of them.
    doors : names of the doors to open and close; the others are left to the scenario.
    observation : the terms that are observed, ``{"terms": ["count", "queue"]}``; by default all.  Custom `RoutingTerm` objects
        may stand among the names.
    reward : weights of the terms, by default ``{"mean": 0.1, "last": 0.1}``.  Custom `RewardTerm` objects may be keys.
    render_mode : None or "rgb_array".

    Attributes
    ----------
    layout : meaning of the columns of the observation and of the numbers of an action, a `RoutingLayout`.

    Raises
    ------
    ValueError
        If any of these is unknown, out of range, or does not fit together.

    Examples
    --------
    >>> env = gymnasium.make("crowd_env/routing-v0", grid=(4, 1))
    >>> observation, info = env.reset(seed=0)
    >>> observation, reward, terminated, truncated, info = env.step([0, 1, 1, 1])  # the left quarter west, the others east
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 5}
    batch: RoutingBatch

    @answers_unknown(like=RoutingBatch)
    def __init__(
        self, scenario: Place = "two-exit-hall-v0", *, render_mode: str | None = None, **arguments: Any
    ) -> None:
        super().__init__(RoutingBatch(scenario, **arguments), render_mode)


class RoutingVectorEnv(BatchVectorEnv):
    """Many evacuations in one array, each with its own controller's action; each row equals `RoutingEnv`.

    For infos and restarts see `BatchVectorEnv`: an evacuation that has ended restarts in the same step unless
    ``autoreset_mode`` differs.

    Parameters
    ----------
    scenario : as `CrowdEnv` takes it; by default "two-exit-hall-v0".
    num_envs : number of evacuations E.
    autoreset_mode : "SameStep", "NextStep" or "Disabled".
    render_mode : None or "rgb_array".
    max_episode_steps : decisions of a controller until the time limit; by default that of the place.
    **arguments : all others of `RoutingEnv`.

    Raises
    ------
    ValueError
        If any of these is unknown, out of range, or does not fit together.
    """

    decides: Literal["routing"] = "routing"
    batch: RoutingBatch

    @answers_unknown(like=RoutingBatch)
    def __init__(
        self,
        scenario: Place = "two-exit-hall-v0",
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.SAME_STEP,
        render_mode: str | None = None,
        max_episode_steps: int | None = None,
        **arguments: Any,
    ) -> None:
        make = partial(RoutingBatch, scenario, num_envs=num_envs, **arguments)
        super().__init__(make, autoreset_mode, render_mode, max_episode_steps)

    @property
    def finished(self) -> Bools:
        """Which evacuations ended in the last step, or wait for a reset (E,)."""
        return self.env.finished
