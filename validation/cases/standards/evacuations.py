"""Tests of small buildings: doors, congestion, assigned exits, an exit that closes, someone slow in a passage."""

from dataclasses import replace
from typing import Any

import numpy as np

from crowd_env import Cohorts, DoorEvent, Gate, Geometry, Population, Scenario, Uniform
from crowd_env.geometry.geometry import box
from validation.cases.case import Setting, Verdict, adults
from validation.cases.crowds import Ints, Passages, draw_crowds, mean_of, steady_flow
from validation.cases.standards.places import place

_DESIGN = 1.33  # 1/(s m)


def last_out(setting: Setting, scenarios: list[Scenario], limit: float) -> list[float]:
    """Return the mean time [s] at which the last is out of each scenario; nan if people are left inside."""
    crowds = draw_crowds(scenarios, setting)
    out = crowds.walk(limit).exit_time
    times = [float(np.max(out[crowds.people(e)])) for e in range(crowds.count)]
    return [float(np.mean([times[e] for e in crowds.of(k)])) for k in range(len(scenarios))]


def exits_taken(
    setting: Setting, building: Geometry, people: Population | Cohorts, limit: float = 120.0, **options: Any
) -> Ints:
    """Return which exit everyone takes (draws, N); the options are those of `Scenario`."""
    scenario = Scenario("exits", building, people, limit, **options)
    return draw_crowds([scenario], setting).walk(limit).exit_index.reshape(setting.draws, -1)


def flows_past(setting: Setting, scenario: Scenario, *at: float) -> list[float]:
    """Return the steady flows [1/s] past lines of constant x [m], mean over draws."""
    crowds = draw_crowds([scenario], setting)
    lines = [Passages(crowds, 0, one) for one in at]
    crowds.walk(scenario.time_limit, *lines)
    return [mean_of([steady_flow(line.times(e)) for e in range(crowds.count)]) for line in lines]


def four_doors(setting: Setting) -> Verdict:
    """RiMEA 9, IMO 9: 1000 people and four doors of 1 m, or two."""
    people = adults(1000, start_region="inside")
    scenarios = [Scenario("four doors", place(name), people, 600.0) for name in ("four-doors", "two-doors")]
    four, two = last_out(replace(setting, draws=1), scenarios, 600.0)
    figure = f"{four:.0f} s through four doors, {two:.0f} s through two: {two / four:.2f} times as long"
    return Verdict(1.6 <= two / four <= 2.4, figure, {"four": four, "two": two})


def rooms(setting: Setting) -> Verdict:
    """RiMEA 10, IMO 10, ISO 8, NIST 3.1: the people of twelve rooms take the exits that they are assigned."""
    building = place("rooms")
    cohorts = []
    for name in building.regions:
        left, _, right, _ = building.regions[name].bounds
        people, route = 1 if right - left < 2.0 else 2, "main" if left < 11.0 else "second"
        cohorts.append(adults(people, start_region=name, route=route, name=name))
    taken = exits_taken(setting, building, Cohorts(tuple(cohorts)))
    wanted = [building.exit_names.index(str(cohort.route)) for cohort in cohorts for _ in range(cohort.people)]
    right = float((taken == wanted).mean())
    return Verdict(right == 1.0, f"{100 * right:.0f} % of {len(wanted)} people took their exit", {"share": right})


def near_exit(setting: Setting) -> Verdict:
    """RiMEA 11: 1000 people in one end of a room with two exits; most take the near one, some the other."""
    building = place("near-exit")
    taken = exits_taken(replace(setting, draws=1), building, adults(1000, start_region="left"), 900.0)
    near, far = (int((taken == building.exit_names.index(name)).sum()) for name in ("near", "far"))
    return Verdict(near > far > 0, f"{near} by the near exit, {far} by the other", {"near": near, "far": far})


def beyond_necks(setting: Setting, *kinds: tuple[float, float, float]) -> tuple[list[float], list[float]]:
    """Return the steady flows [1/s] through necks, and when the last of 150 people is out [s]; means over draws.

    A kind is the length and width of a neck, and how far behind it the exit is [m].
    """
    scenarios = []
    for length, width, behind in kinds:
        ahead = 10.0 + length
        floor = [
            box(0.0, -5.0, 10.0, 5.0),
            box(9.99, -0.5 * width, ahead + 0.01, 0.5 * width),
            box(ahead, -5.0, ahead + behind, 5.0),
        ]
        exits = {"end": [(ahead + behind, -5.0), (ahead + behind, 5.0)]}
        ground = Geometry.from_polygon(floor, exits=exits, regions={"left": box(0.0, -5.0, 5.0, 5.0)})
        scenarios.append(Scenario("neck", ground, adults(150, start_region="left"), 300.0))
    crowds = draw_crowds(scenarios, setting)
    through = Passages(crowds, 0, 10.1)
    out = crowds.walk(300.0, through).exit_time
    last = [float(np.max(out[crowds.people(e)])) for e in range(crowds.count)]
    return crowds.means([steady_flow(through.times(e)) for e in range(crowds.count)]), crowds.means(last)


def goal_position(setting: Setting) -> Verdict:
    """RiMEA 12a: the nearer the goal behind a door, the sooner people are there; the door passes as many."""
    away = (1.0, 5.0, 10.0)
    flows, times = beyond_necks(setting, *((0.3, 1.0, behind) for behind in away))
    figure = ", ".join(f"{b:g} m {t:.1f} s, {f:.2f} /s" for b, t, f in zip(away, times, flows, strict=True))
    passed = bool((np.diff(times) > 0.0).all()) and flows[0] >= 0.95 * max(flows)
    return Verdict(passed, figure, {"flows": flows, "times": times})


def neck_length(setting: Setting) -> Verdict:
    """RiMEA 12b: a long neck passes fewer people than a short one."""
    flows, times = beyond_necks(setting, (0.2, 1.0, 3.0), (5.0, 1.0, 3.0))
    figure = f"{flows[0]:.2f} /s through 0.2 m, {flows[1]:.2f} /s through 5 m; {times[0]:.1f} s and {times[1]:.1f} s"
    return Verdict(flows[1] < flows[0] and times[0] < times[1], figure, {"flows": flows, "times": times})


def neck_width(setting: Setting) -> Verdict:
    """RiMEA 12d: a wider neck passes more people."""
    widths = (0.8, 1.0, 1.2)
    flows, times = beyond_necks(setting, *((0.3, width, 3.0) for width in widths))
    figure = ", ".join(f"{w:g} m {flow:.2f} /s" for w, flow in zip(widths, flows, strict=True))
    return Verdict(
        bool((np.diff(flows) > 0.0).all() and (np.diff(times) < 0.0).all()), figure, {"flows": flows, "times": times}
    )


def neck(setting: Setting) -> Verdict:
    """RiMEA 12c: of two necks of 1 m one after the other the first alone holds people up."""
    crowds = draw_crowds([Scenario("neck", place("neck"), adults(150, start_region="left"), 300.0)], setting)
    lines = [Passages(crowds, 0, at) for at in (15.0, 25.3)]
    waiting = []
    for before, now in crowds.moments(300.0):
        for line in lines:
            line.see(before, now)
        x, near = now.position[:, 0], now.active & (np.abs(now.position[:, 1]) < 1.0)
        waiting.append([float(np.sum(near & (x >= at - 2.0) & (x < at))) for at in (10.0, 25.0)])
    peaks = np.max(waiting, axis=0) / (4.0 * setting.draws)
    through, out = (mean_of([steady_flow(line.times(e)) for e in range(crowds.count)]) for line in lines)
    figure = (
        f"{through:.2f} /s through the first neck, {out:.2f} /s through the second; at most {peaks[0]:.1f} /m2 before the "
        f"first, {peaks[1]:.1f} /m2 before the second"
    )
    passed = bool(out <= through + 0.05 and peaks[1] < 0.5 * peaks[0])
    return Verdict(passed, figure, {"first": through, "second": out, "peaks": peaks})


def turned_corner(setting: Setting) -> Verdict:
    """RiMEA 15: 500 people turn a corner 20 m wide, sooner than along its outer side, later than along its inner one.

    From the front of the people it is 34 m to the corner and 10 m on: 44 m inside, 75.4 m along the outer quarter of a circle.
    """
    outer = 44.0 + 10.0 * np.pi
    inner, long = ({"end": [(length, 0.0), (length, 20.0)]} for length in (44.0, outer))
    grounds = (
        (box(-6.0, 0.0, 44.0, 20.0), inner),
        ([box(-6.0, 0.0, 54.0, 20.0), box(34.0, -10.0, 54.0, 0.01)], {"end": [(54.0, -10.0), (34.0, -10.0)]}),
        (box(-6.0, 0.0, outer, 20.0), long),
    )
    start = {"start": box(-6.0, 0.0, 0.0, 20.0)}
    people = adults(500, start_region="start")
    scenarios = [
        Scenario("corner", Geometry.from_polygon(floor, exits=exits, regions=start), people, 300.0)
        for floor, exits in grounds
    ]
    short, turned, far = last_out(replace(setting, draws=1), scenarios, 300.0)
    figure = f"{short:.1f} s over 44 m, {turned:.1f} s around the corner, {far:.1f} s over {outer:.1f} m"
    return Verdict(short < turned < far, figure, {"times": [short, turned, far]})


def exit_flow(setting: Setting) -> Verdict:
    """IMO 4, ISO 11, NIST 5.2: 100 people and an exit of 1 m; a gate lets through as many as it is given."""
    people = adults(100, start_region="room")
    (flow,) = flows_past(setting, Scenario("exit", place("exit"), people, 240.0), 8.3)
    crowds = draw_crowds([Scenario("gate", place("gated"), people, 240.0, gates=(Gate("door", _DESIGN),))], setting)
    out = crowds.walk(240.0).exit_time
    held = mean_of([steady_flow(np.sort(out[crowds.people(e)])) for e in range(crowds.count)])
    figure = f"{flow:.2f} /(m s), people in experiments 1.6 to 2.8; {held:.2f} with a gate of {_DESIGN} /s"
    return Verdict(flow <= _DESIGN, figure, {"flow": flow, "held": held})


def closing_exit(setting: Setting) -> Verdict:
    """ISO 9, NIST 4.1: an exit closes after 1 s, and everyone takes the other."""
    building, closes = place("two-exits"), (DoorEvent("door", False, at=1.0),)
    taken = exits_taken(setting, building, adults(20, start_region="left"), door_events=closes)
    share = float((taken == building.exit_names.index("second")).mean())
    return Verdict(share == 1.0, f"{100 * share:.0f} % left by the exit that stayed open", {"share": share})


def slow_person(setting: Setting) -> Verdict:
    """ISO 7, NIST 2.10: someone slow and large in a passage of 1.5 m holds 24 others up."""
    others = adults(24, start_region="back", name="others")
    times = []
    for speed, radius in ((0.4, 0.35), (1.34, 0.17)):
        special = {"desired_speed": Uniform(speed, speed), "radius": Uniform(radius, radius)}
        people = Cohorts((others, adults(1, start_region="front", name="one", **special)))
        crowds = draw_crowds([Scenario("passage", place("passage"), people, 120.0)], setting)
        out = crowds.walk(120.0).exit_time.reshape(setting.draws, 25)[:, :24]
        times.append(float(out.max(axis=1).mean()))
    slow, usual = times
    figure = f"the 24 others are out after {slow:.1f} s, after {usual:.1f} s with an adult in place of the slow person"
    return Verdict(slow > usual, figure, {"slow": slow, "usual": usual})
