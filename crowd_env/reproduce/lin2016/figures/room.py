"""People in the room at a few moments, in the form of Figure 6 of Lin, Ma, Lo."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.geometry.geometry import Geometry
from crowd_env.rendering.canvas import draw_floor, draw_lines, name_panel, new_figure, show_plan
from crowd_env.rendering.palette import EXIT, WALL

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_BODY, _RIM = "#c3d4e0", "#4f6f88"


def draw_rooms(moments: Mapping[float, Floats], geometry: Geometry) -> "Figure":
    """Return the room at four moments [s], two by two; of each person (K, 4) x, y and radius [m] and angle [rad]."""
    from matplotlib.collections import LineCollection, PatchCollection
    from matplotlib.patches import Circle

    figure = new_figure((8.6, 9.0))
    for letter, axes, (time, people) in zip("abcd", figure.subplots(2, 2).flat, moments.items(), strict=True):
        draw_floor(axes, geometry)
        bodies = [Circle((x, y), radius) for x, y, radius, _ in people]
        axes.add_collection(PatchCollection(bodies, facecolor=_BODY, edgecolor=_RIM, linewidth=0.8, zorder=2))
        middle, radius, angle = people[:, :2], people[:, 2:3], people[:, 3]
        rim = middle + radius * np.column_stack([np.cos(angle), np.sin(angle)])
        axes.add_collection(
            LineCollection(list(np.stack([middle, rim], axis=1)), colors=_RIM, linewidths=0.8, zorder=3)
        )
        draw_lines(axes, geometry.exits, EXIT, 2.4, 1)
        draw_lines(axes, geometry.walls, WALL, 2.4, 4, capstyle="projecting")
        show_plan(axes, geometry, 0.03)
        name_panel(axes, f"{letter}. t = {time:g} s, {len(people)} inside")
    return figure
