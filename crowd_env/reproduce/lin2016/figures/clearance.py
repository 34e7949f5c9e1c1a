"""Figures in the form of those of Lin, Ma, Lo about how long a crowd takes; what blocked is marked as blocked."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from crowd_env.rendering.canvas import hex_of, mark, new_figure, quiet_axes, series, shade
from crowd_env.rendering.palette import QUIET
from crowd_env.reproduce.lin2016.sample import Sample, Samples

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLOCKED = "#b3262f"  # counts, and the band they lie in
_BAND = "#f8ebe9"
_LIGHT: dict[str, Any] = {"lw": 0.8, "alpha": 0.3, "zorder": 2}
_STRONG: dict[str, Any] = {"lw": 1.9, "zorder": 4}
_PAPER: dict[str, Any] = {"marker": "D", "ls": "", "mfc": "white", "mew": 1.6, "ms": 7.5, "zorder": 6}
_PAPER_MEAN: dict[str, Any] = {"color": "black", "lw": 1.3, "dashes": (4, 3), "zorder": 2}


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


def leaving_curves(people: int, panels: Mapping[str, Sequence[Curve]]) -> "Figure":
    """Return how many are out against time (Figures 4 and 5), a panel a title, all draws light, one of them strong."""
    figure = new_figure((6.8 if len(panels) == 1 else 11.0, 4.9))
    for axes, (title, curves) in zip(figure.subplots(1, len(panels), squeeze=False).flat, panels.items(), strict=True):
        quiet_axes(axes, "time [s]", "people out", title=title, grid=True)
        _leaving(axes, people, curves, every=True)
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
    quiet_axes(
        left, "time [s]", "people out", title=f"a. Leaving process, {people} people, one draw a speed", grid=True
    )
    colors = [shade(level) for level in np.linspace(0.0, 1.0, len(found))]
    curves = [Curve(f"{v:.1f} m/s", color, found[v]) for v, color in zip(found, colors, strict=True)]
    _leaving(left, people, curves, every=False)
    draws = max(len(sample.episodes) for sample in found.values())
    title = f"b. Clearance time, {draws} draws a speed"
    quiet_axes(right, "desired speed [m/s]", "clearance time [s]", title=title, grid=True)
    times = [(speed, time) for speed, draws in found.items() for time in draws.cleared]
    medians = [(speed, draws.median) for speed, draws in found.items() if draws.median is not None]
    right.plot(*np.reshape(times, (-1, 2)).T, "o", color=series(0), alpha=0.4, ms=5, mew=0, label="one draw")
    right.plot(
        *np.reshape(medians, (-1, 2)).T, "-o", color=series(0), mec="white", label="median of those that cleared"
    )
    printed = [float(time) for time in paper.values()]
    if printed:
        right.plot(list(paper), printed, **_PAPER, mec="black", label="paper, from its text")
    if paper_mean is not None:
        right.plot(
            paper_mean[:2], [float(paper_mean[2])] * 2, **_PAPER_MEAN, label=f"paper, mean close to {paper_mean[2]} s"
        )
    right.axvline(
        paper_blocked, color=hex_of(QUIET), lw=1.1, dashes=(2, 2), label=f"paper: blocked from {paper_blocked:g} m/s"
    )
    right.set_xticks(list(found))
    _blocked_band(right, found, 1.08 * max([*(time for _, time in times), *printed], default=100.0))
    right.legend(frameon=False, fontsize=9, loc="lower left")
    return figure


def _leaving(axes: "Axes", people: int, curves: Sequence[Curve], *, every: bool) -> None:
    """Draw curves: of each the middle draw strongly, and if ``every`` the others lightly; a cross where a draw blocked."""
    for curve in curves:
        draws, middle = curve.sample, curve.middle
        lost = f", {draws.blocked} of {len(draws.episodes)} blocked" if every and draws.blocked else ""
        for k, exits in enumerate(draws.exits):
            if every or k == middle:
                at, label = np.append(0.0, exits), curve.label + lost if k == middle else None
                style = _STRONG if k == middle else _LIGHT
                axes.plot(at, np.arange(len(at)), drawstyle="steps-post", label=label, color=curve.color, **style)
                if draws.blocked_since[k] is not None:
                    axes.plot(at[-1], len(exits), "x", color=curve.color, ms=7, mew=1.6, zorder=5, clip_on=False)
        if curve.paper is not None:
            axes.plot(float(curve.paper), people, **_PAPER, mec=curve.color, clip_on=False)
    axes.set_xlim(left=0.0)
    axes.set_ylim(0.0, 1.06 * people)
    marks, grey = axes.get_legend_handles_labels()[0], hex_of(QUIET)
    if any(line.get_marker() == "x" for line in axes.get_lines()):
        marks.append(mark("blocked from here on", marker="x", ls="", color=grey))
    if any(curve.paper is not None for curve in curves):
        marks.append(mark("paper", **_PAPER, mec=grey))
    axes.legend(handles=marks, fontsize=9.5, loc="lower right", edgecolor="none").set_zorder(8)


def _blocked_band(axes: "Axes", found: Samples, top: float) -> None:
    """End the upright axis with a band above ``top`` that counts the blocked draws."""
    style: dict[str, Any] = {"va": "center", "color": BLOCKED, "fontsize": 8.5, "zorder": 7}
    axes.axhspan(top, 1.1 * top, color=_BAND, lw=0.0, zorder=0)
    axes.text(0.012, 1.05 * top, "blocked", transform=axes.get_yaxis_transform(), **style)
    for speed, draws in found.items():
        if draws.blocked:
            axes.text(speed, 1.05 * top, f"{draws.blocked}/{len(draws.episodes)}", ha="center", **style)
    axes.set_ylim(0.0, 1.1 * top)
    axes.set_yticks([tick for tick in axes.get_yticks() if tick <= top])
