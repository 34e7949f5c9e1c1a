"""Many evacuations under the rule, and what they amount to."""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np

from crowd_env.envs.crowd import CrowdEnv
from crowd_env.envs.metrics import EpisodeMetrics, share_interval, summarise
from crowd_env.physics import ContactScheme, make_scheme
from crowd_env.scenarios.scenario import Scenario

# People simulated side by side: enough to fill a call, few enough to show progress.
_PEOPLE_AT_ONCE = 2000
_RUNS_AT_ONCE = 50

Found = TypeVar("Found")


class RunsInterrupted(KeyboardInterrupt):
    """Ctrl-C in the middle of many runs.

    Attributes
    ----------
    finished : number of each run that was finished by then -> what it amounted to.
    asked : how many runs were to be made.
    """

    def __init__(self, finished: dict[int, Any], asked: int) -> None:
        super().__init__(f"{len(finished)} of {asked} runs are finished")
        self.finished, self.asked = finished, asked


def finished_runs(
    scenario: Scenario,
    runs: int,
    read: Callable[[CrowdEnv, int], Found],
    *,
    seed: int = 0,
    threads: int = 1,
    progress: Callable[[int], object] | None = None,
    **options: Any,
) -> list[Found]:
    """Run ``runs`` evacuations without anyone's actions and return what ``read`` says of each; run k is the draw ``seed + k``.

    Parameters
    ----------
    read : called with an environment and the row there of a run that is over.
    threads : see `crowd_env.envs.crowd.CrowdEnv`; at most one a run.
    progress : called with the number of runs that have just finished.
    **options : of `crowd_env.envs.crowd.CrowdEnv`.

    Raises
    ------
    ValueError
        If the number of runs or the seed is out of range, or the crowd does not fit.
    RunsInterrupted
        On Ctrl-C, with what was finished by then.
    """
    if runs < 1:
        raise ValueError(f"runs is {runs}; it must be at least 1")
    if seed < 0:
        raise ValueError(f"seed is {seed}; it must be >= 0")
    found: dict[int, Found] = {}
    at_once = max(1, min(_RUNS_AT_ONCE, _PEOPLE_AT_ONCE // scenario.population.count))
    env, begin, under_way = None, 0, False
    try:
        for begin in range(0, runs, at_once):
            seeds = list(range(seed + begin, seed + min(begin + at_once, runs)))
            if env is None or env.num_envs != len(seeds):
                env = CrowdEnv(scenario, num_envs=len(seeds), threads=min(threads, len(seeds)), **options)
            env.reset(seeds)
            under_way = True
            while not env.finished.all():
                ended = env.step(None).info["finished"]
                if progress is not None and ended.any():
                    progress(int(ended.sum()))
            found |= {begin + e: read(env, e) for e in range(len(seeds))}
            under_way = False
    except KeyboardInterrupt:
        if env is not None and under_way:
            found |= {begin + int(e): read(env, int(e)) for e in np.flatnonzero(env.finished)}
        raise RunsInterrupted(found, runs) from None
    return list(found.values())


def run_rule(
    scenario: Scenario,
    scheme: str | ContactScheme,
    runs: int,
    *,
    seed: int = 0,
    dt: float | None = None,
    decision_dt: float = 0.1,
    strategy: str = "shortest",
    rules: bool = True,
    progress: Callable[[int], object] | None = None,
) -> list[EpisodeMetrics]:
    """Run ``runs`` evacuations in which everyone walks as the strategy says; run ``k`` is the draw ``seed + k``.

    Parameters
    ----------
    strategy, rules : see `crowd_env.scenarios.scenario.Scenario.ways`.
    progress : called with the number of runs that have just finished.

    Raises
    ------
    ValueError
        If the number of runs or the seed is out of range, or the crowd does not fit.
    RunsInterrupted
        On Ctrl-C, with what was finished by then.
    """
    options: dict[str, Any] = {"scheme": scheme, "dt": dt, "decision_dt": decision_dt, "strategy": strategy}
    return finished_runs(scenario, runs, CrowdEnv.metrics, seed=seed, progress=progress, rules=rules, **options)


def report(
    scenario: Scenario,
    scheme: str | ContactScheme,
    episodes: Sequence[EpisodeMetrics],
    numbers: Sequence[int] | None = None,
) -> dict[str, Any]:
    """Return the figures of many evacuations, ready for JSON: times in s, flow in 1/s, lengths in mm, residual in m/s.

    ``numbers`` are those of the runs, 0, 1, ... by default.
    ``blocked`` lists the runs in which the exits blocked: the number of the run, since when [s], and how many were left.
    ``evacuation_time`` and ``flow`` (per-run least-squares slopes) are over the runs in which everyone, or at least three
    people, got out; ``overlap_mm.mean`` is the mean over runs of the mean over all overlapping contacts of a run;
    ``outside_mm`` is the furthest that any body reached beyond a wall.  The shares of runs in which someone was left inside,
    and in which the exits blocked, have Wilson's interval.
    """

    def column(name: str) -> np.ndarray:
        return np.array([getattr(episode, name) for episode in episodes], dtype=np.float64)

    def share(count: int) -> dict[str, Any]:
        return {"mean": count / len(episodes), "ci95": list(share_interval(count, len(episodes)))}

    left, stuck = (int(np.count_nonzero(runs)) for runs in (column("unfinished"), np.isfinite(column("blocked_since"))))
    time, flow = summarise(column("evacuation_time")), summarise(column("flow"))
    return {
        "scenario": scenario.name,
        "scheme": make_scheme(scheme).info.name,
        "runs": len(episodes),
        "people": scenario.population.count,
        "unfinished": int(column("unfinished").sum()),
        "unfinished_runs": left,
        "unfinished_share": share(left),
        "blocked_share": share(stuck),
        "blocked": [
            {"run": k, "since": episode.blocked_since, "left": episode.unfinished}
            for k, episode in zip(numbers or range(len(episodes)), episodes, strict=True)
            if np.isfinite(episode.blocked_since)
        ],
        "evacuation_time": {"mean": _json(time.mean), "sd": _json(time.sd), "ci95": [_json(x) for x in time.ci95]},
        "flow": {"mean": _json(flow.mean), "sd": _json(flow.sd)},
        "overlap_mm": {
            "mean": 1e3 * float(column("mean_overlap").mean()),
            "max": 1e3 * float(column("max_overlap").max()),
        },
        "outside_mm": 1e3 * float(column("max_outside").max()),
        "max_speed": float(column("max_speed").max()),
        "escaped": int(column("escaped").sum()),
        "residual": float(column("residual").max()),
        "unconverged_steps": int(column("unconverged").sum()),
    }


def _json(value: float) -> float | None:
    """JSON knows no nan."""
    return None if np.isnan(value) else value
