"""What the figures of the map share: a panel for each manner, a color for each scheme, and black for what was recorded."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Literal

from crowd_env import SCHEMES
from crowd_env.rendering.canvas import new_figure, quiet_axes
from validation.cases.case import Row

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Told apart in print and by color-blind eyes; the recording is black.
COLORS = dict(zip(SCHEMES, ("#0f7680", "#89478f", "#9e7a16", "#4a5ca0", "#747b83", "#a03c3c", "#5d7a2b"), strict=True))
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
