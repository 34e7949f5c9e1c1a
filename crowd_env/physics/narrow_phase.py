"""The narrow phase: the entries of the neighbor list that are contacts, and their normals.

A wall is a set of segments and of end points.  A disc touches the inside of a segment only where its center projects on it,
and an end point only where every segment that ends there projects beyond it: each contact is found exactly once, at a door
jamb, around the corner of an obstacle, and along a straight wall made of pieces.  A round jamb is an end point with a radius:
a circle between the two walls that end on it, at the points where they are tangent to it.
"""

import numpy as np

from crowd_env.core.arrays.state import Ints
from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.geometry.geometry import Boundary
from crowd_env.physics.contacts import Contacts, contact_key
from crowd_env.physics.workspace import Batch


@inner_kernel
def find_contacts(e: int, batch: Batch, margin: float) -> None:
    """Write the contacts of environment ``e`` with a gap below ``margin``, sorted by (i, j), walls last.

    The starting impulse is that kept from the previous step for a lasting contact, else zero.
    """
    near, contacts = batch.workspace.neighbors, batch.history.contacts
    entry_start, pair_end, wall_end = near.entry_start[e], near.pair_end[e], near.wall_end[e]
    kept = keep_history(entry_start, entry_start + contacts.number[e], batch, None)
    pairs = find_candidates(entry_start, pair_end, batch, margin)
    c, walls = entry_start, pair_end
    if pair_end < wall_end:
        walls = find_wall_candidates(e, pair_end, wall_end, batch, margin)
    if walls > pair_end:
        c = _write_all(e, (entry_start, pairs), (pair_end, walls), batch, margin)
    elif pairs > entry_start:
        c = _write_pairs(entry_start, pairs, batch, margin, c)
    contacts.number[e] = c - entry_start
    load_history(entry_start, c, kept, batch, None)


@inner_kernel
def find_candidates(entry_start: int, entry_stop: int, batch: Batch, margin: float) -> int:
    """List the pair entries with a gap below ``margin`` as candidates; returns one past the last.

    Every entry is written, and kept only if it counts: a branch would be mispredicted every third time, which costs more than
    all else.
    """
    near, candidates = batch.workspace.neighbors, batch.workspace.narrow_phase.candidates
    position = batch.state.position
    owner, partner, contact_distance = near.owner, near.partner, near.contact_distance
    candidate = index(entry_start)
    for entry in range(index(entry_start), index(entry_stop)):
        i, j = owner[entry], partner[entry]
        dx, dy = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1]
        limit = contact_distance[entry] + margin
        candidates[candidate] = entry
        candidate += index(dx * dx + dy * dy < limit * limit)
    return int(np.int64(candidate))


@inner_kernel
def find_wall_candidates(e: int, entry_start: int, entry_stop: int, batch: Batch, margin: float) -> int:
    """List the wall entries with a near line or corner as candidates; returns one past the last.

    It takes no root and no division.
    """
    near, boundary, g = batch.workspace.neighbors, batch.world.boundary, batch.world.geometry_of_env[e]
    owner, partner, wall, corner = near.owner, near.partner, boundary.wall, boundary.corner
    tangent, corner_radius = boundary.tangent, boundary.corner_radius
    radius, position, candidates = batch.bodies.radius, batch.state.position, batch.workspace.narrow_phase.candidates
    wall_first, corner_first = boundary.wall_start[g], boundary.corner_start[g]
    candidate, walls = entry_start, boundary.chord_start[g] - wall_first
    for entry in range(index(entry_start), index(entry_stop)):
        i, k = owner[entry], np.int64(partner[entry])
        x, y, limit = position[i, 0], position[i, 1], radius[i] + margin
        candidates[candidate] = entry
        if k < walls:
            k += wall_first
            height = tangent[k, 0] * (y - wall[k, 0, 1]) - tangent[k, 1] * (x - wall[k, 0, 0])
            # With room for rounding: the narrow phase decides exactly at the limit.
            candidate += abs(height) < 1.000001 * limit
        else:
            k += corner_first - walls
            dx, dy, far = x - corner[k, 0], y - corner[k, 1], limit + corner_radius[k]
            candidate += dx * dx + dy * dy < 1.000001 * far * far
    return candidate


@inner_kernel
def _write_pairs(candidate_start: int, candidate_stop: int, batch: Batch, margin: float, c: int) -> int:
    """Write the contacts among these pair candidates from contact ``c`` on; returns one past the last contact."""
    near, contacts, state = batch.workspace.neighbors, batch.history.contacts, batch.state
    owner, partner, contact_distance = near.owner, near.partner, near.contact_distance
    present, position, candidates = state.present, state.position, batch.workspace.narrow_phase.candidates
    contact_i, contact_j, contact_gap, normal = contacts.i, contacts.j, contacts.gap, contacts.normal
    for h in range(index(candidate_start), index(candidate_stop)):
        entry = candidates[h]
        i, j = owner[entry], partner[entry]
        dx, dy = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1]
        gap, nx, ny = disc_on_point(dx, dy, contact_distance[entry])
        if present[i] and present[j] and gap < margin:
            contact_i[c], contact_j[c], contact_gap[c] = i, j, gap
            normal[c, 0], normal[c, 1] = nx, ny
            c += 1
    return c


@inner_kernel
def _write_all(e: int, pairs: tuple[int, int], walls: tuple[int, int], batch: Batch, margin: float) -> int:
    """Write the contacts among these pair and wall candidates; returns one past the last contact."""
    near, contacts, state = batch.workspace.neighbors, batch.history.contacts, batch.state
    boundary, g, radius = batch.world.boundary, batch.world.geometry_of_env[e], batch.bodies.radius
    owner, partner, present, position = near.owner, near.partner, state.present, state.position
    contact_i, contact_j, contact_gap, normal = contacts.i, contacts.j, contacts.gap, contacts.normal
    candidates, c, h = batch.workspace.narrow_phase.candidates, pairs[0], pairs[0]
    for entry in candidates[walls[0] : walls[1]]:
        i, feature = owner[entry], np.int64(partner[entry])
        if not present[i]:
            continue
        gap, nx, ny = gap_to_feature(position[i, 0], position[i, 1], radius[i], boundary, g, feature, margin)
        if gap < margin:
            before = h
            while h < pairs[1] and owner[candidates[h]] <= i:  # walls come after the pairs of i
                h += 1
            c = _write_pairs(before, h, batch, margin, c)
            contact_i[c], contact_j[c], contact_gap[c] = i, -1 - feature, gap
            normal[c, 0], normal[c, 1] = nx, ny
            c += 1
    return _write_pairs(h, pairs[1], batch, margin, c)


@inner_kernel
def keep_history(contact_start: int, contact_stop: int, batch: Batch, outline: bool | None) -> int:
    """Save the history of the contacts of the last step; returns one past the last of them.

    With an ``outline`` contacts join discs of bodies, else bodies.
    """
    contacts, work = batch.history.contacts, batch.workspace.narrow_phase
    i, j, history, old_key, old_history = contacts.i, contacts.j, contacts.history, work.old_key, work.old_history
    kept = contact_start
    for c in range(contact_start, contact_stop):
        if history[c, 0] != 0.0 or history[c, 1] != 0.0:
            old_key[kept] = contact_key(i[c], j[c])
            old_history[kept, 0], old_history[kept, 1] = history[c, 0], history[c, 1]
            if outline is not None:
                work.old_disc[kept, 0], work.old_disc[kept, 1] = contacts.disc_i[c], contacts.disc_j[c]
            kept += 1
    return kept


@inner_kernel
def load_history(contact_start: int, contact_stop: int, kept: int, batch: Batch, outline: bool | None) -> None:
    """Give the contacts the history of the same contacts in the last step, and start their impulses from it."""
    contacts, work = batch.history.contacts, batch.workspace.narrow_phase
    i, j, impulse, history = contacts.i, contacts.j, contacts.impulse, contacts.history
    old_key, old_history = work.old_key, work.old_history
    old = contact_start
    for c in range(index(contact_start), index(contact_stop)):
        normal, tangent = 0.0, 0.0
        if old < kept:
            key = contact_key(i[c], j[c])
            while old < kept and old_key[old] < key:
                old += 1
            if outline is not None:
                while old < kept and old_key[old] == key and _is_before(work.old_disc[old], contacts, c):
                    old += 1
                if old < kept and old_key[old] == key and _is_of(work.old_disc[old], contacts, c):
                    normal, tangent = old_history[old, 0], old_history[old, 1]
            elif old < kept and old_key[old] == key:
                normal, tangent = old_history[old, 0], old_history[old, 1]
        history[c, 0], history[c, 1] = normal, tangent
        impulse[c, 0], impulse[c, 1] = normal, tangent


@inner_kernel
def _is_before(discs: Ints, contacts: Contacts, c: int) -> bool:
    """Whether two discs (2,) come before the discs of contact ``c`` of the same bodies."""
    return discs[0] < contacts.disc_i[c] or (discs[0] == contacts.disc_i[c] and discs[1] < contacts.disc_j[c])


@inner_kernel
def _is_of(discs: Ints, contacts: Contacts, c: int) -> bool:
    """Whether two discs (2,) are the discs of contact ``c``."""
    return discs[0] == contacts.disc_i[c] and discs[1] == contacts.disc_j[c]


@inner_kernel
def gap_to_feature(
    x: float, y: float, radius: float, boundary: Boundary, g: int, feature: int, most: float = np.inf
) -> tuple[float, float, float]:
    """Return gap and normal between a disc and wall feature ``feature`` of geometry ``g``.

    The gap is infinite if the disc does not face the feature, and perhaps if it is not below ``most`` [m].
    """
    wall_first = boundary.wall_start[g]
    walls = boundary.chord_start[g] - wall_first
    if feature < walls:
        return _disc_on_wall(x, y, radius, boundary, wall_first + feature)
    return _disc_on_corner(x, y, radius, boundary, boundary.corner_start[g] + feature - walls, most)


@inner_kernel
def disc_on_point(dx: float, dy: float, radius: float) -> tuple[float, float, float]:
    """Return gap and normal of a disc and a point (dx, dy) away (or, with ``radius`` the sum of two, of two discs)."""
    distance = np.sqrt(dx * dx + dy * dy)
    if distance == 0.0:  # coincident centers: any direction will do, but always the same
        return -radius, 1.0, 0.0
    return distance - radius, dx / distance, dy / distance


@inner_kernel
def _disc_on_wall(x: float, y: float, radius: float, boundary: Boundary, k: int) -> tuple[float, float, float]:
    wall, tx, ty = boundary.wall, boundary.tangent[k, 0], boundary.tangent[k, 1]
    dx, dy = x - wall[k, 0, 0], y - wall[k, 0, 1]
    along, height = dx * tx + dy * ty, tx * dy - ty * dx  # > 0: the center is left of the wall, on the walkable side
    if along <= 0.0 or along >= boundary.length[k]:
        return np.inf, 0.0, 0.0
    if height >= 0.0:
        return height - radius, -ty, tx
    if boundary.two_sided[k]:
        return -height - radius, ty, -tx
    # A center that was pressed a little into the wall is pushed back, not through: the gap stays continuous.  Further
    # behind it belongs to the other face, or stands on the other side of a slim partition.
    if -height < min(0.5 * radius, boundary.depth[k]):
        return height - radius, -ty, tx
    return np.inf, 0.0, 0.0


@inner_kernel
def _disc_on_corner(
    x: float, y: float, radius: float, boundary: Boundary, v: int, most: float
) -> tuple[float, float, float]:
    dx, dy, radius = x - boundary.corner[v, 0], y - boundary.corner[v, 1], radius + boundary.corner_radius[v]
    far = radius + most
    # With room for rounding; most corners are too far, or not faced: neither needs a root.
    if dx * dx + dy * dy > 1.000001 * far * far or not is_beyond_walls(x, y, boundary, v, 0.0):
        return np.inf, 0.0, 0.0
    return disc_on_point(dx, dy, radius)


@inner_kernel
def is_beyond_walls(x: float, y: float, boundary: Boundary, v: int, margin: float) -> bool:
    """Whether a point lies beyond the end of every wall that ends at corner ``v``, or no further than ``margin`` [m] before."""
    wall, tangent = boundary.wall, boundary.tangent
    corner_wall, corner_wall_end = boundary.corner_wall, boundary.corner_wall_end
    for m in range(boundary.corner_wall_start[v], boundary.corner_wall_start[v + 1]):
        k, end = corner_wall[m], corner_wall_end[m]
        along = (x - wall[k, end, 0]) * tangent[k, 0] + (y - wall[k, end, 1]) * tangent[k, 1]
        if (along if end == 0 else -along) > margin:  # the segment itself is nearer
            return False
    return True
