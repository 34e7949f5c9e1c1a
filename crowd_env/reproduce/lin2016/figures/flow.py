"""Figures in the form of those of Lin, Ma, Lo about the flow through the exit."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from crowd_env.rendering.canvas import hex_of, new_figure, quiet_axes, save_figure
from crowd_env.rendering.palette import INK, QUIET
from crowd_env.reproduce.lin2016.figures.clearance import BLOCKED, foot, series
from crowd_env.state import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_PAPER = "#efece4"


def window_flows(
    path: str | Path,
    crowds: Mapping[int, Mapping[float, Sequence[Floats]]],
    blocked: Mapping[tuple[int, float], int],
    paper: Mapping[float, tuple[float, float]],
    window: float,
    rests_on: str,
) -> Path:
    """Draw the flow in windows of time (Figure 9), a column a crowd and a row a speed; return the path.

    Parameters
    ----------
    path : ends in .png.
    crowds : number of people -> desired speed [m/s] -> for every draw, the flow in each window [1/s].
    blocked : (people, speed) -> number of draws that blocked.
    paper : speed -> range of the flow that the paper prints [1/s].
    window : s.
    rests_on : a line below.
    """
    speeds = list(next(iter(crowds.values())))
    figure = new_figure((10.6, 1.5 + 1.42 * len(speeds)))
    grid = figure.subplots(len(speeds), len(crowds), sharex="col", sharey=True, squeeze=False)
    for column, (people, flows) in enumerate(crowds.items()):
        for row, speed in enumerate(speeds):
            axes = grid[row, column]
            quiet_axes(axes, "time [s]" if row == len(speeds) - 1 else "", "people/s" if column == 0 else "", grid=True)
            _windows(axes, flows[speed], window, paper.get(speed))
            lost = blocked[people, speed]
            label = f"{speed:g} m/s" + (f", {lost} of {len(flows[speed])} blocked" if lost else "")
            axes.text(
                0.995, 0.97, label, transform=axes.transAxes, ha="right", va="top", fontsize=9.5, fontweight="bold",
                color=BLOCKED if lost else hex_of(INK),
                bbox={"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1},
            )  # fmt: skip
            axes.set_xlim(left=0.0)
            axes.set_ylim(-0.06, 2.0)
            axes.set_yticks([0.0, 0.5, 1.0, 1.5])
        title = f"{'abc'[column]}. {people} people"
        grid[0, column].set_title(title, loc="left", color=hex_of(INK), fontsize=11)
    _name_windows(grid[0, 0], len(next(iter(flows.values()))), window)
    foot(figure, rests_on)
    return save_figure(figure, path)


def _windows(axes: "Axes", draws: Sequence[Floats], window: float, paper: tuple[float, float] | None) -> None:
    if paper is not None:
        axes.axhspan(*paper, color=_PAPER, lw=0.0, zorder=0)
    for k, flow in reversed(list(enumerate(draws))):
        middle = window * (np.arange(len(flow)) + 0.5)
        strong = k == 0
        axes.plot(
            middle, flow, "-o" if strong else "-", color=series(0) if strong else "#9fb6bb", ms=2.6, mew=0,
            lw=1.4 if strong else 0.7, alpha=1.0 if strong else 0.55, zorder=4 if strong else 2,
        )  # fmt: skip


def _name_windows(axes: "Axes", draws: int, window: float) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    marks = [
        Line2D([], [], color=series(0), marker="o", ms=3, lw=1.4, label=f"first draw, windows of {window:g} s"),
        Line2D([], [], color="#9fb6bb", lw=1.0, label=f"the other {draws - 1}"),
        Patch(color=_PAPER, label="paper, range in its text"),
    ]
    if draws == 1:
        del marks[1]
    figure = axes.get_figure()
    assert figure is not None
    figure.legend(handles=marks, loc="outside upper center", ncols=3, frameon=False, fontsize=9.5)


def mean_flows(
    path: str | Path,
    flows: Mapping[int, Mapping[float, Floats]],
    blocked: Mapping[tuple[int, float], int],
    runs: int,
    states: Sequence[tuple[str, float, float]],
    paper_range: tuple[float, float],
    paper_mean: float,
    rests_on: str,
) -> Path:
    """Draw the mean flow of every draw against the desired speed, and what blocked (Figure 10); return the path.

    Parameters
    ----------
    path : ends in .png.
    flows : number of people -> desired speed [m/s] -> flow of every draw that cleared [1/s].
    blocked : (people, speed) -> number of draws that blocked, of ``runs``.
    states : name, from speed, to speed.
    paper_range, paper_mean : of the second state, as printed [1/s].
    rests_on : a line below.
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
    upper.fill_between(transition, *paper_range, facecolor="none", edgecolor="#c9c2ae", hatch="////", lw=0.0, zorder=1)
    upper.plot(transition, [paper_mean] * 2, color="black", lw=1.4, dashes=(4, 3), zorder=2)
    for k, (people, of_speed) in enumerate(flows.items()):
        _flows(upper, people, of_speed, k, len(flows))
        share = [(speed + 0.032 * (k - 1), blocked[people, speed] / runs) for speed in of_speed]
        at, height = zip(*share, strict=True)
        lower.bar(at, height, width=0.028, color=series(k), zorder=3)
    upper.set_ylim(bottom=0.0, top=1.12 * max([1.2, *(v for s in flows.values() for f in s.values() for v in f)]))
    upper.set_xlim(edge, states[-1][2])
    lower.set_ylim(0.0, 1.04)
    lower.set_yticks([0.0, 0.5, 1.0], ["0", "half", "all"])
    _name_flows(upper, paper_range, paper_mean, list(flows))
    foot(figure, rests_on)
    return save_figure(figure, path)


def _flows(axes: "Axes", people: int, of_speed: Mapping[float, Floats], k: int, crowds: int) -> None:
    aside = 0.022 * (k - 0.5 * (crowds - 1))
    medians = [(speed + aside, float(np.median(flow))) for speed, flow in of_speed.items() if len(flow)]
    for speed, flow in of_speed.items():
        axes.plot(np.full(len(flow), speed + aside), flow, "o", color=series(k), alpha=0.3, ms=4, mew=0, zorder=3)
    if medians:
        axes.plot(*zip(*medians, strict=True), "-o", color=series(k), lw=1.7, ms=6.5, mec="white", mew=0.9, zorder=5)


def _name_flows(axes: "Axes", paper_range: tuple[float, float], paper_mean: float, crowds: Sequence[int]) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    marks: list[Line2D | Patch] = [
        Line2D([], [], color=series(k), marker="o", ms=6.5, mec="white", lw=1.7, label=f"{people} people, median")
        for k, people in enumerate(crowds)
    ]
    marks.append(Line2D([], [], color=hex_of(QUIET), marker="o", ms=4, mew=0, ls="", alpha=0.5, label="one draw"))
    marks.append(Line2D([], [], color="black", lw=1.4, dashes=(4, 3), label=f"paper, average {paper_mean:g}"))
    range_label = f"paper, {paper_range[0]:g} to {paper_range[1]:g}"
    marks.append(Patch(facecolor="none", edgecolor="#c9c2ae", hatch="////", lw=0.0, label=range_label))
    axes.legend(handles=marks, frameon=False, fontsize=9.5, loc="lower left", ncols=2)
