"""Contacts of bodies of several discs: one row for each pair of discs that touch, and for each disc and wall feature.

The neighbor list still holds pairs of bodies, by the gap of their nominal discs.  Its reach is twice the excess of an outline
over the nominal radius, so it holds all discs that can touch at any angle.  Other readers of the list, such as the social
force, are not affected.

A shoulder may be pressed through a wall by more than its radius; the center of a body cannot (`crowd_env.physics.bounds`).
Therefore the line from the center of the body to that of the disc decides on which side of a wall the disc belongs.
"""

import numpy as np

from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.geometry.geometry import Boundary
from crowd_env.physics.contacts import contact_of_key
from crowd_env.physics.narrow_phase import (
    disc_on_point,
    find_candidates,
    find_wall_candidates,
    gap_to_feature,
    keep_history,
    load_history,
)
from crowd_env.physics.neighbors.update import FULL
from crowd_env.physics.step import find_neighbors
from crowd_env.physics.workspace import Batch

NO_DISC = -1  # a wall has none
_ROUNDING = 1.0 + 1e-9


@inner_kernel
def detect_discs(e: int, rank_stop: int, batch: Batch, cutoff: float) -> bool:
    """Bring neighbors and contacts of environment ``e`` up to date; False (with the reason in `status`) if it cannot."""
    spread = _find_spread(e, rank_stop, batch)
    if not find_neighbors(e, batch, max(2.0 * spread, cutoff)):
        return False
    _place_discs(e, rank_stop, batch)
    return _find_contacts(e, spread, batch)


@inner_kernel
def _find_spread(e: int, rank_stop: int, batch: Batch) -> float:
    """Return the largest excess [m] of an outline over the nominal radius."""
    inside, radius, largest = batch.workspace.inside, batch.bodies.radius, 0.0
    for rank in range(index(batch.bodies.env_start[e]), index(rank_stop)):
        largest = max(largest, radius[inside[rank]])
    return largest * (batch.behaviors.outline.reach - 1.0)


@inner_kernel
def _place_discs(e: int, rank_stop: int, batch: Batch) -> None:
    """Write the places of all discs, relative to the center of the body, at the present angles."""
    inside, radius, angle = batch.workspace.inside, batch.bodies.radius, batch.state.angle
    outline, discs = batch.behaviors.outline, batch.workspace.discs
    shape_x, shape_y, shape_radius = outline.x, outline.y, outline.radius
    x, y, r, count = discs.x, discs.y, discs.radius, index(len(outline.radius))
    for rank in range(index(batch.bodies.env_start[e]), index(rank_stop)):
        i = index(inside[rank])
        cosine, sine, size = np.cos(angle[i]), np.sin(angle[i]), radius[i]
        discs.cosine[i], discs.sine[i] = cosine, sine
        for a in range(count):
            k = i * count + a
            x[k] = size * (cosine * shape_x[a] - sine * shape_y[a])
            y[k] = size * (sine * shape_x[a] + cosine * shape_y[a])
            r[k] = size * shape_radius[a]


@inner_kernel
def _find_contacts(e: int, spread: float, batch: Batch) -> bool:
    """Write the contacts of environment ``e``, sorted by (i, j, discs), walls last; False if they do not fit.

    In that case the contacts of the last step are kept.
    """
    near, contacts, present = batch.workspace.neighbors, batch.history.contacts, batch.state.present
    candidates, owner = batch.workspace.narrow_phase.candidates, near.owner
    first, pair_end, wall_end = near.entry_start[e], near.pair_end[e], near.wall_end[e]
    kept = keep_history(first, first + contacts.number[e], batch, True)
    pair_stop, wall_stop = find_candidates(first, pair_end, batch, 2.0 * spread), pair_end
    if pair_end < wall_end:
        wall_stop = find_wall_candidates(e, pair_end, wall_end, batch, spread)
    c, h = first, first
    for w in range(pair_end, wall_stop):
        i = owner[candidates[w]]
        if not present[i]:
            continue
        while h < pair_stop and owner[candidates[h]] <= i and c >= 0:  # walls come after the pairs of i
            c = _write_pair(e, candidates[h], batch, c)
            h += 1
        if c >= 0:
            c = _write_wall(e, candidates[w], batch, c)
    while h < pair_stop and c >= 0:
        c = _write_pair(e, candidates[h], batch, c)
        h += 1
    if c < 0:
        _put_back(e, first, kept, batch)
        batch.workspace.status[e] = FULL
        return False
    contacts.number[e] = c - first
    load_history(first, c, kept, batch, True)
    return True


@inner_kernel
def _write_pair(e: int, entry: int, batch: Batch, c: int) -> int:
    """Write the contacts of two bodies from contact ``c`` on; returns one past the last, -1 if they do not fit."""
    near, contacts, discs = batch.workspace.neighbors, batch.history.contacts, batch.workspace.discs
    present, position, radius = batch.state.present, batch.state.position, batch.bodies.radius
    i, j = index(near.owner[entry]), index(near.partner[entry])
    if not (present[i] and present[j]):
        return c
    reach, count = batch.behaviors.outline.reach * _ROUNDING, index(len(batch.behaviors.outline.radius))
    dx, dy = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1]
    limit = reach * (radius[i] + radius[j])
    if dx * dx + dy * dy >= limit * limit:
        return c
    stop, around = near.entry_start[e + 1], reach * radius[j]
    for a in range(count):
        ax, ay, size = dx + discs.x[i * count + a], dy + discs.y[i * count + a], discs.radius[i * count + a]
        limit = around + size
        if ax * ax + ay * ay >= limit * limit:
            continue
        for b in range(count):
            bx, by, limit = ax - discs.x[j * count + b], ay - discs.y[j * count + b], size + discs.radius[j * count + b]
            if bx * bx + by * by >= _ROUNDING * limit * limit:
                continue
            gap, nx, ny = disc_on_point(bx, by, limit)
            if gap < 0.0:
                if c == stop:
                    return -1
                contacts.i[c], contacts.j[c], contacts.gap[c] = i, j, gap
                contacts.normal[c, 0], contacts.normal[c, 1] = nx, ny
                contacts.disc_i[c], contacts.disc_j[c] = a, b
                c += 1
    return c


@inner_kernel
def _write_wall(e: int, entry: int, batch: Batch, c: int) -> int:
    """Write the contacts of a body and a wall feature from contact ``c`` on; returns as `_write_pair`."""
    near, contacts, discs = batch.workspace.neighbors, batch.history.contacts, batch.workspace.discs
    boundary, g = batch.world.boundary, batch.world.geometry_of_env[e]
    i, feature, stop = index(near.owner[entry]), np.int64(near.partner[entry]), near.entry_start[e + 1]
    x, y, count = batch.state.position[i, 0], batch.state.position[i, 1], index(len(batch.behaviors.outline.radius))
    for a in range(count):
        k = i * count + a
        gap, nx, ny = _gap_to_feature(x, y, discs.x[k], discs.y[k], discs.radius[k], boundary, g, feature)
        if gap < 0.0:
            if c == stop:
                return -1
            contacts.i[c], contacts.j[c], contacts.gap[c] = i, -1 - feature, gap
            contacts.normal[c, 0], contacts.normal[c, 1] = nx, ny
            contacts.disc_i[c], contacts.disc_j[c] = a, NO_DISC
            c += 1
    return c


@inner_kernel
def _put_back(e: int, first: int, kept: int, batch: Batch) -> None:
    """Restore the contacts that `keep_history` has saved."""
    contacts, work = batch.history.contacts, batch.workspace.narrow_phase
    for c in range(first, kept):
        contacts.i[c], contacts.j[c] = contact_of_key(work.old_key[c])
        contacts.disc_i[c], contacts.disc_j[c] = work.old_disc[c, 0], work.old_disc[c, 1]
        contacts.history[c, 0], contacts.history[c, 1] = work.old_history[c, 0], work.old_history[c, 1]
    contacts.number[e] = kept - first


# --------------------------------------------------------------------------------------------------------------- walls


@inner_kernel
def _gap_to_feature(
    x: float, y: float, dx: float, dy: float, radius: float, boundary: Boundary, g: int, feature: int
) -> tuple[float, float, float]:
    """Return gap and normal between a wall feature and the disc at (dx, dy) from the center (x, y) of its body."""
    start = boundary.wall_start[g]
    walls = boundary.chord_start[g] - start
    if feature < walls:
        k = start + feature
        side, height = _crossed(x, y, x + dx, y + dy, boundary, k)
        if side != 0.0:  # pressed through the wall: back to the side of the body
            return height - radius, -side * boundary.tangent[k, 1], side * boundary.tangent[k, 0]
        return gap_to_feature(x + dx, y + dy, radius, boundary, g, feature)
    gap, nx, ny = gap_to_feature(x + dx, y + dy, radius, boundary, g, feature)
    if gap < 0.0:
        v = boundary.corner_start[g] + feature - walls
        for m in range(boundary.corner_wall_start[v], boundary.corner_wall_start[v + 1]):
            side, _ = _crossed(x, y, x + dx, y + dy, boundary, boundary.corner_wall[m])
            if side != 0.0:  # the wall pushes back already
                return np.inf, 0.0, 0.0
    return gap, nx, ny


@inner_kernel
def _crossed(x0: float, y0: float, x1: float, y1: float, boundary: Boundary, k: int) -> tuple[float, float]:
    """Return the side of wall ``k`` with point 0 (1 = left, -1) if the line from it to point 1 crosses the wall, else 0.

    Also returns the height [m] of point 1 above the wall, seen from that side: negative.
    """
    ax, ay = boundary.wall[k, 0, 0], boundary.wall[k, 0, 1]
    tx, ty = boundary.tangent[k, 0], boundary.tangent[k, 1]
    before, after = tx * (y0 - ay) - ty * (x0 - ax), tx * (y1 - ay) - ty * (x1 - ax)
    if before * after >= 0.0 or (before < 0.0 and not boundary.two_sided[k]):
        return 0.0, 0.0
    part = before / (before - after)
    along = (x0 + part * (x1 - x0) - ax) * tx + (y0 + part * (y1 - y0) - ay) * ty
    if along < 0.0 or along > boundary.length[k]:
        return 0.0, 0.0
    return (1.0 if before > 0.0 else -1.0), -abs(after)
