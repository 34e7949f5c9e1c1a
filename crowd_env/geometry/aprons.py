"""Aprons: the ground behind an exit line on which people go on being bodies.

An apron lengthens the passage that is drawn in front of a line: a crowd is held up by the people in the first two meters behind
the jambs, drawn or not.  It is as wide as the line, and reaches straight outwards.  It has walls at its sides, where it
meets neither floor nor the apron of another exit, and none at its end.  Where floor lies behind the line, as beyond an area in
the middle of a hall that people walk into, an apron ends halfway.  It is no part of the walkable area.
"""

import numpy as np
import shapely
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from crowd_env.core.arrays.state import Bools, Floats
from crowd_env.core.checks import Range
from crowd_env.geometry.parsing import SLIVER, Area, tangents

APRON = 2.0  # m from the jambs to the end, the usual
APRONS = Range(0.0, 10.0)  # m
_INWARDS = 1e-3  # m; an apron begins this far inside, so that no gap of rounding parts it from the area
_MIDDLE = 0.2  # m, off either end of a line: floor that is nearer to its ends does not end an apron
_BODY = 0.15  # m, radius: a line in front of which no such body gets, as of an area drawn a hand off the wall, has none
_PARALLEL = 0.98  # cosine between the sides of a passage and its axis
_SAME = 1e-9  # m
_SHARP = 0.5  # cosine: lines that turn by more, as around an area, do not converge but cross


def add_aprons(walkable: Area, exits: Floats, depth: float | Floats) -> Area:
    """Return the area with the aprons of ``exits`` (X, 2, 2), all of one ``depth`` [m] or each of its own (X,)."""
    area = shapely.union_all([walkable, *shapely.polygons(_corners(exits, _INWARDS, depth))])
    assert isinstance(area, Polygon | MultiPolygon)  # each apron touches the area along its exit
    return area


def depths_of_aprons(walkable: Area, walls: Floats, exits: Floats, length: float) -> Floats:
    """Return the depth (X,) [m] of the apron behind each exit.

    Parameters
    ----------
    walkable : the drawn area.
    walls, exits : (W, 2, 2) and (X, 2, 2) m, with the area to their left.
    length : m, from the jambs to the end of an apron.  An unreachable line has none, nor have lines bent into the area.
    """
    if not length or not len(exits):
        return np.zeros(len(exits))
    wanted = wanted_depths(walls, exits, length)
    found = _free_depths(walkable, exits, wanted)
    return np.where(_converge(exits) & (found == wanted), 0.0, found)


def wanted_depths(walls: Floats, exits: Floats, length: float) -> Floats:
    """Return the depth (X,) [m] of the apron behind each exit where nothing lies behind the line."""
    return np.maximum(length - _passages(walls, exits), 0.0)


def _converge(exits: Floats) -> Bools:
    """Return (X,) which lines meet another at a small angle whose apron leans towards theirs: people would wedge there."""
    along, _ = tangents(exits)
    follows = np.hypot(*(exits[:, None, 1] - exits[None, :, 0]).T).T < _SAME  # line i ends where j begins
    turn = along[:, None, 0] * along[None, :, 1] - along[:, None, 1] * along[None, :, 0]
    lean = follows & (turn < -_SAME) & (along @ along.T > _SHARP)
    return lean.any(axis=1) | lean.any(axis=0)


def ends_of_aprons(exits: Floats, depths: Floats) -> Floats:
    """Return the lines (X, 2, 2) [m] at the ends of aprons of these ``depths`` (X,) [m]."""
    return exits + depths[:, None, None] * _outwards(exits)[:, None]


def sides_of_aprons(walkable: Area, exits: Floats, depths: Floats) -> Floats:
    """Return the side walls (A, 2, 2) [m] of aprons of these ``depths`` (X,) [m], which lie to the left of them."""
    deep, ends = np.flatnonzero(depths > 0.0), exits.reshape(-1, 2)
    corners = _corners(exits[deep], 0.0, depths[deep])
    strips, floor, sides = shapely.polygons(corners), shapely.buffer(walkable, -SLIVER), [np.empty((0, 2, 2))]
    for k, (near_a, near_b, far_b, far_a) in enumerate(corners):
        others = shapely.buffer(shapely.union_all(np.delete(strips, k)), -SLIVER)
        # Aprons of an area at the outer face of a wall meet in the door behind which it lies: no wall closes that.
        doors = shapely.buffer(shapely.multilinestrings(np.delete(exits, deep[k], axis=0)), SLIVER, cap_style="flat")
        for end, side in ((near_a, (near_a, far_a)), (near_b, (far_b, near_b))):
            if (np.hypot(*(ends - end).T) < _SAME).sum() == 1:  # not where two lines of one opening meet
                sides.append(_pieces(np.array(side), floor, others, doors))
    return np.concatenate(sides)


def _corners(exits: Floats, inwards: float, depth: float | Floats) -> Floats:
    """Return the corners (X, 4, 2) [m] of strips that reach from ``inwards`` in front of lines to ``depth`` behind them."""
    outward = _outwards(exits)[:, None]
    far = exits + np.broadcast_to(depth, len(exits))[:, None, None] * outward
    return np.concatenate([exits - inwards * outward, far[:, ::-1]], axis=1)


def _passages(walls: Floats, exits: Floats) -> Floats:
    """Return the length (X,) [m] of the passage in front of each line: of the shorter of its two sides."""
    along, length = tangents(walls)
    found = np.zeros((len(exits), 2))
    for k, (normal, line) in enumerate(zip(_outwards(exits), exits, strict=True)):
        for end, sign in ((0, 1.0), (1, -1.0)):  # one side runs to the first end, the other from the second
            at_end = np.hypot(*(walls[:, 1 - end] - line[end]).T) < _SAME
            found[k, end] = length[at_end & (sign * (along @ normal) > _PARALLEL)].max(initial=0.0)
    return found.min(axis=1)


def _outwards(exits: Floats) -> Floats:
    """Return the outward normals (X, 2)."""
    along, _ = tangents(exits)
    return np.stack([along[:, 1], -along[:, 0]], axis=1)  # the area lies to the left


def _free_depths(walkable: Area, exits: Floats, depth: Floats) -> Floats:
    """Return the depth (X,) [m] of each apron: half of the way to the floor behind the line, ``depth`` at most."""
    outward, (along, length) = _outwards(exits), tangents(exits)
    off = np.minimum(_MIDDLE, 0.4 * length)[:, None] * along
    middle = np.stack([exits[:, 0] + off, exits[:, 1] - off], axis=1)
    floor = shapely.buffer(shapely.buffer(walkable, -_BODY), _BODY)
    in_front = shapely.intersects(shapely.polygons(_corners(middle, 0.5 * _BODY, 0.0)), floor)
    found = np.where(in_front, depth, 0.0)
    behind = shapely.intersection(shapely.polygons(_corners(middle, -SLIVER, 2.0 * depth)), walkable)
    for k in np.flatnonzero(in_front & (shapely.area(behind) > SLIVER)):
        points = shapely.get_coordinates(behind[k]) - exits[k, 0]
        found[k] = min(found[k], 0.5 * float((points @ outward[k]).min()))
    return np.where(found > SLIVER, found, 0.0)


def _pieces(side: Floats, *ground: BaseGeometry) -> Floats:
    """Return the pieces (K, 2, 2) of a side wall that lie on no other ``ground``."""
    line: BaseGeometry = shapely.LineString(side)
    for other in ground:
        line = shapely.difference(line, other)
    left = shapely.get_parts(line)
    ends = [shapely.get_coordinates(part)[[0, -1]] for part in left if shapely.length(part) > 10.0 * SLIVER]
    along = side[1] - side[0]
    return np.array([piece if (piece[1] - piece[0]) @ along > 0.0 else piece[::-1] for piece in ends]).reshape(-1, 2, 2)
