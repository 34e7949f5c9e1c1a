"""Doors: how many people a second pass one of 0.5 to 5 m, with floor behind it, and with the exit line in the wall."""

from typing import Any

from crowd_env import Geometry, Scenario
from crowd_env.geometry.geometry import box
from validation.cases.case import Row, Setting, adults, number, row
from validation.cases.crowds import Passages, draw_crowds, mean_of, steady_flow

# 1/(m s): the points of tests/data/published_flows.csv, as compiled by the test suite of JuPedSim, and their mean.
LOW, HIGH, MEAN = 1.6, 2.8, 2.12

WIDTHS = (0.5, 0.8, 1.0, 1.2, 1.6, 2.0, 2.4, 5.0)  # m
JUDGED = (0.8, 1.0, 1.2, 1.6, 2.0, 2.4)

_PER_METER = 150  # people; 115 make the flow of a whole run that of its steady part (Liao et al. 2015)
_DENSITY = 3.0  # 1/m2, in front of the door at the start
_HALF, _NECK, _BEYOND = 4.0, 0.3, 3.0  # m: half the width of the reservoir, length of neck and free space behind
_PATIENCE = 20.0  # s without a passage: stuck
_LIMIT = 400.0  # s


def door(width: float, people: int | None = None, in_wall: bool = False) -> Scenario:
    """Return people in front of a neck of ``width`` [m] in a wall, behind which 3 m are free up to the exit line.

    Or that line is the opening ``in_wall`` itself.
    """
    people = round(_PER_METER * width) if people is None else people
    back = -0.5 - people / (_DENSITY * 2.0 * _HALF)
    end, half = (0.0, 0.5 * width) if in_wall else (_NECK + _BEYOND, _HALF)
    floor = [box(back, -_HALF, 0.0, _HALF)]
    if not in_wall:
        floor += [box(-0.1, -0.5 * width, _NECK + 0.1, 0.5 * width), box(_NECK, -_HALF, end, _HALF)]
    place = Geometry.from_polygon(
        floor, exits={"out": [(end, -half), (end, half)]}, regions={"reservoir": box(back, -_HALF, -0.5, _HALF)}
    )
    return Scenario(f"door-{width:g}", place, adults(people, start_region="reservoir"), _LIMIT)


def specific_flows(
    setting: Setting, widths: tuple[float, ...] = WIDTHS, in_wall: bool = False
) -> dict[str, dict[str, Any]]:
    """Return, for each width, the mean flow per metre [1/(m s)] of the runs that were not stuck, all of them, and the stuck."""
    crowds = draw_crowds([door(width, in_wall=in_wall) for width in widths], setting)
    passages = Passages(crowds, 0, 0.0 if in_wall else _NECK)
    stuck = passages.watch(_LIMIT, _PATIENCE)
    found = {}
    for k, width in enumerate(widths):
        flows = {e: steady_flow(passages.times(e)) / width for e in crowds.of(k)}
        through = [flow for e, flow in flows.items() if e not in stuck]
        stuck_here = len(flows) - len(through)
        found[f"{width:g}"] = {"flow": mean_of(through), "runs": list(flows.values()), "stuck": stuck_here}
    return found


def run(setting: Setting) -> list[Row]:
    """Return the row of all widths."""
    found, in_wall = specific_flows(setting), specific_flows(setting, JUDGED, in_wall=True)
    judged = [*(found[f"{width:g}"] for width in JUDGED), *in_wall.values()]
    passed = all(LOW <= one["flow"] <= HIGH and not one["stuck"] for one in judged)
    figure = f"{_told(found, setting)}; with the exit line in the wall {_told(in_wall, setting)} /(m s)"
    return [row("doors", setting, passed, figure, widths=found, in_wall=in_wall)]


def _told(found: dict[str, dict[str, Any]], setting: Setting) -> str:
    return ", ".join(
        f"{width} m {number(one['flow'])}" + (f" ({one['stuck']} of {setting.draws} stuck)" if one["stuck"] else "")
        for width, one in found.items()
    )
