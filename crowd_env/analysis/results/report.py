"""Figures of many evacuations, ready for JSON."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from crowd_env.analysis.results.plain import plain
from crowd_env.core.arrays.headway import Manner, plain_manner
from crowd_env.core.arrays.outline import BodyShape, plain_outline
from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.core.checks import counted
from crowd_env.core.files.json_file import json_number
from crowd_env.core.version import __version__
from crowd_env.envs.metrics import EpisodeMetrics, flow_slope, share_interval, summarise
from crowd_env.envs.rollout import Episode
from crowd_env.geometry.geometry import Geometry
from crowd_env.physics import ContactScheme, make_scheme
from crowd_env.scenarios.scenario import Scenario

_NEARLY_ALL = 0.95  # of the people, for T95
# 1/(s m)  What crowds of experiments reach at doors is below.
HIGHEST_FLOW = 2.8


def report(
    scenario: Scenario,
    scheme: str | ContactScheme,
    episodes: Sequence[Episode],
    manner: Manner | None = None,
    outline: BodyShape | None = None,
    *,
    dt: float | None = None,
    strategy: str = "shortest",
) -> dict[str, Any]:
    """Return the figures of many evacuations, ready for JSON: times in s, flow in 1/s, lengths in mm, residual in m/s.

    ``manner``, ``outline``, ``dt`` [s] and ``strategy`` are those of the run, by default the scenario's or the scheme's.

    ``blocked`` lists the runs in which the exits blocked: the number of the run, since when [s], and how many were left.
    ``evacuation_time``, ``t95`` (95 % of the people are out) and ``flow`` (per-run least-squares slopes) are over the runs in
    which everyone, so many, or at least three people, got out; ``mean_exit_time`` is the mean over runs of the mean over those
    who got out; ``exits`` are those of `exits_of`;
    ``overlap_mm.mean`` is the mean over runs of the mean over all overlapping contacts of a run; ``outside_mm`` is the furthest
    that any body reached beyond a wall.  The shares of runs in which someone was left inside, and in which the exits blocked,
    have Wilson's interval.
    """
    metrics = [episode.metrics for episode in episodes]
    chosen = make_scheme(scheme)
    return {
        "scenario": scenario.name,
        "scheme": chosen.info.name,
        "manner": plain_manner(scenario.manner_of_run(manner)),
        "outline": plain_outline(scenario.outline_of_run(outline)),
        "strategy": strategy,
        "seed": episodes[0].seed - episodes[0].run,
        "dt": chosen.info.default_dt if dt is None else dt,
        "time_limit": episodes[0].time_limit,
        "version": __version__,
        "people": scenario.population.people,
        "population": plain(scenario.population.parts),
        **figures_of(metrics),
        "mean_exit_time": named(column(metrics, "mean_exit_time")),
        "t95": named(np.array([time_of_share(episode.exit_time, _NEARLY_ALL) for episode in episodes])),
        "exits": exits_of(scenario, episodes),
        "blocked": [
            {"run": episode.run, "since": episode.metrics.blocked_since, "left": episode.metrics.unfinished}
            for episode in episodes
            if np.isfinite(episode.metrics.blocked_since)
        ],
        "overlap_mm": {
            "mean": 1e3 * float(column(metrics, "mean_overlap").mean()),
            "max": 1e3 * float(column(metrics, "max_overlap").max()),
        },
        "outside_mm": 1e3 * float(column(metrics, "max_outside").max()),
        "residual": float(column(metrics, "residual").max()),
        "unconverged_steps": int(column(metrics, "unconverged").sum()),
    }


def time_of_share(exit_time: Floats, share: float) -> float:
    """Return when at least this share of the people were out [s]; nan if they never were.

    ``exit_time`` (N,) [s] is nan for people who did not get out.
    """
    count = max(int(np.ceil(share * len(exit_time) - 1e-9)), 1)
    return float(np.sort(exit_time)[count - 1])  # nan go last


def exit_names(scenario: Scenario, exit_index: Ints) -> np.ndarray:
    """Return the name of the exit that each person took (N,); "" for people who did not get out."""
    return np.array([*scenario.geometry.exit_names, ""])[exit_index]  # row -1 is the last


def exits_of(scenario: Scenario, episodes: Sequence[Episode]) -> dict[str, Any]:
    """Return figures of each exit, ready for JSON.

    ``people`` took it in all runs, ``share`` is of those who got out in a run, ``flow_per_meter`` is its flow over its
    width [1/(s m)].
    """
    taken = [exit_names(scenario, episode.exit_index) for episode in episodes]
    out = np.array([(names != "").sum() for names in taken])
    found = {}
    for name, width in exit_widths(scenario.geometry).items():
        count = np.array([(names == name).sum() for names in taken])
        of_run = np.divide(count, out, out=np.full(len(out), np.nan), where=out > 0)
        flows = [flow_slope(one.exit_time[names == name]) / width for one, names in zip(episodes, taken, strict=True)]
        found[name] = {"people": int(count.sum()), "share": named(of_run), "flow_per_meter": named(np.array(flows))}
    return found


def exit_widths(geometry: Geometry) -> dict[str, float]:
    """Return the width of each exit by its name [m]."""
    widths: dict[str, float] = {}
    for name, (a, b) in zip(geometry.exit_names, geometry.exits, strict=True):
        widths[name] = widths.get(name, 0.0) + float(np.hypot(*(b - a)))
    return widths


def doubts(figures: Mapping[str, Any]) -> str:
    """Return in one sentence what makes the figures of a `report` doubtful; "" if nothing does."""
    fast = {name: taken["flow_per_meter"]["mean"] or 0.0 for name, taken in figures["exits"].items()}
    said = [
        f"{flow:.1f} people per second and meter pass exit {name}, more than the {HIGHEST_FLOW:g} that experiments found"
        for name, flow in fast.items()
        if flow > HIGHEST_FLOW
    ]
    if figures["unfinished"]:
        left, cut = figures["unfinished"], figures["unfinished_runs"] - figures["blocked_runs"]
        said.append(f"{counted(left, 'person is', 'people are')} left inside")
        if cut:
            said.append(f"{counted(cut, 'run was', 'runs were')} cut by the time limit")
    if "interrupted_of" in figures:
        said.append(f"only {figures['runs']} of {figures['interrupted_of']} runs were finished")
    return "; ".join(said)


def figures_of(metrics: Sequence[EpisodeMetrics]) -> dict[str, Any]:
    """Return the figures that every report of many evacuations has, ready for JSON; see `report`."""
    runs, unfinished = len(metrics), column(metrics, "unfinished")
    left, blocked = int((unfinished > 0).sum()), int(np.isfinite(column(metrics, "blocked_since")).sum())
    return {
        "runs": runs,
        "unfinished": int(unfinished.sum()),
        "unfinished_runs": left,
        "unfinished_share": share(left, runs),
        "blocked_runs": blocked,
        "blocked_share": share(blocked, runs),
        "evacuation_time": named(column(metrics, "evacuation_time")),
        "flow": named(column(metrics, "flow")),
        "max_speed": float(column(metrics, "max_speed").max()),
        "escaped": int(column(metrics, "escaped").sum()),
    }


def column(metrics: Sequence[EpisodeMetrics], name: str) -> Floats:
    """Return one of the metrics of every evacuation (R,)."""
    return np.array([getattr(one, name) for one in metrics], dtype=np.float64)


def named(values: np.ndarray) -> dict[str, Any]:
    """Return mean, spread and interval of the mean of the finite values, ready for JSON."""
    mean, sd, ci95 = summarise(values)
    return {"mean": json_number(mean), "sd": json_number(sd), "ci95": [json_number(bound) for bound in ci95]}


def share(count: int, of: int) -> dict[str, Any]:
    """Return a share with its Wilson interval, ready for JSON."""
    return {"mean": count / of, "ci95": list(share_interval(count, of))}
