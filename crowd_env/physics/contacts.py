"""The waist of the hourglass: every touch, disc on disc, disc on wall and disc on corner, as one struct of arrays.

Sign conventions: ``gap`` is the distance between the surfaces (negative = overlap); the unit ``normal`` points from ``j`` to
``i``, so a positive normal impulse pushes ``i`` along ``+normal`` and ``j`` along ``-normal``; the tangent is the normal turned
left by 90 degrees.  ``j < 0`` is a wall feature: it does not move.

A wall is a set of segments and of end points.  A disc touches the inside of a segment only where its center projects on it,
and an end point only where every segment that ends there projects beyond it: each touch is found exactly once, at a door
jamb, around the corner of an obstacle, and along a straight wall made of pieces.
"""

from typing import NamedTuple

import numpy as np

from crowd_env._kernels.jit import index, inner_kernel
from crowd_env.geometry.geometry import Boundary
from crowd_env.physics.neighbors.lists import NeighborList, Places
from crowd_env.state import Bodies, Bools, CrowdState, Floats, Ints


class Contacts(NamedTuple):
    """Contacts of all environments; ``e`` owns ``NeighborList.entry_start[e]`` onwards, ``number[e]`` of them."""

    number: Ints  # (E,)
    i: Ints  # (M,)    global person
    j: Ints  # (M,)    global person > i, or -1 - k: wall feature k
    gap: Floats  # (M,)    m     < 0 is overlap
    normal: Floats  # (M, 2)        unit, from j to i
    impulse: Floats  # (M, 2)  N s   normal, tangential, of the current step
    history: Floats  # (M, 2)  what the scheme keeps of a contact while it lasts; 0 at first
    #                nsm1, nsm2: normal and tangential impulse of the last step [N s]; hertz: tangential elongation [m], 0
    old_key: Ints  # (M,)    scratch: keys and history of the contacts of the last step
    old_history: Floats  # (M, 2)
    hit: Places  # (M,)    scratch: entries of the list that are contacts


# What contacts are and keep; the rest of `Contacts` is scratch.
KEPT = ("i", "j", "gap", "normal", "impulse", "history")


def allocate_contacts(near: NeighborList) -> Contacts:
    """Return no contacts, with as much room as the neighbor list."""
    entries = len(near.touch)
    return Contacts(
        number=np.zeros(len(near.reach), dtype=np.int64),
        i=np.zeros(entries, dtype=np.int64),
        j=np.zeros(entries, dtype=np.int64),
        gap=np.zeros(entries),
        normal=np.zeros((entries, 2)),
        impulse=np.zeros((entries, 2)),
        history=np.zeros((entries, 2)),
        old_key=np.zeros(entries, dtype=np.int64),
        old_history=np.zeros((entries, 2)),
        hit=np.zeros(entries, dtype=np.uint32),
    )


def rows_of(e: int, contacts: Contacts, near: NeighborList) -> slice:
    """Return where the contacts of environment ``e`` are."""
    first = int(near.entry_start[e])
    return slice(first, first + int(contacts.number[e]))


def move_contacts(old: Contacts, old_near: NeighborList, new: Contacts, new_near: NeighborList) -> None:
    """Copy the contacts of every environment to where they belong in longer arrays."""
    new.number[:] = old.number
    for e in range(len(old.number)):
        source, target = rows_of(e, old, old_near), rows_of(e, new, new_near)
        for name in KEPT:
            getattr(new, name)[target] = getattr(old, name)[source]


@inner_kernel
def contact_key(i: int, j: int) -> int:
    """Where a contact stands in the order (i, j), walls last."""
    return (i << 32) + (j if j >= 0 else (1 << 31) - 1 - j)


def contact_keys(i: Ints, j: Ints) -> Ints:
    """The same for arrays (C,)."""
    return np.asarray((i << 32) + np.where(j >= 0, j, (1 << 31) - 1 - j))


@inner_kernel
def find_contacts(
    e: int,
    g: int,
    boundary: Boundary,
    bodies: Bodies,
    state: CrowdState,
    near: NeighborList,
    contacts: Contacts,
    margin: float,
) -> None:
    """Narrow phase: write the contacts of environment ``e`` with a gap below ``margin``, sorted by (i, j), walls last.

    The starting impulse is what is kept of a pair that was in contact in the previous step, else zero.
    """
    first, wall, wall_end = near.entry_start[e], near.pair_end[e], near.wall_end[e]
    kept = first
    if contacts.number[e] > 0:
        kept = _keep_history(
            first,
            first + contacts.number[e],
            contacts.i,
            contacts.j,
            contacts.history,
            contacts.old_key,
            contacts.old_history,
        )
    hits = _near_enough(first, wall, near.owner, near.partner, near.touch, state.position, margin, contacts.hit)
    c, walls = first, wall
    if wall < wall_end:
        walls = _near_walls(
            g,
            wall,
            wall_end,
            boundary.wall_start,
            boundary.corner_start,
            boundary.wall,
            boundary.corner,
            near.owner,
            near.partner,
            bodies.radius,
            state.position,
            margin,
            contacts.hit,
        )
    if walls > wall:
        c = _touch_all(
            g, first, hits, wall, walls, boundary, bodies.radius, state.active, state.position, near, contacts, margin
        )
    elif hits > first:
        c = _touch_people(
            first, hits, near.owner, near.partner, near.touch, state.active, state.position, margin, contacts, c
        )
    contacts.number[e] = c - first
    if c > first:
        _load_history(
            first,
            c,
            kept,
            contacts.i,
            contacts.j,
            contacts.impulse,
            contacts.history,
            contacts.old_key,
            contacts.old_history,
        )


@inner_kernel
def _near_enough(
    first: int, last: int, owner: Places, partner: Places, touch: Floats, position: Floats, margin: float, hit: Places
) -> int:
    """Write the entries ``first:last`` with a gap below ``margin`` into ``hit``; returns one past the last.

    Every entry is written down, whether it counts or not: the processor would guess a branch wrong every third time, which
    costs more than all of the rest.
    """
    hits = index(first)
    for entry in range(index(first), index(last)):
        i, j = owner[entry], partner[entry]
        dx, dy, limit = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1], touch[entry] + margin
        hit[hits] = entry
        hits += index(dx * dx + dy * dy < limit * limit)
    return int(np.int64(hits))


@inner_kernel
def _near_walls(
    g: int,
    first: int,
    last: int,
    wall_start: Ints,
    corner_start: Ints,
    wall: Floats,
    corner: Floats,
    owner: Places,
    partner: Places,
    radius: Floats,
    position: Floats,
    margin: float,
    hit: Places,
) -> int:
    """The same for the wall entries ``first:last``: those whose line or corner is near enough, without root or division."""
    hits, walls = first, wall_start[g + 1] - wall_start[g]
    for entry in range(index(first), index(last)):
        i, k = owner[entry], np.int64(partner[entry])
        x, y, limit = position[i, 0], position[i, 1], radius[i] + margin
        hit[hits] = entry
        if k < walls:
            k += wall_start[g]
            ax, ay = wall[k, 0, 0], wall[k, 0, 1]
            tx, ty = wall[k, 1, 0] - ax, wall[k, 1, 1] - ay
            cross = tx * (y - ay) - ty * (x - ax)
            # With room for rounding: what is exactly at the limit is for the narrow phase to say.
            hits += cross * cross < 1.000001 * limit * limit * (tx * tx + ty * ty)
        else:
            k += corner_start[g] - walls
            dx, dy = x - corner[k, 0], y - corner[k, 1]
            hits += dx * dx + dy * dy < 1.000001 * limit * limit
    return hits


@inner_kernel
def _touch_people(
    first: int,
    last: int,
    owner: Places,
    partner: Places,
    touch: Floats,
    active: Bools,
    position: Floats,
    margin: float,
    contacts: Contacts,
    c: int,
) -> int:
    """Write the contacts of the hits ``first:last`` from contact ``c`` on; returns one past the last contact."""
    hit, contact_i, contact_j, contact_gap, normal = contacts.hit, contacts.i, contacts.j, contacts.gap, contacts.normal
    for h in range(index(first), index(last)):
        entry = hit[h]
        i, j = owner[entry], partner[entry]
        gap, nx, ny = _disc_on_point(position[i, 0] - position[j, 0], position[i, 1] - position[j, 1], touch[entry])
        if active[i] and active[j] and gap < margin:
            contact_i[c], contact_j[c], contact_gap[c] = i, j, gap
            normal[c, 0], normal[c, 1] = nx, ny
            c += 1
    return c


@inner_kernel
def _touch_all(
    g: int,
    first: int,
    last: int,
    wall: int,
    wall_end: int,
    boundary: Boundary,
    radius: Floats,
    active: Bools,
    position: Floats,
    near: NeighborList,
    contacts: Contacts,
    margin: float,
) -> int:
    """Write the contacts of the hits ``first:last`` and ``wall:wall_end``; returns one past the last contact."""
    owner, partner, touch, hit, c, h = near.owner, near.partner, near.touch, contacts.hit, first, first
    contact_i, contact_j, contact_gap, normal = contacts.i, contacts.j, contacts.gap, contacts.normal
    for entry in hit[wall:wall_end]:
        i, feature = owner[entry], np.int64(partner[entry])
        if not active[i]:
            continue
        gap, nx, ny = gap_to_feature(position[i, 0], position[i, 1], radius[i], boundary, g, feature)
        if gap < margin:
            before = h
            while h < last and owner[hit[h]] <= i:  # walls come after the people whom i touches
                h += 1
            c = _touch_people(before, h, owner, partner, touch, active, position, margin, contacts, c)
            contact_i[c], contact_j[c], contact_gap[c] = i, -1 - feature, gap
            normal[c, 0], normal[c, 1] = nx, ny
            c += 1
    return _touch_people(h, last, owner, partner, touch, active, position, margin, contacts, c)


@inner_kernel
def _keep_history(first: int, last: int, i: Ints, j: Ints, history: Floats, old_key: Ints, old_history: Floats) -> int:
    """Put aside the history of the contacts ``first:last`` of the last step; returns one past the last of these."""
    kept = first
    for c in range(first, last):
        if history[c, 0] != 0.0 or history[c, 1] != 0.0:
            old_key[kept] = contact_key(i[c], j[c])
            old_history[kept, 0], old_history[kept, 1] = history[c, 0], history[c, 1]
            kept += 1
    return kept


@inner_kernel
def _load_history(
    first: int,
    last: int,
    kept: int,
    i: Ints,
    j: Ints,
    impulse: Floats,
    history: Floats,
    old_key: Ints,
    old_history: Floats,
) -> None:
    """Give the contacts ``first:last`` the history of the same contacts, and start their impulses from it."""
    old = first
    for c in range(index(first), index(last)):
        normal, tangent = 0.0, 0.0
        if old < kept:
            key = contact_key(i[c], j[c])
            while old < kept and old_key[old] < key:
                old += 1
            if old < kept and old_key[old] == key:
                normal, tangent = old_history[old, 0], old_history[old, 1]
        history[c, 0], history[c, 1] = normal, tangent
        impulse[c, 0], impulse[c, 1] = normal, tangent


@inner_kernel
def gap_to_feature(
    x: float, y: float, radius: float, boundary: Boundary, g: int, feature: int
) -> tuple[float, float, float]:
    """Return gap and normal between a disc and wall feature ``feature`` of geometry ``g``; infinite if it does not face it."""
    first, stop = boundary.wall_start[g], boundary.wall_start[g + 1]
    walls = stop - first
    if feature < walls:
        return _disc_on_wall(x, y, radius, boundary, first + feature)
    return _disc_on_corner(x, y, radius, boundary, boundary.corner_start[g] + feature - walls)


@inner_kernel
def _disc_on_point(dx: float, dy: float, radius: float) -> tuple[float, float, float]:
    """Gap and normal between a disc and a point (dx, dy) away (or, with ``radius`` the sum of two, between two discs)."""
    distance = np.sqrt(dx * dx + dy * dy)
    if distance == 0.0:  # coincident centers: any direction will do, but always the same
        return -radius, 1.0, 0.0
    return distance - radius, dx / distance, dy / distance


@inner_kernel
def _disc_on_wall(x: float, y: float, radius: float, boundary: Boundary, k: int) -> tuple[float, float, float]:
    wall = boundary.wall
    ax, ay = wall[k, 0, 0], wall[k, 0, 1]
    tx, ty = wall[k, 1, 0] - ax, wall[k, 1, 1] - ay
    square = tx * tx + ty * ty
    along = (x - ax) * tx + (y - ay) * ty
    if along <= 0.0 or along >= square:
        return np.inf, 0.0, 0.0
    length = np.sqrt(square)
    height = (tx * (y - ay) - ty * (x - ax)) / length  # > 0: the center is left of the wall, on the walkable side
    nx, ny = -ty / length, tx / length
    if height >= 0.0:
        return height - radius, nx, ny
    if boundary.two_sided[k]:
        return -height - radius, -nx, -ny
    # A center that was pressed a little into the wall is pushed back, not through: the gap stays continuous.  Further
    # behind it belongs to the other face, or stands on the other side of a slim partition.
    if -height < min(0.5 * radius, boundary.depth[k]):
        return height - radius, nx, ny
    return np.inf, 0.0, 0.0


@inner_kernel
def _disc_on_corner(x: float, y: float, radius: float, boundary: Boundary, v: int) -> tuple[float, float, float]:
    wall, corner_wall, start = boundary.wall, boundary.corner_wall, boundary.corner_wall_start
    px, py = boundary.corner[v, 0], boundary.corner[v, 1]
    for m in range(start[v], start[v + 1]):
        k = corner_wall[m]
        ax, ay = wall[k, 0, 0], wall[k, 0, 1]
        bx, by = wall[k, 1, 0], wall[k, 1, 1]
        if abs(ax - px) + abs(ay - py) > abs(bx - px) + abs(by - py):  # the far end
            ox, oy = ax, ay
        else:
            ox, oy = bx, by
        if (x - px) * (ox - px) + (y - py) * (oy - py) > 0.0:  # the segment itself is nearer
            return np.inf, 0.0, 0.0
    return _disc_on_point(x - px, y - py, radius)
