"""The figures of the map: a panel for each manner, a color for each scheme, and black for what was recorded."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from crowd_env import SCHEMES
from crowd_env.rendering.canvas import new_figure, quiet_axes, save_figure
from validation.cases.case import Row
from validation.cases.crowds import Floats
from validation.cases.gate import PASSED, PLAN, RADIUS
from validation.cases.ring import BANDS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Told apart in print and by color-blind eyes; the recording is black.
_COLORS = ("#0f7680", "#89478f", "#9e7a16", "#6b4a2f", "#4a5ca0", "#747b83", "#a03c3c", "#5d7a2b", "#b8651b")
COLORS = dict(zip(SCHEMES, _COLORS, strict=True))
WALL, BAND = "#37414d", "#d5d8dc"
_TITLE: dict[str, Any] = {"loc": "left", "fontsize": 9, "color": "#747b83"}


def draw_panels(
    path: Path,
    rows: Sequence[Row],
    labels: tuple[str, str],
    draw: Callable[["Axes", list[Row]], None],
    legend: Literal["upper right", "lower right"] = "upper right",
    plan: Callable[["Axes"], None] | None = None,
) -> None:
    """Write a figure of panels: the ``plan`` if there is one, then for each manner what ``draw`` makes of its rows."""
    manners = list(dict.fromkeys(row.manner for row in rows))
    width, height = (0.6, 4.2) if plan is None else (5.0, 4.6)
    figure = new_figure((width + 4.2 * len(manners), height), dpi=130)
    every = list(figure.subplots(1, len(manners) + (plan is not None), squeeze=False)[0])
    if plan is not None:
        plan(every.pop(0))
    for axes, manner in zip(every, manners, strict=True):
        quiet_axes(axes, *labels).set_title(manner, **_TITLE)
        draw(axes, [row for row in rows if row.manner == manner])
        for line in axes.legend(loc=legend, frameon=False, fontsize=8).get_lines():
            line.set(linewidth=2.0, alpha=1.0)
    save_figure(figure, path)


def gate(folder: Path, rows: Sequence[Row]) -> None:
    """Write ``gate.png``, the plan and the counts, and ``gate-gaps.png``, the share of gaps that are longer than t."""
    counts = ("time since the first frame [s]", "people in the gate")
    gaps = ("gap $t$ between two people in the gate [s]", "P(gap > $t$)")
    draw_panels(folder / "gate.png", rows, counts, _draw_counts, "lower right", partial(_draw_plan, rows[0]))
    draw_panels(folder / "gate-gaps.png", rows, gaps, _draw_gaps)


def _draw_plan(row: Row, axes: "Axes") -> None:
    """Draw the barriers, and where people stood first."""
    from matplotlib.patches import Circle

    quiet_axes(axes, "x [m]", "y [m]")
    for side in (PLAN[:5], PLAN[5:]):
        axes.plot(*np.transpose(side), color=WALL, lw=2)
    for x, y in row.more["position"]:
        axes.add_patch(Circle((x, y), RADIUS, facecolor="#a8bccd", edgecolor=WALL, lw=0.6))
    axes.set(aspect="equal", xlim=(-3.1, 3.1), ylim=(-1.4, 7.0))
    axes.set_title(f"first positions, radius {RADIUS:g} m", **_TITLE)


def _draw_counts(axes: "Axes", rows: list[Row]) -> None:
    """Draw N(t) of every run of some schemes, flat to the right where it got stuck, and the recorded one."""
    of_rows = [_runs(row) for row in rows]
    known, at = _recorded(rows[0])
    end = 1.05 * max(float(at[-1]), *(float(times[-1]) for runs in of_rows for times in runs if len(times)))
    for row, runs in zip(rows, of_rows, strict=True):
        for k, times in enumerate(runs):
            label = None if k else f"{row.scheme}: {row.figure.partition(';')[0]}"
            axes.step(*_curve(times, end), where="post", color=COLORS[row.scheme], lw=0.9, alpha=0.6, label=label)
    axes.plot(at, known, color="black", lw=1.8, label="recorded: 1.13 /s")
    axes.set(xlim=(0, end), ylim=(0, len(rows[0].more["position"]) + 1))


def _draw_gaps(axes: "Axes", rows: list[Row]) -> None:
    """Draw the share of gaps that are longer than t: of all draws of a scheme together, and of the recording."""
    found = [
        (row.scheme, np.concatenate([np.empty(0), *map(np.diff, _runs(row))]), COLORS[row.scheme], 1.4) for row in rows
    ]
    if (recorded := rows[0].more["recorded"]) is not None:
        found.append(("recorded", np.diff(recorded), "black", 1.8))
    for name, gaps, color, width in found:
        label = f"{name}: mean {gaps.mean():.2f} s" if len(gaps) else name
        axes.step(*longer(gaps), where="post", color=color, lw=width, label=label)
    axes.set(xlim=(0, 4), ylim=(1e-3, 1.1), yscale="log")


def longer(gaps: Floats) -> tuple[Floats, Floats]:
    """Return the gaps (K+1,) [s] in order, from 0 on, and the share of them that are longer."""
    return np.concatenate([[0.0], np.sort(gaps)]), 1.0 - np.arange(len(gaps) + 1.0) / max(len(gaps), 1)


def _runs(row: Row) -> list[Floats]:
    """Return when people passed in each run."""
    return [np.array([t for t in run if t is not None]) for run in row.more["passages"]]


def _recorded(row: Row) -> tuple[Floats, Floats]:
    """Return how many had passed, and when: every person of the recording if there is one, else the counted ones."""
    times = row.more["recorded"]
    if times is None:
        return np.array([0.0, *PASSED]), np.array([0.0, *PASSED.values()])
    return np.arange(len(times) + 1.0), np.array([0.0, *times])


def _curve(times: Floats, end: float) -> tuple[Floats, Floats]:
    """Return N(t) up to ``end``."""
    count = np.arange(len(times) + 1.0)
    return np.concatenate([[0.0], times, [end]]), np.append(count, count[-1])


def corridor(folder: Path, rows: Sequence[Row]) -> None:
    """Write ``corridor.png``: a point for each of the nine runs, and lines of mean speeds in bins of density."""
    draw_panels(folder / "corridor.png", rows, ("density [1/m²]", "speed [m/s]"), _draw_diagrams)


def _draw_diagrams(axes: "Axes", rows: list[Row]) -> None:
    """Draw the runs of some schemes and the recorded ones."""
    found = [(row.scheme, row.more["runs"], row.more["diagram"], COLORS[row.scheme], 4, 1.0) for row in rows]
    known = rows[0].more
    found.append(("recorded", known["recorded"], known["recorded_diagram"], "black", 5, 1.6))
    for name, runs, diagram, color, size, width in found:
        points = np.array([(run["density"], run["speed"]) for run in runs], dtype=np.float64)
        axes.plot(*points.T, "o", color=color, ms=size, label=name)
        if diagram is not None:
            axes.plot([float(density) for density in diagram], list(diagram.values()), color=color, lw=width)
    axes.set(xlim=(0.0, 6.0), ylim=(0.0, 1.6))


def ring(folder: Path, rows: Sequence[Row]) -> None:
    """Write ``ring.png``: the recorded 10 to 90 % band with its median, and the mean speeds of every scheme."""
    draw_panels(folder / "ring.png", rows, ("people per metre of the lane [1/m]", "mean speed [m/s]"), _draw_speeds)


def _draw_speeds(axes: "Axes", rows: list[Row]) -> None:
    """Draw the mean speeds of some schemes over the recorded band."""
    density = np.array(list(BANDS))
    low, median, high = np.array(list(BANDS.values())).T
    axes.fill_between(density, low, high, color=BAND, label="recorded, 10 to 90 %")
    axes.plot(density, median, color="black", lw=1.8, label="recorded, median")
    for row in rows:
        found = {float(k): speed for k, speed in row.more["speed"].items() if speed is not None}
        color = COLORS[row.scheme]
        axes.plot(list(found), list(found.values()), "o-", color=color, lw=1.2, ms=3.5, label=row.scheme)
    axes.set(xlim=(0.4, 2.6), ylim=(0.0, 1.4))
