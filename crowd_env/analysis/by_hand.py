"""The hand calculation of fire engineers: pedestrians walk to the exits, and queue at the narrowest passages on the way.

The hydraulic model of first order (SFPE Handbook of Fire Protection Engineering, 5th edition 2016, chapter 59): a door passes
1.32 people a second and meter of effective width, which is 0.15 m less on each side than the clear width, and pedestrians
alone walk at 1.19 m/s, slower ones at their own median speed.  On a stair flow and speed are less, both by 51.8 √(tread /
riser) to 84, landings included; a stair is two boundary layers less wide than between its walls.  Stairs between the same
levels are one passage, which all pass that have no other way out.  The people of a cohort queue from when half of them have
responded and the first have come; they use the exits that they may take and can reach in proportion to their widths.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from crowd_env.analysis.plan_check import PlanCheck, check_place, spot
from crowd_env.analysis.ways_out import WaysOut, binding, closed_for_good, cut_off, ways_out
from crowd_env.core.arrays.state import segment_lengths
from crowd_env.core.files.json_file import json_number
from crowd_env.routing.route_set import RouteSet
from crowd_env.scenarios.population import Population
from crowd_env.scenarios.scenario import Scenario

FLOW = 1.32  # 1/(s m)  of effective width: k / (4 a) with k = 1.4 m/s and a = 0.266 m2
BOUNDARY = 0.15  # m  on each side of a door
SPEED, _SLOW = 1.19, 0.1  # m/s  0.85 k, and the least that slower people are taken to walk at


class _Cohort(NamedTuple):
    people: int
    exits: frozenset[str]  # that are open to it
    response: tuple[float, float]  # s, of the median and of the latest person
    walk: tuple[float, float]  # s, of the first and of the last person


def by_hand(place: Scenario, check: PlanCheck | None = None, strategy: str | None = None) -> dict[str, Any]:
    """Return what an evacuation takes by hand, in ``words`` and ready for JSON: times in s, widths in m.

    ``check`` is that of the place, if it is known; ``strategy`` that of the runs, by default the place's.

    ``response`` is the median of the cohort that responds first, and the latest; ``walk`` that of the first and of the last.
    The queue is the longest of that at all exits together, at the exits of a cohort, and at each passage that people have to
    pass, stairs among them, ``at`` which it is; it and ``time`` are None if that is no wider than its boundary layers.
    """
    check = check or check_place(place)
    routes = place.route_set(binding(place, strategy), rules=False).when(closed_for_good(place))
    cohorts = [_cohort(place, check, k, ways, routes) for k, ways in enumerate(ways_out(place, strategy))]
    widths, sets = check.widths, {one.exits for one in cohorts}
    queues = []
    for exits in dict.fromkeys([frozenset().union(*sets), *sorted(sets, key=sorted)]):
        at = "the exits" if len(exits) == len(widths) else f"exit {', '.join(sorted(exits)) or 'none'}"
        here = [(one, one.people) for one in cohorts if one.exits <= exits]
        queues.append(_queue(here, sum(_effective(widths[name]) for name in exits), at))
    for passage in check.passages.values():
        if passage is not None and not passage.is_exit:
            lost = {exits: cut_off(place, passage.gap.line[None], exits, check.position) for exits in sets}
            here = [(one, int(lost[one.exits][check.cohort == k].sum())) for k, one in enumerate(cohorts)]
            queues.append(_queue(here, _effective(passage.gap.width), spot(check.geometry, passage.gap.line)))
    queues += _queues_at_stairs(place, cohorts, check)
    queue, effective, at, _ = max(queues)
    time = max(*(over for *_, over in queues), *(one.response[1] + one.walk[1] for one in cohorts))
    spans = [[*one.response, *one.walk] for one in cohorts]
    low, high = np.min(spans, axis=0).tolist(), np.max(spans, axis=0).tolist()
    response, walk = [low[0], high[1]], [low[2], high[3]]
    late = f"responses of {response[0]:.0f} to {response[1]:.0f} s, " if response[1] else ""
    line = f"{queue:.0f} s of queue at {at}, {effective:.2f} m of effective width"
    out = f"{time:.0f} s" if np.isfinite(time) else "never"
    words = f"{out}: {late}walks of {walk[0]:.0f} to {walk[1]:.0f} s, {line}"
    times = {"time": json_number(time), "response": response, "walk": walk, "queue": json_number(queue)}
    return {"words": words, "people": place.population.people, **times, "effective_width": effective, "at": at}


def response_of(part: Population) -> tuple[float, float]:
    """Return the response times [s] of the median and of the latest of a cohort, in one draw."""
    drawn = part.draw_bodies(np.random.default_rng(0)).response_time
    return float(np.median(drawn)), float(drawn.max())


def _cohort(place: Scenario, check: PlanCheck, k: int, ways: WaysOut, routes: RouteSet) -> _Cohort:
    part, at = place.population.parts[k], check.position[check.cohort == k]
    reached = (name for name in ways.exits if not cut_off(place, np.empty((0, 2, 2)), [name], at).all())
    exits = frozenset(name for name in reached if check.passages[name] is not None)
    if not exits:
        return _Cohort(part.people, exits, response_of(part), (0.0, 0.0))
    field = routes.routes[routes.number(ways.route)].potential
    last = float(place.walks(part, field)[1].max(initial=0.0))
    first = float((field.travel_time_for(at, 0.0) - field.behind).min(initial=last))
    speed = float(np.clip(np.median(part.draw_bodies(np.random.default_rng(0)).desired_speed), _SLOW, SPEED))
    return _Cohort(part.people, exits, response_of(part), (first / speed, last / speed))


def _queues_at_stairs(
    place: Scenario, cohorts: Sequence[_Cohort], check: PlanCheck
) -> Iterator[tuple[float, float, str, float]]:
    """Yield the queue at the stairs between the same levels, of people that have no other way out."""
    geometry, building = place.geometry, place.geometry.building
    if building is None:
        return
    sheets, beside = building.sheets, [set[int]() for _ in building.sheets]
    for seam in building.seams:
        beside[seam.left].add(seam.right)
        beside[seam.right].add(seam.left)
    width = np.full(len(sheets), np.inf)
    np.minimum.at(width, building.from_sheet, segment_lengths(building.lines))
    of_exit, start = (geometry.on_sheets(points)[1] for points in (geometry.exits.mean(axis=1), check.position))
    stairs = [s for s, sheet in enumerate(sheets) if np.isnan(sheet.level)]
    for ends in dict.fromkeys(frozenset(beside[s]) for s in stairs):
        group = [s for s in stairs if beside[s] == ends]
        here = []
        for k, one in enumerate(cohorts):
            reached = {int(s) for s, name in zip(of_exit, geometry.exit_names, strict=True) if name in one.exits}
            while more := {t for s in reached for t in beside[s]} - reached - {*group}:
                reached |= more
            behind = ~np.isin(start, [*reached, *group]) & (check.cohort == k)
            here.append((one, int(behind.sum())))
        rooms = [_effective(float(width[s])) for s in group]
        # Flow and speed are less by the same share.
        shares = [min(min(slope.up, slope.down) for slope in sheets[s].slopes) for s in group]
        flow = float(np.dot(rooms, shares)) / (sum(rooms) or 1.0)
        yield _queue(here, float(sum(rooms)), " and ".join(repr(sheets[s].name) for s in group), flow)


def _effective(width: float) -> float:
    return max(width - 2.0 * BOUNDARY, 0.0)


def _queue(
    here: Sequence[tuple[_Cohort, int]], effective: float, at: str, share: float = 1.0
) -> tuple[float, float, str, float]:
    """Return for how long [s] people of cohorts pass an effective width [m], both, and when the last of them has.

    They pass at a ``share`` of the flow of a door.
    """
    rate = FLOW * effective * share
    came = sorted(((one.response[0] + one.walk[0], people) for one, people in here if people), reverse=True)
    behind, over = 0, 0.0
    for begin, people in came:  # the last cohort first
        behind += people
        over = max(over, begin + behind / rate if rate else np.inf)
    return (behind / rate if rate else np.inf if behind else 0.0), effective, at, over
