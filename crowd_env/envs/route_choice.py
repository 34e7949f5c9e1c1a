"""Choice of the way out: the exits and routes of a place, which pedestrians may take them, and the time of the last change.

An action of a kind with ``routes`` chooses a way, see `crowd_env.envs.action.SpeedExitTable`.  A change costs nothing but the
way back; after it a pedestrian keeps the new way for ``ActionKind.dwell``.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Bools, CrowdState, Floats, Ints
from crowd_env.core.kernels.jit import inner_kernel, kernel
from crowd_env.core.kernels.struct_ref import struct_ref
from crowd_env.envs.action import KEEP, ActionKind, Masks, fit_routes, way_of_action
from crowd_env.envs.observation.layout import ObservationLayout
from crowd_env.envs.observation.view import Ways

if TYPE_CHECKING:  # no part of what kernels are made of
    from crowd_env.routing.route_set import RouteSet
    from crowd_env.scenarios.population import Population
    from crowd_env.scenarios.scenario import Scenario

_EARLY = 1e-9  # s  sums of physics steps that fall short of the dwell by rounding count as whole


class OpenWays:
    """Which exits and routes lead to an exit that no closed door bars.

    Parameters
    ----------
    scenario_of_env : (E,) place of each environment.
    ways : names of the C exits and routes of each.
    opened : doors that count as open whatever they do.
    """

    def __init__(
        self, scenario_of_env: Sequence["Scenario"], ways: Sequence[Sequence[str]], opened: Sequence[str] = ()
    ) -> None:
        count, exits = len(ways), max(len(scenario.exits) for scenario in scenario_of_env)
        self._leads_to: Bools = np.zeros((count, len(ways[0]), exits), dtype=bool)
        most = max(len(scenario.geometry.doors) for scenario in scenario_of_env)
        self._bars: Bools = np.zeros((count, most, exits), dtype=bool)
        for e, (scenario, names) in enumerate(zip(scenario_of_env, ways, strict=True)):
            place, known = scenario.geometry, scenario.exits
            for k, name in enumerate(names):
                self._leads_to[e, k, : len(known)] = np.isin(known, _goals(name, scenario))
            for d, (door, barred) in enumerate(zip(place.doors, place.exits_of_door, strict=True)):
                self._bars[e, d, : len(known)] = [one == barred and door not in opened for one in known]
        self.may_close = bool(self._bars.any())

    def __call__(self, door_open: Bools) -> Bools:
        """Return which ways (E, C) are open, as doors (E, D) stand."""
        shut = ~door_open[:, : self._bars.shape[1]]
        barred = np.asarray((self._bars & shut[:, :, None]).any(axis=1))
        return np.asarray((self._leads_to & ~barred[:, None]).any(axis=2))


class KnownWays(NamedTuple):
    """The C ways that can be chosen, and the time of each pedestrian's last change."""

    ways: Ways
    allowed: Bools  # (P, C)  cohorts that have a route or exits of their own keep to these
    is_open: Bools  # (E, C)  as doors stood at the last call
    chosen_at: Floats  # (P,)  s   of the last change of way; -inf = none in this episode
    dwell: float  # s
    env_start: Ints  # (E+1,)


class RouteChoice:
    """What pedestrians may choose among, and what they chose.

    Parameters
    ----------
    route_sets : of each environment, with all `Scenario.ways` of its place if it is used.
    used : whether there is anything to choose; else C = 0.
    """

    def __init__(
        self,
        scenario_of_env: Sequence["Scenario"],
        route_sets: Sequence["RouteSet"],
        env_start: Ints,
        kind: ActionKind,
        *,
        used: bool,
    ) -> None:
        names = [scenario.ways if used else () for scenario in scenario_of_env]
        route, then = np.zeros((2, len(names), len(names[0])), dtype=np.int64)
        allowed = np.zeros((int(env_start[-1]), len(names[0])), dtype=bool)
        for e, (scenario, route_set) in enumerate(zip(scenario_of_env, route_sets, strict=True) if used else ()):
            route[e] = [route_set.number(name) for name in names[e]]
            then[e] = [route_set.routes[k].following for k in route[e]]
            begin = int(env_start[e])
            for part in scenario.population.parts:
                allowed[begin : begin + part.people] = _allowed(part, scenario)
                begin += part.people
        chosen_at = np.full(len(allowed), -np.inf)
        is_open = np.ones(route.shape, dtype=bool)
        self._open, self._way_of_action = OpenWays(scenario_of_env, names), way_of_action(kind)
        self.known = struct_ref(KnownWays(Ways(route, then), allowed, is_open, chosen_at, kind.dwell, env_start))

    def take(self, choice: Ints, controlled: Bools, state: CrowdState, door_open: Bools) -> None:
        """Write the way that each pedestrian takes from now on, after choices (P,) of ``controlled`` (P,) ones."""
        self._look(door_open)
        take_routes(choice, controlled, self.known, state)

    def mask(self, inside: Bools, state: CrowdState, door_open: Bools) -> Masks | None:
        """Return the choices (P, n) that ``inside`` (P,) ones can take; None if choices are not discrete or take no way."""
        if self._way_of_action is None:
            return None
        self._look(door_open)
        mask = np.empty((len(inside), len(self._way_of_action)), dtype=np.int8)
        write_masks(self._way_of_action, inside, self.known, state, mask)
        return mask

    def _look(self, door_open: Bools) -> None:
        if self._open.may_close:
            self.known.is_open[:] = self._open(door_open)


@inner_kernel
def is_current(e: int, i: int, k: int, known: KnownWays, state: CrowdState) -> bool:
    """Return whether a pedestrian is on way ``k``, whichever half of it."""
    own = state.route[i]
    return own == known.ways.route[e, k] or own == known.ways.then[e, k]


@inner_kernel
def can_take(e: int, i: int, k: int, known: KnownWays, state: CrowdState) -> bool:
    """Return whether a pedestrian could take way ``k`` now, or is on it and it is open."""
    if not known.is_open[e, k]:
        return False
    rests = state.time[e] - known.chosen_at[i] >= known.dwell - _EARLY
    return is_current(e, i, k, known, state) or (known.allowed[i, k] and rests)


@kernel
def take_routes(choice: Ints, controlled: Bools, known: KnownWays, state: CrowdState) -> None:
    """Write the way that each pedestrian takes from now on, after choices (P,) of ``controlled`` (P,) ones."""
    for e in range(len(known.env_start) - 1):
        for i in range(known.env_start[e], known.env_start[e + 1]):
            k = choice[i]
            if controlled[i] and k >= 0 and can_take(e, i, k, known, state) and not is_current(e, i, k, known, state):
                state.route[i], known.chosen_at[i] = known.ways.route[e, k], state.time[e]


@kernel
def write_masks(way_of_action: Ints, inside: Bools, known: KnownWays, state: CrowdState, mask: Masks) -> None:
    """Write which choices (P, n) of ways (n,) people ``inside`` (P,) can take; the current way can always be kept."""
    for e in range(len(known.env_start) - 1):
        for i in range(known.env_start[e], known.env_start[e + 1]):
            way, left = KEEP, True
            for n in range(len(way_of_action)):
                if way_of_action[n] != way:  # mostly that of the choice before
                    way = way_of_action[n]
                    left = way < 0 or (inside[i] and can_take(e, i, way, known, state))
                mask[i, n] = left


def fit_to_ways(
    kind: ActionKind, layout: ObservationLayout, scenarios: Sequence["Scenario"]
) -> tuple[ActionKind, ObservationLayout, bool]:
    """Return action kind and layout for the exits and routes of some places, and whether one of them needs a route to each.

    Raises
    ------
    ValueError
        If an action or an observation has another number of ways, or the places differ in it.
    """
    if kind.routes is None and not layout.tells_of_routes:
        return kind, layout, False
    for scenario in scenarios:
        if len(scenario.ways) != len(scenarios[0].ways):
            counts = f"{len(scenarios[0].ways)} in {scenarios[0].name}, {len(scenario.ways)} in {scenario.name}"
            raise ValueError(f"places of one batch have as many exits and routes to choose among, not {counts}")
    name, ways = scenarios[0].name, scenarios[0].ways
    if layout.tells_of_routes:
        if layout.routes not in (0, len(ways)):
            raise ValueError(f"observation: routes is {layout.routes}; {name} has {len(ways)}: {', '.join(ways)}")
        layout = replace(layout, routes=len(ways))
    return fit_routes(kind, name, ways), layout, True


def _goals(way: str, scenario: "Scenario") -> tuple[str, ...]:
    """Return the exits to which an exit or route of a place may lead in the end."""
    leads_to = {route.name: route.exits or scenario.exits for route in scenario.routes}
    return leads_to.get(way, (way,))


def _allowed(part: "Population", scenario: "Scenario") -> list[bool]:
    """Return which of the ways of a place (C,) the people of a cohort may choose."""
    known = set(part.exits or scenario.exits)
    return [part.route is None and set(_goals(name, scenario)) <= known for name in scenario.ways]
