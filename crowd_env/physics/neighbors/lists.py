"""Lists of neighbors: their content and their construction."""

from collections.abc import Sequence
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowd_env.core.arrays.state import Bodies, Bools, CrowdState, Floats, Indices, Ints
from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.geometry.geometry import Boundary
from crowd_env.geometry.surface import Surface, are_level, has_sheets, is_wall_near
from crowd_env.physics.allocation import allocate

# Up to this number of people all pairs are tested, which is quicker than to sort them into cells.
_FEW = 64  # people

FIRST_HORIZON = 0.05  # s

# Capacity of every environment beyond that of its people.
_SPARE_ENTRIES = 16
_SPARE_CELLS = 64
_CELLS_PER_PERSON = 4


class NeighborList(NamedTuple):
    """Half lists of all environments; ``e`` owns the entries from ``entry_start[e]`` on: pairs, then walls, then exits."""

    entry_start: Ints  # (E+1,)
    pair_end: Annotated[Ints, "E"]
    wall_end: Annotated[Ints, "E"]
    exit_end: Annotated[Ints, "E"]
    owner: Annotated[Indices, "M"]  # person i
    # Person j > i; or wall k of the geometry, then its corners; or exit k of the geometry.
    partner: Annotated[Indices, "M"]
    contact_distance: Annotated[Floats, "M"]  # m    sum of the two radii of a pair
    origin_x: Annotated[Floats, "P"]  # m    positions when the list was built
    origin_y: Annotated[Floats, "P"]
    allowed: Annotated[Floats, "P"]  # m    allowed path from there, each body's own
    room: Annotated[Floats, "P"]  # m    scratch: radius and allowed displacement, in the order of cells
    reach: Annotated[Floats, "E"]  # m    gap up to which the list is complete while no path exceeds `allowed`
    # The list is valid: no body and no door has been moved from outside since it was built.
    is_valid: Annotated[Bools, "E"]
    horizon: Annotated[Floats, "E"]  # s    for which the list should last
    age: Annotated[Ints, "E"]  # steps since it was built
    built: Annotated[Floats, "E"]  # s    time when it was built
    cell_start: Annotated[NDArray[np.int32], "C"]  # cell heads of the counting sort, see `first_cell`
    cell_item: Annotated[NDArray[np.int32], "P"]
    cell_of: Annotated[NDArray[np.int32], "P"]
    columns: Annotated[Ints, "E"]  # of cells, where pairs are listed by them
    rows: Annotated[Ints, "E"]


def allocate_neighbors(bodies: Bodies, per_person: int) -> NeighborList:
    """Return an empty list with ``per_person`` entries a pedestrian (and a few more an environment)."""
    people, environments = len(bodies.radius), len(bodies.env_start) - 1
    entry_start = bodies.env_start * per_person + _SPARE_ENTRIES * np.arange(environments + 1)
    cells = _CELLS_PER_PERSON * people + _SPARE_CELLS * environments
    sizes = {"P": people, "E": environments, "M": int(entry_start[-1]), "C": cells}
    ends = {name: entry_start[:-1].copy() for name in ("pair_end", "wall_end", "exit_end")}
    horizon = np.full(environments, FIRST_HORIZON)
    return allocate(NeighborList, sizes, entry_start=entry_start, horizon=horizon, **ends)


def invalidate_lists(near: NeighborList, environments: int | Sequence[int] | slice = slice(None)) -> None:
    """Make the next step of some or all environments rebuild the list."""
    near.is_valid[environments] = False


def entries_per_person(near: NeighborList, bodies: Bodies) -> int:
    """Return the number of entries a pedestrian that the list was allocated with."""
    people, environments = len(bodies.radius), len(bodies.env_start) - 1
    return (int(near.entry_start[-1]) - _SPARE_ENTRIES * environments) // max(people, 1)


@inner_kernel
def first_cell(e: int, slot_start: int) -> int:
    """Return the start of the cell table of environment ``e``, which has ``slot_start`` as its first slot."""
    return _CELLS_PER_PERSON * slot_start + _SPARE_CELLS * e


@inner_kernel
def sort_into_cells(
    e: int, slot_start: int, slot_stop: int, active: Bools, position: Floats, near: NeighborList, size: float
) -> tuple[int, int, int]:
    """Counting sort of the active people into square cells; returns the head of the cell table, columns and rows."""
    x_low, y_low, x_high, y_high = np.inf, np.inf, -np.inf, -np.inf
    count = 0
    for i in range(slot_start, slot_stop):
        if active[i]:
            count += 1
            x_low, x_high = min(x_low, position[i, 0]), max(x_high, position[i, 0])
            y_low, y_high = min(y_low, position[i, 1]), max(y_high, position[i, 1])
    head = first_cell(e, slot_start)
    if count == 0:
        return head, 0, 0
    start, item, cell_of = near.cell_start, near.cell_item, near.cell_of
    room = first_cell(e + 1, slot_stop) - head - 2  # a sparse crowd gets larger cells rather than a longer table
    columns = int((x_high - x_low) / size) + 1
    rows = int((y_high - y_low) / size) + 1
    while columns * rows > room:
        size *= 1.3
        columns = int((x_high - x_low) / size) + 1
        rows = int((y_high - y_low) / size) + 1
    for c in range(head, head + columns * rows + 1):
        start[c] = 0
    for i in range(slot_start, slot_stop):
        if active[i]:
            cell = int((position[i, 1] - y_low) / size) * columns + int((position[i, 0] - x_low) / size)
            cell_of[i] = cell
            start[head + cell + 1] += 1
    for c in range(head, head + columns * rows):
        start[c + 1] += start[c]
    for i in range(slot_stop - 1, slot_start - 1, -1):  # backwards: ids ascend within a cell
        if active[i]:
            cell = cell_of[i]
            start[head + cell + 1] -= 1
            item[slot_start + start[head + cell + 1]] = i
    # start[head + c + 1] is now the first item of cell c; its end is start[head + c + 2], or `count` for the last cell
    for c in range(head, head + columns * rows):
        start[c] = start[c + 1]
    start[head + columns * rows] = count
    return head, columns, rows


@inner_kernel
def list_pairs(e: int, bodies: Bodies, state: CrowdState, near: NeighborList, size: float) -> bool:
    """Write all pairs nearer than `reach` and their allowed displacements; cells of ``size``.  False if they do not fit."""
    slots, entries = (bodies.env_start[e], bodies.env_start[e + 1]), (near.entry_start[e], near.entry_start[e + 1])
    if slots[1] - slots[0] <= _FEW:
        near.pair_end[e] = _all_pairs(e, bodies, state, near)
    else:
        sort_for_pairs(e, bodies, state, near, size)
        near.pair_end[e] = pairs_by_cell(e, slots, entries, bodies, state, near)
    find_distances(entries[0], near.pair_end[e], bodies, near)
    return near.pair_end[e] >= 0


@inner_kernel
def find_distances(entry_start: int, entry_stop: int, bodies: Bodies, near: NeighborList) -> None:
    """Write the contact distances of pairs."""
    owner, partner, contact_distance, radius = near.owner, near.partner, near.contact_distance, bodies.radius
    if entry_stop > entry_start:
        for k in range(index(entry_start), index(entry_stop)):
            contact_distance[k] = radius[owner[k]] + radius[partner[k]]


# Entries are unsigned: numba would guard every signed index that is written to, which takes half as long again.


@inner_kernel
def _all_pairs(e: int, bodies: Bodies, state: CrowdState, near: NeighborList) -> int:
    """Write the near pairs of few people; returns one past the last entry, -1 if they do not fit."""
    slot_stop, radius, present, position = bodies.env_start[e + 1], bodies.radius, state.present, state.position
    owner, partner, allowed, reach = near.owner, near.partner, near.allowed, near.reach[e]
    entry, entry_stop = index(near.entry_start[e]), index(near.entry_start[e + 1])
    for i in range(index(bodies.env_start[e]), index(slot_stop)):
        if not present[i]:
            continue
        if entry + index(slot_stop) - i > entry_stop:  # all of them fit: no test inside the loop
            return -1
        x, y, limit = position[i, 0], position[i, 1], radius[i] + allowed[i] + reach
        for j in range(i + index(1), index(slot_stop)):
            dx, dy, far = x - position[j, 0], y - position[j, 1], limit + (radius[j] + allowed[j])
            owner[entry], partner[entry] = i, j
            entry += index((dx * dx + dy * dy < far * far) & present[j])
    return int(np.int64(entry))


@inner_kernel
def sort_for_pairs(e: int, bodies: Bodies, state: CrowdState, near: NeighborList, size: float) -> None:
    """Sort many people into cells, no smaller than two radii, the allowed displacements and the reach."""
    begin, position, radius, allowed = bodies.env_start[e], state.position, bodies.radius, near.allowed
    head, columns, rows = sort_into_cells(e, begin, bodies.env_start[e + 1], state.present, position, near, size)
    near.columns[e], near.rows[e], cell_item, cell_start = columns, rows, near.cell_item, near.cell_start
    x_of, y_of, room = near.origin_x, near.origin_y, near.room  # in the order of cells; the origins are written later
    for item in range(index(begin), index(begin) + index(cell_start[head + columns * rows])):
        j = cell_item[item]
        x_of[item], y_of[item], room[item] = position[j, 0], position[j, 1], radius[j] + allowed[j]


@inner_kernel
def pairs_by_cell(
    e: int, slots: tuple[int, int], entries: tuple[int, int], bodies: Bodies, state: CrowdState, near: NeighborList
) -> int:
    """Write the near pairs with an owner in ``slots`` into ``entries``; returns one past the last, -1 if they do not fit."""
    slot_start, radius, present, position = bodies.env_start[e], bodies.radius, state.present, state.position
    head, columns, rows = first_cell(e, slot_start), near.columns[e], near.rows[e]
    cell_of, cell_item, cell_start, allowed = near.cell_of, near.cell_item, near.cell_start, near.allowed
    x_of, y_of, room, reach = near.origin_x, near.origin_y, near.room, near.reach[e]
    owner, partner, one = near.owner, near.partner, index(1)
    entry, entry_stop = index(entries[0]), index(entries[1])
    for i in range(slots[0], slots[1]):
        if not present[i]:
            continue
        x, y, limit, own_start = position[i, 0], position[i, 1], radius[i] + allowed[i] + reach, entry
        column, row = cell_of[i] % columns, cell_of[i] // columns
        for above in range(max(row - 1, 0), min(row + 2, rows)):
            item_start = index(slot_start + cell_start[head + above * columns + max(column - 1, 0)])
            item_stop = index(slot_start + cell_start[head + above * columns + min(column + 1, columns - 1) + 1])
            if entry + item_stop - item_start > entry_stop:
                return -1
            for item in range(item_start, item_stop):
                j = cell_item[item]
                dx, dy, far = x - x_of[item], y - y_of[item], limit + room[item]
                owner[entry], partner[entry] = i, j
                entry += index((j > i) & (dx * dx + dy * dy < far * far))
        for k in range(own_start + one, entry):  # insertion sort by partner: they are few, and nearly in order
            j, at = partner[k], index(k)
            while at > own_start and partner[at - one] > j:
                partner[at] = partner[at - one]
                at -= one
            partner[at] = j
    return int(np.int64(entry))


@inner_kernel
def drop_other_levels(e: int, height: Floats, near: NeighborList) -> None:
    """Take pairs out of the list of environment ``e`` if their ``height`` [m] differs too much."""
    owner, partner, distance = near.owner, near.partner, near.contact_distance
    kept = index(near.entry_start[e])
    for k in range(index(near.entry_start[e]), index(near.pair_end[e])):
        owner[kept], partner[kept], distance[kept] = owner[k], partner[k], distance[k]
        kept += index(are_level(height[owner[k]], height[partner[k]]))
    near.pair_end[e] = kept


@inner_kernel
def _lets_through(e: int, i: int, door: int, doors: Any) -> bool:
    """Whether a door is no wall for pedestrian ``i``."""
    if not doors.door_open[e, door]:
        return False
    return not doors.is_gate[e, door] or bool((doors.admitted[i] >> door) & 1)


@inner_kernel
def list_walls(
    e: int,
    g: int,
    boundary: Boundary,
    surface: Surface,
    doors: Any,
    bodies: Bodies,
    state: CrowdState,
    near: NeighborList,
    reach: float,
) -> bool:
    """Write the wall features nearer than ``reach`` to each body, but for open ``doors``; False if they do not fit.

    ``doors`` are the `History` with their state; an open gate is left out for admitted people alone.  Where there are sheets,
    walls at other heights than the body are left out.

    Where walls turn left no body inside is beyond both: such a corner touches no body and is in no list.
    """
    slot_start, slot_stop, radius = bodies.env_start[e], bodies.env_start[e + 1], bodies.radius
    present, position = state.present, state.position
    wall_first, wall_stop = boundary.wall_start[g], boundary.chord_start[g]
    wall, tangent, wall_door = boundary.wall, boundary.tangent, boundary.wall_door
    corner, corner_door, corner_start = boundary.corner, boundary.corner_door, boundary.corner_start
    corner_radius, corner_turn = boundary.corner_radius, boundary.corner_turn
    owner, partner, allowed = near.owner, near.partner, near.allowed
    entry, entry_stop, sheets = near.pair_end[e], near.entry_start[e + 1], has_sheets(surface, g)
    for i in range(slot_start, slot_stop):
        if not present[i]:
            continue
        x, y, limit = position[i, 0], position[i, 1], radius[i] + allowed[i] + reach
        for k in range(wall_first, wall_stop):
            ax, ay, bx, by = wall[k, 0, 0], wall[k, 0, 1], wall[k, 1, 0], wall[k, 1, 1]
            if x < min(ax, bx) - limit or x > max(ax, bx) + limit or y < min(ay, by) - limit or y > max(ay, by) + limit:
                continue
            if wall_door[k] >= 0 and _lets_through(e, i, wall_door[k], doors):
                continue
            if abs(tangent[k, 0] * (y - ay) - tangent[k, 1] * (x - ax)) < limit:
                along = tangent[k, 0] * (x - ax) + tangent[k, 1] * (y - ay)
                if sheets and not is_wall_near(surface, k, along, boundary.length[k], doors.height[i]):
                    continue
                if entry == entry_stop:
                    return False
                owner[entry], partner[entry] = i, k - wall_first
                entry += 1
        for k in range(corner_start[g], corner_start[g + 1]):
            dx, dy, far = x - corner[k, 0], y - corner[k, 1], limit + corner_radius[k]
            if dx * dx + dy * dy < far * far and corner_turn[k] <= 0.0:
                if corner_door[k] >= 0 and _lets_through(e, i, corner_door[k], doors):
                    continue
                if sheets and not are_level(surface.corner_height[k], doors.height[i]):
                    continue
                if entry == entry_stop:
                    return False
                owner[entry], partner[entry] = i, wall_stop - wall_first + k - corner_start[g]
                entry += 1
    near.wall_end[e] = entry
    return True


@inner_kernel
def list_exits(e: int, g: int, boundary: Boundary, bodies: Bodies, state: CrowdState, near: NeighborList) -> bool:
    """Write the exit lines within reach of each body's center; False if they do not fit."""
    slot_start, slot_stop, active, position = bodies.env_start[e], bodies.env_start[e + 1], state.active, state.position
    entry, entry_stop, line, exit_start = near.wall_end[e], near.entry_start[e + 1], boundary.exit, boundary.exit_start
    owner, partner, allowed = near.owner, near.partner, near.allowed
    for k in range(exit_start[g], exit_start[g + 1]):
        ax, ay, bx, by = line[k, 0, 0], line[k, 0, 1], line[k, 1, 0], line[k, 1, 1]
        left, right, low, high = min(ax, bx), max(ax, bx), min(ay, by), max(ay, by)
        length = np.hypot(bx - ax, by - ay)
        for i in range(index(slot_start), index(slot_stop)):
            x, y, limit = position[i, 0], position[i, 1], allowed[i]
            if x < left - limit or x > right + limit or y < low - limit or y > high + limit or not active[i]:
                continue
            if abs((bx - ax) * (y - ay) - (by - ay) * (x - ax)) <= limit * length:
                if entry == entry_stop:
                    return False
                owner[entry], partner[entry] = i, k - exit_start[g]
                entry += 1
    near.exit_end[e] = entry
    return True
