"""Heat maps over a floor plan: where people stood close, and where they pressed each other."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.geometry.geometry import Geometry
from crowd_env.rendering.canvas import draw_geometry, hex_of, name_panel, new_figure, without_formulas
from crowd_env.rendering.libraries import Axes, Figure
from crowd_env.rendering.palette import ANCHORS, FAINT, INK, QUIET, Color, blend

_COLUMNS = 2
_WIDTH, _TALLEST = 10.6, 9.0  # inch
_BAR = 0.72  # inch, of a color bar with its numbers and the title above it
# From hardly there to much: teal, and the warm part of the ramp of pressures.
_ANCHORS: dict[str, tuple[Color, ...]] = {
    "density": ((235, 243, 244), (142, 203, 205), (15, 118, 128), (8, 42, 60)),
    "pressure": ((240, 242, 243), *ANCHORS[1:]),
}


class HeatMap(NamedTuple):
    """Values on square cells."""

    title: str
    values: Floats  # (rows, columns)  rows from low to high y; 0 is left blank
    origin: tuple[float, float]  # m  lower left corner
    cell: float  # m
    unit: str
    colors: Literal["density", "pressure"]
    full: float | None = None  # value of the last color; by default the largest


def heat_maps(geometry: Geometry, maps: Sequence[HeatMap], *, title: str = "", note: str = "") -> Figure:
    """Draw maps over the plan, two side by side, and return the figure.

    Parameters
    ----------
    maps : each with a color bar of its own; give the same ``full`` to maps that are to be compared.
    note : a line below.
    """
    rows = -(-len(maps) // _COLUMNS)
    x0, y0, x1, y1 = geometry.bounds
    across = _WIDTH / _COLUMNS
    height = rows * (across * (y1 - y0) / max(x1 - x0, 1e-9) + _BAR) + 0.5 * bool(title) + 0.3 * bool(note)
    shrink = min(1.0, _TALLEST / height)
    figure = new_figure((max(_WIDTH * shrink, 5.0), max(height * shrink, 2.6)))
    figure.get_layout_engine().set(hspace=0.03, wspace=0.03)  # type: ignore[union-attr,call-arg]
    for axes, one in zip(figure.subplots(rows, _COLUMNS, squeeze=False).flat, maps, strict=False):
        _draw(axes, geometry, one)
    for axes in figure.axes[len(maps) : rows * _COLUMNS]:
        axes.axis("off")
    if title:
        figure.suptitle(title, x=0.02, ha="left", color=hex_of(INK), fontsize=12.5, fontweight="bold")
    if note:
        figure.supxlabel(note, x=0.02, ha="left", color=hex_of(QUIET), fontsize=9)
    return without_formulas(figure)


def _draw(axes: Axes, geometry: Geometry, one: HeatMap) -> None:
    from matplotlib.colors import ListedColormap

    rows, columns = one.values.shape
    (left, low), cell = one.origin, one.cell
    full = one.full or float(one.values.max(initial=0.0)) or 1.0
    floor = draw_geometry(axes, geometry, wall=1.6, exit=3.0, margin=0.015)
    image = axes.imshow(
        np.ma.masked_less_equal(one.values, 0.0),
        origin="lower",
        extent=(left, left + cell * columns, low, low + cell * rows),
        cmap=ListedColormap(blend(_ANCHORS[one.colors], np.linspace(0.0, 1.0, 256)) / 255.0),
        vmin=0.0,
        vmax=full,
        interpolation="nearest",
        zorder=1.2,
    )
    image.set_clip_path(floor)
    name_panel(axes, one.title, fontsize=10.5, pad=4)
    figure = axes.get_figure()
    assert figure is not None
    beyond = "max" if one.values.max(initial=0.0) > full * (1.0 + 1e-9) else "neither"
    bar = figure.colorbar(image, ax=axes, orientation="horizontal", fraction=0.045, pad=0.02, aspect=40, extend=beyond)
    bar.outline.set_edgecolor(hex_of(FAINT))
    bar.ax.tick_params(colors=hex_of(QUIET), labelsize=8.5, length=2)
    bar.ax.locator_params(nbins=6)
    bar.set_label(one.unit, color=hex_of(QUIET), fontsize=8.5)
