"""Figures in the form of those of Lin, Ma, Lo about the flow through the exit."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.rendering.canvas import hex_of, name_panel, new_figure, quiet_axes, series
from crowd_env.rendering.palette import QUIET
from crowd_env.reproduce.lin2016.figures.clearance import BLOCKED
from crowd_env.reproduce.lin2016.sample import Samples

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PAPER: dict[str, Any] = {"color": "#efece4", "lw": 0.0, "zorder": 0}
_OTHER_DRAWS: dict[str, Any] = {"color": "#9fb6bb", "lw": 0.7, "zorder": 2}
_FIRST_DRAW: dict[str, Any] = {"color": series(0), "lw": 1.4, "marker": "o", "ms": 2.6, "mew": 0, "zorder": 4}
_PAPER_RANGE: dict[str, Any] = {"facecolor": "none", "edgecolor": "#c9c2ae", "hatch": "////", "lw": 0.0}
_STATES = ("#eef5f2", "#f7f4ec", "#f8ebe9")


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
        axes.axhspan(*paper[speed], **_PAPER, label="paper, range in its text")
        for k, flow in enumerate(draws):
            label = {0: f"first draw, windows of {window:g} s", 1: f"the other {len(draws) - 1}"}.get(k)
            style = _OTHER_DRAWS if k else _FIRST_DRAW
            axes.plot(window * (np.arange(len(flow)) + 0.5), flow, label=label, **style)
        text = f"{speed:g} m/s" + (f", {lost} of {len(draws)} blocked" if lost else "")
        color = BLOCKED if lost else "black"
        axes.text(0.995, 0.97, text, transform=axes.transAxes, ha="right", va="top", fontsize=9.5, color=color)
        axes.set_xlim(left=0.0)
        axes.set_ylim(-0.06, 2.0)
        if row == 0:
            name_panel(axes, f"{'abc'[column]}. {people} people")
    figure.legend(
        *grid[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=3, frameon=False, fontsize=9.5
    )
    return figure


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
    for (name, low, high), color in zip(states, _STATES, strict=True):
        for axes in (upper, lower):
            axes.axvspan(low, high, color=color, lw=0.0, zorder=0)
        middle, transform = 0.5 * (low + high), upper.get_xaxis_transform()
        upper.text(middle, 0.985, name, transform=transform, ha="center", va="top", fontsize=10, color=hex_of(QUIET))
    transition = states[1][1:]
    upper.fill_between(
        transition, *paper_range, **_PAPER_RANGE, label=f"paper, {paper_range[0]:g} to {paper_range[1]:g}"
    )
    upper.plot(transition, [paper_mean] * 2, "k--", lw=1.4, label=f"paper, average {paper_mean:g}")
    crowds = sorted({people for people, _ in found})
    for k, people in enumerate(crowds):
        draws = {speed: sample for (of, speed), sample in found.items() if of == people}
        aside = 0.022 * (k - 0.5 * (len(crowds) - 1))
        flows = [(speed + aside, flow) for speed, sample in draws.items() for flow in sample.mean_flows]
        medians = [(speed + aside, np.median(one.mean_flows)) for speed, one in draws.items() if len(one.cleared)]
        upper.plot(*np.reshape(flows, (-1, 2)).T, "o", color=series(k), alpha=0.3, ms=4, mew=0)
        upper.plot(
            *np.reshape(medians, (-1, 2)).T, "-o", color=series(k), mec="white", label=f"{people} people, median"
        )
        share = [sample.blocked / len(sample.episodes) for sample in draws.values()]
        lower.bar([speed + 0.032 * (k - 1) for speed in draws], share, width=0.028, color=series(k), zorder=3)
    upper.set_ylim(bottom=0.0)
    lower.set_ylim(0.0, 1.04)
    upper.legend(frameon=False, fontsize=9.5, loc="lower left", ncols=2)
    return figure
