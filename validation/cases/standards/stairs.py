"""Tests of stairs, each a slope between two levels: speed, speed by density, flow by width, the jam at the foot."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np

from crowd_env import Cohorts, Geometry, Route, Scenario, Uniform
from crowd_env.geometry.geometry import box
from crowd_env.scenarios.buildings import Level, Stair, building
from validation.cases.case import Setting, Verdict, adults
from validation.cases.crowds import EVERY, Bools, Crowds, Floats, Moment, Passages, draw_crowds, mean_of, steady_flow
from validation.cases.standards.evacuations import flows_past, last_out
from validation.cases.standards.groups import Given

RISER, TREAD = 0.18, 0.28054  # m; three steps are 1 m along the slope
_SLOPE = float(np.hypot(RISER, TREAD))  # m
# m/s, Fruin 1971 as in the RiMEA guideline: people up to 50 years, means of both kinds of stairs
_UP, _DOWN = 0.5525, 0.75
_SPEEDS = (*np.repeat([1.34, 1.30, 1.24, 1.20, 1.14, 1.10], 15).tolist(), *[0.96] * 10)  # m/s, of RiMEA 13
_WIDTHS = (1.0, 1.2, 1.4, 1.6, 1.8)  # m
_DENSE = (0.6, 1.5)  # 1/m2, between which the band of Corbetta is given

# Speeds of slow people and of quick ones, each with how far they spread: polynomials of density, highest power first.
_BANDS = {
    "up": (((0.01, 0.48), (-0.02, 0.10)), ((0.18, -0.55, 1.02), (-0.14, 0.35))),
    "down": (((-0.08, 0.67), (-0.06, 0.14)), ((0.33, -1.02, 1.39), (-0.11, 0.29))),
}

Box: TypeAlias = tuple[float, float, float, float]  # left, bottom, right, top [m]
_MIDDLE, _AREA = (1.0, -1.0, 4.0, 1.0), 6.0  # m and m2, where speed and density are measured


def with_stair(
    near: Sequence[Box], steps: int, beyond: float, width: float = 2.0, *, climbs: bool = True, **stair: Any
) -> Geometry:
    """Return floor, a stair from x = 0 on, and ``beyond`` [m] of floor behind it, at the end of which people are out.

    They start in the first of the boxes ``near``, and climb or descend the stair; its other options are those of a `Stair`.
    """
    run, rise = steps * TREAD, steps * RISER
    here, there = ("below", "above") if climbs else ("above", "below")
    height = {"below": 0.0, "above": rise}
    half, end = 0.5 * width, run + beyond
    levels = [
        Level(here, height[here], [box(*each) for each in near], regions={"start": box(*near[0])}),
        Level(there, height[there], box(run, -half, end, half), exits={"out": [(end, -half), (end, half)]}),
    ]
    foot, direction = ((0.0, 0.0), 0.0) if climbs else ((run, 0.0), 180.0)
    return building(levels, [Stair("stair", "below", "above", foot, direction, width, RISER, TREAD, **stair)])


def speeds(setting: Setting) -> Verdict:
    """RiMEA 2 and 3, ISO 3, NIST 2.2, IMO 2 and 3: one person walks 10 m and 100 m along the slope, up and down."""
    found, off = [], []
    for steps, way, free, wanted in (
        (30, "up", 1.34, _UP),
        (30, "down", 1.34, _DOWN),
        (300, "up", 1.0, 1.0),
        (300, "down", 1.0, 1.0),
    ):
        place = with_stair([(-2.0, -1.0, 0.0, 1.0)], steps, 2.0, climbs=way == "up", **{way: wanted / free})
        person = adults(1, desired_speed=Uniform(free, free), start_region="start")
        crowds = draw_crowds([Scenario("stair", place, person, 240.0)], setting)
        lines = [Passages(crowds, 0, at) for at in (0.0, steps * TREAD)]
        crowds.walk(240.0, *lines)
        took, length = mean_of(lines[1].time - lines[0].time), steps * _SLOPE
        off.append(length / took / wanted - 1.0)
        found.append(f"{length:.0f} m {way} at {wanted:.2f} m/s in {took:.1f} s ({100.0 * off[-1]:+.1f} %)")
    return Verdict(max(map(abs, off)) <= 0.05, ", ".join(found), {"off": off})


def inside(area: Box, moment: Moment) -> Bools:
    """Return which people (P,) are in a box of true coordinates."""
    (x, y), (left, bottom, right, top) = moment.position.T, area
    return moment.active & (x >= left) & (x < right) & (y >= bottom) & (y < top)


def by_crowd(crowds: Crowds, values: Floats | Bools) -> Floats:
    """Return the sums of values (P,) over the people of each crowd."""
    return np.add.reduceat(np.asarray(values, dtype=np.float64), crowds.simulation.bodies.env_start[:-1])


def band(density: Floats, way: str) -> tuple[Floats, Floats]:
    """Return between which speeds [m/s] people walk on stairs by density [1/m2], as tracked from above.

    Source: Corbetta et al., Eindhoven station, as fitted in a public port of RiMEA 13.
    """
    slow, fast = ((np.polyval(mean, density), np.polyval(wide, density)) for mean, wide in _BANDS[way])
    return slow[0] - slow[1], fast[0] + np.maximum(fast[1], 0.0)


def diagram(setting: Setting) -> Verdict:
    """RiMEA 13: speed by density in the middle of a stair, seen from above, of 100 people on the way up or down."""
    people = adults(100, desired_speed=Given(_SPEEDS), start_region="start")
    shares, means, counts = [], [], []
    for way, speed in (("up", _UP), ("down", _DOWN)):
        room = [(-12.0, -5.0, -2.0, 5.0), (-2.1, -1.0, 0.0, 1.0)]
        place = with_stair(room, 18, 4.0, climbs=way == "up", **{way: speed / float(np.mean(_SPEEDS))})
        crowds = draw_crowds([Scenario("stair", place, people, 180.0)], setting)
        points = []
        for before, now in crowds.moments(180.0):
            there = inside(_MIDDLE, now)
            ahead = (now.position - before.position)[:, 0] / (now.time - before.time)
            many = by_crowd(crowds, there)
            seen = many > 0.0
            points.append(np.array([many[seen] / _AREA, by_crowd(crowds, there * ahead)[seen] / many[seen]]))
        density, walked = np.concatenate(points, axis=1)
        judged = (density >= _DENSE[0]) & (density <= _DENSE[1])
        low, high = band(density[judged], way)
        shares.append(float(np.mean((walked[judged] >= low) & (walked[judged] <= high))))
        means.append(float(walked[judged].mean()))
        counts.append(int(judged.sum()))
    figure = " and ".join(
        f"{100.0 * share:.0f} % of the points on the way {way} in the band, mean {mean:.2f} m/s"
        for way, share, mean in zip(_BANDS, shares, means, strict=True)
    )
    passed = min(shares) >= 0.5 and means[1] > means[0]
    return Verdict(passed, figure, {"shares": shares, "speeds": means, "points": counts})


def congestion(setting: Setting) -> Verdict:
    """IMO 11, NIST 5.1, ISO 10: people jam where they leave a room for a corridor of 2 m, and at the foot of a stair behind it.

    While they come, from 20 % to 90 % of them, the jam at the foot grows, since the stair passes fewer.  IMO has 150 people and
    a corridor of 12 m.  ISO has 100, 9 m and half of the speed on the stair, and compares the densest moments.
    """
    jam, flows, _ = _jam(setting, 150, 12.0, 11, 1.0)
    early, late = jam[: len(jam) // 2].mean(axis=0), jam[len(jam) // 2 :].mean(axis=0)
    grows = late[2] > 1.1 * early[2] and min(early[0], late[0]) > max(early[1], late[1]) and flows[1] < 0.95 * flows[0]
    *_, peaks = _jam(setting, 100, 9.0, 21, 2.0, up=0.5)
    figure = (
        f"{flows[0]:.2f} /s in the corridor, {flows[1]:.2f} /s on the stair; at its foot {early[2]:.1f}, then {late[2]:.1f} "
        f"/m2, before the corridor {late[0]:.1f}, in it {late[1]:.1f}; at half of the speed at most {peaks[2]:.1f}, "
        f"{peaks[0]:.1f}, {peaks[1]:.1f} /m2"
    )
    more = {"early": early, "late": late, "flows": flows, "peaks": peaks}
    return Verdict(bool(grows and peaks[1] < min(peaks[0], peaks[2])), figure, more)


def _jam(
    setting: Setting, people: int, length: float, steps: int, beyond: float, **stair: Any
) -> tuple[Floats, list[float], Floats]:
    """Return the densities (T, 3) [1/m2] at the room's exit, in the corridor and at the foot while people come, and more.

    These are the flows [1/s] in the corridor and above the stair, and the greatest densities (3,) of a second in all the run.
    """
    near = [(-length - 8.0, -2.5, -length, 2.5), (-length - 0.1, -1.0, 0.0, 1.0)]
    crowd = adults(people, start_region="start")
    crowds = draw_crowds([Scenario("stair", with_stair(near, steps, beyond, **stair), crowd, 240.0)], setting)
    lines = [Passages(crowds, 0, at) for at in (1.0 - length, steps * TREAD)]
    middle, found = -0.5 * length, []
    for before, now in crowds.moments(240.0):
        for line in lines:
            line.see(before, now)
        edges = ((-length - 0.5, -length + 0.5), (middle - 0.5, middle + 0.5), (-1.0, 0.0))
        found.append([by_crowd(crowds, inside((left, -1.0, right, 1.0), now)).mean() / 2.0 for left, right in edges])
    flows = [mean_of([steady_flow(line.times(e)) for e in range(crowds.count)]) for line in lines]
    passing = [mean_of([lines[0].times(e)[round(share * people)] for e in range(crowds.count)]) for share in (0.2, 0.9)]
    density, second = np.array(found), round(1.0 / EVERY)
    peaks = np.lib.stride_tricks.sliding_window_view(density, second, axis=0).mean(axis=-1).max(axis=0)
    return density[slice(*(round(time / EVERY) for time in passing))], flows, peaks


def flow_by_width(setting: Setting) -> Verdict:
    """ISO 12: 100 people leave a room by stairs of 1.0 to 1.8 m, at half of their speed."""
    people = adults(100, start_region="start")
    flows = []
    for width in _WIDTHS:
        place = with_stair([(-10.0, -4.0, 0.0, 4.0)], 21, 2.0, width, up=0.5)
        (flow,) = flows_past(setting, Scenario("stair", place, people, 240.0), 21 * TREAD)
        flows.append(flow)
    slope = float(np.polyfit(_WIDTHS, flows, 1)[0])
    figure = ", ".join(f"{w:g} m {flow:.2f} /s" for w, flow in zip(_WIDTHS, flows, strict=True))
    return Verdict(bool((np.diff(flows) > 0.0).all()), f"{figure}; {slope:.2f} /(m s)", {"flows": flows})


def lower_floor(setting: Setting) -> Verdict:
    """RiMEA 14: start and exit are on the upper floor, the short way leads over the lower one, the long one does not.

    Which one people take is written down: by default, and sent by the corridor.
    """
    floor = [box(0, 0, 5, 20), box(4.9, 15, 25.1, 20), box(25, 0, 30, 20)]
    regions = {"start": box(0.0, 0.0, 5.0, 8.0), "corridor": box(14.0, 15.0, 16.0, 20.0)}
    levels = [
        Level("upper", 5.0, floor, exits={"out": [(27.0, 0.0), (29.0, 0.0)]}, regions=regions),
        Level("lower", 0.0, box(10, 3, 20, 7)),
    ]
    flights = [
        Stair(name, "lower", "upper", foot, angle, 2.0, 0.25, 0.25)
        for name, foot, angle in (("down", (10.0, 5.0), 180.0), ("up", (20.0, 5.0), 0.0))
    ]
    people = tuple(adults(20, start_region="start", route=route) for route in (None, "long"))
    scenario = Scenario(
        "floors", building(levels, flights), Cohorts(people), 240.0, routes=(Route("long", via="corridor"),)
    )
    crowds = draw_crowds([scenario], setting)
    below = np.zeros(len(crowds.simulation.state.active), dtype=bool)
    for _, now in crowds.moments(240.0):
        below |= inside((10.0, 3.0, 20.0, 7.0), now)
    short, sent = below.reshape(setting.draws, 2, 20).mean(axis=(0, 2)).tolist()
    left = int(crowds.simulation.state.active.sum())
    figure = (
        f"{100 * short:.0f} % take the short way, {100 * sent:.0f} % if the corridor is their route; {left} left inside"
    )
    return Verdict(left == 0 and (short, sent) == (1.0, 0.0), figure, {"short": short, "sent": sent})


def three_storeys(setting: Setting) -> Verdict:
    """RiMEA 8: 448 people of 112 rooms on three storeys; the effect of one parameter at a time is written down."""
    place, starts = _storeys()
    kinds: dict[str, dict[str, Any]] = {
        "as adults are": {},
        "all 1.34 m/s": {"desired_speed": Uniform(1.34, 1.34)},
        "all 1.0 m/s": {"desired_speed": Uniform(1.0, 1.0)},
        "response 30 s": {"response_time": Uniform(30.0, 30.0)},
        "response 0 to 60 s": {"response_time": Uniform(0.0, 60.0)},
    }
    scenarios = [
        Scenario("storeys", place, adults(len(starts), starts=starts, **kind), 600.0) for kind in kinds.values()
    ]
    times = last_out(replace(setting, draws=1), scenarios, 600.0)
    figure = ", ".join(f"{kind}: {time:.0f} s" for kind, time in zip(kinds, times, strict=True))
    return Verdict(bool(np.isfinite(times).all()), figure, dict(zip(kinds, times, strict=True)))


def _storeys() -> tuple[Geometry, Floats]:
    """Return the building of RiMEA 8, and where its people stand (448, 2) [m] in the layout.

    22 m x 14 m: rows of rooms of 2 m x 3 m on two corridors of 1 m, with doors of 1 m; around the stair a hall of 6 m x 6 m.
    That the hall is open to the corridors, on the ground floor to one of them by a door of 2 m, is our reading of the figure.
    """
    levels, spots = [], []
    for storey, name in enumerate(("ground", "first", "second")):
        top = (
            9 if storey == 0 else 11
        )  # rooms of the last row; on the ground floor the hall before the exit has the others
        rows = ((0.0, 3.0, 11), (7.0, 4.0, 8), (7.0, 10.0, 8), (14.0, 11.0, top))  # back wall, wall with doors, rooms
        walls = [[(0.0, 7.0), (16.0, 7.0)], [(16.0, 4.0), (16.0, 10.0)]]
        for back, front, count in rows:
            walls += [[(2.0 * k, back), (2.0 * k, front)] for k in range(1, count + (count < 11))]
            gaps = [0.0, *(x for k in range(count) for x in (2.0 * k + 0.5, 2.0 * k + 1.5)), 2.0 * count]
            walls += [[(a, front), (b, front)] for a, b in zip(gaps[::2], gaps[1::2], strict=True)]
            middle = 0.5 * (back + front)
            spots += [
                (storey, (2.0 * k + x, middle + y)) for k in range(count) for x in (0.5, 1.5) for y in (-0.7, 0.7)
            ]
        if storey == 0:
            walls.append([(16.0, 10.0), (20.0, 10.0)])
        out = {"out": [(19.0, 14.0), (21.0, 14.0)]} if storey == 0 else {}
        levels.append(Level(name, 4.0 * storey, box(0.0, 0.0, 22.0, 14.0), thin_walls=walls, exits=out))
    stairs = [
        Stair(f"to {upper.name}", lower.name, upper.name, (20.0, 5.0), 180.0, 2.0, 0.25, 0.25, "u-right", core=0.0)
        for lower, upper in pairwise(levels)
    ]
    place = building(levels, stairs)
    sheet, at = zip(*spots, strict=True)
    return place, place.laid_out(np.array(at), np.array(sheet))
