"""The figure of the open corridor: the fundamental diagram, speed against density, recorded and simulated."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from crowd_env.rendering.canvas import save_figure
from validation.cases.case import Row
from validation.cases.panels import COLORS, manner_panels


def draw(folder: Path, rows: Sequence[Row]) -> None:
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
