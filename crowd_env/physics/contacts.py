"""The waist of the hourglass: every touch, disc on disc, disc on wall and disc on corner, as one struct of arrays.

Sign conventions: ``gap`` is the distance between the surfaces (negative = overlap); the unit ``normal`` points from ``j`` to
``i``, so a positive normal impulse pushes ``i`` along ``+normal`` and ``j`` along ``-normal``; the tangent is the normal turned
left by 90 degrees.  ``j < 0`` is a wall feature: it does not move.

A wall is a set of segments and of end points.  A disc touches the inside of a segment only where its centre projects on it,
and an end point only where every segment that ends there projects beyond it: each touch is found exactly once, at a door
jamb, around the corner of an obstacle, and along a straight wall made of pieces.
"""

from typing import NamedTuple

import numpy as np

from crowd_env._jit import kernel
from crowd_env.geometry import Boundary
from crowd_env.physics.neighbors import NeighbourList
from crowd_env.state import Bodies, CrowdState, Floats, Ints


class Contacts(NamedTuple):
    """Contacts of all environments; ``e`` owns ``NeighbourList.entry_start[e]`` onwards, ``number[e]`` of them."""

    number: Ints  # (E,)
    i: Ints  # (M,)    global person
    j: Ints  # (M,)    global person > i, or -1 - k: wall feature k
    gap: Floats  # (M,)    m     < 0 is overlap
    normal: Floats  # (M, 2)        unit, from j to i
    impulse: Floats  # (M, 2)  N s   normal, tangential, of the current step
    entry: Ints  # (M,)          where the pair stands in the neighbour list


def allocate_contacts(near: NeighbourList) -> Contacts:
    """Return contacts with as much room as the neighbour list."""
    entries = len(near.partner)
    return Contacts(
        number=np.zeros(len(near.reach), dtype=np.int64),
        i=np.zeros(entries, dtype=np.int64),
        j=np.zeros(entries, dtype=np.int64),
        gap=np.zeros(entries),
        normal=np.zeros((entries, 2)),
        impulse=np.zeros((entries, 2)),
        entry=np.zeros(entries, dtype=np.int64),
    )


@kernel
def find_contacts(
    e: int,
    g: int,
    boundary: Boundary,
    bodies: Bodies,
    state: CrowdState,
    near: NeighbourList,
    contacts: Contacts,
    margin: float,
) -> None:
    """Narrow phase: write the contacts of environment ``e`` with a gap below ``margin``, sorted by (i, j), walls last.

    The starting impulse is the history of a pair that was in contact in the previous step, else zero.
    """
    active, position, radius, partner, history = state.active, state.position, bodies.radius, near.partner, near.history
    c = near.entry_start[e]
    for i in range(bodies.env_start[e], bodies.env_start[e + 1]):
        if not active[i]:
            continue
        x, y, r = position[i, 0], position[i, 1], radius[i]
        for entry in range(near.row_begin[i], near.row_end[i]):
            j = partner[entry]
            gap, nx, ny = np.inf, 0.0, 0.0
            if j >= 0:
                dx, dy, limit = x - position[j, 0], y - position[j, 1], r + radius[j] + margin
                if dx * dx + dy * dy < limit * limit and active[j]:
                    gap, nx, ny = _disc_on_point(dx, dy, r + radius[j])
            else:
                gap, nx, ny = gap_to_feature(x, y, r, boundary, g, -1 - j)
            if gap < margin:
                contacts.i[c], contacts.j[c], contacts.gap[c] = i, j, gap
                contacts.normal[c, 0], contacts.normal[c, 1] = nx, ny
                contacts.impulse[c, 0], contacts.impulse[c, 1] = history[entry, 0], history[entry, 1]
                contacts.entry[c] = entry
                c += 1
            elif history[entry, 0] != 0.0 or history[entry, 1] != 0.0:  # rarely: to look is cheaper than to write
                history[entry, 0] = 0.0
                history[entry, 1] = 0.0
    contacts.number[e] = c - near.entry_start[e]


@kernel
def gap_to_feature(
    x: float, y: float, radius: float, boundary: Boundary, g: int, feature: int
) -> tuple[float, float, float]:
    """Return gap and normal between a disc and wall feature ``feature`` of geometry ``g``; infinite if it does not face it."""
    walls = boundary.wall_start[g + 1] - boundary.wall_start[g]
    if feature < walls:
        return _disc_on_wall(x, y, radius, boundary, boundary.wall_start[g] + feature)
    return _disc_on_corner(x, y, radius, boundary, boundary.corner_start[g] + feature - walls)


@kernel
def _disc_on_point(dx: float, dy: float, radius: float) -> tuple[float, float, float]:
    """Gap and normal between a disc and a point (dx, dy) away (or, with ``radius`` the sum of two, between two discs)."""
    distance = np.sqrt(dx * dx + dy * dy)
    if distance == 0.0:  # coincident centres: any direction will do, but always the same
        return -radius, 1.0, 0.0
    return distance - radius, dx / distance, dy / distance


@kernel
def _disc_on_wall(x: float, y: float, radius: float, boundary: Boundary, k: int) -> tuple[float, float, float]:
    ax, ay = boundary.wall[k, 0, 0], boundary.wall[k, 0, 1]
    tx, ty = boundary.wall[k, 1, 0] - ax, boundary.wall[k, 1, 1] - ay
    square = tx * tx + ty * ty
    along = (x - ax) * tx + (y - ay) * ty
    if along <= 0.0 or along >= square:
        return np.inf, 0.0, 0.0
    length = np.sqrt(square)
    height = (tx * (y - ay) - ty * (x - ax)) / length  # > 0: the centre is left of the wall, on the walkable side
    nx, ny = -ty / length, tx / length
    if height >= 0.0:
        return height - radius, nx, ny
    if boundary.two_sided[k]:
        return -height - radius, -nx, -ny
    # A centre that was pressed a little into the wall is pushed back, not through: the gap stays continuous.  Further
    # behind it belongs to the other face, or stands on the other side of a slim partition.
    if -height < min(0.5 * radius, boundary.depth[k]):
        return height - radius, nx, ny
    return np.inf, 0.0, 0.0


@kernel
def _disc_on_corner(x: float, y: float, radius: float, boundary: Boundary, v: int) -> tuple[float, float, float]:
    px, py = boundary.corner[v, 0], boundary.corner[v, 1]
    for m in range(boundary.corner_wall_start[v], boundary.corner_wall_start[v + 1]):
        k = boundary.corner_wall[m]
        ax, ay = boundary.wall[k, 0, 0], boundary.wall[k, 0, 1]
        bx, by = boundary.wall[k, 1, 0], boundary.wall[k, 1, 1]
        if abs(ax - px) + abs(ay - py) > abs(bx - px) + abs(by - py):  # the far end
            ox, oy = ax, ay
        else:
            ox, oy = bx, by
        if (x - px) * (ox - px) + (y - py) * (oy - py) > 0.0:  # the segment itself is nearer
            return np.inf, 0.0, 0.0
    return _disc_on_point(x - px, y - py, radius)
