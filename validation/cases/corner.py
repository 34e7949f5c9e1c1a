"""Corners: in a corridor of 2.4 m people walk the slower, the denser they come; a turn costs a crowd little, however wide."""

from typing import NamedTuple

import numpy as np
import shapely
from shapely.affinity import rotate

from crowd_env import Geometry, Scenario
from crowd_env.geometry.geometry import box
from validation.cases.case import Row, Setting, adults, number, row
from validation.cases.crowds import Floats, Passages, draw_crowds
from validation.cases.voronoi import looks_at, mean_figures, steady

RANK, HALVED = -0.8, 0.5
WIDTHS = (1.2, 1.6, 2.0, 2.4, 3.0, 4.0)  # m, of the turns
LONGER, WIDER = 1.15, 1.05


class Run(NamedTuple):
    """Widths [m] of entrance and exit, and people: enough for a queue to reach the corner."""

    entrance: float
    exit: float
    people: int


RUNS = (
    *(Run(0.5, 2.4, 60), Run(0.8, 2.4, 80), Run(1.2, 2.4, 110), Run(1.8, 2.4, 150), Run(2.4, 2.4, 200)),
    *(Run(2.4, 1.1, 220), Run(2.4, 0.7, 180)),
)

_WIDTH, _LEG = 2.4, 6.0  # m, width of the corridor and length of the first leg
_FAR, _TOP, _MIDDLE = _WIDTH + _LEG, _WIDTH + 3.0, 0.5 * _WIDTH  # m, the second leg is 3 m long
_NECK, _HALF, _DENSITY = 0.2, 4.0, 3.0  # m, m, 1/m2: length of necks; half width of the waiting area; people in it
_BEYOND = 3.0  # m, depth of the opening behind
_FIELD = box(_LEG, 0.0, _FAR, _WIDTH)
_FLOOR = shapely.union(box(0.0, 0.0, _FAR, _WIDTH), box(_LEG, 0.0, _FAR, _TOP))
_FIRST, _LAST = 0.5, 0.85  # shares of the people between whose passages everything is steady
_PATIENCE, _LIMIT = 20.0, 300.0  # s
_TURN_LEG, _TURN_DENSITY = 12.0, 1.5  # m, from end to corner along the middle; 1/m2, of people in the first leg


def corner(run: Run) -> Scenario:
    """Return waiting area, entrance, both legs, exit and an opening; people walk east, then north."""
    depth = run.people / (_DENSITY * 2.0 * _HALF) + 0.5
    turn, top = _LEG + _MIDDLE, _TOP + _NECK
    floor = [
        box(-_NECK - depth, _MIDDLE - _HALF, -_NECK, _MIDDLE + _HALF),
        box(-_NECK - 0.01, _MIDDLE - 0.5 * run.entrance, 0.01, _MIDDLE + 0.5 * run.entrance),
        _FLOOR,
        box(turn - 0.5 * run.exit, _TOP - 0.01, turn + 0.5 * run.exit, top + 0.01),
        box(turn - 3.0, top, turn + 3.0, top + _BEYOND),
    ]
    place = Geometry.from_polygon(
        floor,
        exits={"out": [(turn - 3.0, top + _BEYOND), (turn + 3.0, top + _BEYOND)]},
        regions={"waiting": box(-_NECK - depth, _MIDDLE - _HALF, -_NECK - 0.5, _MIDDLE + _HALF)},
    )
    return Scenario(f"corner-{run.entrance:g}-{run.exit:g}", place, adults(run.people, start_region="waiting"), _LIMIT)


def measure(setting: Setting, runs: tuple[Run, ...] = RUNS) -> list[dict[str, float]]:
    """Return density, speed, flow and the number of stuck draws of each run."""
    crowds = draw_crowds([corner(run) for run in runs], setting)
    passages = Passages(crowds, 1, _WIDTH)
    moments = passages.moments(_LIMIT, _PATIENCE)
    looks = looks_at(crowds, moments, lambda x, y: (x > _LEG - 2.0) & (y < _WIDTH + 2.0))
    found = []
    for k, run in enumerate(runs):
        first, last = (round(share * run.people) for share in (_FIRST, _LAST))
        parts = [
            steady(first, last, passages.times(e), [one for one in looks if one.crowd == e], _FLOOR, _FIELD)
            for e in crowds.of(k)
        ]
        found.append({**mean_figures(parts), "stuck": passages.count_stuck(k)})
    return found


def rank_correlation(x: Floats, y: Floats) -> float:
    """Return Spearman's rank correlation of values without ties."""
    return float(np.corrcoef(np.argsort(np.argsort(x)), np.argsort(np.argsort(y)))[0, 1])


def falls(density: Floats, speed: Floats) -> bool:
    """Return whether the speed falls with density as the criterion asks."""
    if not (np.isfinite(density).all() and np.isfinite(speed).all()):
        return False
    order = np.argsort(density)
    return rank_correlation(density, speed) <= RANK and bool(speed[order[-1]] <= HALVED * speed[order[0]])


def run(setting: Setting) -> list[Row]:
    """Return the row."""
    found = measure(setting)
    density, speed = (np.array([one[name] for one in found]) for name in ("density", "speed"))
    stuck = int(sum(one["stuck"] for one in found))
    pairs = ", ".join(f"{number(d)} /m2 {number(v)} m/s" for d, v in zip(density, speed, strict=True))
    figure = pairs + (f"; {stuck} of {len(RUNS) * setting.draws} stuck" if stuck else "")
    return [row("corner", setting, falls(density, speed) and not stuck, figure, runs=found)]


def turn(width: float, angle: bool = True, degrees: float = 0.0) -> Scenario:
    """Return a corridor of two legs at a right ``angle``, or one behind the other; people fill the first leg.

    The whole lies ``degrees`` off the axes of the drawing.
    """
    half, leg = 0.5 * width, _TURN_LEG
    first, second = box(-leg, -half, 0.0, half), box(0.0, -half, leg, half)
    end = [(leg, -half), (leg, half)]
    if angle:
        second = shapely.union(box(-half, -half, half, half), box(-half, 0.0, half, leg))
        end = [(-half, leg), (half, leg)]
    first, second, out = (rotate(one, degrees, (0.0, 0.0)) for one in (first, second, shapely.LineString(end)))
    place = Geometry.from_polygon([first, second], exits={"out": list(out.coords)}, regions={"leg": first})
    return Scenario(f"turn-{width:g}", place, adults(round(_TURN_DENSITY * leg * width), start_region="leg"), _LIMIT)


def times(setting: Setting, degrees: float = 0.0) -> Floats:
    """Return when the last person is out [s] of a turn and of a straight corridor (2, widths), means over the draws."""
    crowds = draw_crowds([turn(width, angle, degrees) for angle in (True, False) for width in WIDTHS], setting)
    out = crowds.walk(_LIMIT).exit_time
    return np.array(crowds.means([float(out[crowds.people(e)].max()) for e in range(crowds.count)])).reshape(2, -1)


def costs_little(turned: Floats, straight: Floats) -> bool:
    """Return whether turns of `WIDTHS` take hardly longer [s] than straight corridors, and wider ones than narrower ones.

    Wider ones hold more people, and so slower ones: each is compared with the straight one of the same people.
    """
    cost = turned / straight
    return bool((cost <= LONGER).all() and (cost <= WIDER * np.minimum.accumulate(cost)).all())


def run_turn(setting: Setting) -> list[Row]:
    """Return the row of the turns of all widths."""
    turned, straight = times(setting)
    pairs = zip(WIDTHS, turned, straight, strict=True)
    figure = "turned (straight): " + ", ".join(f"{w:g} m {number(a, 1)} ({number(b, 1)}) s" for w, a, b in pairs)
    return [row("turn", setting, costs_little(turned, straight), figure, turned=turned, straight=straight)]
