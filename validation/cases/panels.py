"""The figures of the map: a panel for each manner, a color for each scheme, and black for what was recorded."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from crowd_env import SCHEMES
from crowd_env.rendering.canvas import new_figure, quiet_axes, save_figure
from validation.cases.case import Row
from validation.cases.crowds import Floats
from validation.cases.gate import PASSED, PLAN, RADIUS
from validation.cases.ring import BANDS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Told apart in print and by color-blind eyes; the recording is black.
_COLORS = ("#0f7680", "#89478f", "#9e7a16", "#6b4a2f", "#4a5ca0", "#747b83", "#a03c3c", "#5d7a2b")
COLORS = dict(zip(SCHEMES, _COLORS, strict=True))
WALL, QUIET, BAND = "#37414d", "#747b83", "#d5d8dc"


class Panel:
    """The axes of one manner."""

    def __init__(self, axes: "Axes", manner: str, rows: Sequence[Row]) -> None:
        self.axes, self.rows = axes, [row for row in rows if row.manner == manner]
        axes.set_title(manner, loc="left", fontsize=9, color=QUIET)

    def legend(self, place: Literal["upper right", "lower right"]) -> None:
        """Write which line is which."""
        for line in self.axes.legend(loc=place, frameon=False, fontsize=8).get_lines():
            line.set(linewidth=2.0, alpha=1.0)


def manner_panels(rows: Sequence[Row], xlabel: str, ylabel: str) -> tuple["Figure", Iterator[Panel]]:
    """Return a figure, and a panel for each manner side by side."""
    manners = list(dict.fromkeys(row.manner for row in rows))
    figure = new_figure((0.6 + 4.2 * len(manners), 4.2), dpi=130)
    every = figure.subplots(1, len(manners), squeeze=False)[0]
    for axes in every:
        quiet_axes(axes, xlabel, ylabel)
    return figure, (Panel(axes, manner, rows) for axes, manner in zip(every, manners, strict=True))


def gate(folder: Path, rows: Sequence[Row]) -> None:
    """Write ``gate.png``, the counts, and ``gate-gaps.png``, the distribution of the gaps."""
    _draw_gate(folder, rows)
    _draw_gaps(folder, rows)


def _draw_gate(folder: Path, rows: Sequence[Row]) -> None:
    """Draw the plan, and a panel each manner, in which every run is a thin line, flat to the right where it got stuck."""
    from matplotlib.patches import Circle

    manners = list(dict.fromkeys(row.manner for row in rows))
    figure = new_figure((5.0 + 4.2 * len(manners), 4.6), dpi=130)
    left, *panels = figure.subplots(1, 1 + len(manners))
    corners = np.array(PLAN)
    quiet_axes(left, "x [m]", "y [m]")
    left.plot(*corners[:5].T, color=WALL, lw=2)
    left.plot(*corners[5:].T, color=WALL, lw=2)
    for x, y in rows[0].more["position"]:
        left.add_patch(Circle((x, y), RADIUS, facecolor="#a8bccd", edgecolor=WALL, lw=0.6))
    left.set(aspect="equal", xlim=(-3.1, 3.1), ylim=(-1.4, 7.0))
    left.set_title(f"first positions, radius {RADIUS:g} m", loc="left", fontsize=9, color=QUIET)
    for axes, manner in zip(panels, manners, strict=True):
        quiet_axes(axes, "time since the first frame [s]", "people in the gate")
        _draw_counts(Panel(axes, manner, rows))
    save_figure(figure, folder / "gate.png")


def _draw_counts(panel: Panel) -> None:
    """Draw N(t) of every run of some schemes, and the recorded one."""
    of_rows = [_runs(row) for row in panel.rows]
    known, at = _recorded(panel.rows[0])
    end = 1.05 * max(float(at[-1]), *(float(times[-1]) for runs in of_rows for times in runs if len(times)))
    for row, runs in zip(panel.rows, of_rows, strict=True):
        for k, times in enumerate(runs):
            label = None if k else f"{row.scheme}: {row.figure.partition(';')[0]}"
            color = COLORS[row.scheme]
            panel.axes.step(*_curve(times, end), where="post", color=color, lw=0.9, alpha=0.6, label=label)
    panel.axes.plot(at, known, color="black", lw=1.8, label="recorded: 1.13 /s")
    panel.axes.set(xlim=(0, end), ylim=(0, len(panel.rows[0].more["position"]) + 1))
    panel.legend("lower right")


def _draw_gaps(folder: Path, rows: Sequence[Row]) -> None:
    """Draw the share of gaps that are longer than t: of all draws of a scheme together, and of the recording."""
    figure, panels = manner_panels(rows, "gap $t$ between two people in the gate [s]", "P(gap > $t$)")
    for panel in panels:
        for row in panel.rows:
            gaps = np.concatenate([np.empty(0), *(np.diff(times) for times in _runs(row))])
            label = f"{row.scheme}: mean {gaps.mean():.2f} s" if len(gaps) else row.scheme
            panel.axes.step(*longer(gaps), where="post", color=COLORS[row.scheme], lw=1.4, label=label)
        recorded = panel.rows[0].more["recorded"]
        if recorded is not None:
            gaps = np.diff(recorded)
            label = f"recorded: mean {gaps.mean():.2f} s"
            panel.axes.step(*longer(gaps), where="post", color="black", lw=1.8, label=label)
        panel.axes.set(xlim=(0, 4), ylim=(1e-3, 1.1), yscale="log")
        panel.legend("upper right")
    save_figure(figure, folder / "gate-gaps.png")


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
    figure, panels = manner_panels(rows, "density [1/m²]", "speed [m/s]")
    for panel in panels:
        recorded = panel.rows[0].more["recorded"]
        for row in panel.rows:
            color = COLORS[row.scheme]
            points = np.array([(run["density"], run["speed"]) for run in row.more["runs"]], dtype=np.float64)
            panel.axes.plot(*points.T, "o", color=color, ms=4, label=row.scheme)
            panel.axes.plot(*_line(row.more["diagram"]), color=color, lw=1.0)
        points = np.array([(run["density"], run["speed"]) for run in recorded])
        panel.axes.plot(*points.T, "o", color="black", ms=5, label="recorded")
        if panel.rows[0].more["recorded_diagram"] is not None:
            panel.axes.plot(*_line(panel.rows[0].more["recorded_diagram"]), color="black", lw=1.6)
        panel.axes.set(xlim=(0.0, 6.0), ylim=(0.0, 1.6))
        panel.legend("upper right")
    save_figure(figure, folder / "corridor.png")


def _line(diagram: dict[str, float]) -> tuple[list[float], list[float]]:
    """Return densities [1/m2] and mean speeds [m/s] of the bins."""
    return [float(density) for density in diagram], list(diagram.values())


def ring(folder: Path, rows: Sequence[Row]) -> None:
    """Write ``ring.png``: the recorded 10 to 90 % band with its median, and the mean speeds of every scheme."""
    density = np.array(list(BANDS))
    low, median, high = np.array(list(BANDS.values())).T
    figure, panels = manner_panels(rows, "people per metre of the lane [1/m]", "mean speed [m/s]")
    for panel in panels:
        panel.axes.fill_between(density, low, high, color=BAND, label="recorded, 10 to 90 %")
        panel.axes.plot(density, median, color="black", lw=1.8, label="recorded, median")
        for row in panel.rows:
            found = {float(k): speed for k, speed in row.more["speed"].items() if speed is not None}
            color = COLORS[row.scheme]
            panel.axes.plot(list(found), list(found.values()), "o-", color=color, lw=1.2, ms=3.5, label=row.scheme)
        panel.axes.set(xlim=(0.4, 2.6), ylim=(0.0, 1.4))
        panel.legend("upper right")
    save_figure(figure, folder / "ring.png")
