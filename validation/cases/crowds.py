"""Crowds of one or several scenarios side by side, looked at every 0.1 s; when people pass a line."""

from collections.abc import Callable, Collection, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowd_env import (
    Bodies,
    CrowdState,
    Geometry,
    Physics,
    Pulls,
    Scenario,
    Simulation,
    Walking,
    make_scheme,
    make_state,
)
from crowd_env.core.behaviors.headway import Headway
from crowd_env.envs.metrics import flow_slope
from validation.cases.case import Setting

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

EVERY = 0.1  # s between two looks at a crowd


class Moment(NamedTuple):
    """Where everyone is; P people of all crowds."""

    time: float  # s
    position: Floats  # (P, 2) m, in a building in true coordinates
    active: Bools  # (P,) still inside


Command = Callable[[Moment], Floats]


class Crowds:
    """Draws of one or several experiments side by side: crowd ``k * draws + d`` is draw ``d`` of experiment ``k``."""

    def __init__(self, simulation: Simulation, draws: int) -> None:
        self.simulation, self.draws = simulation, draws
        self.count = len(simulation.state.time)

    def people(self, e: int) -> slice:
        """Return the slots of the people of crowd ``e``."""
        start = self.simulation.bodies.env_start
        return slice(int(start[e]), int(start[e + 1]))

    def of(self, experiment: int) -> range:
        """Return the crowds that are draws of an experiment."""
        return range(experiment * self.draws, (experiment + 1) * self.draws)

    def stop(self, e: int) -> None:
        """Take everyone out of crowd ``e``: its run is over."""
        self.simulation.state.active[self.people(e)] = False

    def moments(self, limit: float, command: Command | None = None) -> Iterator[tuple[Moment, Moment]]:
        """Yield what was and what is after every 0.1 s, until everyone is out or for ``limit`` seconds.

        Parameters
        ----------
        command : function of a `Moment` that returns desired velocities (P, 2) in the axes of the world, as multiples of the
            the desired speed of each pedestrian; by default pedestrians follow their routes.
        """
        simulation, state = self.simulation, self.simulation.state
        steps, relative = round(EVERY / simulation.dt), np.zeros(len(state.active), dtype=bool)
        before = Moment(0.0, state.position.copy(), state.active.copy())
        for k in range(1, round(limit / EVERY) + 1):
            if not state.active.any():
                return
            if command is None:
                simulation.advance(n_substeps=steps)
            else:
                simulation.advance(command(before), relative=relative, n_substeps=steps)
            now = Moment(k * EVERY, state.position.copy(), state.active.copy())
            yield before, now
            before = now

    def speeds(
        self, command: Command, advance: Callable[[Moment, Moment], Floats], first: float, last: float
    ) -> list[float]:
        """Return the mean speed [m/s] of each crowd that is led by a ``command``, from ``first`` to ``last`` [s].

        ``advance`` says how far (P,) [m] people got between two moments.
        """
        walked, counted = np.zeros(len(self.simulation.state.active)), 0.0
        for before, now in self.moments(last, command):
            if before.time >= first - 1e-9:
                walked += advance(before, now)
                counted += now.time - before.time
        return [float(walked[self.people(e)].mean() / counted) for e in range(self.count)]

    def means(self, values: Sequence[float]) -> list[float]:
        """Return the mean over the draws of each experiment of what is not nan; ``values`` has one for each crowd."""
        return [mean_of(values[k : k + self.draws]) for k in range(0, self.count, self.draws)]

    def walk(self, limit: float, *lines: "Passages") -> CrowdState:
        """Let everyone walk for ``limit`` seconds past lines, and return the state at the end."""
        for before, now in self.moments(limit):
            for line in lines:
                line.see(before, now)
        return self.simulation.state


def draw_crowds(scenarios: Sequence[Scenario], setting: Setting) -> Crowds:
    """Return every draw of every scenario; draw ``d`` comes from `generator`, whatever the scheme and the manner.

    Bodies with shoulders stand so far apart that everyone can turn.

    Raises
    ------
    ValueError
        If they do not fit.
    """
    drawn = [
        each.population.draw(generator(setting, d), each.geometry, setting.room)
        for each in scenarios
        for d in range(setting.draws)
    ]
    strategies = [each.strategy_of_run(setting.strategy) for each in scenarios]
    fields = [each.route_set(strategy) for each, strategy in zip(scenarios, strategies, strict=True)]
    which = np.repeat(np.arange(len(scenarios)), setting.draws)
    places = [each.geometry for each in scenarios]
    pulls = [each.pulls for each in scenarios]
    options: dict[str, Any] = {"fields": fields, "geometry_of_env": which, "pulls": pulls}
    crowds = crowds_at(places, drawn, setting, setting.draws, **options)
    for e, (bodies, position) in enumerate(drawn):
        route_set = crowds.simulation.planner.route_set(e)
        assert route_set is not None  # every scenario has an exit
        k = e // setting.draws
        crowds.simulation.send(e, scenarios[k].choose(route_set, strategies[k], position, bodies.radius, bodies.group))
    return crowds


def crowds_at(
    place: Geometry | list[Geometry],
    drawn: Sequence[tuple[Bodies, Floats]],
    setting: Setting,
    draws: int,
    pulls: Sequence[Pulls] | None = None,
    **options: Any,
) -> Crowds:
    """Return crowds of bodies at positions (N, 2) [m], side by side; the other options are those of `Simulation`."""
    bodies, position = zip(*drawn, strict=True)
    columns = [np.concatenate(column) for column in zip(*(part[:-1] for part in bodies), strict=True)]
    every = Bodies._make([*columns, np.cumsum([0, *map(len, position)])])
    where = [place] * len(drawn) if isinstance(place, Geometry) else [place[k] for k in options["geometry_of_env"]]
    standing, sheet = zip(*(one.on_sheets(points) for one, points in zip(where, position, strict=True)), strict=True)
    state = make_state(np.concatenate(standing), sheet=np.concatenate(sheet), environments=len(drawn))
    how: dict[str, Any] = {"outline": setting.outline}
    if Headway.of(setting.manner) is not None and make_scheme(setting.scheme).drives:
        how["max_drive"] = Scenario.max_drive  # of people who keep a distance
    physics = Physics(setting.scheme, **how)
    walking = Walking(setting.manner, pulls=pulls)
    return Crowds(Simulation(place, every, state, physics=physics, walking=walking, **options), draws)


def generator(setting: Setting, draw: int) -> np.random.Generator:
    """Return the generator of a draw."""
    return np.random.default_rng([setting.seed, draw])


class Passages:
    """When people first pass a line of constant x or y, towards larger or smaller values; linear between two looks.

    Parameters
    ----------
    axis : 0 or 1, of x or y.
    at : m, where the line is: for all, or for each of them (P,).
    sign : 1 or -1, the direction that counts: for all, or for each of them (P,).
    """

    def __init__(self, crowds: Crowds, axis: int, at: float | Floats, sign: int | Ints = 1) -> None:
        self._crowds, self._axis, self._at, self._sign = crowds, axis, at, sign
        self.time = np.full(len(crowds.simulation.state.active), np.nan)  # (P,) s; nan for people who have not
        self.last = np.zeros(crowds.count)  # s, when somebody last passed, by crowd
        self.stuck: dict[int, float] = {}  # crowd -> s, when it was stopped

    def see(self, before: Moment, now: Moment) -> None:
        """Note the people who pass between two moments."""
        then, here = (self._sign * (moment.position[:, self._axis] - self._at) for moment in (before, now))
        passed = np.flatnonzero((then < 0.0) & (here >= 0.0) & before.active & np.isnan(self.time))
        if len(passed):
            share = then[passed] / (then[passed] - here[passed])
            self.time[passed] = before.time + share * (now.time - before.time)
            start = self._crowds.simulation.bodies.env_start
            self.last[np.searchsorted(start, passed, side="right") - 1] = now.time

    def stop_the_stuck(self, now: Moment, patience: float) -> None:
        """Stop crowds in which people have yet to pass and none has for ``patience`` seconds."""
        for e in np.flatnonzero(now.time - self.last > patience):
            people = self._crowds.people(int(e))
            if (now.active[people] & np.isnan(self.time[people])).any():
                self._crowds.stop(int(e))
                self.stuck[int(e)] = now.time

    def moments(self, limit: float, patience: float) -> Iterator[tuple[Moment, Moment]]:
        """Yield those of `Crowds.moments`, all that pass seen and the stuck stopped."""
        for before, now in self._crowds.moments(limit):
            self.see(before, now)
            self.stop_the_stuck(now, patience)
            yield before, now

    def watch(self, limit: float, patience: float) -> Collection[int]:
        """Let all crowds walk for ``limit`` seconds, and stop the stuck; return which these are."""
        for _ in self.moments(limit, patience):
            pass
        return self.stuck

    def count_stuck(self, experiment: int) -> int:
        """Return how many draws of an experiment have been stopped."""
        return sum(e in self.stuck for e in self._crowds.of(experiment))

    def times(self, e: int) -> Floats:
        """Return when the people of crowd ``e`` passed, in order; nan last."""
        return np.sort(self.time[self._crowds.people(e)])


def steady_flow(times: Floats, first: float = 0.2, last: float = 0.9) -> float:
    """Return the slope [1/s] of the number passed against time, from a share ``first`` of the people to a share ``last``."""
    return flow_slope(times[round(first * len(times)) : round(last * len(times))])


def mean_of(values: Sequence[float] | Floats) -> float:
    """Return the mean of what is not nan; nan if nothing is."""
    finite = np.asarray(values, dtype=np.float64)
    finite = finite[np.isfinite(finite)]
    return float(finite.mean()) if len(finite) else float("nan")
