"""Figures in the form of those of Lin, Ma, Lo about how long a crowd takes; what blocked is marked as blocked."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from crowd_env.rendering.canvas import hex_of, new_figure, quiet_axes, save_figure
from crowd_env.rendering.palette import INK, QUIET, SERIES, blend
from crowd_env.state import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLOCKED = "#b3262f"  # crosses and the band they lie in
_BAND = "#f8ebe9"
_SPEEDS = ((158, 122, 22), (15, 118, 128), (74, 92, 160), (137, 71, 145), (70, 20, 60))  # from slow to fast


class Draws(NamedTuple):
    """Draws of one configuration, drawn as one curve each."""

    label: str
    color: str
    exits: Sequence[Floats]  # of every draw: exit times [s], ascending
    blocked: Sequence[bool]  # of every draw
    paper: float | None = None  # s, clearance time that the paper prints


class Panel(NamedTuple):
    """One panel of leaving curves."""

    title: str
    people: int
    curves: Sequence[Draws]


def series(k: int) -> str:
    """Return the color of the curve ``k``."""
    return hex_of(SERIES[k % len(SERIES)])


def speed_color(level: float) -> str:
    """Return the color of a speed between the slowest (0) and the fastest (1) of a figure."""
    r, g, b = (int(value) for value in blend(_SPEEDS, level))
    return hex_of((r, g, b))


def leaving_curves(path: str | Path, panels: Sequence[Panel], rests_on: str) -> Path:
    """Draw how many are out against time (Figures 4 and 5), all draws light, one of them strong; return the path.

    Parameters
    ----------
    path : ends in .png.
    panels : side by side.
    rests_on : a line below: what the runs rest on.
    """
    figure = new_figure((6.8, 4.9) if len(panels) == 1 else (11.0, 4.9))
    for axes, panel in zip(np.atleast_1d(figure.subplots(1, len(panels), sharey=True)), panels, strict=True):
        quiet_axes(axes, "time [s]", "people out" if axes.get_subplotspec().is_first_col() else "", grid=True)
        _leaving(axes, panel.people, panel.curves, every=True)
        axes.set_ylim(0.0, 1.06 * panel.people)
        axes.set_title(panel.title, loc="left", color=hex_of(INK), fontsize=11)
        draws = max(len(curve.exits) for curve in panel.curves)
        _name_curves(axes, draws, with_paper=any(curve.paper is not None for curve in panel.curves))
    foot(figure, rests_on)
    return save_figure(figure, path)


def clearance_times(
    path: str | Path,
    people: int,
    process: Sequence[Draws],
    times: Mapping[float, Sequence[float | None]],
    blocked: Mapping[float, int],
    paper: Mapping[float, float],
    paper_mean: tuple[float, float, float] | None,
    paper_blocked: float,
    rests_on: str,
) -> Path:
    """Draw one leaving process a speed, and every clearance time against the speed (Figures 7 and 8); return the path.

    Parameters
    ----------
    path : ends in .png.
    process : one draw a speed.
    times : speed [m/s] -> clearance time of every draw [s], None where there is none.
    blocked : speed -> number of draws that blocked.
    paper : speed -> clearance time that the paper prints.
    paper_mean : from speed, to speed, mean clearance time that the paper prints for them; or None.
    paper_blocked : m/s, from this speed on the paper finds the exit blocked.
    rests_on : a line below: what the runs rest on.
    """
    figure = new_figure((11.4, 5.2))
    left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.12])
    quiet_axes(left, "time [s]", "people out", grid=True)
    _leaving(left, people, process, every=False)
    left.set_ylim(0.0, 1.06 * people)
    left.set_title(f"a. Leaving process, {people} people, one draw a speed", loc="left", color=hex_of(INK), fontsize=11)
    _name_curves(left, 1, with_paper=False, title="desired speed")
    quiet_axes(right, "desired speed [m/s]", "clearance time [s]", grid=True)
    draws = max(len(of_speed) for of_speed in times.values())
    right.set_title(f"b. Clearance time, {draws} draws a speed", loc="left", color=hex_of(INK), fontsize=11)
    _times(right, times, blocked, paper, paper_mean, paper_blocked)
    foot(figure, rests_on)
    return save_figure(figure, path)


def _leaving(axes: "Axes", people: int, curves: Sequence[Draws], *, every: bool) -> None:
    """Draw curves: of each the middle draw strongly, and if ``every`` the others lightly."""
    for curve in curves:
        strong = _middle(curve)
        lost = f", {sum(curve.blocked)} of {len(curve.exits)} blocked" if every and any(curve.blocked) else ""
        for k in range(len(curve.exits)) if every else (strong,):
            _one_leaving(axes, curve, k, curve.label + lost if k == strong else None)
        if curve.paper is not None:
            axes.plot(curve.paper, people, "D", mfc="white", mec=curve.color, mew=1.7, ms=7.5, zorder=6, clip_on=False)
    end = axes.get_xlim()[1]
    for curve in curves:
        k = _middle(curve)
        if curve.blocked[k]:  # nobody else gets out
            begin, level = curve.exits[k].max(initial=0.0), len(curve.exits[k])
            axes.plot([begin, end], [level, level], color=curve.color, lw=1.2, dashes=(1, 2.5), zorder=3)
    axes.set_xlim(0.0, end)


def _one_leaving(axes: "Axes", curve: Draws, k: int, label: str | None) -> None:
    """Draw the draw ``k`` of a curve, strongly if it has a label; where it blocked, there is a cross."""
    exits, strong = curve.exits[k], label is not None
    at, out = np.append(0.0, exits), np.arange(len(exits) + 1.0)
    axes.plot(
        at, out, color=curve.color, lw=1.9 if strong else 0.8, alpha=1.0 if strong else 0.3, drawstyle="steps-post",
        label=label, zorder=4 if strong else 2,
    )  # fmt: skip
    if curve.blocked[k]:
        axes.plot(
            at[-1], out[-1], "x", color=curve.color, ms=8.5 if strong else 6.0, mew=2.0 if strong else 1.1,
            alpha=1.0 if strong else 0.6, zorder=5, clip_on=False,
        )  # fmt: skip


def _middle(curve: Draws) -> int:
    """Return the draw in the middle of all draws, by the time of the last exit; those that blocked come last."""
    ends = [(lost, float(exits.max(initial=0.0))) for exits, lost in zip(curve.exits, curve.blocked, strict=True)]
    order = sorted(range(len(ends)), key=ends.__getitem__)
    return order[(len(order) - 1) // 2]


def _name_curves(axes: "Axes", draws: int, *, with_paper: bool, title: str | None = None) -> None:
    from matplotlib.lines import Line2D

    marks, _ = axes.get_legend_handles_labels()
    if draws > 1:
        marks.append(
            Line2D([], [], color=hex_of(QUIET), lw=0.8, alpha=0.6, label="the other draws; strong: the middle one")
        )
    if any(line.get_marker() == "x" for line in axes.get_lines()):
        marks.append(
            Line2D(
                [],
                [],
                marker="x",
                ls="",
                color=hex_of(QUIET),
                mew=1.8,
                ms=7,
                label="blocked from here on",
            )
        )
    if with_paper:
        marks.append(Line2D([], [], marker="D", ls="", mfc="white", mec=hex_of(QUIET), mew=1.6, ms=7, label="paper"))
    named = axes.legend(
        handles=marks, fontsize=9.5, loc="lower right", title=title, title_fontsize=9.5, facecolor="white", edgecolor="none",
        framealpha=0.92,
    )  # fmt: skip
    named.set_zorder(8)


def _times(
    axes: "Axes",
    times: Mapping[float, Sequence[float | None]],
    blocked: Mapping[float, int],
    paper: Mapping[float, float],
    paper_mean: tuple[float, float, float] | None,
    paper_blocked: float,
) -> None:
    from matplotlib.lines import Line2D

    cleared = {speed: [time for time in draws if time is not None] for speed, draws in times.items()}
    everything = [*(time for draws in cleared.values() for time in draws), *paper.values()]
    top = 1.08 * max(everything, default=100.0)
    ink, teal = hex_of(INK), series(0)
    known = [(speed, float(np.median(draws))) for speed, draws in cleared.items() if draws]
    for speed, draws in cleared.items():
        aside = _aside(len(draws), 0.012)
        axes.plot(speed + aside, draws, "o", color=teal, alpha=0.4, ms=5, mew=0, zorder=3)
    if known:
        axes.plot(*zip(*known, strict=True), "-", color=teal, lw=1.8, zorder=4)
        axes.plot(*zip(*known, strict=True), "o", color=teal, ms=7, mec="white", mew=1.0, zorder=5)
    axes.plot(list(paper), list(paper.values()), "D", mfc="white", mec="black", mew=1.5, ms=7.5, zorder=6)
    if paper_mean is not None:
        axes.plot(paper_mean[:2], [paper_mean[2]] * 2, color="black", lw=1.3, dashes=(4, 3), zorder=2)
    blocked_band(axes, times, blocked, top)
    axes.plot([paper_blocked] * 2, [0.0, top], color=hex_of(QUIET), lw=1.1, dashes=(2, 2), zorder=1)
    axes.annotate(
        f"paper: blocked from {paper_blocked:g} m/s", (paper_blocked, 0.03 * top), (-5, 0), textcoords="offset points",
        rotation=90, ha="right", va="bottom", fontsize=8.5, color=hex_of(QUIET),
    )  # fmt: skip
    axes.set_xticks(list(times))
    marks = [
        Line2D([], [], color=teal, marker="o", ms=7, mec="white", lw=1.8, label="median of those that cleared"),
        Line2D([], [], color=teal, marker="o", ms=5, mew=0, ls="", alpha=0.4, label="one draw"),
        Line2D([], [], marker="D", mfc="white", mec="black", mew=1.5, ms=7, ls="", label="paper, from its text"),
    ]
    if paper_mean is not None:
        marks.append(
            Line2D([], [], color="black", lw=1.3, dashes=(4, 3), label=f"paper, mean close to {paper_mean[2]:g} s")
        )
    if not paper:
        del marks[2]
    axes.legend(handles=marks, frameon=False, fontsize=9, loc="lower left", labelcolor=ink)


def blocked_band(
    axes: "Axes", draws: Mapping[float, Sequence[object]], blocked: Mapping[float, int], top: float
) -> None:
    """End the upright axis with a band above ``top``: a cross for every blocked draw, and how many they are."""
    height = 0.16 * top
    axes.axhspan(top, top + height, color=_BAND, lw=0.0, zorder=0)
    axes.text(
        0.012, top + 0.5 * height, "blocked", transform=axes.get_yaxis_transform(), va="center",
        color=BLOCKED, fontsize=9.5, fontweight="bold", zorder=7,
    )  # fmt: skip
    for speed, number in blocked.items():
        rows = [min(number, 5), max(number - 5, 0)] if number <= 10 else [number]
        for row, some in enumerate(rows):
            level = top + height * (0.38 - 0.2 * row if rows[-1] else 0.3)
            axes.plot(speed + _aside(some, 0.024), np.full(some, level), "x", color=BLOCKED, ms=4.2, mew=1.2, zorder=6)
        if number:
            text = f"{number}/{len(draws[speed])}"
            axes.text(speed, top + 0.76 * height, text, ha="center", va="center", fontsize=8.5, color=BLOCKED, zorder=7)
    axes.set_ylim(0.0, top + height)
    axes.set_yticks([tick for tick in axes.get_yticks() if tick <= top])


def _aside(count: int, step: float) -> Floats:
    """Return sideways offsets that keep ``count`` marks apart."""
    return step * (np.arange(count, dtype=np.float64) - 0.5 * (count - 1))


def foot(figure: "Figure", text: str) -> None:
    """Write a line below everything."""
    figure.supxlabel(text, fontsize=8.5, color=hex_of(QUIET), x=0.012, ha="left")
