"""The evacuations of section 4.2: the same draws for every scheme."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.executors import Executor
from crowd_env.envs.metrics import share_interval
from crowd_env.envs.rollout import Episode, RunsInterrupted, run_episodes
from crowd_env.reproduce.pecol2011.flow import ESTIMATORS, Estimate, run_slopes
from crowd_env.reproduce.pecol2011.settings import PecolSettings
from crowd_env.reproduce.result import Halfway, Progress, RawTable, Row
from crowd_env.reproduce.sound import require_none_escaped

# Table 5 of the paper, flows in persons/s; it has one NSM1, we have the two that its text describes.
PRINTED = {"dem": "3.04", "nsm1": "4.65", "nsm1-inertial": "4.65", "nsm2-printed": "2.60"}
EXPERIMENT = "2.67"

_HEADER = ("scheme", "seed", "number_out", "time_s")


@dataclass(frozen=True, eq=False)
class Evacuations:
    """Many evacuations under one scheme."""

    scheme: str
    exit_times: Floats  # (R, N) s, in the order of leaving; nan for those still inside at the time limit
    unconverged: int  # physics steps whose solve missed its tolerance
    max_speed: float = math.nan  # m/s  of anyone, in any step

    @cached_property
    def slopes(self) -> Floats:
        """Slope of every run (R,) [1/s]."""
        return run_slopes(self.exit_times)

    @cached_property
    def estimates(self) -> dict[str, Estimate]:
        """The flow by every estimator."""
        return {name: estimator.estimate(self.exit_times) for name, estimator in ESTIMATORS.items()}

    @property
    def unfinished(self) -> tuple[int, int]:
        """How many people are left inside, and in how many runs."""
        inside = np.isnan(self.exit_times).sum(axis=1)
        return int(inside.sum()), int((inside > 0).sum())


def evacuate(settings: PecolSettings, scheme: str, progress: Progress, executor: Executor | None = None) -> Evacuations:
    """Run the draws ``seed`` to ``seed + runs - 1`` under a scheme, everyone walking the shortest path.

    They are the draws of ``crowd-env run``.

    Raises
    ------
    Halfway
        On Ctrl-C, with the exits of the runs that were finished by then.
    """
    contact = settings.contact(scheme)
    try:
        episodes = run_episodes(
            settings.room(),
            settings.runs,
            seed=settings.seed,
            progress=progress,
            executor=executor,
            scheme=contact,
            dt=settings.dt,
            # How often we look; the rule does not depend on it.
            decision_dt=settings.dt * max(1, round(0.1 / settings.dt)),
        )
    except RunsInterrupted as stopped:
        rows = [row for episode in stopped.episodes for row in _exits(scheme, episode.seed, _sorted_times(episode))]
        raise Halfway(RawTable(_HEADER, rows), len(stopped.episodes)) from None
    metrics = [episode.metrics for episode in episodes]
    require_none_escaped(contact.info.name, sum(episode.escaped for episode in metrics))
    return Evacuations(
        scheme,
        np.stack([_sorted_times(episode) for episode in episodes]),
        sum(episode.unconverged for episode in metrics),
        max(episode.max_speed for episode in metrics),
    )


def _sorted_times(episode: Episode) -> Floats:
    """Return the exit times (N,) [s] in the order of leaving, nan at the end."""
    return np.asarray(np.sort(episode.exit_time))


def flow_rows(done: Evacuations) -> list[Row]:
    """Return the rows of one scheme: every estimator, and who did not get out."""
    rows = []
    for name, estimator in ESTIMATORS.items():
        value, n, sd, ci95 = done.estimates[name]
        quantity = f"flow, {done.scheme}, {name}"
        rows.append(Row(quantity, PRINTED[done.scheme], value, "1/s", n, estimator.reading, sd=sd, ci95=ci95))
    people, runs = done.unfinished
    where = "at the time limit"
    rows.append(Row(f"left inside, {done.scheme}", None, people, "people", done.exit_times.size, where))
    share = share_interval(runs, len(done.exit_times))
    rows.append(
        Row(f"unfinished, {done.scheme}", None, runs, "runs", len(done.exit_times), where, ci95=share, closes=True)
    )
    return rows


def raw_times(settings: PecolSettings, results: list[Evacuations]) -> RawTable:
    """Return every exit: scheme, seed of the run, how many are out by then, and when (empty if never)."""
    runs = [(done.scheme, settings.seed + k, run) for done in results for k, run in enumerate(done.exit_times)]
    return RawTable(_HEADER, [row for run in runs for row in _exits(*run)])


def _exits(scheme: str, seed: int, times: Floats) -> list[tuple[object, ...]]:
    return [(scheme, seed, k + 1, "" if np.isnan(time) else f"{time:.6f}") for k, time in enumerate(times)]


def room_remarks(settings: PecolSettings, results: list[Evacuations]) -> list[str]:
    """Return the readings behind the flows, and what went wrong."""
    remarks = [
        f"Runs are the draws {settings.seed} to {settings.seed + settings.runs - 1}, the same for every scheme: uniform "
        "random starts without overlap, at rest; a person is out when the center crosses the line of the door."
    ]
    fastest = ", ".join(f"{done.scheme} {done.max_speed:.2f}" for done in results)
    remarks.append(f"Nobody was outside of the plan at any decision; largest speeds [m/s]: {fastest}.")
    for done in results:
        people, runs = done.unfinished
        if people:
            left = f"{people} {'person' if people == 1 else 'people'} in {runs} {'run' if runs == 1 else 'runs'}"
            remarks.append(
                f"{done.scheme}: {left} still inside after {settings.time_limit:g} s, as in a static arch at "
                "the door; slopes are over those who got out."
            )
        if done.unconverged:
            remarks.append(f"{done.scheme}: {done.unconverged} steps did not meet the solver's tolerance.")
    return remarks
