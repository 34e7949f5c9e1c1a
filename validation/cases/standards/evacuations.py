"""Tests of small buildings: doors, congestion, assigned exits, an exit that closes, someone slow in a passage."""

from dataclasses import replace
from typing import Any

import numpy as np

from crowd_env import Cohorts, DoorEvent, Geometry, Population, Scenario, Uniform
from validation.cases.case import Setting, Verdict, adults
from validation.cases.crowds import Ints, Passages, draw_crowds, mean_of, steady_flow
from validation.cases.standards.places import place


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


def neck(setting: Setting) -> Verdict:
    """RiMEA 12: a neck of 1 m between two rooms holds people up, the exit of 1 m behind it does not."""
    scenario = Scenario("neck", place("neck"), adults(150, start_region="left"), 300.0)
    through, out = flows_past(setting, scenario, 15.0, 25.3)
    figure = f"{through:.2f} /s through the neck, {out:.2f} /s through the exit"
    return Verdict(bool(out <= through + 0.05), figure, {"neck": through, "exit": out})


def exit_flow(setting: Setting) -> Verdict:
    """IMO 4, ISO 11, NIST 5.2: 100 people and an exit of 1 m; 1.33 /(m s) is a value of design, which people exceed."""
    scenario = Scenario("exit", place("exit"), adults(100, start_region="room"), 240.0)
    (flow,) = flows_past(setting, scenario, 8.3)
    return Verdict(None, f"{flow:.2f} /(m s); people in experiments: 1.6 to 2.8", {"flow": flow})


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
