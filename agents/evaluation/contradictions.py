"""What the columns of a run must have in common: no evacuation can have done what breaks one of these rules.

Each follows from what the columns are, and from the place.  What is merely hard to believe is for `credibility` to say.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple, TypeAlias

import numpy as np

from crowd_env import Scenario
from crowd_env.analysis.results.measurements import ALONE
from crowd_env.core.arrays.state import Bools, Floats
from crowd_env.envs.observation.view import SLOWEST
from crowd_env.envs.tasks.task import Task
from crowd_env.physics.pressure import INJURY

from ..tasks.lower_bounds import exit_widths

Runs: TypeAlias = Mapping[str, Floats]  # column -> its value in each run

MIXED = ("mean_exit_learned", "mean_exit_others")  # figures of mixed crowds
_NOT_ALWAYS = (*MIXED, "last_time", "mean_exit", "flow")  # what a run may lack
_NEVER_TWICE = ("last_time", "mean_exit", "flow", "walked")  # no two crowds agree in all digits, but by chance
_ROUNDED = 1.002  # numbers have four digits and more
_MEASURED = 1.02  # areas err by 1 %


class Crowd(NamedTuple):
    """What is known of the people of all runs."""

    people: int
    learned: int  # that the policy moves
    desired: tuple[float, float]  # m/s  of pedestrians that want to walk
    radius: tuple[float, float]  # m
    discs: bool
    apron: float  # m
    least_way: float  # m  see `least_way`
    time_limit: float  # s
    step: float  # s  between decisions


def crowd_of(task: Task, place: Scenario, learned_share: float) -> Crowd:
    """Return what is known of the people in runs of a task at a place, which may be varied."""
    people, parts = place.population.people, place.population.parts
    return Crowd(
        people,
        max(1, round(learned_share * people)),
        (
            max(SLOWEST, min(one.desired_speed.low for one in parts)),
            max(one.desired_speed.high for one in parts),
        ),
        (min(one.radius.low for one in parts), max(one.radius.high for one in parts)),
        place.room == 1.0,
        place.apron,
        least_way(place),
        place.time_limit,
        task.decision_dt,
    )


def least_way(place: Scenario) -> float:
    """Return the mean way [m] to the exits of people that fill the floor around them with bodies as small as they can be.

    The floor within d of X exits of widths w is at most ``sum (pi d^2 + 2 w d)``, and a disc is 2 r / 3 from its center on
    average.
    """
    radius, widths = min(one.radius.low for one in place.population.parts), exit_widths(place)
    area, width, caps = place.population.people * np.pi * radius**2, widths.sum(), np.pi * len(widths)
    reach = (np.sqrt(width**2 + caps * area) - width) / caps
    return float((2.0 / 3.0 * caps * reach**3 + width * reach**2) / area - 2.0 / 3.0 * radius)


def _latest(time: str, runs: Runs, crowd: Crowd) -> Floats:
    """Return a time of each run (R,) [s], at the latest; people left inside count until the time limit."""
    return np.where(runs["unfinished"] == 0, runs[time], crowd.time_limit) + crowd.step


def _apart(people: int) -> float:
    """Return the most of flow x (last_time - mean_exit).

    The flow is at most the spread of the numbers 1 to N over that of the times, and of N times with the mean m one is T only
    if they spread by (T - m) / sqrt(N - 1) or more.
    """
    return float(np.sqrt((people**2 - 1) * (people - 1) / 12.0))


def _mixed_wrongly(runs: Runs, crowd: Crowd) -> Bools:
    learned, others = (runs[name] for name in MIXED)
    alone = crowd.learned == crowd.people
    mean = learned if alone else (crowd.learned * learned + (crowd.people - crowd.learned) * others) / crowd.people
    wrong = ~np.isclose(mean, runs["mean_exit"], rtol=_ROUNDED - 1.0)
    return (wrong & np.isfinite(learned)) | np.isfinite(others) if alone else wrong & (runs["unfinished"] == 0)


# Rule -> the runs (R,) that break it.  Comparisons with what a run lacks are False.
RULES: Mapping[str, Callable[[Runs, Crowd], Bools]] = {
    "a run that all have left has a last time, a mean exit time and a flow, all finite": lambda r, c: (
        (r["unfinished"] == 0) & ~np.isfinite(r["last_time"] + r["mean_exit"] + r["flow"])
    ),
    "a run that someone has not left has no last time and no mean exit time": lambda r, c: (
        (r["unfinished"] > 0) & (np.isfinite(r["last_time"]) | np.isfinite(r["mean_exit"]))
    ),
    "blocked must be 0 where all have left": lambda r, c: (r["blocked"] > 0) & (r["unfinished"] == 0),
    "last_time must not be beyond the time limit": lambda r, c: r["last_time"] > _ROUNDED * (c.time_limit + c.step),
    "mean_exit must not be above last_time": lambda r, c: r["mean_exit"] > r["last_time"],
    "mean_exit must not be below last_time over the people": lambda r, c: (
        _ROUNDED * r["mean_exit"] * c.people < r["last_time"]
    ),
    # A slope is least if some leave at once and the others at the end.
    "flow must not be below half of the people over last_time": lambda r, c: (
        _ROUNDED * r["flow"] * r["last_time"] < 0.5 * c.people
    ),
    "last_time must not be so far above mean_exit at this flow": lambda r, c: (
        r["flow"] * (r["last_time"] - r["mean_exit"]) > _ROUNDED * _apart(c.people)
    ),
    "mean_exit_learned and mean_exit_others must amount to mean_exit": _mixed_wrongly,
    "crushed must be 0 where crushed_time is 0, and there alone": lambda r, c: (
        (r["crushed"] > 0) != (r["crushed_time"] > 0)
    ),
    f"crushed must be 0 where max_pressure is below {INJURY:g} N/m, and there alone": lambda r, c: np.where(
        r["crushed"] > 0, _ROUNDED * r["max_pressure"] < INJURY, r["max_pressure"] > _ROUNDED * INJURY
    ),
    "crushed_time must not be below a decision step, or above the time of the run, for each of the crushed": lambda r, c: (
        (_ROUNDED * r["crushed_time"] < c.step * r["crushed"])
        | (r["crushed_time"] > _ROUNDED * r["crushed"] * _latest("last_time", r, c))
    ),
    "contact_impulse must not be above max_pressure on all, all the time": lambda r, c: (
        (r["contact_impulse"] > _ROUNDED * 2.0 * np.pi * c.radius[1] * r["max_pressure"] * _latest("mean_exit", r, c))
        & (c.apron == 0.0)
    ),
    "contact_impulse must not be below that of max_pressure on one, in one decision step": lambda r, c: (
        _ROUNDED * r["contact_impulse"] * c.people < 2.0 * np.pi * c.radius[0] * r["max_pressure"] * c.step
    ),
    "max_speed must not be below walked over mean_exit": lambda r, c: (
        r["walked"] > _ROUNDED * r["max_speed"] * _latest("mean_exit", r, c)
    ),
    "max_speed must not be below hurry times the least desired speed": lambda r, c: (
        r["hurry"] * c.desired[0] > _ROUNDED * r["max_speed"]
    ),
    "hurry must not be below walked over mean_exit and the largest desired speed": lambda r, c: (
        r["walked"] > _ROUNDED * r["hurry"] * c.desired[1] * _latest("mean_exit", r, c)
    ),
    "walked must not be below the way of people who start as near to the exits as they fit": lambda r, c: (
        (_ROUNDED * r["walked"] < c.least_way) & (r["unfinished"] == 0)
    ),
    "max_density must not be below that of someone alone": lambda r, c: _MEASURED * r["max_density"] < ALONE,
    "max_density must not be above what leaves each body, less max_overlap, its floor": lambda r, c: (
        (r["max_density"] * np.pi * np.maximum(c.radius[0] - r["max_overlap"], 0.0) ** 2 > _MEASURED) & c.discs
    ),
}


def contradiction(runs: Runs, crowd: Crowd) -> str:
    """Return what the people of a place cannot have done in runs, given as columns; "" if there is nothing."""
    count = len(runs["unfinished"])
    some = {name: values[np.isfinite(values)] for name, values in runs.items()}
    for name in ("unfinished", "escaped", "crushed", "blocked"):
        most = 1 if name == "blocked" else crowd.people
        if not np.isin(runs[name], np.arange(most + 1)).all():
            return f"{name} must be whole numbers from 0 to {most}"
    for name, values in some.items():
        if np.isinf(runs[name]).any():
            return f"{name} must be finite"
        if name not in _NOT_ALWAYS and len(values) < count:
            return f"{name} must be a number in every run"
        if (values < 0.0).any():
            return f"{name} must not be negative"
        if name in _NEVER_TWICE and len(values) > 2 and (values == values[0]).all():
            return f"{name} must not be the same in all runs"
    for rule, breaks in RULES.items():
        if breaks(runs, crowd).any():
            return rule
    every = np.nan_to_num(np.stack(list(runs.values()), axis=1), nan=-1.0)
    return "two runs are the same" if len(np.unique(every, axis=0)) < count else ""
