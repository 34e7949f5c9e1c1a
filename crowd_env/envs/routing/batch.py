"""Evacuations with one controller each: every few seconds it chooses, region by region, an exit or route.

A batch over arrays; `crowd_env.envs.routing.env` gives it the interfaces of Gymnasium.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import ArrayLike

from crowd_env.checks import POSITIVE, array, known, number, table
from crowd_env.envs.batch import BatchStep
from crowd_env.envs.client_input import NUMBERS
from crowd_env.envs.crowd import CrowdEnv
from crowd_env.envs.observation.layout import ObservationLayout
from crowd_env.envs.routing.layout import RoutingLayout, check_names, grid_regions, named_regions
from crowd_env.physics import ContactScheme, make_scheme
from crowd_env.scenarios.scenario import Scenario
from crowd_env.state import Bools, Floats, Ints, as_grid

DENSITY_SCALE = 5.0  # 1/m2
SPEED_SCALE = 2.0  # m/s
FLOW_SCALE = 5.0  # 1/(s m)  people out per second and meter of exit
QUEUE_REACH = 2.5  # m  people with no further to walk to an exit stand in its queue


class RoutingBatch:
    """E evacuations with a controller each; see `crowd_env.envs.routing.env.RoutingEnv` for the other parameters.

    Parameters
    ----------
    autoreset : start a new episode in the step in which one ends.

    Attributes
    ----------
    env : the crowds, a `CrowdEnv` whose decision step is the interval.
    regions, layout : where decisions are made, and what is observed.
    choices : (R + D,) number of choices of each entry of an action.
    """

    def __init__(
        self,
        scenario: str | Scenario,
        *,
        num_envs: int = 1,
        autoreset: bool = False,
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
        **scenario_options: Any,
    ) -> None:
        self.weights = _weights(reward)
        interval = number("the interval between decisions", interval, POSITIVE, "s")
        dt = make_scheme(scheme).info.default_dt if dt is None else dt
        if dt > 0 and (abs(interval / dt - round(interval / dt)) > 1e-6 or interval < 0.5 * dt):
            raise ValueError(f"the interval of {interval:g} s is not a whole number of physics steps of dt = {dt:g} s")
        self.env = CrowdEnv(
            scenario,
            num_envs=num_envs,
            scheme=scheme,
            dt=dt,
            decision_dt=interval,
            observation=ObservationLayout(terms=("desired_speed",)),  # nobody reads it
            time_limit=time_limit,
            threads=threads,
            strategy="nearest",  # until the controller says otherwise; makes a route of every exit
            rules=rules,
            **scenario_options,
        )
        self.scenario = self.env.scenarios[0]
        geometry, route_set = self.scenario.geometry, self.env.route_set[0]
        exits = tuple(dict.fromkeys(geometry.exit_names))
        known = tuple(dict.fromkeys((*exits, *(route.name for route in self.scenario.routes))))
        routes = check_names("route", routes, known) or known
        doors, regions = check_names("door", doors, geometry.doors), check_names("region", regions, [*geometry.regions])
        self.interval, self.autoreset = interval, autoreset
        self.regions = named_regions(geometry, regions) if regions else grid_regions(geometry, grid)
        self.layout = RoutingLayout(self.regions.names, exits, routes, doors)
        self.choices = np.array([len(routes)] * len(self.regions.names) + [2] * len(doors), dtype=np.int64)
        self._route = np.array([route_set.number(name) for name in routes], dtype=np.int64)
        # A route via a region continues as another route from there: people on that one already follow the first.
        self._continuation = np.array([route_set.route_set[k].following for k in self._route], dtype=np.int64)
        self._exit_of_row = np.array([exits.index(name) for name in geometry.exit_names], dtype=np.int64)
        length = np.hypot(*(geometry.exits[:, 1] - geometry.exits[:, 0]).T)
        self._width = np.bincount(self._exit_of_row, weights=length, minlength=len(exits))
        self._fields = [route_set.route_set[route_set.number(name)].field for name in exits]

    @property
    def observation_space(self) -> gymnasium.spaces.Box:
        """Space of one evacuation's observation."""
        return gymnasium.spaces.Box(0.0, 1.0, (self.layout.size,), np.float32)

    @property
    def action_space(self) -> gymnasium.spaces.MultiDiscrete:
        """Space of one controller's action.

        Raises
        ------
        ValueError
            If every action would be the same.
        """
        if (self.choices == 1).all():
            doors = ", ".join(self.scenario.geometry.doors) or "none"
            raise ValueError(
                f"scenario {self.scenario.name!r}: there is nothing to choose, with one route ({self.layout.routes[0]}) and no "
                f"door to control (known doors: {doors}); take a scenario with two exits, more routes or a door"
            )
        return gymnasium.spaces.MultiDiscrete(self.choices)

    def info_at_reset(self) -> dict[str, np.ndarray]:
        """Return ``inside`` (E,): everyone."""
        return {"inside": np.full(self.env.num_envs, self.env.num_people // self.env.num_envs)}

    def reset(self, seed: int | Sequence[int] | None = None, mask: ArrayLike | None = None) -> np.ndarray:
        """Start new episodes everywhere, or where ``mask`` (E,) is true; return all observations (E, D)."""
        self.env.reset(seed, mask)
        return self.observe(self.env.active, np.zeros(self.env.num_people, dtype=np.bool_))

    def step(self, actions: ArrayLike) -> BatchStep:
        """Send people along routes and let ``interval`` seconds pass; an evacuation that has ended stays as it is.

        The info holds the terms of the reward, and the number of people inside (E,).

        Raises
        ------
        ValueError
            If an action is not one of the choices.
        """
        self.send(actions)
        step = self.env.step(None)
        inside = self.env.active | step.truncated
        spent = -as_grid(step.info["reward/time"], self.env.num_envs)  # s inside during this interval
        terms = {"mean": -spent.mean(axis=1), "last": -spent.max(axis=1)}
        reward = np.zeros(self.env.num_envs)
        for name, weight in self.weights.items():
            reward += weight * terms[name]
        truncated = np.asarray(as_grid(step.truncated, self.env.num_envs).any(axis=1))
        terminated = np.logical_and(step.info["finished"], ~truncated)
        info: dict[str, Any] = {f"reward/{name}": values for name, values in terms.items()}
        info["inside"] = as_grid(inside, self.env.num_envs).sum(axis=1)
        observation, final, ended = self.observe(inside, step.terminated), None, terminated | truncated
        if self.autoreset and ended.any():
            final, observation = observation, np.where(ended[:, None], self.reset(mask=ended), observation)
        return BatchStep(observation, final, reward, terminated, truncated, info, step.info["metrics"])

    def send(self, actions: ArrayLike) -> None:
        """Send the people of each region along the chosen route, and open and close doors, as ``actions`` (E, R + D) say.

        Raises
        ------
        ValueError
            If an action is not one of the choices.
        """
        shape = (self.env.num_envs, len(self.choices))
        given = array("the array of actions", actions, shape, NUMBERS)
        bad = np.argwhere(~((given >= 0) & (given < self.choices) & (given == np.floor(given))))
        if len(bad):
            e, k = bad[0]
            names = [f"region {name!r}" for name in self.layout.regions] + [f"door {n!r}" for n in self.layout.doors]
            raise ValueError(
                f"the action for {names[k]} is {given[e, k]}; it must be a whole number from 0 to {self.choices[k] - 1}"
            )
        action, state = given.astype(np.int64), self.env.simulation.state
        for e in range(self.env.num_envs if self.layout.doors else 0):
            opened = action[e, len(self.regions.names) :]
            closed = {name for name, opens in zip(self.layout.doors, opened, strict=True) if not opens}
            self.env.simulation.close_doors(e, closed | (self._closed(e) - set(self.layout.doors)))
        region = self.regions.locate(state.position)
        choice = action[self.env.env_of_person, np.maximum(region, 0)]
        sent = state.active & (region >= 0) & (state.route != self._continuation[choice])
        state.route[sent] = self._route[choice[sent]]

    def _closed(self, e: int) -> set[str]:
        is_open = self.env.simulation.memory.door_open[e]
        return {name for k, name in enumerate(self.scenario.geometry.doors) if not is_open[k]}

    def observe(self, inside: Bools, left: Bools) -> np.ndarray:
        """Return observations (E, D) of people ``inside`` (P,), and of people who ``left`` (P,) since the last one."""
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
        for k, (route, continuation) in enumerate(zip(self._route, self._continuation, strict=True)):
            follows = (state.route == route) | ((state.route == continuation) & (continuation >= 0))
            out[:, layout["assigned"].start + k] = (
                self._per_room(room, np.where(inside & follows, 0, -1), 1)[:, 0] / people
            )
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


def _weights(reward: Mapping[str, float] | None) -> dict[str, float]:
    """Return the weight of each term of the reward that is named."""
    if reward is None:
        return {"mean": 0.1, "last": 0.1}
    return {
        known("reward term", name, ("mean", "last")): number(f"weight of reward term {name!r}", weight)
        for name, weight in table("reward", reward, "weights such as {'mean': 0.1}").items()
    }
