"""How long a crowd takes: Figures 4, 5, 7 and 8 of Lin, Ma, Lo, by the social force, rotation and the desired speed."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from crowd_env.rendering.canvas import hex_of, mark, new_figure, quiet_axes, series, shade
from crowd_env.rendering.libraries import Axes, Figure
from crowd_env.rendering.palette import QUIET
from crowd_env.reproduce.evacuations import Case
from crowd_env.reproduce.lin2016.sample import Sample, Samples, clearance_rows, result, together
from crowd_env.reproduce.lin2016.settings import LinSettings
from crowd_env.reproduce.result import Result, Row

SPEEDS = (0.6, 0.8, 1.0, 1.2, 1.4, 1.6, 1.8, 2.0)  # m/s
PAPER_BLOCKED = 1.8  # m/s, "1.8 m/s or higher could lead to the totally blockage of the exit"


class Point(NamedTuple):
    """One configuration of a figure."""

    of: str  # in the rows
    case: tuple[Any, ...]  # of `LinSettings.case`: people, speed, strength, rotation
    paper: str | None = None  # s, as printed
    remark: str = ""  # what the paper prints in words


class Clearance(NamedTuple):
    """A figure of clearance times, by what it varies."""

    points: Mapping[Any, Point]
    draw: Callable[[Samples], Figure]
    printed_mean: tuple[float, float, str] | None = None  # from speed, to speed [m/s], s

    def cases(self, settings: LinSettings) -> dict[Any, Case]:
        """Return the draws of each configuration."""
        return {key: settings.case(*point.case) for key, point in self.points.items()}

    def reproduce(self, settings: LinSettings, found: Samples) -> Result:
        """Return the figure, made of a sample for each configuration."""
        points = self.points.items()
        sections = [clearance_rows(one.of, found[key], one.paper, one.remark) for key, one in points]
        if self.printed_mean is not None:
            sections.append([_mean(found, *self.printed_mean)])
        return result(settings, found, sections, lambda: self.draw(found))


def _mean(found: Samples, low: float, high: float, paper: str) -> Row:
    some = together(draws for speed, draws in found.items() if low <= speed <= high)
    times, lost = some.cleared, some.blocked
    reading = f"mean of the draws that cleared; {lost or 'none'} of {lost + len(times)} blocked"
    mean = float(times.mean()) if len(times) else None
    return Row(f"clearance, {low:.1f} to {high:.1f} m/s", paper, mean, "s", len(times), reading)


def _by_strength() -> Clearance:
    barely = (None, "paper: barely differs from 300 N")
    printed = {200.0: ("170", ""), 300.0: ("120", ""), 400.0: barely, 500.0: barely}  # A [N] -> s
    points = {a: Point(f"A = {a:g} N", (100, 1.0, a), *words) for a, words in printed.items()}

    def draw(found: Samples) -> Figure:
        curves = [Curve(points[a].of, series(k), draws, points[a].paper) for k, (a, draws) in enumerate(found.items())]
        return leaving_curves(100, {"100 people who want 1 m/s, by the strength A of the social force": curves})

    return Clearance(points, draw)


def _by_rotation() -> Clearance:
    remarks = {1.0: "paper: basically the same as with rotation", 2.0: "paper: clogs more, barely recovers"}
    points = {}
    for speed, remark in remarks.items():
        points[speed, True] = Point(f"{speed:g} m/s, rotation", (100, speed, 300.0, True))
        points[speed, False] = Point(f"{speed:g} m/s, no rotation", (100, speed, 300.0, False), remark=remark)

    def draw(found: Samples) -> Figure:
        kinds = ((True, "with rotation"), (False, "without"))
        panels = {}
        for letter, speed in zip("ab", remarks, strict=True):
            curves = [Curve(name, series(k), found[speed, turning]) for k, (turning, name) in enumerate(kinds)]
            panels[f"{letter}. 100 people who want {speed:g} m/s"] = curves
        return leaving_curves(100, panels)

    return Clearance(points, draw)


def _by_speed(
    people: int,
    speeds: Sequence[float] = SPEEDS,
    printed: Mapping[float, str] = MappingProxyType({}),
    mean: tuple[float, float, str] | None = None,
) -> Clearance:
    def point(speed: float) -> Point:
        remark = "paper: blocked" if speed >= PAPER_BLOCKED else ""
        return Point(f"{speed:.1f} m/s", (people, speed), printed.get(speed), remark)

    points = {speed: point(speed) for speed in speeds}
    draw = partial(clearance_times, people, paper=printed, paper_mean=mean)
    return Clearance(points, draw, mean)


# ------------------------------------------------------------------------------------------------------------ figures

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
        """The draw in the middle of all draws, by the time of the last exit; blocked ones come last."""
        pairs = zip(self.sample.blocked_since, self.sample.exits, strict=True)
        ends = [(since is not None, max(exits, default=0.0)) for since, exits in pairs]
        return sorted(range(len(ends)), key=ends.__getitem__)[(len(ends) - 1) // 2]


def leaving_curves(people: int, panels: Mapping[str, Sequence[Curve]]) -> Figure:
    """Return how many are out against time (Figures 4 and 5), a panel a title, all draws light, one of them strong."""
    figure = new_figure((6.8 if len(panels) == 1 else 11.0, 4.9))
    for axes, (title, curves) in zip(figure.subplots(1, len(panels), squeeze=False).flat, panels.items(), strict=True):
        quiet_axes(axes, "time [s]", "people out", title=title, grid=True)
        _leaving(axes, people, curves, every=True)
    return figure


def clearance_times(
    people: int, found: Samples, paper: Mapping[float, str], paper_mean: tuple[float, float, str] | None
) -> Figure:
    """Return one leaving process a speed, and every clearance time against the speed (Figures 7 and 8).

    Parameters
    ----------
    found : desired speed [m/s] -> its draws.
    paper : speed -> clearance time [s] that the paper prints.
    paper_mean : from speed, to speed, mean clearance time that the paper prints for them; or None.
    """
    figure = new_figure((11.4, 5.2))
    left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.12])
    title = f"a. Leaving process, {people} people, one draw a speed"
    quiet_axes(left, "time [s]", "people out", title=title, grid=True)
    colors = [shade(level) for level in np.linspace(0.0, 1.0, len(found))]
    curves = [Curve(f"{v:.1f} m/s", color, found[v]) for v, color in zip(found, colors, strict=True)]
    _leaving(left, people, curves, every=False)
    draws = max(len(sample.episodes) for sample in found.values())
    title = f"b. Clearance time, {draws} draws a speed"
    quiet_axes(right, "desired speed [m/s]", "clearance time [s]", title=title, grid=True)
    times = [(speed, time) for speed, draws in found.items() for time in draws.cleared]
    medians = [(speed, draws.median) for speed, draws in found.items() if draws.median is not None]
    right.plot(*np.reshape(times, (-1, 2)).T, "o", color=series(0), alpha=0.4, ms=5, mew=0, label="one draw")
    label = "median of those that cleared"
    right.plot(*np.reshape(medians, (-1, 2)).T, "-o", color=series(0), mec="white", label=label)
    printed = [float(time) for time in paper.values()]
    if printed:
        right.plot(list(paper), printed, **_PAPER, mec="black", label="paper, from its text")
    if paper_mean is not None:
        label = f"paper, mean close to {paper_mean[2]} s"
        right.plot(paper_mean[:2], [float(paper_mean[2])] * 2, **_PAPER_MEAN, label=label)
    label = f"paper: blocked from {PAPER_BLOCKED:g} m/s"
    right.axvline(PAPER_BLOCKED, color=hex_of(QUIET), lw=1.1, dashes=(2, 2), label=label)
    right.set_xticks(list(found))
    _blocked_band(right, found, 1.08 * max([*(time for _, time in times), *printed], default=100.0))
    right.legend(frameon=False, fontsize=9, loc="lower left")
    return figure


def _leaving(axes: Axes, people: int, curves: Sequence[Curve], *, every: bool) -> None:
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
    axes.set(xlim=(0.0, None), ylim=(0.0, 1.06 * people))
    marks, grey = axes.get_legend_handles_labels()[0], hex_of(QUIET)
    if any(line.get_marker() == "x" for line in axes.get_lines()):
        marks.append(mark("blocked from here on", marker="x", ls="", color=grey))
    if any(curve.paper is not None for curve in curves):
        marks.append(mark("paper", **_PAPER, mec=grey))
    axes.legend(handles=marks, fontsize=9.5, loc="lower right", edgecolor="none").set_zorder(8)


def _blocked_band(axes: Axes, found: Samples, top: float) -> None:
    """End the upright axis with a band above ``top`` that counts the blocked draws."""
    style: dict[str, Any] = {"va": "center", "color": BLOCKED, "fontsize": 8.5, "zorder": 7}
    axes.axhspan(top, 1.1 * top, color=_BAND, lw=0.0, zorder=0)
    axes.text(0.012, 1.05 * top, "blocked", transform=axes.get_yaxis_transform(), **style)
    for speed, draws in found.items():
        if draws.blocked:
            axes.text(speed, 1.05 * top, f"{draws.blocked}/{len(draws.episodes)}", ha="center", **style)
    axes.set_ylim(0.0, 1.1 * top)
    axes.set_yticks([tick for tick in axes.get_yticks() if tick <= top])


FIGURES = (
    _by_strength(),
    _by_rotation(),
    _by_speed(200, (*SPEEDS, 2.2), {0.6: "340", 1.0: "210"}, (1.0, 1.8, "220")),
    _by_speed(300),
)
