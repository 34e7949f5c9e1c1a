"""What must hold of every crowd, however it is tuned: laws in which one draw is enough.  They run with the tests.

Pass marks of experiments lie close to what is simulated, and one draw falls on either side of them; these do not.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from crowd_env.core.behaviors.headway import Headway
from crowd_env.core.behaviors.outline import Outline
from validation.cases import corner, counterflow, doors, ring, row
from validation.cases.case import Row, Setting, number
from validation.cases.case import row as row_of

Holds = tuple[bool, str]

WIDTHS = (0.8, 1.2, 2.0)  # m
FASTER = 1.2  # times as many pass a door if they press on
_RANK = -0.9


def speed_falls_in_single_file(setting: Setting) -> Holds:
    """Whether people around a ring are the slower, the more they are."""
    found = ring.speeds(setting)
    rank = corner.rank_correlation(np.array(list(found)), np.array(list(found.values())))
    speeds = ", ".join(number(speed) for speed in found.values())
    return rank <= _RANK, f"{speeds} m/s from {min(found):g} to {max(found):g} /m"


def speed_falls_at_a_corner(setting: Setting) -> Holds:
    """Whether people who turn a corner are slower in a crowd, and no run gets stuck."""
    runs = (corner.RUNS[0], corner.RUNS[3], corner.RUNS[-1])
    found = corner.measure(setting, runs)
    found.sort(key=lambda one: one["density"])
    speeds = [one["speed"] for one in found]
    figure = ", ".join(f"{number(one['density'])} /m2 {number(one['speed'])} m/s" for one in found)
    return bool(np.all(np.diff(speeds) < 0.0) and not any(one["stuck"] for one in found)), figure


def wider_doors_pass_more(setting: Setting) -> Holds:
    """Whether the flow grows with the width of the door, and no run gets stuck."""
    found = doors.specific_flows(setting, WIDTHS)
    flows = [width * found[f"{width:g}"]["flow"] for width in WIDTHS]
    stuck = sum(one["stuck"] for one in found.values())
    figure = ", ".join(f"{width:g} m {number(flow)}" for width, flow in zip(WIDTHS, flows, strict=True))
    return bool(np.all(np.diff(flows) > 0.0)) and not stuck, f"{figure} /s; {stuck} stuck"


def pressing_on_is_faster(setting: Setting) -> Holds:
    """Whether people who keep a distance pass a door more slowly than those who press on with all their might."""
    keeping, pressing = (
        doors.specific_flows(replace(setting, manner=manner), (1.2,))["1.2"]["flow"]
        for manner in (setting.manner, "competitive")
    )
    return pressing > FASTER * keeping, f"{number(keeping)} /(m s), pressing on {number(pressing)}"


def oncoming_people_slow_down(setting: Setting) -> Holds:
    """Whether two streams pass each other, and more slowly than one stream of as many people walks."""
    (found,) = counterflow.run(setting)
    one, both = found.more["one_way"], found.more["both_ways"]
    return not found.more["gridlocked"] and both is not None and both < one, found.figure


def pushes_travel(setting: Setting) -> Holds:
    """Whether a push goes through a row of people, and the further and faster, the stronger it is."""
    return row.pushes(setting)[:2]


LAWS: dict[str, tuple[Callable[[Setting], Holds], str]] = {
    "single file": (speed_falls_in_single_file, f"rank correlation of speed and line density at most {_RANK:g}"),
    "corner": (speed_falls_at_a_corner, "the denser, the slower, in three runs; nobody stuck"),
    "door": (wider_doors_pass_more, "the wider, the more pass; nobody stuck"),
    "press": (pressing_on_is_faster, f"people who press on pass a door more than {FASTER:g} times as fast"),
    "two streams": (oncoming_people_slow_down, "no gridlock, and slower than one way"),
    "push": (pushes_travel, "the stronger, the further and faster through a row"),
}


def run(setting: Setting) -> Iterator[Row]:
    """Yield a row a law; people who press on are not held against themselves, and the row that is pushed is of discs."""
    for name, (law, criterion) in LAWS.items():
        if law is pressing_on_is_faster and Headway.of(setting.manner) is None:
            continue
        if law is pushes_travel and Outline.of(setting.outline) is not None:
            continue
        setting.notify(f"{setting.scheme}, {setting.manner}: {name}")
        holds, figure = law(setting)
        yield row_of(name, setting, holds, figure, criterion, f"law: {name}")
