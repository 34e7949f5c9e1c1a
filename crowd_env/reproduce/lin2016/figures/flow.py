"""Figures in the form of those of Lin, Ma, Lo about the flow through the exit."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.rendering.canvas import hex_of, mark, name_panel, new_figure, quiet_axes, series
from crowd_env.rendering.palette import INK, QUIET
from crowd_env.reproduce.lin2016.figures.clearance import BLOCKED
from crowd_env.reproduce.lin2016.sample import Samples

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PAPER = "#efece4"
_OTHER_DRAWS = "#9fb6bb"
_PAPER_RANGE: dict[str, Any] = {"facecolor": "none", "edgecolor": "#c9c2ae", "hatch": "////", "lw": 0.0}
_PAPER_MEAN: dict[str, Any] = {"color": "black", "lw": 1.4, "dashes": (4, 3)}


def window_flows(
    flows: Mapping[tuple[int, float], Sequence[Floats]],
    blocked: Mapping[tuple[int, float], int],
    paper: Mapping[float, tuple[float, float]],
    window: float,
) -> "Figure":
    """Return the flow in windows of time (Figure 9), a column a crowd and a row a speed.

    Parameters
    ----------
    flows : (people, desired speed [m/s]) -> for every draw, the flow in each window [1/s].
    blocked : (people, desired speed) -> number of draws that blocked.
    paper : speed -> range of the flow that the paper prints [1/s].
    window : s.
    """
    crowds, speeds = sorted({people for people, _ in flows}), list(paper)
    figure = new_figure((10.6, 1.5 + 1.42 * len(speeds)))
    grid = figure.subplots(len(speeds), len(crowds), sharex="col", sharey=True, squeeze=False)
    for (row, column), axes in np.ndenumerate(grid):
        people, speed = crowds[column], speeds[row]
        draws, lost = flows[people, speed], blocked[people, speed]
        quiet_axes(axes, "time [s]" if row == len(speeds) - 1 else "", "people/s" if column == 0 else "", grid=True)
        _windows(axes, draws, window, paper[speed])
        label = f"{speed:g} m/s" + (f", {lost} of {len(draws)} blocked" if lost else "")
        axes.text(
            0.995, 0.97, label, transform=axes.transAxes, ha="right", va="top", fontsize=9.5, fontweight="bold",
            color=BLOCKED if lost else hex_of(INK),
            bbox={"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1},
        )  # fmt: skip
        axes.set_xlim(left=0.0)
        axes.set_ylim(-0.06, 2.0)
        axes.set_yticks([0.0, 0.5, 1.0, 1.5])
        if row == 0:
            name_panel(axes, f"{'abc'[column]}. {people} people")
    _name_windows(figure, len(draws), window)
    return figure


def _windows(axes: "Axes", draws: Sequence[Floats], window: float, paper: tuple[float, float]) -> None:
    axes.axhspan(*paper, color=_PAPER, lw=0.0, zorder=0)
    for k, flow in reversed(list(enumerate(draws))):
        middle = window * (np.arange(len(flow)) + 0.5)
        strong = k == 0
        axes.plot(
            middle, flow, "-o" if strong else "-", color=series(0) if strong else _OTHER_DRAWS, ms=2.6, mew=0,
            lw=1.4 if strong else 0.7, alpha=1.0 if strong else 0.55, zorder=4 if strong else 2,
        )  # fmt: skip


def _name_windows(figure: "Figure", draws: int, window: float) -> None:
    from matplotlib.patches import Patch

    marks = [
        mark(f"first draw, windows of {window:g} s", color=series(0), marker="o", ms=3, lw=1.4),
        mark(f"the other {draws - 1}", color=_OTHER_DRAWS, lw=1.0),
        Patch(color=_PAPER, label="paper, range in its text"),
    ]
    if draws == 1:
        del marks[1]
    figure.legend(handles=marks, loc="outside upper center", ncols=3, frameon=False, fontsize=9.5)


def mean_flows(
    found: Samples,
    states: Sequence[tuple[str, float, float]],
    paper_range: tuple[float, float],
    paper_mean: float,
) -> "Figure":
    """Return the mean flow of every draw against the desired speed, and what blocked (Figure 10).

    Parameters
    ----------
    found : (people, desired speed [m/s]) -> its draws.
    states : name, from speed, to speed.
    paper_range, paper_mean : of the second state, as printed [1/s].
    """
    figure = new_figure((8.4, 6.2))
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3.2, 1.0])
    quiet_axes(upper, "", "mean flow of those that cleared [people/s]", grid=True)
    quiet_axes(lower, "desired speed [m/s]", "draws blocked", grid=True)
    edge = states[0][1] - 0.08
    for k, (name, low, high) in enumerate(states):
        low = low if k else edge
        for axes in (upper, lower):
            axes.axvspan(low, high, color=("#eef5f2", "#f7f4ec", "#f8ebe9")[k % 3], lw=0.0, zorder=0)
        upper.text(
            0.5 * (low + high), 0.985, name, transform=upper.get_xaxis_transform(), ha="center", va="top", fontsize=10,
            color=hex_of(QUIET),
        )  # fmt: skip
    transition = states[1][1:]
    upper.fill_between(transition, *paper_range, **_PAPER_RANGE, zorder=1)
    upper.plot(transition, [paper_mean] * 2, **_PAPER_MEAN, zorder=2)
    crowds = sorted({people for people, _ in found})
    for k, people in enumerate(crowds):
        draws = {speed: sample for (of, speed), sample in found.items() if of == people}
        _flows(upper, {speed: sample.mean_flows for speed, sample in draws.items()}, k, len(crowds))
        share = [sample.blocked / len(sample.episodes) for sample in draws.values()]
        lower.bar([speed + 0.032 * (k - 1) for speed in draws], share, width=0.028, color=series(k), zorder=3)
    highest = max(flow for sample in found.values() for flow in (1.2, *sample.mean_flows))
    upper.set_ylim(bottom=0.0, top=1.12 * highest)
    upper.set_xlim(edge, states[-1][2])
    lower.set_ylim(0.0, 1.04)
    lower.set_yticks([0.0, 0.5, 1.0], ["0", "half", "all"])
    _name_flows(upper, paper_range, paper_mean, crowds)
    return figure


def _flows(axes: "Axes", of_speed: Mapping[float, Floats], k: int, crowds: int) -> None:
    aside = 0.022 * (k - 0.5 * (crowds - 1))
    medians = [(speed + aside, float(np.median(flow))) for speed, flow in of_speed.items() if len(flow)]
    for speed, flow in of_speed.items():
        axes.plot(np.full(len(flow), speed + aside), flow, "o", color=series(k), alpha=0.3, ms=4, mew=0, zorder=3)
    if medians:
        axes.plot(*zip(*medians, strict=True), "-o", color=series(k), lw=1.7, ms=6.5, mec="white", mew=0.9, zorder=5)


def _name_flows(axes: "Axes", paper_range: tuple[float, float], paper_mean: float, crowds: Sequence[int]) -> None:
    from matplotlib.patches import Patch

    marks: list[Any] = [
        mark(f"{people} people, median", color=series(k), marker="o", ms=6.5, mec="white", lw=1.7)
        for k, people in enumerate(crowds)
    ]
    marks.append(mark("one draw", color=hex_of(QUIET), marker="o", ms=4, mew=0, ls="", alpha=0.5))
    marks.append(mark(f"paper, average {paper_mean:g}", **_PAPER_MEAN))
    marks.append(Patch(**_PAPER_RANGE, label=f"paper, {paper_range[0]:g} to {paper_range[1]:g}"))
    axes.legend(handles=marks, frameon=False, fontsize=9.5, loc="lower left", ncols=2)
