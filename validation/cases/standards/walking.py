"""Tests of how single people and small cohorts walk: speed, response times, corners, ages, densities."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import shapely
from scipy import stats

from crowd_env import Geometry, LogNormal, Normal, Population, Scenario, Uniform
from crowd_env.geometry.geometry import box
from crowd_env.routing.fields.fundamental_diagram import weidmann
from validation.cases.case import Setting, Verdict, adults
from validation.cases.crowds import Floats, Passages, crowds_at, draw_crowds, generator, mean_of
from validation.cases.ring import along, annulus, around
from validation.cases.standards.places import place

_ALL_AT = (1.33, 1.0)  # m/s, of the tests in a corridor of 40 m
_MANY = 50  # draws of response times, so that a test of their law sees a wrong one
_DENSITIES = (0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)  # 1/m2
_RADIUS, _WIDTH = 10.0, 2.4  # m, of the ring that stands for a corridor of 1000 m
_FREE, _JUDGED = 1.34, 3.0  # m/s and 1/m2: free speed of Weidmann 1993; up to there his speeds are asked for ...
WITHIN = 0.3  # ... within this share


class Quantiles(NamedTuple):
    """A distribution that draws from a law of scipy.stats, without the last hundredth."""

    law: Any

    @property
    def low(self) -> float:
        """The smallest."""
        return float(self.law.ppf(0.0))

    @property
    def high(self) -> float:
        """The largest."""
        return float(self.law.ppf(0.99))

    def sample(self, rng: np.random.Generator, count: int) -> Floats:
        """Draw values."""
        return np.asarray(self.law.ppf(rng.uniform(0.0, 0.99, count)))


def corridor(people: Population, length: float = 40.0) -> Scenario:
    """Return a corridor 2 m wide in which everyone starts 0.4 to 0.6 m from one end and leaves at the other."""
    ground = Geometry.from_polygon(
        box(0.0, -1.0, length, 1.0),
        exits={"end": [(length, -1.0), (length, 1.0)]},
        regions={"start": box(0.2, -0.5, 0.8, 0.5)},
    )
    return Scenario("corridor", ground, people.changed(start_region="start"), 120.0)


def alone(setting: Setting, scenario: Scenario, first: float, last: float) -> tuple[Floats, Floats, Floats]:
    """Return what people who walk alone, one a draw, want [m/s], their speed between two lines, and when they are out [s]."""
    crowds = draw_crowds([scenario], setting)
    lines = [Passages(crowds, 0, at) for at in (first, last)]
    state = crowds.walk(scenario.time_limit, *lines)
    return crowds.simulation.bodies.desired_speed, (last - first) / (lines[1].time - lines[0].time), state.exit_time


def corridor_of_40_m(setting: Setting) -> Verdict:
    """RiMEA 1, ISO 2, NIST 2.1, IMO 1: one person walks 40 m."""
    found = []
    for speed in _ALL_AT:
        _, walked, out = alone(setting, corridor(adults(1, desired_speed=Uniform(speed, speed))), 5.0, 35.0)
        found.append((mean_of(walked), mean_of(out)))
    (_, took), (slow, _) = found
    passed = 26.0 <= took <= 34.0 and abs(slow - 1.0) <= 0.05
    return Verdict(passed, f"{took:.1f} s at 1.33 m/s; {slow:.3f} m/s at 1 m/s", {"time": took, "speed": slow})


def ages(setting: Setting) -> Verdict:
    """RiMEA 7, IMO 7, ISO 5, NIST 2.4: people walk at the speeds that they were given."""
    by_age = adults(1, desired_speed=Uniform(0.7, 1.6))
    desired, walked, _ = alone(replace(setting, draws=50), corridor(by_age), 5.0, 35.0)
    off = float(np.abs(walked / desired - 1.0).max())
    drawn = adults(1, desired_speed=Normal(1.2, 0.2, 0.5, 1.9))
    _, normal, _ = alone(replace(setting, draws=100), corridor(drawn), 5.0, 35.0)
    mean, sd = mean_of(normal), float(np.nanstd(normal, ddof=1))
    passed = off <= 0.05 and abs(mean - 1.2) <= 0.05 and abs(sd - 0.2) <= 0.05
    figure = f"50 people of 0.7 to 1.6 m/s within {100 * off:.1f} %; 100 of 1.2 ± 0.2 m/s walk at {mean:.2f} ± {sd:.2f}"
    return Verdict(passed, figure, {"largest_deviation": off, "mean": mean, "sd": sd})


def response_times(setting: Setting) -> Verdict:
    """RiMEA 5, ISO 1, NIST 1.1, IMO 5: ten people begin to walk when their own response time is over, by the law of these.

    They stand side by side at the back, where walking people cannot push waiting ones.  Of people with shoulders, which need
    room to turn, every other one stands 0.2 m further back.  A pedestrian walks when faster than half of the desired speed:
    where a social force acts, waiting people are moved apart a little.
    """
    askew = 0.1 if setting.room > 1.0 else 0.0
    across = np.linspace(0.25 + 0.2 * askew, 4.75 - 0.2 * askew, 10)
    starts = np.column_stack([0.5 + askew * (-1.0) ** np.arange(10), across])
    drawn = (Uniform(10.0, 100.0), Normal(55.0, 15.0, 0.0, 110.0), LogNormal(98.1, 0.967, high=900.0, low=1.0))
    laws = [stats.uniform(10.0, 90.0), stats.norm(55.0, 15.0), stats.lognorm(0.967, scale=98.1)]
    laws += [stats.gamma(1.291, scale=103.901), stats.weibull_min(1.195, scale=139.285)]
    scenarios = [
        Scenario("response", place("response"), adults(10, response_time=law, starts=starts), 1000.0)
        for law in (*drawn, *map(Quantiles, laws[len(drawn) :]))
    ]
    crowds = draw_crowds(scenarios, replace(setting, draws=_MANY))
    bodies = crowds.simulation.bodies
    began = np.full(len(bodies.radius), np.nan)
    for before, now in crowds.moments(1000.0):
        walks = np.hypot(*(now.position - before.position).T) > 0.5 * bodies.desired_speed * (now.time - before.time)
        began[walks & np.isnan(began)] = now.time
    late = began - bodies.response_time
    chances = [
        float(stats.kstest(times, law.cdf).pvalue)
        for times, law in zip(began.reshape(len(laws), -1), laws, strict=True)
    ]
    passed = bool((late > 0.0).all() and (late < 1.0).all()) and min(chances) > 0.05
    figure = (
        f"people begin {late.min():.2f} to {late.max():.2f} s after their response time; that times are of the law has "
        f"p = {', '.join(f'{p:.2f}' for p in chances)}"
    )
    return Verdict(passed, figure, {"late": [float(late.min()), float(late.max())], "p": chances})


def corner(setting: Setting) -> Verdict:
    """RiMEA 6, ISO 4, NIST 2.3, IMO 6: twenty people turn a corner, and none goes through a wall."""
    floor = shapely.union(box(0.0, 0.0, 12.0, 2.0), box(10.0, 0.0, 12.0, 12.0))
    ground = Geometry.from_polygon(floor, exits={"end": "10,12,12,12"}, regions={"start": box(0.0, 0.0, 6.0, 2.0)})
    crowds = draw_crowds([Scenario("corner", ground, adults(20, start_region="start"), 120.0)], setting)
    outside = 0
    shapely.prepare(floor)
    for _, now in crowds.moments(120.0):
        outside += int((~shapely.intersects_xy(shapely.buffer(floor, 1e-3), *now.position[now.active].T)).sum())
    left = int(crowds.simulation.state.active.sum())
    return Verdict(left == 0 and outside == 0, f"{left} left, {outside} outside", {"left": left, "outside": outside})


def fundamental_diagram(setting: Setting) -> Verdict:
    """RiMEA 4, ISO 13: speed and flow by density, in a ring 2.4 m wide in place of a corridor of 1000 m; judged by Weidmann."""
    ground = annulus(_RADIUS, _WIDTH)
    densities = [density for density in _DENSITIES if density * setting.room**2 <= _DENSITIES[-1]]  # that fit
    numbers = [round(density * ground.area) for density in densities]
    people = [adults(n) for n in numbers]
    drawn = [some.draw(generator(setting, 0), ground, setting.room) for some in people]
    crowds = crowds_at(ground, drawn, setting, 1)
    speed = np.array(crowds.speeds(along, around, 10.0, 30.0))
    flow = speed * np.array(densities)
    best = int(np.argmax(flow))
    expected = _FREE * weidmann(np.array(densities))
    off = (speed / expected - 1.0)[[density <= _JUDGED for density in densities]]
    passed = bool((np.diff(speed) < 0.0).all()) and 0 < best < len(flow) - 1 and bool((np.abs(off) <= WITHIN).all())
    figure = ", ".join(f"{d:g} /m2 {v:.2f} ({w:.2f}) m/s" for d, v, w in zip(densities, speed, expected, strict=True))
    figure += f"; most flow, {flow[best]:.2f} /(m s), at {densities[best]:g} /m2"
    return Verdict(passed, figure, {"density": densities, "speed": speed.tolist(), "flow": flow.tolist()})
