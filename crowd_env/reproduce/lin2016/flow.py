"""The flow through the exit: Figure 9 of Lin, Ma, Lo in windows of time, and Figure 10 its mean against the desired speed."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.envs.metrics import share_interval
from crowd_env.rendering.canvas import hex_of, name_panel, new_figure, quiet_axes, series
from crowd_env.rendering.libraries import Figure
from crowd_env.rendering.palette import QUIET
from crowd_env.reproduce.evacuations import Case
from crowd_env.reproduce.lin2016.clearance import BLOCKED, SPEEDS
from crowd_env.reproduce.lin2016.sample import Sample, Samples, raw_runs, result, together
from crowd_env.reproduce.lin2016.settings import LinSettings
from crowd_env.reproduce.result import RawTable, Result, Row

# ----------------------------------------------------------------------------------------------------------- Figure 9

_PAPER: dict[str, Any] = {"color": "#efece4", "lw": 0.0, "zorder": 0}
_OTHER_DRAWS: dict[str, Any] = {"color": "#9fb6bb", "lw": 0.7, "zorder": 2}
_FIRST_DRAW: dict[str, Any] = {"color": series(0), "lw": 1.4, "marker": "o", "ms": 2.6, "mew": 0, "zorder": 4}


WINDOW = 10.0  # s  a single window is uncertain by about 0.2 to 0.3 /s
# Speeds [m/s] that the paper puts together, and the lowest and highest flow that it prints for them.
_TOGETHER = {
    "0.6 m/s": ((0.6,), "0.4", "0.6"),
    "1-1.2 m/s": ((1.0, 1.2), "0.3", "1.3"),
    "≥ 1.6 m/s": ((1.6, 2.0), "0", "1.6"),
}
_RANGES = {speed: (float(low), float(high)) for speeds, low, high in _TOGETHER.values() for speed in speeds}


def window_cases(settings: LinSettings) -> dict[tuple[int, float], Case]:
    """Return the draws for each number of people, panels a and b, and speed [m/s]."""
    return {(people, speed): settings.case(people, speed) for people in (100, 300) for speed in _RANGES}


def window_flow(exits: Floats, until: float) -> Floats:
    """Return the flow [1/s] in each window of `WINDOW` seconds from t = 0 on that has begun before ``until`` [s]."""
    edges = WINDOW * np.arange(int(np.ceil(until / WINDOW)) + 1)
    return np.histogram(exits, edges)[0] / WINDOW


def inner_flow(exits: Floats) -> Floats:
    """Return the flow [1/s] in the windows that lie wholly between the first and the last exit."""
    if len(exits) == 0:
        return np.empty(0)
    first, last = int(np.ceil(exits[0] / WINDOW)), int(exits[-1] // WINDOW)
    return window_flow(exits, exits[-1])[first:last]


def windows(settings: LinSettings, found: Samples) -> Result:
    """Return Figure 9, made of a sample for each number of people and speed [m/s]."""
    sections = [_window_rows(found, people, state) for people in (100, 300) for state in _TOGETHER]
    flows = {key: _shown(draws) for key, draws in found.items()}
    raw = RawTable(
        ("people", "desired_speed_mps", "seed", "window_start_s", "flow_per_s"),
        [
            (*key, run.seed, f"{WINDOW * k:g}", f"{flow:.3f}")
            for key, draws in found.items()
            for run, of_run in zip(draws.episodes, flows[key], strict=True)
            for k, flow in enumerate(of_run)
        ],
    )
    return result(settings, found, sections, lambda: window_flows(flows, found), {"windows": raw}, "1/s")


def _window_rows(found: Samples, people: int, state: str) -> list[Row]:
    speeds, low, high = _TOGETHER[state]
    draws = together(found[people, speed] for speed in speeds)
    flows = np.concatenate([inner_flow(exits) for exits in draws.exits])
    counted = f"{draws.blocked or 'none'} of {len(draws.episodes)} runs blocked"
    some, label = len(flows) > 0, f"{people} at {state}"
    values = (*np.percentile(flows, [5, 95]), flows.mean()) if some else (None, None, None)
    least, most = (f"; least {flows.min():.1f}", f"; most {flows.max():.1f}") if some else ("", "")
    return [
        Row(f"lowest, {label}", low, values[0], "1/s", len(flows), f"5th percentile{least}; {counted}"),
        Row(f"highest, {label}", high, values[1], "1/s", len(flows), f"95th percentile{most}; {counted}"),
        Row(f"mean, {label}", None, values[2], "1/s", len(flows), f"of the windows; {counted}"),
    ]


def _shown(draws: Sample) -> list[Floats]:
    """Return the flow of every draw in all windows until the last one got out, or until the exit was given up as blocked."""
    return [
        window_flow(exits, exits[-1] if since is None and len(exits) else (since or 0.0) + 120.0)
        for exits, since in zip(draws.exits, draws.blocked_since, strict=True)
    ]


def window_flows(flows: Mapping[tuple[int, float], Sequence[Floats]], found: Samples) -> Figure:
    """Return the flow in windows of time, a column a crowd and a row a speed.

    ``flows`` [1/s] are of every draw in each window, by number of people and desired speed [m/s].
    """
    crowds, speeds = sorted({people for people, _ in flows}), list(_RANGES)
    figure = new_figure((10.6, 1.5 + 1.42 * len(speeds)))
    grid = figure.subplots(len(speeds), len(crowds), sharex="col", sharey=True, squeeze=False)
    for (row, column), axes in np.ndenumerate(grid):
        people, speed = crowds[column], speeds[row]
        draws, lost = flows[people, speed], found[people, speed].blocked
        quiet_axes(axes, "time [s]" if row == len(speeds) - 1 else "", "people/s" if column == 0 else "", grid=True)
        axes.axhspan(*_RANGES[speed], **_PAPER, label="paper, range in its text")
        for k, flow in enumerate(draws):
            label = {0: f"first draw, windows of {WINDOW:g} s", 1: f"the other {len(draws) - 1}"}.get(k)
            style = _OTHER_DRAWS if k else _FIRST_DRAW
            axes.plot(WINDOW * (np.arange(len(flow)) + 0.5), flow, label=label, **style)
        text = f"{speed:g} m/s" + (f", {lost} of {len(draws)} blocked" if lost else "")
        color = BLOCKED if lost else "black"
        axes.text(0.995, 0.97, text, transform=axes.transAxes, ha="right", va="top", fontsize=9.5, color=color)
        axes.set(xlim=(0.0, None), ylim=(-0.06, 2.0))
        if row == 0:
            name_panel(axes, f"{'abc'[column]}. {people} people")
    lines = grid[0, 0].get_legend_handles_labels()
    figure.legend(*lines, loc="outside upper center", ncols=3, frameon=False, fontsize=9.5)
    return figure


# ---------------------------------------------------------------------------------------------------------- Figure 10

_CROWDS = (100, 200, 300)  # people
# Name, from speed, to speed [m/s], color.
_STATES = (
    ("smooth", 0.6, 1.0, "#eef5f2"),
    ("transition", 1.0, 1.6, "#f7f4ec"),
    ("phase separation", 1.6, 2.1, "#f8ebe9"),
)
_IN_TRANSITION = ("0.82", "0.7", "0.95")  # 1/s  mean, lowest and highest as printed
_FASTEST = "1.22"  # 1/s, above 1.6 m/s
_PAPER_RANGE: dict[str, Any] = {"facecolor": "none", "edgecolor": "#c9c2ae", "hatch": "////", "lw": 0.0}


def mean_cases(settings: LinSettings) -> dict[tuple[int, float], Case]:
    """Return the draws for each number of people and speed [m/s]."""
    return {(people, speed): settings.case(people, speed) for people in _CROWDS for speed in SPEEDS}


def means(settings: LinSettings, found: Samples) -> Result:
    """Return Figure 10, made of a sample for each number of people and speed [m/s]."""
    sections = [*(_mean_rows(found, people) for people in _CROWDS), _state_rows(found)]
    return result(settings, found, sections, lambda: mean_flows(found), {"runs": raw_runs(found)}, "1/s")


def _mean_rows(found: Samples, people: int) -> list[Row]:
    rows = []
    for speed in SPEEDS:
        draws = found[people, speed]
        flows = draws.mean_flows
        spread = f"median, {flows.min():.2f} to {flows.max():.2f}; " if len(flows) > 1 else ""
        value = float(np.median(flows)) if len(flows) else None
        low, high = share_interval(draws.blocked, len(draws.episodes))
        reading = f"{spread}{draws.count_blocked()} (95 %: {100 * low:.0f} to {100 * high:.0f} %)"
        rows.append(Row(f"flow, {people} at {speed:.1f} m/s", None, value, "1/s", len(flows), reading))
    return rows


def _pooled(found: Samples, low: float, high: float) -> tuple[Floats, int]:
    """Return the flows of the draws that cleared at speeds in [low, high], and how many blocked."""
    some = together(draws for (_, speed), draws in found.items() if low <= speed <= high)
    return some.mean_flows, some.blocked


def _state_rows(found: Samples) -> list[Row]:
    """Return the rows of the transition and of what is faster."""
    flows, lost = _pooled(found, 1.0, 1.6)
    values = (flows.mean(), flows.min(), flows.max()) if len(flows) else (None, None, None)
    counted = f"of the draws that cleared; {lost or 'none'} of {lost + len(flows)} blocked"
    names, readings = ("mean", "lowest", "highest"), (counted, "draw that cleared", "draw that cleared")
    rows = [
        Row(f"{name}, 1.0 to 1.6 m/s", paper, value, "1/s", len(flows), reading)
        for name, paper, value, reading in zip(names, _IN_TRANSITION, values, readings, strict=True)
    ]
    flows, lost = _pooled(found, 1.7, np.inf)
    most, of = flows.max() if len(flows) else None, lost + len(flows)
    reading = f"paper: from 1.22 /s to zero; {lost or 'none'} of {of} blocked"
    return [
        *rows,
        Row("highest, above 1.6 m/s", _FASTEST, most, "1/s", len(flows), "draw that cleared"),
        Row("blocked, above 1.6 m/s", None, lost / of, "share", of, reading, ci95=share_interval(lost, of)),
    ]


def mean_flows(found: Samples) -> Figure:
    """Return the mean flow of every draw against the desired speed, and what blocked."""
    figure = new_figure((8.4, 6.2))
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3.2, 1.0])
    quiet_axes(upper, "", "mean flow of those that cleared [people/s]", grid=True)
    quiet_axes(lower, "desired speed [m/s]", "draws blocked", grid=True)
    for name, low, high, color in _STATES:
        for axes in (upper, lower):
            axes.axvspan(low, high, color=color, lw=0.0, zorder=0)
        middle, transform = 0.5 * (low + high), upper.get_xaxis_transform()
        upper.text(middle, 0.985, name, transform=transform, ha="center", va="top", fontsize=10, color=hex_of(QUIET))
    transition, (mean, low, high) = _STATES[1][1:3], map(float, _IN_TRANSITION)
    upper.fill_between(transition, low, high, **_PAPER_RANGE, label=f"paper, {low:g} to {high:g}")
    upper.plot(transition, [mean] * 2, "k--", lw=1.4, label=f"paper, average {mean:g}")
    crowds = sorted({people for people, _ in found})
    for k, people in enumerate(crowds):
        draws = {speed: sample for (of, speed), sample in found.items() if of == people}
        aside = 0.022 * (k - 0.5 * (len(crowds) - 1))
        flows = [(speed + aside, flow) for speed, sample in draws.items() for flow in sample.mean_flows]
        medians = [(speed + aside, np.median(one.mean_flows)) for speed, one in draws.items() if len(one.cleared)]
        upper.plot(*np.reshape(flows, (-1, 2)).T, "o", color=series(k), alpha=0.3, ms=4, mew=0)
        label = f"{people} people, median"
        upper.plot(*np.reshape(medians, (-1, 2)).T, "-o", color=series(k), mec="white", label=label)
        share = [sample.blocked / len(sample.episodes) for sample in draws.values()]
        lower.bar([speed + 0.032 * (k - 1) for speed in draws], share, width=0.028, color=series(k), zorder=3)
    upper.set_ylim(bottom=0.0)
    lower.set_ylim(0.0, 1.04)
    upper.legend(frameon=False, fontsize=9.5, loc="lower left", ncols=2)
    return figure
