"""The figure of the gate: the plan with the first positions, and N(t) recorded and simulated."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from crowd_env.rendering.canvas import new_figure, quiet_axes, save_figure
from validation.cases.case import Row
from validation.cases.crowds import Floats
from validation.cases.gate import PASSED, PLAN, RADIUS

# Told apart in print and by color-blind eyes; the recording is black.
_COLORS = ("#0f7680", "#89478f", "#9e7a16", "#4a5ca0", "#a03c3c", "#5d7a2b", "#747b83")
_WALL, _QUIET = "#37414d", "#747b83"


def draw(folder: Path, rows: Sequence[Row]) -> None:
    """Write ``gate.png``: a panel each manner, in which every run is a thin line, flat to the right where it got stuck."""
    from matplotlib.patches import Circle

    manners = list(dict.fromkeys(row.manner for row in rows))
    figure = new_figure((5.0 + 4.2 * len(manners), 4.6), dpi=130)
    left, *panels = figure.subplots(1, 1 + len(manners))
    corners = np.array(PLAN)
    quiet_axes(left, "x [m]", "y [m]")
    left.plot(*corners[:5].T, color=_WALL, lw=2)
    left.plot(*corners[5:].T, color=_WALL, lw=2)
    for x, y in rows[0].more["position"]:
        left.add_patch(Circle((x, y), RADIUS, facecolor="#a8bccd", edgecolor=_WALL, lw=0.6))
    left.set(aspect="equal", xlim=(-3.1, 3.1), ylim=(-1.4, 7.0))
    left.set_title(f"first positions, radius {RADIUS:g} m", loc="left", fontsize=9, color=_QUIET)
    for panel, manner in zip(panels, manners, strict=True):
        _draw_counts(panel, manner, [row for row in rows if row.manner == manner])
    save_figure(figure, folder / "gate.png")


def _draw_counts(panel: Any, manner: str, rows: Sequence[Row]) -> None:
    """Draw N(t) of every run of some schemes, and the recorded one."""
    of_rows = [[np.array([t for t in run if t is not None]) for run in row.more["passages"]] for row in rows]
    known, at = _recorded(rows[0])
    end = 1.05 * max(float(at[-1]), *(float(times[-1]) for runs in of_rows for times in runs if len(times)))
    quiet_axes(panel, "time since the first frame [s]", "people in the gate")
    for color, row, runs in zip(_COLORS, rows, of_rows, strict=False):
        for k, times in enumerate(runs):
            label = None if k else f"{row.scheme}: {row.figure.partition(';')[0]}"
            panel.step(*_curve(times, end), where="post", color=color, lw=0.9, alpha=0.6, label=label)
    panel.plot(at, known, color="black", lw=1.8, label="recorded: 1.13 /s")
    panel.set(xlim=(0, end), ylim=(0, len(rows[0].more["position"]) + 1))
    for line in panel.legend(frameon=False, loc="lower right", fontsize=9).get_lines():
        line.set(linewidth=2.0, alpha=1.0)
    panel.set_title(manner, loc="left", fontsize=9, color=_QUIET)


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
