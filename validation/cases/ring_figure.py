"""The figure of the ring: speed against line density, beside the band of the experiments."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from crowd_env.rendering.canvas import save_figure
from validation.cases.case import Row
from validation.cases.panels import BAND, COLORS, manner_panels
from validation.cases.ring import BANDS


def draw(folder: Path, rows: Sequence[Row]) -> None:
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
