"""Counter-flow: two streams meet in a corridor; do they gridlock, how much slower are they, do lanes form?"""

from typing import Any

import numpy as np

from crowd_env import Cohorts, Geometry, Scenario
from crowd_env.geometry.geometry import box
from validation.cases.case import Row, Setting, adults, number, row, share
from validation.cases.crowds import Bools, Crowds, Floats, Passages, draw_crowds, mean_of

_PEOPLE = 100  # in each stream
_DENSITY = 1.5  # 1/m2, of both together
_HALF, _SECTION = 2.0, 20.0  # m, half width of the corridor, length of the section that is measured
_LANE = 0.5  # m, width of a row in which directions are compared
_WINDOW = (6.0, 14.0)  # m, where: both streams have to be there
_LEAST = 6  # people of either stream in the window, for order to be measured
_PATIENCE = 20.0  # s without a pedestrian who leaves the section: gridlock
_SHUFFLES = 100


def corridor(two_ways: bool) -> Scenario:
    """Return two streams that come from both ends, or one of as many people: the density where they have met is the same."""
    room = 2 * _PEOPLE / (_DENSITY * 2.0 * _HALF)
    low, high = -room, _SECTION + room
    place = Geometry.from_polygon(
        box(low, -_HALF, high, _HALF),
        exits={"west": [(low, -_HALF), (low, _HALF)], "east": [(high, -_HALF), (high, _HALF)]},
        regions={"in west": box(low, -_HALF, 0.0, _HALF), "in east": box(_SECTION, -_HALF, high, _HALF)},
    )
    if not two_ways:
        people: Any = adults(2 * _PEOPLE, start_region="in west", route="east")
    else:
        east = adults(_PEOPLE, start_region="in west", route="east", name="eastward")
        people = Cohorts((east, adults(_PEOPLE, start_region="in east", route="west", name="westward")))
    return Scenario("two ways" if two_ways else "one way", place, people, 240.0)


def lane_order(position: Floats, eastward: Bools, lane: float = _LANE) -> float:
    """Return the mean over people of ((n+ - n-) / (n+ + n-))^2 of the row they walk in; rows run along x, ``lane`` [m] wide."""
    rows = np.floor(position[:, 1] / lane).astype(int)
    rows -= rows.min()
    there, back = np.bincount(rows, eastward), np.bincount(rows, ~eastward)
    order = ((there - back) / np.maximum(there + back, 1)) ** 2
    return float(order[rows].mean())


def reduced_order(position: Floats, eastward: Bools, rng: np.random.Generator) -> tuple[float, bool]:
    """Return (order - that of shuffled directions) / (1 - that), and whether the order is above 95 % of the shuffled."""
    order = lane_order(position, eastward)
    shuffled = np.array([lane_order(position, rng.permutation(eastward)) for _ in range(_SHUFFLES)])
    usual = float(shuffled.mean())
    return (order - usual) / max(1.0 - usual, 1e-9), bool(order > np.quantile(shuffled, 0.95))


def run(setting: Setting) -> list[Row]:
    """Return the row.  Everyone takes the shortest way: there is no other."""
    crowds = draw_crowds([corridor(two_ways=False), corridor(two_ways=True)], setting)
    eastward = np.concatenate([_eastward(crowds, e) for e in range(crowds.count)])
    ends = np.where(eastward, 0.0, _SECTION), np.where(eastward, _SECTION, 0.0)
    entered, left = (Passages(crowds, 0, end, np.where(eastward, 1, -1)) for end in ends)
    orders: list[tuple[float, bool]] = []
    rng = np.random.default_rng(setting.seed)
    for k, (before, now) in enumerate(left.moments(240.0, _PATIENCE)):
        entered.see(before, now)
        if k % 5 == 0:
            orders += _orders(crowds, now.position, now.active, eastward, rng)
    took, stuck = left.time - entered.time, left.stuck
    speeds = [_SECTION / mean_of(took[crowds.people(e)]) if e not in stuck else np.nan for e in range(crowds.count)]
    one, two = mean_of(speeds[: setting.draws]), mean_of(speeds[setting.draws :])
    order, above = mean_of([each for each, _ in orders]), mean_of([float(each) for _, each in orders])
    jams = sum(e >= setting.draws for e in stuck)
    passed = not stuck and 1.0 - two / one < 1.0 / 3.0 and above > 0.5
    figure = (
        f"{number(two)} m/s both ways, {number(one)} m/s one way; lane order {number(order)}, above shuffled at "
        f"{number(100 * above, 0)} % of moments; {share(jams, setting.draws)} gridlocked"
    )
    if jams < len(stuck):
        figure += f", {len(stuck) - jams} stuck one way"
    more: dict[str, Any] = {"both_ways": two, "one_way": one, "order": order, "above": above, "gridlocked": jams}
    return [row("counterflow", setting, bool(passed), figure, **more)]


def _eastward(crowds: Crowds, e: int) -> Bools:
    """Return which pedestrians of crowd ``e`` walk east: all of a one-way scenario, which come first, else the first stream."""
    people = crowds.people(e)
    return (np.arange(people.stop - people.start) < _PEOPLE) | (e < crowds.draws)


def _orders(
    crowds: Crowds, position: Floats, active: Bools, eastward: Bools, rng: np.random.Generator
) -> list[tuple[float, bool]]:
    """Return the lane order of each two-way crowd in whose window both streams are."""
    found = []
    for e in crowds.of(1):
        here = crowds.people(e)
        x = position[here, 0]
        seen = active[here] & (x > _WINDOW[0]) & (x < _WINDOW[1])
        east = eastward[here][seen]
        if min(east.sum(), (~east).sum()) >= _LEAST:
            found.append(reduced_order(position[here][seen], east, rng))
    return found
