"""Who can touch whom soon: cell list -> Verlet half list with a skin, and the wall features near each body.

The list of an environment names every pair i < j and every (person, wall feature) closer than ``reach`` (gap), each sorted,
so that the order of every later sum depends neither on the cells nor on when the list was built.  It is flat, one entry after
the other, pairs first: a loop over it has no inner loop whose end the processor would have to guess.
"""

import numpy as np

from crowd_env._kernels.jit import index, inner_kernel
from crowd_env.physics.neighbors.lists import NeighborList, list_exits, list_pairs, list_walls
from crowd_env.physics.workspace import Batch
from crowd_env.state import Bools, Floats

# What a step can answer; anything but OK hands over to Python.
OK, FULL, DIVERGED, TOO_FAST = 0, 1, 2, 3

# Map coordinates are welcome; beyond this a run has blown up, and the number of cells would overflow.
_FARTHEST = 1e8  # m

# How far everyone may go before a new list is needed: as far as the own speed leads within the horizon, so that a few who are
# shot out of a door do not make the whole crowd look anew.  The horizon of an environment follows from how long the last list
# was good for and how many pairs it held in vain: a new list costs as much as some forty looks at a pair.  What is found does
# not depend on any of this.
_LEAST_WAY, _MOST_WAY = 0.02, 0.2  # m
_LONGEST_HORIZON = 1.0  # s
_LOOKS = 40.0


@inner_kernel
def update_neighbors(e: int, batch: Batch, margin: float) -> int:
    """Rebuild the list of environment ``e`` if a gap below ``margin`` could be missing from it.

    Returns OK; FULL if the entries do not fit; or DIVERGED if someone is nowhere near the world.
    """
    near, radius, allowed = batch.workspace.neighbors, batch.bodies.radius, batch.workspace.neighbors.allowed
    active, position, velocity = batch.state.active, batch.state.position, batch.state.velocity
    begin, end = batch.bodies.env_start[e], batch.bodies.env_start[e + 1]
    near.age[e] += 1
    if margin <= near.reach[e] and are_near(begin, end, active, position, near.origin_x, near.origin_y, allowed):
        return OK
    for i in range(begin, end):
        if active[i] and not (abs(position[i, 0]) < _FARTHEST and abs(position[i, 1]) < _FARTHEST):
            return DIVERGED  # nan too
    if near.reach[e] >= margin:
        near.horizon[e] = _better_horizon(e, begin, end, radius, near, batch.state.time[e] - near.built[e])
    near.age[e], near.built[e] = 0, batch.state.time[e]
    near.reach[e] = -1.0
    widest, largest, horizon = 0.0, 0.0, near.horizon[e]
    for i in range(index(begin), index(end)):
        speed = np.sqrt(velocity[i, 0] * velocity[i, 0] + velocity[i, 1] * velocity[i, 1])
        way = min(_LEAST_WAY + horizon * speed, _MOST_WAY)
        allowed[i] = way
        if active[i]:
            widest, largest = max(widest, way), max(largest, radius[i])
    reach = 1.1 * margin  # some schemes ask for a little more or less every step
    if not list_pairs(e, begin, end, radius, active, position, near, reach, 2.0 * (largest + widest) + reach):
        return FULL
    g, boundary, door_open = batch.world.geometry_of_env[e], batch.world.boundary, batch.history.door_open
    if not list_walls(e, g, begin, end, boundary, door_open, radius, active, position, near, reach):
        return FULL
    if not list_exits(e, g, begin, end, boundary, active, position, near):
        return FULL
    origin_x, origin_y = near.origin_x, near.origin_y
    for i in range(begin, end):
        # Whoever is not listed is never near: let in by hand, he asks for a new list.
        origin_x[i] = position[i, 0] if active[i] else np.inf
        origin_y[i] = position[i, 1]
    near.reach[e] = reach
    return OK


@inner_kernel
def are_near(
    begin: int, end: int, active: Bools, position: Floats, origin_x: Floats, origin_y: Floats, allowed: Floats
) -> bool:
    """Whether nobody inside has gone further than allowed.

    To count is free of branches; nan counts.
    """
    gone = 0
    for i in range(index(begin), index(end)):
        dx, dy = position[i, 0] - origin_x[i], position[i, 1] - origin_y[i]
        gone += active[i] & (not dx * dx + dy * dy <= allowed[i] * allowed[i])
    return gone == 0


@inner_kernel
def _better_horizon(e: int, begin: int, end: int, radius: Floats, near: NeighborList, lasted: float) -> float:
    """Return the horizon of the next list of environment ``e``: the last one's spare pairs are to cost what making it does.

    Where people stand evenly the share d^2 / (d + s)^2 of the pairs would be there if nobody were allowed to go anywhere.  A
    list that ``lasted`` [s] much shorter than it was meant to was ended by a few who are too fast for any horizon.
    """
    horizon, allowed, diameter, skin = near.horizon[e], near.allowed, 0.0, 0.0
    for i in range(index(begin), index(end)):
        diameter += 2.0 * radius[i]
        skin += 2.0 * allowed[i]
    pairs = (near.pair_end[e] - near.entry_start[e]) / (end - begin)
    spare = pairs * (1.0 - (diameter / (diameter + skin)) ** 2)
    looks = spare * near.age[e]
    if horizon > 4.0 * lasted:
        return horizon / 1.25
    if looks < _LOOKS / 1.5:
        return min(1.25 * horizon, _LONGEST_HORIZON)
    return horizon / 1.25 if looks > _LOOKS * 1.5 else horizon
