"""Tests of smoke: people are slower in it, and its gases make a dose."""

from dataclasses import replace

import numpy as np

from crowd_env import Geometry, Scenario, SpeedZone, Uniform
from crowd_env.analysis.smoke import dose, speed_in_smoke
from crowd_env.geometry.geometry import box
from validation.cases.case import Setting, Verdict, adults
from validation.cases.crowds import mean_of
from validation.cases.standards.walking import alone

_CLEAR, _THIN = 1.25, 1.0  # m/s and 1/m
_SLOWER = (1.0, 0.75, 0.5, 0.25)  # m/s, in thin smoke
# Relative speed by extinction coefficient [1/m], by hand: 1 - 0.057 / 0.706 K, at least a tenth.
_BY_HAND = {0.5: 0.9596, 1.0: 0.9193, 3.0: 0.7578, 7.5: 0.3945, 10.0: 0.1926}
# Volume fractions of CO, CO2 and O2, and when the dose is 1 by hand [s]: 60 over the sum of the rates per minute.
_AIRS = {
    (0.005, 0.0, 0.209): 306.4,  # 0.1955 + 0.0003
    (0.0, 0.0, 0.12): 1666.3,  # 0 + 0.0360
    (0.001, 0.05, 0.12): 456.0,  # 0.0956 + 0.0360
    (0.005, 0.02, 0.18): 208.7,  # 0.2861 + 0.0014
}
_STEP = 0.1  # s


def smoke(setting: Setting) -> Verdict:
    """NIST 2.5, ISO 18: one person walks along 100 m in smoke, as thick everywhere, as slowly as by hand."""
    regions = {"start": box(0.2, -0.5, 0.8, 0.5), "smoke": box(0.0, -1.0, 100.0, 1.0)}
    ground = Geometry.from_polygon(regions["smoke"], exits={"end": [(100.0, -0.5), (100.0, 0.5)]}, regions=regions)
    found, off = [], []
    for thick, speed in (*((thick, _CLEAR) for thick in _BY_HAND), *((_THIN, speed) for speed in _SLOWER)):
        person = adults(1, desired_speed=Uniform(speed, speed), start_region="start")
        zones = (SpeedZone("smoke", factor=float(speed_in_smoke(thick))),)
        _, walked, _ = alone(
            replace(setting, draws=1), Scenario("smoke", ground, person, 600.0, zones=zones), 5.0, 95.0
        )
        found.append(mean_of(walked))
        off.append(found[-1] / (speed * _BY_HAND[thick]) - 1.0)
    figure = ", ".join(f"{thick:g} /m {speed:.3f} m/s" for thick, speed in zip(_BY_HAND, found, strict=False))
    worst = float(np.max(np.abs(off)))
    return Verdict(worst <= 0.05, f"{figure}; from the values by hand at most {100 * worst:.1f} %", {"speeds": found})


def gases(setting: Setting) -> Verdict:
    """NIST 2.6, ISO 19: in constant air the dose of a person that stays is 1 when it is by hand."""
    times = np.arange(0.0, 2000.0, _STEP)
    found = [float(times[np.argmax(dose(times, *air) >= 1.0)]) for air in _AIRS]
    figure = ", ".join(f"{here:.1f} s ({hand:g} s by hand)" for here, hand in zip(found, _AIRS.values(), strict=True))
    near = all(abs(here - hand) <= 2.0 * _STEP for here, hand in zip(found, _AIRS.values(), strict=True))
    return Verdict(near, figure, {"times": found})
