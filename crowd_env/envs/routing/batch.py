"""Evacuations led by one controller each: every few seconds it says, region by region, which exit or route to take.

A batch over arrays; `crowd_env.envs.routing.env` gives it the interfaces of Gymnasium.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from crowd_env.checks import shown
from crowd_env.envs.client_input import as_numbers
from crowd_env.envs.crowd import CrowdEnv
from crowd_env.envs.metrics import EpisodeMetrics
from crowd_env.envs.observation.layout import ObservationLayout
from crowd_env.envs.routing.layout import RoutingLayout, check_names, grid_regions, named_regions
from crowd_env.physics import ContactScheme, make_scheme
from crowd_env.scenarios.scenario import Scenario
from crowd_env.state import Bools, Floats, Ints, as_grid

DENSITY_SCALE = 5.0  # 1/m2
SPEED_SCALE = 2.0  # m/s
FLOW_SCALE = 5.0  # 1/(s m)  people out per second and meter of exit
QUEUE_REACH = 2.5  # m  whoever has no further to walk to an exit stands in its queue


class RoutingBatch:
    """E evacuations, each led by a controller of its own; see `crowd_env.envs.routing.env.RoutingEnv` for the parameters.

    Parameters
    ----------
    sample_dt : s, the decision step of ``env``, which divides the interval; by default the interval itself.  A shorter one is
        for callers that look at the crowds between two decisions: they call `send`, step ``env`` by themselves, and `observe`.

    Attributes
    ----------
    env : the crowds, a `CrowdEnv`.
    samples : number of steps of ``env`` in an interval.
    regions, layout : where decisions are made, and what is observed.
    choices : (R + D,) number of choices of each entry of an action.
    """

    def __init__(
        self,
        scenario: str | Scenario,
        *,
        num_envs: int = 1,
        interval: float = 2.0,
        regions: Sequence[str] = (),
        grid: tuple[int, int] = (4, 2),
        routes: Sequence[str] = (),
        doors: Sequence[str] = (),
        reward: Mapping[str, float] | None = None,
        rules: bool = False,
        scheme: str | ContactScheme = "nsm2",
        dt: float | None = None,
        time_limit: float | None = None,
        threads: int = 1,
        sample_dt: float | None = None,
        **scenario_options: Any,
    ) -> None:
        self.weights = _weights(reward)
        if not _is_number(interval) or not 0 < interval < np.inf:
            raise ValueError(f"the interval between decisions is {interval!r} s; it must be a number > 0 and finite")
        dt = make_scheme(scheme).info.default_dt if dt is None else dt
        if dt > 0 and (abs(interval / dt - round(interval / dt)) > 1e-6 or interval < 0.5 * dt):
            raise ValueError(f"the interval of {interval:g} s is not a whole number of physics steps of dt = {dt:g} s")
        self.samples = 1 if sample_dt is None else max(round(interval / sample_dt), 1)
        if sample_dt is not None and abs(interval / sample_dt - self.samples) > 1e-6:
            raise ValueError(f"the interval of {interval:g} s is not a whole number of samples of {sample_dt:g} s")
        self.env = CrowdEnv(
            scenario,
            num_envs=num_envs,
            scheme=scheme,
            dt=dt,
            decision_dt=interval if sample_dt is None else sample_dt,
            observation=ObservationLayout(terms=("desired_speed",)),  # nobody reads it
            time_limit=time_limit,
            threads=threads,
            strategy="nearest",  # where nobody is told anything; makes a route of every exit
            rules=rules,
            **scenario_options,
        )
        self.scenario = self.env.scenarios[0]
        geometry, route_set = self.scenario.geometry, self.env.route_set[0]
        exits = tuple(dict.fromkeys(geometry.exit_names))
        known = tuple(dict.fromkeys((*exits, *(route.name for route in self.scenario.routes))))
        routes = check_names("route", routes, known) or known
        doors, regions = check_names("door", doors, geometry.doors), check_names("region", regions, [*geometry.regions])
        self.interval = interval
        self.regions = named_regions(geometry, regions) if regions else grid_regions(geometry, grid)
        self.layout = RoutingLayout(self.regions.names, exits, routes, doors)
        self.choices = np.array([len(routes)] * len(self.regions.names) + [2] * len(doors), dtype=np.int64)
        self._way = np.array([route_set.number(name) for name in routes], dtype=np.int64)
        # A route via a region goes on as another way from there: whoever is on that one already follows the route.
        self._then = np.array([route_set.routes[k].following for k in self._way], dtype=np.int64)
        self._exit_of_row = np.array([exits.index(name) for name in geometry.exit_names], dtype=np.int64)
        length = np.hypot(*(geometry.exits[:, 1] - geometry.exits[:, 0]).T)
        self._width = np.bincount(self._exit_of_row, weights=length, minlength=len(exits))
        self._fields = [route_set.routes[route_set.number(name)].field for name in exits]

    def reset(self, seed: int | Sequence[int] | None = None, mask: ArrayLike | None = None) -> np.ndarray:
        """Start new episodes everywhere, or where ``mask`` (E,) is true; return all observations (E, D)."""
        self.env.reset(seed, mask)
        return self.observe(self.env.active, np.zeros(self.env.num_people, dtype=np.bool_))

    def step(self, action: ArrayLike) -> tuple[np.ndarray, Floats, Bools, Bools, dict[str, Any]]:
        """Tell everyone what to do and let ``interval`` seconds pass; an evacuation that has ended stays as it is.

        Returns
        -------
        observation (E, D), reward (E,), terminated (E,) all are out, truncated (E,) it ended otherwise, and info with the
        terms of the reward (E,), the people inside (E,) and ``metrics`` {e: EpisodeMetrics} of those that have ended.

        Raises
        ------
        ValueError
            If an action is not one of the choices.
        """
        self.send(action)
        left, stopped = np.zeros((2, self.env.num_people), dtype=np.bool_)
        finished, time = np.zeros(self.env.num_envs, dtype=np.bool_), np.zeros(self.env.num_people)
        metrics: dict[int, EpisodeMetrics] = {}
        for _ in range(self.samples):
            step = self.env.step(None)
            left |= step.terminated
            stopped |= step.truncated
            finished |= step.info["finished"]
            time += step.info["reward/time"]
            metrics |= step.info["metrics"]
        inside = self.env.active | stopped
        spent = -as_grid(time, self.env.num_envs)  # s inside during this interval
        terms = {"mean": -spent.mean(axis=1), "last": -spent.max(axis=1)}
        reward = np.zeros(self.env.num_envs)
        for name, weight in self.weights.items():
            reward += weight * terms[name]
        truncated = np.asarray(as_grid(stopped, self.env.num_envs).any(axis=1))
        terminated = np.logical_and(finished, ~truncated)
        info: dict[str, Any] = {f"reward/{name}": values for name, values in terms.items()}
        info["inside"] = as_grid(inside, self.env.num_envs).sum(axis=1)
        info["metrics"] = metrics
        return self.observe(inside, left), reward, terminated, truncated, info

    def send(self, action: ArrayLike) -> None:
        """Tell everyone where to go, and open and close doors, without letting time pass.

        Raises
        ------
        ValueError
            If an action is not one of the choices.
        """
        self._tell(self._checked(action))

    def _checked(self, action: ArrayLike) -> Ints:
        array = as_numbers(action, (self.env.num_envs, len(self.choices)), "the array of actions")
        bad = np.argwhere(~((array >= 0) & (array < self.choices) & (array == np.floor(array))))
        if len(bad):
            e, k = bad[0]
            names = [f"region {name!r}" for name in self.layout.regions] + [f"door {n!r}" for n in self.layout.doors]
            raise ValueError(
                f"the action for {names[k]} is {array[e, k]}; it must be a whole number from 0 to {self.choices[k] - 1}"
            )
        return array.astype(np.int64)

    def _tell(self, action: Ints) -> None:
        state = self.env.simulation.state
        for e in range(self.env.num_envs if self.layout.doors else 0):
            opened = action[e, len(self.regions.names) :]
            closed = {name for name, wish in zip(self.layout.doors, opened, strict=True) if not wish}
            self.env.simulation.close_doors(e, closed | (self._closed(e) - set(self.layout.doors)))
        region = self.regions.locate(state.position)
        choice = action[self.env.env_of_person, np.maximum(region, 0)]
        told = state.active & (region >= 0) & (state.route != self._then[choice])
        state.route[told] = self._way[choice[told]]

    def _closed(self, e: int) -> set[str]:
        stands_open = self.env.simulation.history.door_open[e]
        return {name for k, name in enumerate(self.scenario.geometry.doors) if not stands_open[k]}

    def observe(self, inside: Bools, left: Bools) -> np.ndarray:
        """Return the observations (E, D) of people ``inside`` (P,); ``left`` (P,) got out since the last decision."""
        state, layout = self.env.simulation.state, self.layout
        room, people = self.env.env_of_person, self.env.num_people // self.env.num_envs
        out = np.zeros((self.env.num_envs, layout.size))
        region = np.where(inside, self.regions.locate(state.position), -1)
        count = self._per_room(room, region, len(layout.regions))
        speed = self._per_room(room, region, len(layout.regions), np.hypot(*state.velocity.T))
        out[:, layout["count"]] = count / people
        out[:, layout["density"]] = count / self.regions.area / DENSITY_SCALE
        out[:, layout["speed"]] = speed / np.maximum(count, 1.0) / SPEED_SCALE
        gone = np.where(left, self._exit_of_row[state.exit_index], -1)
        flow = self._per_room(room, gone, len(layout.exits)) / self.interval
        out[:, layout["flow"]] = flow / (self._width * FLOW_SCALE)
        for k, field in enumerate(self._fields):
            rows, columns = field.travel_time.shape
            j, i = np.rint((state.position - field.origin) / field.spacing).astype(np.int64).T
            away = field.travel_time[np.clip(i, 0, rows - 1), np.clip(j, 0, columns - 1)]  # m: at 1 m/s
            near = np.where(inside & (away <= QUEUE_REACH), 0, -1)
            out[:, layout["queue"].start + k] = self._per_room(room, near, 1)[:, 0] / people
        for k, (way, then) in enumerate(zip(self._way, self._then, strict=True)):
            follows = (state.route == way) | ((state.route == then) & (then >= 0))
            out[:, layout["told"].start + k] = self._per_room(room, np.where(inside & follows, 0, -1), 1)[:, 0] / people
        for e in range(len(out) if layout.doors else 0):
            out[e, layout["door"]] = [name not in self._closed(e) for name in layout.doors]
        out[:, layout["inside"]] = as_grid(inside, len(out)).mean(axis=1, keepdims=True)
        out[:, layout["time"]] = (state.time / self.env.time_limit)[:, None]
        return np.clip(out, 0.0, 1.0).astype(np.float32)

    def _per_room(self, room: Ints, place: Ints, places: int, weights: Floats | None = None) -> Floats:
        """Return the number, or the sum of ``weights``, of people in each place (E, places); place -1 does not count."""
        known = place >= 0
        cell = room[known] * places + place[known]
        values = np.ones(len(cell)) if weights is None else weights[known]
        total = np.bincount(cell, weights=values, minlength=self.env.num_envs * places)
        return np.asarray(total, dtype=np.float64).reshape(-1, places)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)


def _weights(reward: Mapping[str, float] | None) -> dict[str, float]:
    """Return the weight of each term of the reward that is named."""
    if reward is None:
        return {"mean": 0.1, "last": 0.1}
    if not isinstance(reward, Mapping):
        raise ValueError(f"reward is {shown(reward)}; it must be a dictionary of weights: reward={{'mean': 0.1}}")
    for name, weight in reward.items():
        if name not in ("mean", "last"):
            raise ValueError(f"unknown reward term {name!r}; known: mean, last")
        if not _is_number(weight) or not np.isfinite(weight):
            raise ValueError(f"weight of reward term {name!r} is {weight!r}; it must be a finite number")
    return dict(reward)
