"""The evacuations of section 4.3, on a synthetic plan: the same draws with and without the control rules."""

import warnings
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.envs.crowd import CrowdEnv, Step
from crowd_env.envs.rollout import Episode
from crowd_env.physics import NSM2, SocialForce
from crowd_env.reproduce.evacuations import Case
from crowd_env.reproduce.pecol2011.settings import PecolSettings
from crowd_env.reproduce.result import RawTable, Row, mean_row
from crowd_env.scenarios import make_scenario
from crowd_env.scenarios.scenario import Scenario

RUNS = 100
ROUTES = ("A", "B")

# Table 7 of the paper: the exercise, its simulation [s].
PRINTED = {
    "last, A": ("45", "49.4"),
    "mean, A": ("31.1", "30.7"),
    "last, B": ("66", "62"),
    "mean, B": ("53.1", "48.6"),
    "last, all": ("66", "62"),
    "mean, all": ("44", "41.9"),
}
# How many took which route is not printed, but the three mean times leave no other whole numbers.
IMPLIED = {"people by A": (42, 38), "people by B": (59, 63)}

# "The adapted NSM2 that contained the socio-psychological force", Table 6; with the angle fixed at 90 degrees it is 1000 N
# from all sides.
_FROM_ALL_SIDES = SocialForce(strength=1000.0, length=0.08, anisotropy=0.0, cutoff=0.64)
SCHEME = NSM2(1e5, 0.0, reaction="printed", social=_FROM_ALL_SIDES)

SYNTHETIC = (
    "The plan is SYNTHETIC: the paper draws its theatre in a figure that is in no printed text. Rooms, seats, doors, stairs, "
    "rectangles and who sits where are assumed (crowd_env/scenarios/shipped/theatre.py says how); the shortest ways were made "
    "to part the audience about as Table 7 implies. This is an illustration, not a validation."
)


def theatre() -> Scenario:
    """Return the theatre."""
    return make_scenario("theatre-v0")


def cases(settings: PecolSettings, rules: Collection[str]) -> dict[str, Case]:
    """Return the same draws with control rules, "yes", or without, "no"."""
    ruled = Case("theatre-rules", theatre(), SCHEME, settings.seeds, 0.01, True, _Ruled())
    free = replace(ruled, label="theatre-no-rules", rules=False, recorder=None)
    both = {"yes": ruled, "no": free}
    return {name: both[name] for name in rules}


class _Ruled:
    """Keeps how long each rule was on (3,) [s] in an evacuation, and how many people one turned away."""

    def begin(self, env: CrowdEnv, runs: Sequence[int]) -> None:
        self._ruled, self._turned = np.zeros((env.num_envs, 3)), np.zeros(env.num_people, dtype=bool)
        self._running = np.ones(env.num_envs, dtype=bool)

    def add(self, env: CrowdEnv, step: Step) -> None:
        state, history = env.simulation.state, env.simulation.history
        self._ruled += env.decision_dt * (history.rule_on & self._running[:, None])
        self._turned |= state.active & (history.followed != state.route)
        self._running = ~env.finished

    def record(self, env: CrowdEnv, e: int) -> list[Any]:
        return [self._ruled[e].tolist(), int(self._turned[env.people(e)].sum())]


class Egress:
    """R evacuations of N people.

    Attributes
    ----------
    time : (R, N) s, when each got out; nan for a pedestrian inside at the time limit.
    route : (R, N), row of `ROUTES` by which; -1.
    ruled : (R, 3) s, how long each rule was on.
    turned : (R,), how many people a rule turned away, if only for a moment.
    """

    def __init__(self, episodes: Sequence[Episode]) -> None:
        # Index -1, of a pedestrian left inside, takes the last entry.
        row = np.array([*(ROUTES.index(name) for name in theatre().geometry.exit_names), -1], dtype=np.int64)
        self.seeds = [episode.seed for episode in episodes]
        self.time: Floats = np.stack([episode.exit_time for episode in episodes])
        self.route: Ints = np.stack([row[episode.exit_index] for episode in episodes])
        kept = [episode.record or ([0.0] * 3, 0) for episode in episodes]
        self.ruled: Floats = np.array([ruled for ruled, _ in kept])
        self.turned: Floats = np.array([turned for _, turned in kept], dtype=np.float64)

    def by(self, route: str) -> Floats:
        """Return the exit times (R, N) [s] of the pedestrians on a route; nan for all others."""
        return np.where(self.route == ROUTES.index(route), self.time, np.nan)

    @cached_property
    def quantities(self) -> dict[str, Floats]:
        """What Table 7 prints or implies, of every run (R,); nan where there is none."""
        found: dict[str, Floats] = {}
        for name, times in (*((route, self.by(route)) for route in ROUTES), ("all", self.time)):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)  # in some run nobody may have got out
                found[f"last, {name}"] = np.nanmax(times, axis=1)
                found[f"mean, {name}"] = np.nanmean(times, axis=1)
            if name in ROUTES:
                found[f"people by {name}"] = np.isfinite(times).sum(axis=1).astype(np.float64)
        found["last, all"][np.isnan(self.time).any(axis=1)] = np.nan
        return found


def rows_with_rules(done: Egress) -> list[Row]:
    """Return the quantities of Table 7, the paper's simulation beside ours, the exercise named in words."""
    rows = []
    for name, (exercise, simulation) in PRINTED.items():
        row = mean_row(name, done.quantities[name], "s", f"exercise {exercise} s", simulation)
        off = "" if row.here is None else f" ({100 * (row.here / float(exercise) - 1):+.1f} %)"
        rows.append(replace(row, reading=row.reading + off))
    for name, (exercised, simulated) in IMPLIED.items():
        reading = f"implied: exercise {exercised}, paper's simulation {simulated}"
        rows.append(mean_row(name, done.quantities[name], "people", reading))
    return [*rows, unfinished_row("left inside", done)]


def unfinished_row(quantity: str, done: Egress) -> Row:
    """Return how many are still inside at the time limit, in all runs."""
    inside = int(np.isnan(done.time).sum())
    return Row(quantity, None, inside, "people", done.time.size, "at the time limit")


def remarks(settings: PecolSettings) -> list[str]:
    """Return which draws were made, and of what."""
    return [
        SYNTHETIC,
        f"{settings.draws_are} people of Table 6 on the same seats, NSM2 with its social force (at an angle of 90 degrees: "
        "1000 N from all sides, B = 0.08 m), h = 0.01 s. People are out at the far end of the corridor (A) or the stairs (B) "
        "behind the door.",
    ]


def raw_times(results: Mapping[str, Egress]) -> dict[str, RawTable]:
    """Return everybody's exit: rules, seed of the run, person, route and time (empty if never)."""
    rows = [
        (rules, seed, person, "" if by < 0 else ROUTES[by], "" if np.isnan(time) else f"{time:.6f}")
        for rules, done in results.items()
        for seed, times, routes in zip(done.seeds, done.time, done.route, strict=True)
        for person, (by, time) in enumerate(zip(routes, times, strict=True))
    ]
    return {"exit-times": RawTable(("rules", "seed", "person", "route", "time_s"), rows)}
