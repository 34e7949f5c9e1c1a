"""Evacuations with one controller each: every few seconds it chooses, region by region, an exit or route.

A batch over arrays; `crowd_env.envs.routing.env` gives it the interfaces of Gymnasium.
"""

import inspect
from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import ArrayLike

from crowd_env.core.arrays.state import Bools, as_grid, segment_lengths
from crowd_env.core.checks import POSITIVE, Plain, array, known, number, refuse, texts
from crowd_env.envs.action import Masks, mask_info
from crowd_env.envs.arguments import NUMBERS, Place, parts_of
from crowd_env.envs.controlled import BatchStep
from crowd_env.envs.crowd import CrowdEnv
from crowd_env.envs.metrics import EpisodeMetrics
from crowd_env.envs.observation.layout import ObservationLayout
from crowd_env.envs.route_choice import OpenWays
from crowd_env.envs.routing.regions import grid_regions, named_regions, sheets_of
from crowd_env.envs.routing.terms import RoutingLayout, RoutingView, make_terms, make_weights
from crowd_env.envs.settings import Routing, answers_unknown, arguments_of
from crowd_env.envs.tasks.environment import made_for
from crowd_env.envs.terms import RewardTerm
from crowd_env.physics.settings import AsPhysics, AsWalking, Physics


class RoutingBatch:
    """E evacuations with a controller each; see `crowd_env.envs.routing.env.RoutingEnv` for the other parameters.

    Parameters
    ----------
    autoreset : start a new episode in the step in which one ends.
    sample_dt : s, the decision step of ``env``, which divides the interval; by default the interval itself.  A shorter one is
        for callers that measure the crowds between two decisions: they call `send`, step ``env`` by themselves, and `observe`.

    Attributes
    ----------
    env : the crowds, a `CrowdEnv`.
    samples : number of steps of ``env`` in an interval.
    regions, layout : decision regions, and terms of the observation.
    weights : weight of each reward term; 0 = only reported.
    choices : (R + D,) number of choices of each entry of an action.
    """

    @answers_unknown()
    def __init__(
        self,
        scenario: Place = "two-exit-hall-v0",
        *,
        people: int | None = None,
        num_envs: int = 1,
        autoreset: bool = False,
        physics: AsPhysics | None = None,
        walking: AsWalking = None,
        signs: bool = False,
        interval: float = 2.0,
        regions: Sequence[str] = (),
        grid: tuple[int, int] | None = None,
        routes: Sequence[str] = (),
        doors: Sequence[str] = (),
        observation: Plain | None = None,
        reward: Mapping[str | RewardTerm, float] | None = None,
        time_limit: float | None = None,
        sample_dt: float | None = None,
    ) -> None:
        self.weights = make_weights(reward)
        terms = make_terms(observation)
        interval = number("the interval between decisions", interval, POSITIVE, "s")
        task, changed, scenario, made = made_for(scenario, people, time_limit, {"physics": physics, "walking": walking})
        people, walking, physics = people if task is None else None, made["walking"], Physics.of(made["physics"])
        parts_of("interval", interval, "physics steps of dt", physics.dt or physics.law.info.default_dt)
        sample_dt = interval if sample_dt is None else number("sample_dt", sample_dt, POSITIVE, "s")
        self.samples = parts_of("interval", interval, "samples of sample_dt", sample_dt)
        self.env = CrowdEnv(
            scenario,
            people=people,
            num_envs=num_envs,
            physics=physics,
            walking=walking,
            routing=Routing("nearest", signs=signs),  # until the controller decides; makes a route of every exit
            decision_dt=sample_dt,
            observation=ObservationLayout(terms=("desired_speed",)),  # not used
            time_limit=time_limit,
        )
        self.env.task, self.env.changed = task, changed  # its held-out draws are not drawn
        self.scenario = self.env.scenarios[0]
        geometry, route_set = self.scenario.geometry, self.env.route_set[0]
        exits, ways = self.scenario.exits, self.scenario.ways
        routes = _checked_names("route", routes, ways) or ways
        doors = _checked_names("door", doors, geometry.doors)
        regions = _checked_names("region", regions, [*geometry.regions]) or (
            sheets_of(geometry) if grid is None else ()
        )
        self.interval, self.autoreset = interval, autoreset
        self.regions = named_regions(geometry, regions) if regions else grid_regions(geometry, grid or (4, 2))
        self.layout = RoutingLayout(self.regions.names, exits, routes, doors, terms)
        if self.layout.size == 0:
            raise ValueError(f"observation: {', '.join(self.layout.names)} has no column without a door to control")
        self.choices = np.array([len(routes)] * len(self.regions.names) + [2] * len(doors), dtype=np.int64)
        self._route = np.array([route_set.number(name) for name in routes], dtype=np.int64)
        # A route via a region continues as another route from there: people on that one already follow the first.
        self._continuation = np.array([route_set.routes[k].following for k in self._route], dtype=np.int64)
        self._exit_of_row = np.array([exits.index(name) for name in geometry.exit_names], dtype=np.int64)
        length = segment_lengths(geometry.exits)
        self._width = np.bincount(self._exit_of_row, weights=length, minlength=len(exits)).astype(np.float64)
        self._fields = [route_set.routes[route_set.number(name)].field for name in exits]
        self._door = np.array([list(geometry.doors).index(name) for name in doors], dtype=np.int64)
        self._decided = np.zeros(num_envs)  # s  time of the last decision
        # Doors that the controller moves bar no exit: it may open them by the same action.
        self._open = OpenWays(self.env.scenario_of_env, [routes] * num_envs, opened=doors)

    @property
    def made_by(self) -> dict[str, Any]:
        """What decides the future beside the crowds."""
        pays = {term.name: weight for term, weight in self.weights.items()}
        return {"interval": self.interval, "routes": self.layout.routes, "doors": self.layout.doors, "reward": pays}

    @property
    def duration(self) -> float:
        """Simulated time of a step [s]: the interval between decisions."""
        return self.interval

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

    @property
    def action_mask(self) -> Masks | None:
        """The choices of each entry of an action, one entry after the other (E, R K + 2 D); None if no door can bar an exit."""
        if not self._open.may_close:
            return None
        doors = np.ones((self.env.num_envs, 2 * len(self._door)), dtype=bool)
        return np.hstack([np.tile(self._possible(), len(self.regions.names)), doors]).astype(np.int8)

    def _possible(self) -> Bools:
        """Return the routes (E, K) to open exits, or all if there is none."""
        found = self._open(self.env.simulation.history.door_open)
        return found | ~found.any(axis=1, keepdims=True)

    def info_at_reset(self) -> dict[str, np.ndarray]:
        """Return ``inside`` (E,): all people; and the ``action_mask``, if any."""
        inside = np.full(self.env.num_envs, self.env.num_people // self.env.num_envs)
        return {"inside": inside, **mask_info(self.action_mask)}

    def reset(self, seed: int | Sequence[int | None] | None = None, mask: ArrayLike | None = None) -> np.ndarray:
        """Start new episodes everywhere, or where ``mask`` (E,) is true; return all observations (E, D)."""
        self.env.reset(seed, mask)
        self._decided[:] = self.env.simulation.state.time
        return self.observe(self.env.active, np.zeros(self.env.num_people, dtype=bool))

    def step(self, actions: ArrayLike) -> BatchStep:
        """Send people along routes and let ``interval`` seconds pass; an evacuation that has ended stays as it is.

        The info holds the terms of the reward, and the number of people inside (E,).

        Raises
        ------
        ValueError
            If an action is not one of the choices.
        """
        self.send(actions)
        left, cut_off = np.zeros((2, self.env.num_people), dtype=bool)
        finished = np.zeros(self.env.num_envs, dtype=bool)
        metrics: dict[int, EpisodeMetrics] = {}
        for _ in range(self.samples):
            step = self.env.step(None)
            left |= step.terminated
            cut_off |= step.truncated
            finished |= step.info["finished"]
            metrics |= step.info["metrics"]
        view = self._view(self.env.active | cut_off, left)
        reward, info = np.zeros(self.env.num_envs), {}
        for term, weight in self.weights.items():
            values = array(f"reward term {term.name!r}", term.function(view), (self.env.num_envs,), NUMBERS)
            info[f"reward/{term.name}"] = term.finite(values)
            if weight:
                reward += weight * values
        info |= {"inside": view.inside.sum(axis=1), **mask_info(self.action_mask)}
        truncated = np.asarray(as_grid(cut_off, self.env.num_envs).any(axis=1))
        terminated = np.logical_and(finished, ~truncated)
        observation, final, ended = self._observation(view), None, terminated | truncated
        if self.autoreset and ended.any():
            final, observation = observation, np.where(ended[:, None], self.reset(mask=ended), observation)
        return BatchStep(observation, final, reward, terminated, truncated, info, metrics)

    def send(self, actions: ArrayLike) -> None:
        """Send the people of each region along the chosen route, and open and close doors, as ``actions`` (E, R + D) say.

        People sent to an exit that is closed keep the route that they have, if another exit is open.

        Raises
        ------
        ValueError
            If an action of an evacuation under way is not one of the choices.
        """
        shape = (self.env.num_envs, len(self.choices))
        given = array("the array of actions", actions, shape, NUMBERS)
        given = np.where(self.env.finished[:, None], 0, given)  # whatever it is: the evacuation stays as it is
        bad = np.argwhere(~((given >= 0) & (given < self.choices) & (given == np.floor(given))))
        if len(bad):
            e, k = bad[0]
            names = [f"region {name!r}" for name in self.layout.regions] + [f"door {n!r}" for n in self.layout.doors]
            refuse(f"the action for {names[k]}", given[e, k], f"a whole number from 0 to {self.choices[k] - 1}")
        action, state = given.astype(np.int64), self.env.simulation.state
        self._decided[:] = state.time
        for e in range(self.env.num_envs if self.layout.doors else 0):
            is_open = self.env.simulation.history.door_open[e].copy()
            is_open[self._door] = action[e, len(self.regions.names) :]
            doors = zip(self.scenario.geometry.doors, is_open, strict=False)
            self.env.simulation.close_doors(e, {name for name, opens in doors if not opens})
        region = self.regions.locate(self.env.simulation.laid_out)
        choice = action[self.env.env_of_person, np.maximum(region, 0)]
        sent = state.active & (region >= 0) & (state.route != self._continuation[choice])
        sent &= self._possible()[self.env.env_of_person, choice]
        state.route[sent] = self._route[choice[sent]]

    def observe(self, inside: Bools, left: Bools) -> np.ndarray:
        """Return observations (E, D) of people ``inside`` (P,), and of people that ``left`` (P,) since the last decision."""
        return self._observation(self._view(inside, left))

    def _observation(self, view: RoutingView) -> np.ndarray:
        out = np.zeros((self.env.num_envs, self.layout.size))
        for term in self.layout.terms:
            columns = out[:, self.layout[term.name]]
            found = array(f"observation term {term.name!r}", term.function(view), columns.shape, NUMBERS)
            columns[:] = term.finite(found)
        return np.clip(out, 0.0, 1.0).astype(np.float32)

    def _view(self, inside: Bools, left: Bools) -> RoutingView:
        """Return the input of the terms, of people ``inside`` (P,) and people that ``left`` (P,) since the last decision."""
        env, state, rooms = self.env, self.env.simulation.state, self.env.num_envs
        position = env.simulation.laid_out
        until = np.where(left, state.exit_time, state.time[env.env_of_person])
        since = np.fmax(self._decided[env.env_of_person], env.simulation.entrances.entry_time)
        time_inside = np.where(inside | left, until - since, 0.0)
        on_route = [
            inside & ((state.route == route) | ((state.route == continuation) & (continuation >= 0)))
            for route, continuation in zip(self._route, self._continuation, strict=True)
        ]
        return RoutingView(
            interval=self.interval,
            inside=as_grid(inside, rooms),
            left=as_grid(left, rooms),
            time_inside=as_grid(time_inside, rooms),
            position=as_grid(position, rooms),
            velocity=as_grid(state.velocity, rooms),
            region=as_grid(np.where(inside, self.regions.locate(position), -1), rooms),
            region_area=self.regions.area,
            exit_taken=as_grid(np.where(left, self._exit_of_row[state.exit_index], -1), rooms),
            exit_width=self._width,
            exit_distance=np.array(
                [as_grid(field.travel_time_for(position, 0.0) - field.behind, rooms) for field in self._fields]
            ),
            on_route=np.array([as_grid(people, rooms) for people in on_route]),
            door_open=np.asarray(env.simulation.history.door_open[:, self._door], dtype=bool),
            time=state.time,
            time_limit=env.time_limit,
        )


def _checked_names(kind: str, names: Sequence[str], allowed: Sequence[str]) -> tuple[str, ...]:
    """Return the names as a tuple.

    Raises
    ------
    ValueError
        If they are one string or no list of names, or if a name is unknown or given twice.
    """
    found = texts(f"{kind}s", names)
    for name in found:
        known(kind, name, allowed)
        if found.count(name) > 1:
            raise ValueError(f"{kind} {name!r} is named twice; once is enough")
    return found


def routing_arguments(scenario: Place = "two-exit-hall-v0", **settings: Any) -> dict[str, Any]:
    """Return the arguments of a `RoutingBatch` for flat settings, as the files of controllers hold them.

    ``rules`` are the signs; an unknown name is an option of the scenario.  All else is as in `arguments_of`.
    """
    words = {"rules": "signs", "count": "people"}
    known = inspect.signature(RoutingBatch).parameters
    given = arguments_of({words.get(name, name): value for name, value in settings.items()})
    options = {name: given.pop(name) for name in list(given) if name not in known}
    return {"scenario": {"name": scenario, **options} if options else scenario, **given}
