"""Doors: how many people a second pass one, for widths from 0.5 to 5 m."""

from typing import Any

from crowd_env import Geometry, Scenario
from crowd_env.geometry.geometry import box
from validation.cases.case import Row, Setting, adults, number, row
from validation.cases.crowds import Passages, draw_crowds, mean_of, steady_flow

SOURCE = (
    "Kretz, Grünebohm, Schreckenberg 2006 (J. Stat. Mech. P10014); Seyfried et al. 2009 (Transp. Sci. 43:395); Müller 1981; "
    "Nagai 2006; Daamen, Hoogendoorn 2010; Hermes 2009"
)
CRITERION = "J/b from 1.6 to 2.8 /(m s) for doors of 0.8 to 2.4 m, and nobody stuck"
LOW, HIGH, MEAN = 1.6, 2.8, 2.12  # 1/(m s): 79 published points lie from 1.61 to 2.77, and their mean

WIDTHS = (0.5, 0.8, 1.0, 1.2, 1.6, 2.0, 2.4, 5.0)  # m
JUDGED = (0.8, 1.0, 1.2, 1.6, 2.0, 2.4)

# Published flows J [1/s] at doors of width b [m], as compiled by the test suite of JuPedSim; several values = several runs.
PUBLISHED: dict[str, tuple[tuple[float, float], ...]] = {
    "Kretz 2006": (
        *(
            (0.4, 0.879),
            (0.4, 0.899),
            (0.5, 1.007),
            (0.5, 1.036),
            (0.6, 1.124),
            (0.7, 1.222),
            (0.7, 1.251),
            (0.8, 1.388),
        ),
        *(
            (0.8, 1.417),
            (0.8, 1.456),
            (0.9, 1.534),
            (0.9, 1.583),
            (0.9, 1.632),
            (1.0, 1.710),
            (1.0, 1.808),
            (1.0, 1.876),
        ),
        *((1.0, 2.023), (1.2, 2.033), (1.2, 2.111), (1.2, 2.287)),
    ),
    "Seyfried 2009": ((0.8, 1.288), (0.9, 1.674), (1.0, 1.900), (1.1, 2.123), (1.2, 2.364)),
    "Jülich 2006": (
        *(
            (0.9, 1.593),
            (1.0, 1.832),
            (1.1, 1.988),
            (1.2, 2.312),
            (1.4, 2.706),
            (1.6, 2.842),
            (1.8, 3.551),
            (2.0, 3.549),
        ),
        *((2.2, 4.063), (2.5, 5.116)),
    ),
    "Müller 1981": ((0.6, 1.482), (0.9, 2.264), (1.2, 2.751), (1.5, 3.574), (1.8, 3.817)),
    "Nagai 2006": ((0.8, 1.737), (1.2, 2.582), (1.6, 3.257), (2.0, 3.874)),
    "Daamen 2010": (
        *((0.50, 1.057), (0.50, 1.114), (0.85, 2.281), (0.85, 2.329), (0.85, 2.346), (0.85, 2.353), (1.00, 2.535)),
        *((1.00, 2.559), (1.00, 2.731), (1.00, 2.774), (1.10, 2.466), (1.10, 2.492), (1.10, 2.598), (1.10, 2.617)),
        *((1.65, 3.585), (1.65, 3.662), (1.65, 3.672), (1.65, 3.711), (1.65, 3.772), (1.65, 3.895), (2.75, 5.679)),
        *((2.75, 5.743), (2.75, 5.776), (2.75, 5.878), (2.75, 6.034), (2.75, 6.163), (2.75, 6.222), (2.75, 6.276)),
        *((2.75, 6.448), (2.75, 6.465)),
    ),
    "Hermes 2009": ((2.4, 5.803), (3.0, 6.700), (3.6, 8.435), (4.4, 9.534), (5.0, 11.576)),
}

_PER_METER = 150  # people; 115 make the flow of a whole run that of its steady part (Liao et al. 2015)
_DENSITY = 3.0  # 1/m2, in front of the door at the start
_HALF, _NECK, _BEYOND = (
    4.0,
    0.3,
    3.0,
)  # m: half the width of the reservoir, length of the neck, and of the free space behind
_PATIENCE = 20.0  # s without a passage: stuck
_LIMIT = 400.0  # s


def door(width: float, people: int | None = None) -> Scenario:
    """Return people in front of a neck of ``width`` [m] in a wall, behind which 3 m are free up to the exit line."""
    people = round(_PER_METER * width) if people is None else people
    back = -0.5 - people / (_DENSITY * 2.0 * _HALF)
    end = _NECK + _BEYOND
    floor = [
        box(back, -_HALF, 0.0, _HALF),
        box(-0.1, -0.5 * width, _NECK + 0.1, 0.5 * width),
        box(_NECK, -_HALF, end, _HALF),
    ]
    place = Geometry.from_polygon(
        floor, exits={"out": [(end, -_HALF), (end, _HALF)]}, regions={"reservoir": box(back, -_HALF, -0.5, _HALF)}
    )
    return Scenario(f"door-{width:g}", place, adults(people, start_region="reservoir"), _LIMIT)


def specific_flows(setting: Setting, widths: tuple[float, ...] = WIDTHS) -> dict[str, dict[str, Any]]:
    """Return, for each width, the mean flow per metre [1/(m s)] of the runs that were not stuck, all of them, and the stuck."""
    crowds = draw_crowds([door(width) for width in widths], setting)
    passages, stuck = Passages(crowds, 0, _NECK), set()
    for before, now in crowds.moments(_LIMIT):
        passages.see(before, now)
        stuck |= set(passages.stop_the_stuck(now, _PATIENCE))
    found = {}
    for k, width in enumerate(widths):
        flows = {e: steady_flow(passages.times(e)) / width for e in crowds.of(k)}
        through = [flow for e, flow in flows.items() if e not in stuck]
        found[f"{width:g}"] = {
            "flow": mean_of(through),
            "runs": list(flows.values()),
            "stuck": len(flows) - len(through),
        }
    return found


def run(setting: Setting) -> list[Row]:
    """Return the row of all widths."""
    found = specific_flows(setting)
    judged = [found[f"{width:g}"] for width in JUDGED]
    passed = all(LOW <= one["flow"] <= HIGH and not one["stuck"] for one in judged)
    figure = ", ".join(
        f"{width} m {number(one['flow'])}" + (f" ({one['stuck']} of {setting.draws} stuck)" if one["stuck"] else "")
        for width, one in found.items()
    )
    return [row("doors", setting, passed, f"{figure} /(m s)", CRITERION, SOURCE, widths=found)]
