"""The evacuations of section 4.2: the same draws for every scheme."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from crowd_env.env import CrowdEnv
from crowd_env.reproduce.flow import ESTIMATORS, Estimate, run_slopes
from crowd_env.reproduce.result import Progress, RawTable, Row
from crowd_env.reproduce.settings import Settings
from crowd_env.state import Floats

# Table 5 of the paper, flows in persons/s; it has one NSM1, we have the two that its text describes.
PRINTED = {"dem": "3.04", "nsm1": "4.65", "nsm1-inertial": "4.65", "nsm2-printed": "2.60"}
EXPERIMENT = "2.67"

_AT_ONCE = 50  # environments in a batch
_PEOPLE_AT_ONCE = 2000


@dataclass(frozen=True, eq=False)
class Evacuations:
    """Many evacuations under one scheme."""

    scheme: str
    exit_times: Floats  # (R, N) s, in the order of leaving; nan for those still inside at the time limit
    unconverged: int  # physics steps whose solve missed its tolerance

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


def evacuate(settings: Settings, scheme: str, progress: Progress) -> Evacuations:
    """Run the draws ``seed`` to ``seed + runs - 1`` under a scheme, everyone walking the shortest path.

    They are the draws of ``crowd-env run``.
    """
    place, times, unconverged = settings.place(), [], 0
    at_once = max(1, min(_AT_ONCE, _PEOPLE_AT_ONCE // settings.n))
    decision = settings.dt * max(1, round(0.1 / settings.dt))  # how often we look; the rule does not depend on it
    env = None
    for begin in range(0, settings.runs, at_once):
        seeds = list(range(settings.seed + begin, settings.seed + min(begin + at_once, settings.runs)))
        if env is None or env.num_envs != len(seeds):
            env = CrowdEnv(
                place,
                num_envs=len(seeds),
                scheme=settings.contact(scheme),
                dt=settings.dt,
                decision_dt=decision,
            )
        env.reset(seeds)
        while not env.finished.all():
            ended = env.step(None).info["finished"]
            if ended.any():
                progress(int(ended.sum()))
        times.append(np.sort(env.simulation.state.exit_time.reshape(len(seeds), -1), axis=1))
        unconverged += int(env.simulation.diagnostics.unconverged.sum())
    return Evacuations(scheme, np.concatenate(times), unconverged)


def flow_rows(done: Evacuations) -> list[Row]:
    """Return the rows of one scheme: every estimator, and who did not get out."""
    rows = []
    for name, estimator in ESTIMATORS.items():
        value, n, sd, ci95 = done.estimates[name]
        quantity = f"flow, {done.scheme}, {estimator.label}"
        rows.append(Row(quantity, PRINTED[done.scheme], value, "1/s", n, estimator.reading, sd=sd, ci95=ci95))
    people, runs = done.unfinished
    where = "at the time limit"
    rows.append(Row(f"left inside, {done.scheme}", None, people, "people", done.exit_times.size, where))
    rows.append(Row(f"unfinished, {done.scheme}", None, runs, "runs", len(done.exit_times), where, closes=True))
    return rows


def raw_times(settings: Settings, results: list[Evacuations]) -> RawTable:
    """Return every exit: scheme, seed of the run, how many are out by then, and when (empty if never)."""
    rows = []
    for done in results:
        for k, run in enumerate(done.exit_times):
            for place, time in enumerate(run):
                rows.append((done.scheme, settings.seed + k, place + 1, "" if np.isnan(time) else f"{time:.6f}"))
    return RawTable(("scheme", "seed", "number_out", "time_s"), rows)


def room_remarks(settings: Settings, results: list[Evacuations]) -> list[str]:
    """Return the readings behind the flows, and what went wrong."""
    remarks = [
        f"Runs are the draws {settings.seed} to {settings.seed + settings.runs - 1}, the same for every scheme: uniform "
        "random starts without overlap, at rest; a person is out when the centre crosses the line of the door."
    ]
    for done in results:
        people, runs = done.unfinished
        if people:
            remarks.append(
                f"{done.scheme}: {_counted(people, 'person', 'people')} in {_counted(runs, 'run', 'runs')} still inside after "
                f"{settings.time_limit:g} s, as in a static arch at the door; slopes are over those who got out."
            )
        if done.unconverged:
            remarks.append(f"{done.scheme}: {done.unconverged} steps did not meet the solver's tolerance.")
    return remarks


def _counted(count: int, one: str, many: str) -> str:
    return f"{count} {one if count == 1 else many}"
