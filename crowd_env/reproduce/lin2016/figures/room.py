"""People in the room at a few moments, in the form of Figure 6 of Lin, Ma, Lo."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from crowd_env.rendering.canvas import hex_of, new_figure, save_figure
from crowd_env.rendering.palette import EXIT, FLOOR, INK, WALL
from crowd_env.reproduce.lin2016.figures.clearance import foot
from crowd_env.state import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_BODY, _RIM = "#c3d4e0", "#4f6f88"


class RoomPanel(NamedTuple):
    """One panel: K people in the room at one time."""

    title: str
    position: Floats  # (K, 2) m
    radius: Floats  # (K,) m
    angle: Floats  # (K,) rad, of the line from the center to the rim


def snapshots(path: str | Path, moments: Sequence[RoomPanel], walls: Floats, exits: Floats, rests_on: str) -> Path:
    """Draw the room at four moments, two by two; return the path.

    Parameters
    ----------
    path : ends in .png.
    moments : four.
    walls, exits : (W, 2, 2), (X, 2, 2) m.
    rests_on : a line below.
    """
    figure = new_figure((8.6, 9.0))
    for axes, moment in zip(figure.subplots(2, 2).flat, moments, strict=True):
        _room(axes, moment, walls, exits)
    foot(figure, rests_on)
    return save_figure(figure, path)


def _room(axes: "Axes", moment: RoomPanel, walls: Floats, exits: Floats) -> None:
    from matplotlib.collections import LineCollection, PatchCollection
    from matplotlib.patches import Circle

    axes.set_facecolor(hex_of(FLOOR))
    bodies = [Circle((x, y), r) for (x, y), r in zip(moment.position, moment.radius, strict=True)]
    axes.add_collection(PatchCollection(bodies, facecolor=_BODY, edgecolor=_RIM, linewidth=0.8, zorder=2))
    reach = moment.radius[:, None] * np.column_stack([np.cos(moment.angle), np.sin(moment.angle)])
    lines = np.stack([moment.position, moment.position + reach], axis=1)
    axes.add_collection(LineCollection(list(lines), colors=_RIM, linewidths=0.8, zorder=3))
    axes.add_collection(LineCollection(list(exits), colors=hex_of(EXIT), linewidths=2.4, zorder=1))
    axes.add_collection(
        LineCollection(list(walls), colors=hex_of(WALL), linewidths=2.4, capstyle="projecting", zorder=4)
    )
    low, high = walls.min(axis=(0, 1)) - 0.5, np.maximum(walls.max(axis=(0, 1)), exits.max(axis=(0, 1))) + 0.5
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    axes.axis("off")
    axes.set_title(moment.title, loc="left", color=hex_of(INK), fontsize=11, x=0.03, y=0.985)
