"""Figures in the form of those of Lin, Ma, Lo about how long a crowd takes; what blocked is marked as blocked."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.rendering.canvas import hex_of, mark, new_figure, quiet_axes, series
from crowd_env.rendering.palette import INK, QUIET, blend
from crowd_env.reproduce.lin2016.sample import Sample, Samples

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLOCKED = "#b3262f"  # crosses and the band they lie in
_BAND = "#f8ebe9"
_SPEEDS = ((158, 122, 22), (15, 118, 128), (74, 92, 160), (137, 71, 145), (70, 20, 60))  # from slow to fast
_LIGHT: dict[str, Any] = {"lw": 0.8, "alpha": 0.3, "zorder": 2}
_PAPER_MEAN: dict[str, Any] = {"color": "black", "lw": 1.3, "dashes": (4, 3)}


class Curve(NamedTuple):
    """Draws of one configuration, drawn as one curve each."""

    label: str
    color: str
    sample: Sample
    paper: str | None = None  # s, clearance time that the paper prints

    @property
    def middle(self) -> int:
        """The draw in the middle of all draws, by the time of the last exit; those that blocked come last."""
        pairs = zip(self.sample.blocked_since, self.sample.exits, strict=True)
        ends = [(since is not None, max(exits, default=0.0)) for since, exits in pairs]
        return sorted(range(len(ends)), key=ends.__getitem__)[(len(ends) - 1) // 2]


def _speed_color(level: float) -> str:
    """Return the color of a speed between the slowest (0) and the fastest (1) of a figure."""
    r, g, b = (int(value) for value in blend(_SPEEDS, level))
    return hex_of((r, g, b))


def leaving_curves(people: int, panels: Mapping[str, Sequence[Curve]]) -> "Figure":
    """Return how many are out against time (Figures 4 and 5), a panel a title, all draws light, one of them strong."""
    figure = new_figure((6.8, 4.9) if len(panels) == 1 else (11.0, 4.9))
    all_axes = np.atleast_1d(figure.subplots(1, len(panels), sharey=True))
    for axes, (title, curves) in zip(all_axes, panels.items(), strict=True):
        quiet_axes(axes, "time [s]", "people out" if axes is all_axes[0] else "", title=title, grid=True)
        _leaving(axes, people, curves, every=True)
        draws = max(len(curve.sample.episodes) for curve in curves)
        _name_curves(axes, draws, with_paper=any(curve.paper is not None for curve in curves))
    return figure


def clearance_times(
    people: int,
    found: Samples,
    paper: Mapping[float, str],
    paper_mean: tuple[float, float, str] | None,
    paper_blocked: float,
) -> "Figure":
    """Return one leaving process a speed, and every clearance time against the speed (Figures 7 and 8).

    Parameters
    ----------
    found : desired speed [m/s] -> its draws.
    paper : speed -> clearance time [s] that the paper prints.
    paper_mean : from speed, to speed, mean clearance time that the paper prints for them; or None.
    paper_blocked : m/s, from this speed on the paper finds the exit blocked.
    """
    figure = new_figure((11.4, 5.2))
    left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.12])
    title = f"a. Leaving process, {people} people, one draw a speed"
    quiet_axes(left, "time [s]", "people out", title=title, grid=True)
    slowest, span = min(found), max(found) - min(found)
    curves = [Curve(f"{v:.1f} m/s", _speed_color((v - slowest) / span), draws) for v, draws in found.items()]
    _leaving(left, people, curves, every=False)
    _name_curves(left, 1, with_paper=False, title="desired speed")
    draws = max(len(sample.episodes) for sample in found.values())
    title = f"b. Clearance time, {draws} draws a speed"
    quiet_axes(right, "desired speed [m/s]", "clearance time [s]", title=title, grid=True)
    printed = {speed: float(time) for speed, time in paper.items()}
    _times(right, found, printed, paper_mean, paper_blocked)
    return figure


def _leaving(axes: "Axes", people: int, curves: Sequence[Curve], *, every: bool) -> None:
    """Draw curves: of each the middle draw strongly, and if ``every`` the others lightly; a cross where a draw blocked."""
    for curve in curves:
        draws, middle = curve.sample, curve.middle
        lost = f", {draws.blocked} of {len(draws.episodes)} blocked" if every and draws.blocked else ""
        for k, exits in enumerate(draws.exits):
            if not every and k != middle:
                continue
            strong = k == middle
            style: dict[str, Any] = (
                {"color": curve.color, "lw": 1.9, "zorder": 4} if strong else {"color": curve.color, **_LIGHT}
            )
            at, label = np.append(0.0, exits), curve.label + lost if strong else None
            axes.plot(at, np.arange(len(at)), drawstyle="steps-post", label=label, **style)
            if draws.blocked_since[k] is not None:
                axes.plot(at[-1], len(exits), "x", color=curve.color, ms=7, mew=1.6, zorder=5, clip_on=False)
        if curve.paper is not None:
            at_paper = float(curve.paper)
            axes.plot(at_paper, people, "D", mfc="white", mec=curve.color, mew=1.7, ms=7.5, zorder=6, clip_on=False)
    axes.set_xlim(left=0.0)
    axes.set_ylim(0.0, 1.06 * people)


def _name_curves(axes: "Axes", draws: int, *, with_paper: bool, title: str | None = None) -> None:
    marks, _ = axes.get_legend_handles_labels()
    grey = hex_of(QUIET)
    if draws > 1:
        marks.append(mark("the other draws; strong: the middle one", color=grey, lw=0.8, alpha=0.6))
    if any(line.get_marker() == "x" for line in axes.get_lines()):
        marks.append(mark("blocked from here on", marker="x", ls="", color=grey, mew=1.8, ms=7))
    if with_paper:
        marks.append(mark("paper", marker="D", ls="", mfc="white", mec=grey, mew=1.6, ms=7))
    named = axes.legend(
        handles=marks, fontsize=9.5, loc="lower right", title=title, title_fontsize=9.5, facecolor="white", edgecolor="none",
        framealpha=0.92,
    )  # fmt: skip
    named.set_zorder(8)


def _times(
    axes: "Axes",
    found: Samples,
    paper: Mapping[float, float],
    paper_mean: tuple[float, float, str] | None,
    paper_blocked: float,
) -> None:
    cleared = {speed: draws.cleared for speed, draws in found.items()}
    everything = [*(time for draws in cleared.values() for time in draws), *paper.values()]
    top = 1.08 * max(everything, default=100.0)
    ink, teal = hex_of(INK), series(0)
    known = [(speed, draws.median) for speed, draws in found.items() if draws.median is not None]
    for speed, draws in cleared.items():
        aside = _aside(len(draws), 0.012)
        axes.plot(speed + aside, draws, "o", color=teal, alpha=0.4, ms=5, mew=0, zorder=3)
    if known:
        axes.plot(*zip(*known, strict=True), "-", color=teal, lw=1.8, zorder=4)
        axes.plot(*zip(*known, strict=True), "o", color=teal, ms=7, mec="white", mew=1.0, zorder=5)
    axes.plot(list(paper), list(paper.values()), "D", mfc="white", mec="black", mew=1.5, ms=7.5, zorder=6)
    if paper_mean is not None:
        axes.plot(paper_mean[:2], [float(paper_mean[2])] * 2, **_PAPER_MEAN, zorder=2)
    _blocked_band(axes, found, top)
    axes.plot([paper_blocked] * 2, [0.0, top], color=hex_of(QUIET), lw=1.1, dashes=(2, 2), zorder=1)
    axes.annotate(
        f"paper: blocked from {paper_blocked:g} m/s", (paper_blocked, 0.03 * top), (-5, 0), textcoords="offset points",
        rotation=90, ha="right", va="bottom", fontsize=8.5, color=hex_of(QUIET),
    )  # fmt: skip
    axes.set_xticks(list(found))
    marks = [
        mark("median of those that cleared", color=teal, marker="o", ms=7, mec="white", lw=1.8),
        mark("one draw", color=teal, marker="o", ms=5, mew=0, ls="", alpha=0.4),
    ]
    if paper:
        marks.append(mark("paper, from its text", marker="D", mfc="white", mec="black", mew=1.5, ms=7, ls=""))
    if paper_mean is not None:
        marks.append(mark(f"paper, mean close to {paper_mean[2]} s", **_PAPER_MEAN))
    axes.legend(handles=marks, frameon=False, fontsize=9, loc="lower left", labelcolor=ink)


def _blocked_band(axes: "Axes", found: Samples, top: float) -> None:
    """End the upright axis with a band above ``top`` that counts the blocked draws."""
    height = 0.1 * top
    axes.axhspan(top, top + height, color=_BAND, lw=0.0, zorder=0)
    for speed, draws in found.items():
        if draws.blocked:
            text = f"{draws.blocked}/{len(draws.episodes)}"
            axes.text(speed, top + 0.5 * height, text, ha="center", va="center", fontsize=8.5, color=BLOCKED, zorder=7)
    axes.text(
        0.012, top + 0.5 * height, "blocked", transform=axes.get_yaxis_transform(), va="center", color=BLOCKED, fontsize=9.5,
    )  # fmt: skip
    axes.set_ylim(0.0, top + height)
    axes.set_yticks([tick for tick in axes.get_yticks() if tick <= top])


def _aside(count: int, step: float) -> Floats:
    """Return sideways offsets that keep ``count`` marks apart."""
    return step * (np.arange(count, dtype=np.float64) - 0.5 * (count - 1))
