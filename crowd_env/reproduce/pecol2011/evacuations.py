"""The evacuations of section 4.2: the same draws for every scheme."""

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.envs.metrics import share_interval
from crowd_env.envs.rollout import Episode
from crowd_env.reproduce.pecol2011.flow import ESTIMATORS, Estimate, run_slopes
from crowd_env.reproduce.pecol2011.settings import PecolSettings
from crowd_env.reproduce.result import RawTable, Row

# Table 5 of the paper, flows in persons/s; it has one NSM1, we have the two that its text describes.
PRINTED = {"dem": "3.04", "nsm1": "4.65", "nsm1-inertial": "4.65", "nsm2-printed": "2.60"}
EXPERIMENT = "2.67"


class Evacuations:
    """Many evacuations under one scheme.

    Attributes
    ----------
    exit_times : (R, N) s, in the order of leaving; nan for those still inside at the time limit.
    """

    def __init__(self, scheme: str, episodes: Sequence[Episode]) -> None:
        self.scheme, self.episodes = scheme, episodes
        self.exit_times: Floats = np.sort([one.exit_time for one in episodes], axis=1)

    @cached_property
    def slopes(self) -> Floats:
        """Slope of every run (R,) [1/s]."""
        return run_slopes(self.exit_times)

    @cached_property
    def estimates(self) -> dict[str, Estimate]:
        """The flow by every estimator."""
        return {name: estimator.estimate(self.exit_times) for name, estimator in ESTIMATORS.items()}


def of_schemes(runs: Mapping[str, Sequence[Episode]]) -> dict[str, Evacuations]:
    """Return the evacuations by scheme."""
    return {scheme: Evacuations(scheme, episodes) for scheme, episodes in runs.items()}


def flow_rows(done: Evacuations) -> list[Row]:
    """Return the rows of one scheme: every estimator, and who did not get out."""
    rows = []
    for name, estimator in ESTIMATORS.items():
        value, n, sd, ci95 = done.estimates[name]
        quantity = f"flow, {done.scheme}, {name}"
        rows.append(Row(quantity, PRINTED[done.scheme], value, "1/s", n, estimator.reading, sd=sd, ci95=ci95))
    inside = np.isnan(done.exit_times).sum(axis=1)
    runs, where = int((inside > 0).sum()), "at the time limit"
    rows.append(Row(f"left inside, {done.scheme}", None, int(inside.sum()), "people", done.exit_times.size, where))
    share = share_interval(runs, len(inside))
    rows.append(Row(f"unfinished, {done.scheme}", None, runs, "runs", len(inside), where, ci95=share, closes=True))
    return rows


def raw_times(done: Mapping[str, Evacuations]) -> RawTable:
    """Return every exit: scheme, seed of the run, how many are out by then, and when (empty if never)."""
    rows = [
        (scheme, episode.seed, k + 1, "" if np.isnan(time) else f"{time:.6f}")
        for scheme, of_scheme in done.items()
        for episode, times in zip(of_scheme.episodes, of_scheme.exit_times, strict=True)
        for k, time in enumerate(times)
    ]
    return RawTable(("scheme", "seed", "number_out", "time_s"), rows)


def room_remarks(settings: PecolSettings, done: Mapping[str, Evacuations]) -> list[str]:
    """Return the readings behind the flows, and what went wrong."""
    fastest = ", ".join(f"{name} {max(e.metrics.max_speed for e in one.episodes):.2f}" for name, one in done.items())
    remarks = [
        f"{settings.draws_are} the same start for every scheme: uniform, without overlap, at rest; a person is out when the "
        "center crosses the line of the door.",
        f"Largest speeds [m/s]: {fastest}.",
    ]
    for name, one in done.items():
        missed = sum(episode.metrics.unconverged for episode in one.episodes)
        if missed:
            remarks.append(f"{name}: {missed} steps did not meet the solver's tolerance.")
    return remarks
