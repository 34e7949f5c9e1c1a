"""Faster is slower: 200 people in a room of 15 x 15 m, by the speed that they want.

Room, people and contact are those of Helbing, Farkas, Vicsek, Nature 407 (2000) 487: diameters of 0.5 to 0.7 m, 80 kg,
relaxation in 0.5 s, and a door of 1 m in a wall without thickness.  They walk straight to the nearest point of the door that
keeps the body off the jambs, and are out at its line.  On the shortest path for the largest body all of them aim at the middle:
then the last two stop each other at 1 m/s and below.

The same is asked of `helbing` without friction, of `nsm2` with the most tangential dissipation that turns no slip round, and of
`hertz`, with the first draws.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from math import comb
from typing import Any, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import COUNT, POSITIVE, Range
from crowd_env.envs.crowd import CrowdEnv, Step
from crowd_env.envs.rollout import Episode
from crowd_env.physics import NSM2, SCHEMES, ContactScheme, Helbing
from crowd_env.physics.pressure import contact_pressure
from crowd_env.rendering.canvas import new_figure, quiet_axes, series
from crowd_env.rendering.libraries import Axes, Figure
from crowd_env.reproduce.evacuations import Case
from crowd_env.reproduce.paper import Settings, option
from crowd_env.reproduce.result import RawTable, Result, Row, mean_row
from crowd_env.scenarios import make_scenario
from crowd_env.scenarios.cohorts import extreme_bodies
from crowd_env.scenarios.distributions import Uniform
from crowd_env.scenarios.population import Population
from crowd_env.scenarios.scenario import Scenario

SPEEDS = (0.8, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0)  # m/s
PRINTED = {1.5: "150", 5.0: "200"}  # m/s -> s: "around", as Lin, Ma, Lo quote the paper for 200 people
INJURED = 1600.0  # N/m, of the radial forces on a person over the circumference
_MASS = 80.0  # kg
_OTHERS = 5  # draws of the other schemes


class Law(NamedTuple):
    """A contact law that is asked."""

    scheme: ContactScheme
    is_helbing: bool  # with all draws, the step of the settings, and pressures


# K_T of two people of 80 kg is 2 m_e = 80 kg where the slip just stops.
LAWS = {
    "helbing": Law(Helbing(), True),
    "helbing, no friction": Law(Helbing(friction=0.0), True),
    "nsm2, K_T = 80 kg": Law(NSM2(tangential_dissipation=_MASS), False),
    "hertz": Law(SCHEMES["hertz"], False),
}


@dataclass(frozen=True)
class HelbingSettings(Settings):
    """Options of the figure."""

    runs: int = option(20, f"Draws of each point; the first {_OTHERS} of nsm2 and hertz", COUNT)
    dt: float = option(Helbing().info.default_dt, "Time step of helbing, s", POSITIVE)
    door_width: float = option(1.0, "Width of the door, m", Range(0.7, 3.0))
    people: int = option(200, "Number of people", COUNT)


class Crush:
    """Keeps the highest contact pressure [N/m] on each person, at the decisions: normal forces over the circumference."""

    def begin(self, env: CrowdEnv, runs: Sequence[int]) -> None:
        """Start from no pressure."""
        self._most: Floats = np.zeros(len(env.simulation.bodies.radius))

    def add(self, env: CrowdEnv, step: Step) -> None:
        """Look at the contacts of the last step of physics."""
        simulation = env.simulation
        for e in range(env.num_envs):
            people, contacts = env.people(e), simulation.contacts(e)
            normal, pairs = contacts.impulse[:, 0], contacts.j >= 0
            force = np.zeros(people.stop - people.start)
            np.add.at(force, contacts.i, normal)
            np.add.at(force, contacts.j[pairs], normal[pairs])
            pressure = contact_pressure(force, simulation.dt, simulation.bodies.radius[people])
            self._most[people] = np.maximum(self._most[people], pressure)

    def record(self, env: CrowdEnv, e: int) -> list[float]:
        """Return the highest pressure on each person."""
        return [round(float(one), 1) for one in self._most[env.people(e)]]


def place(settings: HelbingSettings, speed: float) -> Scenario:
    """Return the room, with people that want the same ``speed`` [m/s]."""
    people = Population(
        settings.people, Uniform(0.25, 0.35), Uniform(_MASS, _MASS),
        desired_speed=Uniform(speed, speed), relaxation_time=Uniform(0.5, 0.5),
    )  # fmt: skip
    return make_scenario("lin-room-v0", door_width=settings.door_width, population=people, target="nearest")


def cases(settings: HelbingSettings) -> dict[tuple[str, float], Case]:
    """Return the draws under each law at each speed."""
    made = {}
    for name, (scheme, is_helbing) in LAWS.items():
        for speed in SPEEDS:
            where = place(settings, speed)
            dt = settings.dt if is_helbing else scheme.default_dt(extreme_bodies(where.population))
            seeds = settings.seeds if is_helbing else settings.seeds[:_OTHERS]
            label = f"faster-{scheme.info.name}-{speed:g}-mps"
            made[name, speed] = Case(label, where, scheme, seeds, dt, recorder=Crush() if is_helbing else None)
    return made


def leaving_times(episodes: Sequence[Episode]) -> Floats:
    """Return when the last person was out in each draw (R,) [s]; infinite where the door blocked for good."""
    return np.array([np.inf if one.metrics.unfinished else one.metrics.evacuation_time for one in episodes])


def median_of(times: Floats) -> tuple[float, tuple[float, float] | None]:
    """Return the median (R,) and its interval of 95 %, by the binomial law of ranks; None if the draws are too few."""
    draws, ordered = len(times), np.sort(times)
    # The chance that at most k draws lie below the median of all; as many k as have one of at most 2.5 % are cut off.
    chances = (ways / 2**draws for ways in accumulate(comb(draws, k) for k in range(draws)))
    cut = sum(chance <= 0.025 for chance in chances)
    known = cut > 0 and bool(np.isfinite(ordered[draws - cut]))
    return float(np.median(times)), (float(ordered[cut - 1]), float(ordered[draws - cut])) if known else None


def reproduce(settings: HelbingSettings, runs: Mapping[tuple[str, float], Sequence[Episode]]) -> Result:
    """Return leaving times by law and speed, what hurry costs, and how many are pressed as hard as the paper's injured."""
    times = {key: leaving_times(episodes) for key, episodes in runs.items()}
    sections = [[_time_row(name, speed, times[name, speed]) for speed in SPEEDS] for name in LAWS]
    sections.append(_effect({speed: times["helbing", speed] for speed in SPEEDS}))
    crushed = {key: _injured(runs[key]) for key in runs if LAWS[key[0]].is_helbing}
    for name in LAWS:
        if LAWS[name].is_helbing:
            reading = f"people ever beyond {INJURED:g} N/m, in a draw"
            sections.append([mean_row(f"pressed, {name}, {v:g} m/s", crushed[name, v], "1", reading) for v in SPEEDS])
    remarks = [
        f"{settings.draws_are} the same starts for every law and speed; nsm2 and hertz have the first {_OTHERS}. A draw is "
        "blocked when nobody has got out for 2 minutes; its time counts as longer than all others.",
        "150 and 200 s are what Lin, Ma, Lo quote of the paper, which draws a curve and prints no number.",
        f"Pressure is that of bodies: normal contact forces, looked at every 0.1 s. In the paper people beyond {INJURED:g} N/m "
        "are injured and stay where they are; here they walk on.",
    ]
    rows = [
        (name, speed, one.seed, "" if np.isinf(time) else f"{time:.3f}", one.metrics.unfinished, _most(one))
        for (name, speed), episodes in runs.items()
        for one, time in zip(episodes, times[name, speed], strict=True)
    ]
    header = ("law", "desired_speed_mps", "seed", "leaving_time_s", "left", "highest_pressure_n_per_m")
    return Result(sections, {"runs": RawTable(header, rows)}, lambda: draw(times, crushed), remarks, "s")


def _time_row(name: str, speed: float, times: Floats) -> Row:
    median, interval = median_of(times)
    blocked = int(np.isinf(times).sum())
    printed = PRINTED.get(speed) if name == "helbing" else None
    reading = f"median of {len(times)}" + (f", {blocked} blocked" if blocked else "")
    here = median if np.isfinite(median) else None
    return Row(f"time, {name}, {speed:g} m/s", printed, here, "s", len(times), reading, ci95=interval)


def _effect(times: Mapping[float, Floats]) -> list[Row]:
    """Return the speed at which people leave soonest, and how much longer they take at 5 m/s."""
    soonest = min(times, key=lambda speed: float(np.median(times[speed])))
    ratio = times[5.0] / times[soonest]
    reading = f"time at 5 m/s over that at {soonest:g} m/s, draw by draw"
    return [
        Row("soonest out", None, soonest, "m/s", len(ratio), "speed of the least median"),
        mean_row("5 m/s over the soonest", ratio, "share", reading),
    ]


def _injured(episodes: Sequence[Episode]) -> Floats:
    return np.array([float((np.array(one.record) > INJURED).sum()) for one in episodes])


def _most(episode: Episode) -> str:
    return "" if episode.record is None else f"{max(episode.record):.0f}"


# ------------------------------------------------------------------------------------------------------------- figure


def draw(times: Mapping[tuple[str, float], Floats], crushed: Mapping[tuple[str, float], Floats]) -> Figure:
    """Return leaving times, and people beyond the pressure of the injured, against the desired speed."""
    figure = new_figure((11.0, 4.9))
    left, right = figure.subplots(1, 2, width_ratios=[1.3, 1.0])
    wanted = "desired speed [m/s]"
    draws = max(map(len, times.values()))
    quiet_axes(left, wanted, "time until all are out [s]", title=f"a. Faster is slower, {draws} draws", grid=True)
    quiet_axes(right, wanted, "people a draw", title=f"b. Pressed beyond {INJURED:g} N/m", grid=True)
    for k, name in enumerate(LAWS):
        _curve(left, name, k, {v: times[name, v] for v in SPEEDS})
        if LAWS[name].is_helbing:
            right.plot(
                SPEEDS, [crushed[name, v].mean() for v in SPEEDS], "-o", color=series(k), mec="white", label=name
            )
    style: dict[str, Any] = {"ls": "", "marker": "D", "mfc": "white", "mec": "black", "mew": 1.5, "ms": 7, "zorder": 6}
    left.plot([*PRINTED], [float(time) for time in PRINTED.values()], **style, label="the paper, as quoted")
    for axes in (left, right):
        axes.set(xscale="log", xticks=SPEEDS, xticklabels=[f"{v:g}" for v in SPEEDS], ylim=(0.0, None))
        axes.minorticks_off()
        axes.legend(frameon=False, fontsize=9)
    return figure


def _curve(axes: Axes, name: str, k: int, times: Mapping[float, Floats]) -> None:
    """Draw the draws of a law that cleared, and medians with intervals up to the speed from which most draws block."""
    clear = {v: median_of(of) for v, of in times.items() if np.isfinite(np.median(of))}
    blocked = ", blocks" if len(clear) < len(times) else ""
    for speed, of in times.items():
        axes.plot(np.full(len(of), speed), of, "o", color=series(k), alpha=0.25, ms=4, mew=0)
    middle = [median for median, _ in clear.values()]
    error = np.abs([np.subtract(interval or (median, median), median) for median, interval in clear.values()]).T
    axes.errorbar(
        [*clear], middle, np.reshape(error, (2, -1)), fmt="-o", color=series(k), ms=5, label=f"{name}{blocked}"
    )
