"""Faster is slower?  How long it takes to clear a door, by desired speed, push and friction."""

import itertools
from dataclasses import replace

import numpy as np

from crowd_env import Hertz, Scenario, Uniform, make_scheme
from crowd_env.core.behaviors.headway import Headway
from validation.cases.case import Row, Setting, row
from validation.cases.crowds import Passages, draw_crowds
from validation.cases.doors import door

SLACK = 0.05  # by which a time may be longer than that of the next slower desired speed

SPEEDS = (1.0, 1.5, 2.0, 3.0, 4.0)  # m/s, of everyone
PUSHES = (0.0, 0.5, 1.0)
FRICTIONS = (0.0, 0.5)  # of hertz: people on people

_PEOPLE, _DOOR = 100, 0.8  # m
_PATIENCE, _LIMIT = 20.0, 300.0  # s


def room(speed: float) -> Scenario:
    """Return a crowd in front of a door in which everyone wants to walk at ``speed`` [m/s]."""
    scenario = door(_DOOR, _PEOPLE)
    return replace(scenario, population=scenario.population.changed(desired_speed=Uniform(speed, speed)))


def clearing_times(setting: Setting, push: float, speeds: tuple[float, ...] = SPEEDS) -> list[float]:
    """Return the mean time [s] until all are through, for each desired speed; infinite if any of the draws is stuck."""
    crowds = draw_crowds([room(speed) for speed in speeds], setting)
    crowds.simulation.bodies.push[:] = push
    passages = Passages(crowds, 0, 0.3)
    stuck = passages.watch(_LIMIT, _PATIENCE)
    last = [float("inf") if e in stuck else float(passages.times(e)[-1]) for e in range(crowds.count)]
    return [float(np.mean([last[e] for e in crowds.of(k)])) for k in range(len(speeds))]


def never_slower(times: list[float]) -> bool:
    """Return whether no time is longer than that of the next slower speed."""
    return all(np.isfinite(times)) and all(
        later <= (1.0 + SLACK) * earlier for earlier, later in itertools.pairwise(times)
    )


def slowed(times: list[float], smooth: list[float]) -> bool:
    """Return whether crowds that rub take longer on the whole than those that do not."""
    return sum(times) > sum(smooth)


def run(setting: Setting) -> list[Row]:
    """Return the row.  Without a headway rule there is nothing but full push."""
    scheme = make_scheme(setting.scheme)
    frictions = FRICTIONS if isinstance(scheme, Hertz) else (0.0,)
    pushes = PUSHES if Headway.of(setting.manner) is not None else (1.0,)
    found: dict[str, list[float]] = {}
    verdicts, smooth = [], [float("inf")]
    for friction in frictions:
        for push in pushes:
            chosen = replace(scheme, friction=friction) if isinstance(scheme, Hertz) else scheme
            times = clearing_times(replace(setting, scheme=chosen), push)
            found[f"push {push:g}" + (f", friction {friction:g}" if len(frictions) > 1 else "")] = times
            if push == 0.0:
                verdicts.append(never_slower(times))
            elif push == 1.0 and friction:
                verdicts.append(slowed(times, smooth))
            elif push == 1.0:
                smooth = times
    figure = f"s at {', '.join(f'{speed:g}' for speed in SPEEDS)} m/s: " + "; ".join(
        f"{name}: " + " ".join("stuck" if np.isinf(time) else f"{time:.0f}" for time in times)
        for name, times in found.items()
    )
    passed = all(verdicts) if verdicts else None
    return [row("faster", setting, passed, figure, speed=SPEEDS, time=found)]
