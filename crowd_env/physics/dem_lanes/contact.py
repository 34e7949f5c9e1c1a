"""The spring of the soft scheme on lanes: who overlaps, and what that pushes.

Two passes: the first writes down every candidate and keeps its place only if it overlaps, without a branch, which would be
guessed wrong every third time; the second does the square root and the division for those alone.
"""

import numpy as np

from crowd_env._kernels.jit import index, inner_kernel
from crowd_env.geometry.geometry import Boundary
from crowd_env.physics.contacts import gap_to_feature
from crowd_env.physics.neighbors.lists import Places
from crowd_env.state import Floats, Ints

# What a slab has seen in a step, columns of `Cut.seen`.
DEEPEST, SUM, COUNT, OUTSIDE, CARRIED, STRAYS, FURTHEST, FASTEST = range(8)


@inner_kernel
def push_people(
    first: int,
    last: int,
    slab_end: int,
    owner: Places,
    partner: Places,
    touch: Floats,
    x: Floats,
    y: Floats,
    stiffness: float,
    hit: Places,
    fx: Floats,
    fy: Floats,
    squeeze: Floats,
    carried_to: Ints,
    carried: Floats,
    seen: Floats,
    row: int,
) -> None:
    """Add the forces (eqs 4, 5) of the pairs ``first:last`` of one slab, and note what was seen.

    What falls on people beyond ``slab_end``, who belong to another slab, is written down in ``carried`` from ``first`` on.
    """
    hits = index(first)
    for entry in range(index(first), index(last)):
        i, j = owner[entry], partner[entry]
        dx, dy = x[i] - x[j], y[i] - y[j]
        hit[hits] = entry
        hits += index(dx * dx + dy * dy < touch[entry] * touch[entry])
    deepest, total, out, furthest = 0.0, 0.0, index(first), -1.0
    for h in range(index(first), hits):
        entry = hit[h]
        i, j = owner[entry], partner[entry]
        dx, dy = x[i] - x[j], y[i] - y[j]
        distance = np.sqrt(dx * dx + dy * dy)
        overlap = touch[entry] - distance
        size = stiffness * overlap
        deepest, total = max(deepest, overlap), total + overlap
        px, py = size, 0.0  # coincident centers: as `find_contacts` has it
        if distance > 0.0:
            per_distance = size / distance
            px, py = per_distance * dx, per_distance * dy
        fx[i] += px
        fy[i] += py
        squeeze[i] += size
        if j < slab_end:
            fx[j] -= px
            fy[j] -= py
            squeeze[j] += size
        else:
            carried_to[out] = j
            carried[out, 0], carried[out, 1] = px, py
            out += index(1)
            furthest = max(furthest, float(j))
    seen[row, DEEPEST], seen[row, SUM], seen[row, COUNT] = deepest, total, np.int64(hits) - first
    seen[row, FURTHEST] = furthest
    seen[row, OUTSIDE], seen[row, CARRIED] = 0.0, np.int64(out) - first


@inner_kernel
def push_off_walls(
    g: int,
    first: int,
    last: int,
    boundary: Boundary,
    owner: Places,
    partner: Places,
    radius: Floats,
    x: Floats,
    y: Floats,
    stiffness: float,
    fx: Floats,
    fy: Floats,
    squeeze: Floats,
    seen: Floats,
    row: int,
) -> None:
    """The same for the wall entries ``first:last``."""
    for entry in range(index(first), index(last)):
        i = owner[entry]
        gap, nx, ny = gap_to_feature(x[i], y[i], radius[i], boundary, g, np.int64(partner[entry]))
        if gap < 0.0:
            size = -stiffness * gap
            fx[i] += size * nx
            fy[i] += size * ny
            squeeze[i] += size
            seen[row, OUTSIDE] = max(seen[row, OUTSIDE], -gap)
            seen[row, SUM] -= gap
            seen[row, COUNT] += 1


@inner_kernel
def receive(
    first: int,
    count: int,
    begin: int,
    end: int,
    carried_to: Ints,
    carried: Floats,
    fx: Floats,
    fy: Floats,
    squeeze: Floats,
) -> None:
    """Add what another slab wrote down for the people ``begin:end``."""
    for c in range(first, first + count):
        j = carried_to[c]
        if begin <= j < end:
            px, py = carried[c, 0], carried[c, 1]
            fx[j] -= px
            fy[j] -= py
            squeeze[j] += np.sqrt(px * px + py * py)
