"""What all figures share: a sheet, quiet axes, shades, and a file that appears whole or not at all.

Figures are made of matplotlib's objects without ``pyplot``: no backend is chosen, no global setting is changed and nothing
stays open.
"""

import base64
from collections.abc import Iterable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from crowd_env.core.arrays.state import Floats
from crowd_env.core.files.atomic import check_suffix, written
from crowd_env.geometry.geometry import Geometry
from crowd_env.rendering.libraries import Axes, Figure, Line2D, PathPatch, drawing_library
from crowd_env.rendering.palette import EXIT, FLOOR, INK, OBSTACLE, QUIET, SERIES, WALL, Color
from crowd_env.rendering.plan import holes_of, shells_of

_DPI = 160
_LIGHT, _DARK = np.array([142, 203, 205]), np.array([8, 52, 66])  # teal


def new_figure(
    size: tuple[float, float], *, dpi: float = _DPI, background: Color = FLOOR, constrained: bool = True
) -> Figure:
    """Return an empty figure of ``size`` inches that belongs to no window; its axes are spread out if ``constrained``.

    Raises
    ------
    ModuleNotFoundError
        If matplotlib is not installed; the message explains how to install it.
    """
    with drawing_library():
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    figure = Figure(figsize=size, dpi=dpi, facecolor=hex_of(background))
    if constrained:
        figure.set_layout_engine("constrained", w_pad=0.08, h_pad=0.08)
    FigureCanvasAgg(figure)
    return figure


def quiet_axes(axes: Axes, xlabel: str, ylabel: str, *, title: str = "", grid: bool = False) -> Axes:
    """Return ``axes`` with thin grey lines, so that what is measured stands out."""
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color("#c9c6bf")
    axes.tick_params(colors=hex_of(QUIET), labelsize=9, length=3)
    if grid:
        axes.grid(axis="y", color="#eeece7", linewidth=0.8)
        axes.set_axisbelow(True)
    axes.set_xlabel(xlabel, color=hex_of(INK), fontsize=10)
    axes.set_ylabel(ylabel, color=hex_of(INK), fontsize=10)
    if title:
        name_panel(axes, title)
    return axes


def name_panel(axes: Axes, title: str, **style: Any) -> None:
    """Write a title above the upper left corner of ``axes``."""
    axes.set_title(title, loc="left", color=hex_of(INK), **{"fontsize": 11, **style})


def mark(label: str, **style: Any) -> Line2D:
    """Return an entry of a legend: a line or a marker in a ``style`` of matplotlib that is drawn nowhere else."""
    from matplotlib.lines import Line2D

    return Line2D([], [], label=label, **style)


def literal(name: str) -> str:
    """Return a name for a figure that has formulas: a dollar in it begins none."""
    return name.replace("$", r"\$")


def save_figure(figure: Figure, path: str | Path) -> Path:
    """Write ``figure`` to ``path`` and return the path.

    Raises
    ------
    ValueError
        If ``path`` does not end in .png.
    """
    path = check_suffix(path, (".png",))
    with written(path) as part:
        figure.savefig(part, format="png", dpi="figure")
    return path


def encoded(figure: Figure) -> str:
    """Return ``figure`` as a PNG in base64, for a page."""
    picture = BytesIO()
    figure.savefig(picture, format="png", dpi="figure")
    return base64.b64encode(picture.getvalue()).decode("ascii")


def without_formulas(figure: Figure) -> Figure:
    """Return ``figure`` with all texts shown as they are written: a dollar in the name of a file begins no formula."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        text.set_parse_math(False)
    return figure


def fill_rings(axes: Axes, rings: Iterable[Floats], color: Color, layer: float, alpha: float = 1.0) -> PathPatch:
    """Fill what lies between closed lines (K, 2) [m] on axes in meters, and return the patch."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    outline = Outline.make_compound_path(*(Outline(ring, closed=True) for ring in rings))
    patch = PathPatch(outline, facecolor=hex_of(color), alpha=alpha, edgecolor="none", zorder=layer)
    axes.add_patch(patch)
    return patch


def draw_floor(axes: Axes, geometry: Geometry) -> PathPatch:
    """Draw the floor of a plan, and grey obstacles where it has holes, on axes in meters; return the floor."""
    shells = shells_of(geometry.walkable)
    fill_rings(axes, shells, OBSTACLE, 0)
    return fill_rings(axes, [*shells, *holes_of(geometry.walkable)], FLOOR, 1)


def draw_lines(axes: Axes, lines: Iterable[Floats], color: Color, width: ArrayLike, layer: float, **style: Any) -> None:
    """Draw segments (K, 2, 2) [m], ``width`` () or (K,) [points] wide, on axes in meters."""
    from matplotlib.collections import LineCollection

    axes.add_collection(LineCollection(list(lines), colors=hex_of(color), linewidths=width, zorder=layer, **style))


def draw_bodies(axes: Axes, center: Floats, radius: ArrayLike, **style: Any) -> None:
    """Draw discs at ``center`` (K, 2) [m] of ``radius`` (K,) or () [m] on axes in meters."""
    from matplotlib.collections import EllipseCollection

    size = 2.0 * np.broadcast_to(radius, len(center))
    where: dict[str, Any] = {"units": "xy", "offsets": center, "offset_transform": axes.transData}
    axes.add_collection(EllipseCollection(size, size, np.zeros(len(size)), **where, **style))


def draw_geometry(axes: Axes, geometry: Geometry, *, wall: float, exit: float, margin: float) -> PathPatch:
    """Draw all of a plan on axes without ticks, and return the floor; people belong on layers 2 and 3.

    ``wall`` and ``exit`` are points, ``margin`` is a share of the longer side.
    """
    floor = draw_floor(axes, geometry)
    draw_lines(axes, geometry.exits, EXIT, exit, 1.5)
    draw_lines(axes, geometry.walls, WALL, wall, 4, capstyle="projecting")
    x0, y0, x1, y1 = geometry.bounds
    room = margin * max(x1 - x0, y1 - y0)
    axes.set_xlim(x0 - room, x1 + room)
    axes.set_ylim(y0 - room, y1 + room)
    axes.set_aspect("equal")
    axes.set_axis_off()
    return floor


def hex_of(color: Color) -> str:
    """Return ``color`` as matplotlib reads it."""
    return "#{:02x}{:02x}{:02x}".format(*color)


def series(k: int) -> str:
    """Return the color of the curve ``k``."""
    return hex_of(SERIES[k % len(SERIES)])


def shade(level: float) -> str:
    """Return a color from light (0) to dark (1) teal."""
    r, g, b = (round(float(v)) for v in _LIGHT + level * (_DARK - _LIGHT))
    return hex_of((r, g, b))
