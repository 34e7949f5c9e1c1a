"""The room of section 4.2: Figure 3 and Table 5, from the same draws for every scheme."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.envs.metrics import share_interval
from crowd_env.envs.rollout import Episode
from crowd_env.rendering.canvas import hex_of, new_figure, quiet_axes, series
from crowd_env.rendering.libraries import Figure
from crowd_env.rendering.palette import INK, QUIET
from crowd_env.reproduce.pecol2011.flow import ESTIMATORS, pooled_line, run_slopes
from crowd_env.reproduce.pecol2011.settings import PecolSettings
from crowd_env.reproduce.result import Estimate, RawTable, Result, Row

# How the paper's values are marked.
PAPER_MARK: dict[str, Any] = {"marker": "D", "ls": "", "mfc": "white", "mec": "black", "mew": 1.5, "ms": 7}

# Table 5 of the paper, flows in persons/s; it has one NSM1, we have the two that its text describes.
PRINTED = {"dem": "3.04", "nsm1": "4.65", "nsm1-inertial": "4.65", "nsm2-printed": "2.60"}
EXPERIMENT = "2.67"


class Evacuations:
    """Many evacuations under one scheme.

    Attributes
    ----------
    exit_times : (R, N) s, in the order of leaving; nan for a pedestrian inside at the time limit.
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


def flow_rows(done: Evacuations) -> list[Row]:
    """Return the rows of one scheme: every estimator, and how many were left inside."""
    rows = []
    for name, estimator in ESTIMATORS.items():
        value, n, sd, ci95 = done.estimates[name]
        quantity = f"flow, {done.scheme}, {name}"
        rows.append(Row(quantity, PRINTED[done.scheme], value, "1/s", n, estimator.reading, sd=sd, ci95=ci95))
    inside = np.isnan(done.exit_times).sum(axis=1)
    runs, where = int((inside > 0).sum()), "at the time limit"
    rows.append(Row(f"left inside, {done.scheme}", None, int(inside.sum()), "people", done.exit_times.size, where))
    share = share_interval(runs, len(inside))
    rows.append(Row(f"unfinished, {done.scheme}", None, runs, "runs", len(inside), where, ci95=share))
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


# --------------------------------------------------------------------------------------------------------- Figure 3


def fig3(settings: PecolSettings, runs: Mapping[str, Sequence[Episode]]) -> Result:
    """Return Figure 3."""
    ((scheme, episodes),) = runs.items()
    one = Evacuations(scheme, episodes)
    done = {scheme: one}
    slope, start, exits = pooled_line(one.exit_times)
    remarks = [
        f"The line drawn is {slope:.2f} /s · t {start:+.2f}, least squares through {exits} exits; the paper does not say which "
        "exits its regression uses, and draws this figure for NSM2 only.",
        *room_remarks(settings, done),
    ]
    title = f"{scheme.upper()}, door {100 * settings.door_width:g} cm, {len(one.exit_times)} runs of {settings.people}"
    printed, raw = f"paper {PRINTED[scheme]}", {"exit-times": raw_times(done)}

    def draw() -> Figure:
        return exits_against_time(one.exit_times, slope, start, title, printed)

    return Result([flow_rows(one)], raw, draw, remarks, "1/s", of=scheme)


def exits_against_time(exit_times: Floats, slope: float, start: float, title: str, printed: str) -> Figure:
    """Return how many are out against time, every run light, and one regression line (Figure 3).

    Parameters
    ----------
    exit_times : (R, N) s, nan for a pedestrian still inside.
    slope, start : of the line, 1/s and people at t = 0; nan draws none.
    printed : what the paper says to it.
    """
    figure = new_figure((6.6, 4.6))
    axes = quiet_axes(figure.add_subplot(), "time [s]", "pedestrians out", title=title)
    people, known = exit_times.shape[1], exit_times[np.isfinite(exit_times)]
    # By then nearly all are out: one stray at the time limit must not squeeze the rest.
    end = 1.04 * float(min(known.max(), 2.0 * np.percentile(known, 99.0))) if len(known) else 1.0
    for k, times in enumerate(np.sort(exit_times, axis=1)):
        out = np.append(times[np.isfinite(times)], end)  # people inside at the end stay
        count = np.minimum(np.arange(1.0, len(out) + 1.0), len(out) - 1)
        label = f"{len(exit_times)} simulations" if k == 0 else None
        axes.plot(out, count, color="#b4b9bf", lw=0.9, alpha=0.8, label=label, zorder=2)
    if np.isfinite(slope):
        label = f"linear regression, {slope:.2f} /s ({printed} /s)"
        axes.plot([0.0, end], [start, start + slope * end], color="black", lw=2.0, label=label, zorder=3)
    axes.set(xlim=(0.0, end), ylim=(0.0, 1.04 * people))
    axes.legend(frameon=False, fontsize=9.5, loc="lower right")
    return figure


# ---------------------------------------------------------------------------------------------------------- Table 5

SCHEMES = tuple(PRINTED)
# The paper's order, the same with the NSM1 of its section 3, and in pairs.
_ORDERS = (
    ("nsm1", "dem", "nsm2-printed"),
    ("nsm1-inertial", "dem", "nsm2-printed"),
    ("nsm1", "dem"),
    ("nsm1-inertial", "dem"),
    ("dem", "nsm2-printed"),
)


def table5(settings: PecolSettings, runs: Mapping[str, Sequence[Episode]]) -> Result:
    """Return Table 5."""
    done = {scheme: Evacuations(scheme, episodes) for scheme, episodes in runs.items()}
    orders = []
    for order in _ORDERS:
        share, n = order_share(done, order)
        reading = "slopes of the same draw compared"
        orders.append(Row(f"draws with {' > '.join(order)}", None, share, "share", n, reading))
    quoted = "Helbing et al. 2005, quoted; not simulated"
    experiment = Row("flow, experiment imitating panic", EXPERIMENT, None, "1/s", 0, quoted)
    sections = [*map(flow_rows, done.values()), orders, [experiment]]
    remarks = [
        "The paper does not say which exits it regresses: the rows are readings that it can mean. Those that cut in time raise "
        "a slope.",
        *room_remarks(settings, done),
    ]
    door = f"a door of {100 * settings.door_width:g} cm"
    title = f"Flow through {door}, {settings.runs} draws of {settings.people} people"
    raw = {"exit-times": raw_times(done)}
    return Result(sections, raw, lambda: flows(done, title), remarks, "1/s")


def order_share(done: Mapping[str, Evacuations], order: tuple[str, ...]) -> tuple[float | None, int]:
    """Return the share of draws whose slopes come in this order, and the number of draws that have all of them."""
    slopes = np.array([done[name].slopes for name in order])
    slopes = slopes[:, np.isfinite(slopes).all(axis=0)]
    if slopes.shape[1] == 0:
        return None, 0
    return float((np.diff(slopes, axis=0) < 0).all(axis=0).mean()), slopes.shape[1]


def flows(done: Mapping[str, Evacuations], title: str) -> Figure:
    """Return the flow of every run under every scheme, its mean, and the paper's value (Table 5)."""
    figure = new_figure((7.6, 5.0))
    axes = quiet_axes(figure.add_subplot(), "", "flow through the door [persons/s]", title=title, grid=True)
    rng = np.random.default_rng(0)  # for offsets sideways, which keep points of similar value apart
    axes.axhline(float(EXPERIMENT), color=hex_of(QUIET), dashes=(4, 3), zorder=1, label=f"experiment {EXPERIMENT}")
    labels: tuple[str | None, ...] = (
        "one draw",
        "mean of the draws, 95 % interval",
        "other estimators",
        "paper, Table 5",
    )
    for k, (name, evacuations) in enumerate(done.items()):
        color, slopes = series(k), evacuations.slopes[np.isfinite(evacuations.slopes)]
        aside = k - 0.16 + rng.uniform(-0.13, 0.13, len(slopes))
        axes.plot(aside, slopes, ".", color=color, alpha=0.45, markersize=6, mew=0, zorder=2, label=labels[0])
        others = dict(evacuations.estimates)
        mean = others.pop("per run")
        if mean.value is not None:
            low, high = mean.ci95 or (mean.value, mean.value)
            bar = [[mean.value - low], [high - mean.value]]
            axes.errorbar(k + 0.12, mean.value, bar, fmt="o", color=color, ms=7, capsize=4, zorder=4, label=labels[1])
        values = [estimate.value for estimate in others.values() if estimate.value is not None]
        axes.plot(np.full(len(values), k + 0.24), values, "_", color=color, markersize=11, zorder=3, label=labels[2])
        axes.plot(k + 0.37, float(PRINTED[name]), **PAPER_MARK, zorder=5, label=labels[3])
        labels = (None,) * 4  # once is enough
    axes.set_xticks(range(len(done)), [_SPOKEN[name] for name in done], fontsize=10, color=hex_of(INK))
    axes.set_ylim(bottom=0.0)
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return figure


_SPOKEN = {"dem": "DEM", "nsm1": "NSM1\nspontaneous", "nsm1-inertial": "NSM1\ninertial", "nsm2-printed": "NSM2"}
