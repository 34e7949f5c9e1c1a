"""The evacuations of section 4.3, on a synthetic plan: the same draws with and without the control rules."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.core.executors import Executor, all_cores
from crowd_env.envs.crowd import CrowdEnv, Step
from crowd_env.envs.rollout import Episode, RunsInterrupted, run_episodes
from crowd_env.physics import NSM2, SocialForce
from crowd_env.reproduce.pecol2011.flow import mean_of_runs
from crowd_env.reproduce.pecol2011.settings import PecolSettings
from crowd_env.reproduce.result import Halfway, Progress, RawTable, Row
from crowd_env.reproduce.sound import require_none_escaped
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
SCHEME = NSM2(
    1e5, 0.0, reaction="printed", social=SocialForce(strength=1000.0, length=0.08, anisotropy=0.0, cutoff=0.64)
)

SYNTHETIC = (
    "The plan is SYNTHETIC: the paper draws its theatre in a figure that is in no printed text. Rooms, seats, doors, stairs, "
    "rectangles and who sits where are assumed (crowd_env/scenarios/shipped/theatre.py says how); the shortest ways were made "
    "to part the audience about as Table 7 implies. This is an illustration, not a validation."
)

_HEADER = ("rules", "seed", "person", "route", "time_s")


@dataclass(frozen=True, eq=False)
class Egress:
    """R evacuations of N people."""

    time: Floats  # (R, N)  s    when each got out; nan for those still inside at the time limit
    route: Ints  # (R, N)  row of `ROUTES` by which; -1
    ruled: Floats  # (R, 3)  s    how long each rule was on
    turned: Ints  # (R,)  how many people a rule turned away, if only for a moment

    def by(self, route: str) -> Floats:
        """Return the exit times (R, N) [s] of those who took a route; nan for all others."""
        return np.where(self.route == ROUTES.index(route), self.time, np.nan)

    @property
    def unfinished(self) -> int:
        """How many people are left inside, in all runs."""
        return int(np.isnan(self.time).sum())

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


_made: dict[tuple[int, int, bool], Egress] = {}  # Figure 6 rests on half of the runs of Table 7


def theatre() -> Scenario:
    """Return the theatre."""
    return make_scenario("theatre-v0")


def evacuate(settings: PecolSettings, rules: bool, progress: Progress, executor: Executor | None = None) -> Egress:
    """Run the draws ``seed`` to ``seed + runs - 1``, with or without the control rules; once for the same settings.

    Raises
    ------
    Halfway
        On Ctrl-C, with the exits of the runs that were finished by then.
    """
    key = settings.runs, settings.seed, rules
    if key in _made:
        progress(settings.runs)
        return _made[key]
    options: dict[str, Any] = {"scheme": SCHEME, "rules": rules, "progress": progress, "executor": executor}
    options["threads"] = all_cores() if executor is None else 1
    recorder = _RulesRecorder() if rules else None
    try:
        episodes = run_episodes(theatre(), settings.runs, seed=settings.seed, recorder=recorder, **options)
    except RunsInterrupted as stopped:
        name = "yes" if rules else "no"
        rows = [row for e in stopped.episodes for row in _exits(name, e.seed, e.exit_time, _routes(e))]
        halfway = Halfway(RawTable(_HEADER, rows), len(stopped.episodes))
        earlier = _made.get((settings.runs, settings.seed, True)) if not rules else None
        if earlier is not None:
            halfway = halfway.after(raw_times(settings, [("yes", earlier)]), settings.runs)
        raise halfway from None
    require_none_escaped(SCHEME.info.name, sum(episode.metrics.escaped for episode in episodes))
    kept = [episode.record or (np.zeros(3), 0) for episode in episodes]
    _made[key] = Egress(
        np.stack([episode.exit_time for episode in episodes]),
        np.stack([_routes(episode) for episode in episodes]),
        np.stack([ruled for ruled, _ in kept]),
        np.array([turned for _, turned in kept]),
    )
    return _made[key]


class _RulesRecorder:
    """Keeps how long each rule was on (3,) [s] in an evacuation, and how many people one turned away."""

    def begin(self, env: CrowdEnv, runs: Sequence[int]) -> None:
        self._ruled, self._turned = np.zeros((env.num_envs, 3)), np.zeros(env.num_people, dtype=np.bool_)
        self._running = np.ones(env.num_envs, dtype=np.bool_)

    def add(self, env: CrowdEnv, step: Step) -> None:
        state, history = env.simulation.state, env.simulation.history
        self._ruled += env.decision_dt * (history.rule_on & self._running[:, None])
        self._turned |= state.active & (history.followed != state.route)
        self._running = ~env.finished

    def record(self, env: CrowdEnv, e: int) -> tuple[Floats, int]:
        return self._ruled[e].copy(), int(self._turned[env.people(e)].sum())


def _routes(episode: Episode) -> Ints:
    """Return by which of `ROUTES` people got out (N,); -1 for people who did not."""
    row = np.array([*(ROUTES.index(name) for name in theatre().geometry.exit_names), -1], dtype=np.int64)
    return np.asarray(row[episode.exit_index])  # -1 takes the last entry


def mean_row(quantity: str, values: Floats, unit: str, reading: str, paper: str | None = None) -> Row:
    """Return the mean over the runs that have a value, with its spread."""
    mean, n, sd, ci95 = mean_of_runs(values)
    return Row(quantity, paper, mean, unit, n, reading, sd=sd, ci95=ci95)


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
    return rows


def unfinished_row(quantity: str, done: Egress) -> Row:
    """Return how many are still inside at the time limit."""
    return Row(quantity, None, done.unfinished, "people", done.time.size, "at the time limit", closes=True)


def draws_remark(settings: PecolSettings) -> str:
    """Return which draws were made, and of what."""
    return (
        f"{settings.draws_are} people of Table 6 on the same seats, NSM2 with its social force (at an angle of 90 degrees: "
        "1000 N from all sides, B = 0.08 m), h = 0.01 s. People are out at the far end of the corridor (A) or the stairs (B) "
        "behind the door."
    )


def raw_times(settings: PecolSettings, results: Sequence[tuple[str, Egress]]) -> RawTable:
    """Return everybody's exit: rules, seed of the run, person, route and time (empty if never)."""
    runs = [
        (name, settings.seed + k, *run)
        for name, done in results
        for k, run in enumerate(zip(done.time, done.route, strict=True))
    ]
    return RawTable(_HEADER, [row for run in runs for row in _exits(*run)])


def _exits(rules: str, seed: int, times: Floats, routes: Ints) -> list[tuple[object, ...]]:
    return [
        (rules, seed, person, "" if by < 0 else ROUTES[by], "" if np.isnan(time) else f"{time:.6f}")
        for person, (by, time) in enumerate(zip(routes, times, strict=True))
    ]
