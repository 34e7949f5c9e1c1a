"""People in the room at a few moments, in the form of Figure 6 of Lin, Ma, Lo."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from crowd_env.geometry.geometry import Geometry
from crowd_env.rendering.canvas import hex_of, new_figure
from crowd_env.rendering.palette import EXIT, FLOOR, INK, WALL
from crowd_env.reproduce.lin2016.record import Snapshot

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BODY, _RIM = "#c3d4e0", "#4f6f88"


def draw_rooms(moments: Sequence[Snapshot], geometry: Geometry) -> "Figure":
    """Return the room at four moments, two by two."""
    figure = new_figure((8.6, 9.0))
    for letter, axes, moment in zip("abcd", figure.subplots(2, 2).flat, moments, strict=True):
        _room(axes, moment, geometry)
        title = f"{letter}. t = {moment.time:g} s, {len(moment.x)} inside"
        axes.set_title(title, loc="left", color=hex_of(INK), fontsize=11, x=0.03, y=0.985)
    return figure


def _room(axes: "Axes", moment: Snapshot, geometry: Geometry) -> None:
    from matplotlib.collections import LineCollection, PatchCollection
    from matplotlib.patches import Circle

    x, y, radius, angle = (np.array(column) for column in moment[1:])
    axes.set_facecolor(hex_of(FLOOR))
    bodies = [Circle((a, b), r) for a, b, r in zip(x, y, radius, strict=True)]
    axes.add_collection(PatchCollection(bodies, facecolor=_BODY, edgecolor=_RIM, linewidth=0.8, zorder=2))
    rim = np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])
    lines = np.stack([np.column_stack([x, y]), rim], axis=1)
    axes.add_collection(LineCollection(list(lines), colors=_RIM, linewidths=0.8, zorder=3))
    walls, exits = geometry.walls, geometry.exits
    axes.add_collection(LineCollection(list(exits), colors=hex_of(EXIT), linewidths=2.4, zorder=1))
    axes.add_collection(
        LineCollection(list(walls), colors=hex_of(WALL), linewidths=2.4, capstyle="projecting", zorder=4)
    )
    low, high = walls.min(axis=(0, 1)) - 0.5, np.maximum(walls.max(axis=(0, 1)), exits.max(axis=(0, 1))) + 0.5
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    axes.axis("off")
