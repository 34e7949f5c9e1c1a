"""Choice of the way out: the exits and routes of a place, which pedestrians may take them, and the time of the last change.

An action of a kind with ``routes`` chooses a way, see `crowd_env.envs.action.SpeedExitTable`.  A change costs nothing but the
way back; after it a pedestrian keeps the new way for ``ActionKind.dwell``.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Bools, CrowdState, Floats, Ints
from crowd_env.core.kernels.jit import kernel
from crowd_env.envs.action import ActionKind, fit_routes
from crowd_env.envs.observation.layout import ObservationLayout
from crowd_env.envs.observation.view import Ways

if TYPE_CHECKING:  # no part of what kernels are made of
    from crowd_env.routing.route_set import RouteSet
    from crowd_env.scenarios.population import Population
    from crowd_env.scenarios.scenario import Scenario

_EARLY = 1e-9  # s  sums of physics steps that fall short of the dwell by rounding count as whole


class RouteChoice(NamedTuple):
    """The C ways that can be chosen, and the time of each pedestrian's last choice."""

    ways: Ways
    allowed: Bools  # (P, C)  cohorts that have a route or exits of their own keep to these
    chosen_at: Floats  # (P,)  s   of the last change of way; -inf = none in this episode
    dwell: float  # s
    env_start: Ints  # (E+1,)


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


def make_route_choice(
    scenario_of_env: Sequence["Scenario"],
    route_sets: Sequence["RouteSet"],
    env_start: Ints,
    dwell: float,
    *,
    used: bool,
) -> RouteChoice:
    """Return the choices in some environments; nothing unless it is ``used``.

    Parameters
    ----------
    route_sets : of each environment, with all `Scenario.ways` of its place if it is used.
    """
    count = len(scenario_of_env[0].ways) if used else 0
    route, then = np.zeros((2, len(scenario_of_env), count), dtype=np.int64)
    allowed = np.zeros((int(env_start[-1]), count), dtype=np.bool_)
    if used:
        for e, (scenario, route_set) in enumerate(zip(scenario_of_env, route_sets, strict=True)):
            route[e] = [route_set.number(name) for name in scenario.ways]
            then[e] = [route_set.routes[k].following for k in route[e]]
            begin = int(env_start[e])
            for part in scenario.population.parts:
                allowed[begin : begin + part.people] = _allowed(part, scenario)
                begin += part.people
    return RouteChoice(Ways(route, then), allowed, np.full(len(allowed), -np.inf), dwell, env_start)


def _allowed(part: "Population", scenario: "Scenario") -> list[bool]:
    """Return which of the ways of a place (C,) the people of a cohort may choose."""
    leads_to = {route.name: route.exits or scenario.exits for route in scenario.routes}
    goals = part.exits or scenario.exits
    return [part.route is None and set(leads_to.get(name, (name,))) <= set(goals) for name in scenario.ways]


@kernel
def take_routes(choice: Ints, controlled: Bools, known: RouteChoice, state: CrowdState) -> None:
    """Write the way that each pedestrian takes from now on, after choices (P,) of ``controlled`` (P,) ones."""
    route, then, env_start, own = known.ways.route, known.ways.then, known.env_start, state.route
    for e in range(len(env_start) - 1):
        now = state.time[e]
        for i in range(env_start[e], env_start[e + 1]):
            k = choice[i]
            if not controlled[i] or k < 0 or not known.allowed[i, k]:
                continue
            if own[i] == route[e, k] or own[i] == then[e, k] or now - known.chosen_at[i] < known.dwell - _EARLY:
                continue
            own[i], known.chosen_at[i] = route[e, k], now
