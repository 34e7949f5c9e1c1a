"""Who can touch whom soon: cell list -> Verlet half list with a skin, plus the wall features near each body.

Row ``i`` of the list names every partner ``j > i`` and every wall feature closer than ``reach`` (gap), sorted, so that the
order of every later sum depends neither on the cells nor on when the list was built.  Each entry carries what the scheme
remembers of the pair (warm start, friction history); it moves with the pair when the list is rebuilt.
"""

from typing import NamedTuple

import numpy as np

from crowd_env._jit import kernel
from crowd_env.geometry import Boundary
from crowd_env.state import Bodies, Bools, CrowdState, Floats, Ints

# What a step can answer; anything but OK hands over to Python.
OK, FULL, DIVERGED = 0, 1, 2

# Map coordinates are welcome; beyond this a run has blown up, and the number of cells would overflow.
_FARTHEST = 1e8  # m

# Skin of the Verlet list.  0.04 to 0.14 m were measured to be equally fast in a dense crowd.
SKIN = 0.08  # m


class NeighbourList(NamedTuple):
    """Half lists of all environments; environment ``e`` owns the entries ``entry_start[e]:entry_start[e + 1]``."""

    entry_start: Ints  # (E+1,)
    row_begin: Ints  # (P,)   first entry of person i
    row_end: Ints  # (P,)   one past its last entry
    partner: Ints  # (M,)   person j > i (global), or -1 - k: wall k of the geometry (k < walls), else corner k - walls
    history: Floats  # (M, 2) what the scheme remembers of the pair; 0 when not in contact
    #                 nsm1, nsm2: normal and tangential impulse of the last step [N s]; hertz: tangential elongation [m], 0
    origin: Floats  # (P, 2) m    positions when the list was built
    reach: Floats  # (E,)   m    gap up to which the list is complete at `origin`; -1 = must be built
    cell_start: Ints  # cell heads of the counting sort, environment e from 4 * env_start[e] + 64 * e
    cell_item: Ints  # (P,)
    cell_of: Ints  # (P,)
    old_begin: Ints  # (P,)   the previous list, kept while its history moves over
    old_end: Ints  # (P,)
    old_partner: Ints  # (M,)
    old_history: Floats  # (M, 2)


def allocate_neighbours(bodies: Bodies, per_person: int) -> NeighbourList:
    """Return an empty list with room for ``per_person`` entries a pedestrian (and a few more an environment)."""
    people = len(bodies.radius)
    environments = len(bodies.env_start) - 1
    entry_start = bodies.env_start * per_person + 16 * np.arange(environments + 1)
    entries = int(entry_start[-1])
    return NeighbourList(
        entry_start=entry_start,
        row_begin=np.zeros(people, dtype=np.int64),
        row_end=np.zeros(people, dtype=np.int64),
        partner=np.zeros(entries, dtype=np.int64),
        history=np.zeros((entries, 2)),
        origin=np.zeros((people, 2)),
        reach=np.full(environments, -1.0),
        cell_start=np.zeros(4 * people + 64 * environments, dtype=np.int64),
        cell_item=np.zeros(people, dtype=np.int64),
        cell_of=np.zeros(people, dtype=np.int64),
        old_begin=np.zeros(people, dtype=np.int64),
        old_end=np.zeros(people, dtype=np.int64),
        old_partner=np.zeros(entries, dtype=np.int64),
        old_history=np.zeros((entries, 2)),
    )


def grow_neighbours(old: NeighbourList, bodies: Bodies, per_person: int) -> NeighbourList:
    """Return a longer copy of ``old`` that keeps every row and its history."""
    new = allocate_neighbours(bodies, per_person)
    for e in range(len(bodies.env_start) - 1):
        people = slice(bodies.env_start[e], bodies.env_start[e + 1])
        used = int(old.row_end[people].max(initial=old.entry_start[e])) - int(old.entry_start[e])
        source = slice(old.entry_start[e], old.entry_start[e] + used)
        target = slice(new.entry_start[e], new.entry_start[e] + used)
        shift = new.entry_start[e] - old.entry_start[e]
        new.row_begin[people] = old.row_begin[people] + shift
        new.row_end[people] = old.row_end[people] + shift
        new.partner[target] = old.partner[source]
        new.history[target] = old.history[source]
    new.origin[:] = old.origin
    return new  # reach stays -1: built at the next step


@kernel
def update_neighbours(
    e: int,
    g: int,
    boundary: Boundary,
    door_open: Bools,
    bodies: Bodies,
    state: CrowdState,
    near: NeighbourList,
    margin: float,
) -> int:
    """Rebuild the list of environment ``e`` if a gap below ``margin`` could be missing from it.

    Returns OK; FULL, with the old list intact, if the entries do not fit; or DIVERGED if someone is nowhere near the world.
    """
    begin, end = bodies.env_start[e], bodies.env_start[e + 1]
    furthest = 0.0
    for i in range(begin, end):
        if state.active[i]:
            x, y = state.position[i, 0], state.position[i, 1]
            if not (abs(x) < _FARTHEST and abs(y) < _FARTHEST):  # nan too
                return DIVERGED
            dx, dy = x - near.origin[i, 0], y - near.origin[i, 1]
            furthest = max(furthest, dx * dx + dy * dy)
    if near.reach[e] >= 0.0 and margin + 2.0 * np.sqrt(furthest) <= near.reach[e]:
        return OK
    _keep_old_rows(e, begin, end, near)
    reach = margin + max(SKIN, 0.375 * margin)  # 0.15 m beyond the 0.4 m of a social force was measured to be best
    if not _build_rows(e, g, begin, end, boundary, door_open, bodies, state, near, reach):
        _restore_old_rows(e, begin, end, near)
        near.reach[e] = -1.0
        return FULL
    near.reach[e] = reach
    return OK


@kernel
def _keep_old_rows(e: int, begin: int, end: int, near: NeighbourList) -> None:
    last = near.entry_start[e]
    for i in range(begin, end):
        near.old_begin[i] = near.row_begin[i]
        near.old_end[i] = near.row_end[i]
        last = max(last, near.row_end[i])
    for c in range(near.entry_start[e], last):
        near.old_partner[c] = near.partner[c]
        near.old_history[c, 0] = near.history[c, 0]
        near.old_history[c, 1] = near.history[c, 1]


@kernel
def _restore_old_rows(e: int, begin: int, end: int, near: NeighbourList) -> None:
    last = near.entry_start[e]
    for i in range(begin, end):
        near.row_begin[i] = near.old_begin[i]
        near.row_end[i] = near.old_end[i]
        last = max(last, near.old_end[i])
    for c in range(near.entry_start[e], last):
        near.partner[c] = near.old_partner[c]
        near.history[c, 0] = near.old_history[c, 0]
        near.history[c, 1] = near.old_history[c, 1]


@kernel
def sort_into_cells(
    e: int, begin: int, end: int, active: Bools, position: Floats, near: NeighbourList, size: float
) -> tuple[int, int, int]:
    """Counting sort of the active people into square cells; returns the head of the cell table, columns and rows."""
    x_low, y_low, x_high, y_high = np.inf, np.inf, -np.inf, -np.inf
    count = 0
    for i in range(begin, end):
        if active[i]:
            count += 1
            x_low, x_high = min(x_low, position[i, 0]), max(x_high, position[i, 0])
            y_low, y_high = min(y_low, position[i, 1]), max(y_high, position[i, 1])
    head = 4 * begin + 64 * e
    if count == 0:
        return head, 0, 0
    room = 4 * (end - begin) + 62  # a sparse crowd gets larger cells rather than a longer table
    columns = int((x_high - x_low) / size) + 1
    rows = int((y_high - y_low) / size) + 1
    while columns * rows > room:
        size *= 1.3
        columns = int((x_high - x_low) / size) + 1
        rows = int((y_high - y_low) / size) + 1
    start = near.cell_start
    for c in range(head, head + columns * rows + 1):
        start[c] = 0
    for i in range(begin, end):
        if active[i]:
            cell = int((position[i, 1] - y_low) / size) * columns + int((position[i, 0] - x_low) / size)
            near.cell_of[i] = cell
            start[head + cell + 1] += 1
    for c in range(head, head + columns * rows):
        start[c + 1] += start[c]
    for i in range(end - 1, begin - 1, -1):  # backwards: ids ascend within a cell
        if active[i]:
            cell = near.cell_of[i]
            start[head + cell + 1] -= 1
            near.cell_item[begin + start[head + cell + 1]] = i
    # start[head + c + 1] is now the first item of cell c; its end is start[head + c + 2], or `count` for the last cell
    for c in range(head, head + columns * rows):
        start[c] = start[c + 1]
    start[head + columns * rows] = count
    return head, columns, rows


@kernel
def _build_rows(
    e: int,
    g: int,
    begin: int,
    end: int,
    boundary: Boundary,
    door_open: Bools,
    bodies: Bodies,
    state: CrowdState,
    near: NeighbourList,
    reach: float,
) -> bool:
    position, radius = state.position, bodies.radius
    largest = 0.0
    for i in range(begin, end):
        if state.active[i]:
            largest = max(largest, radius[i])
    head, columns, rows = sort_into_cells(e, begin, end, state.active, position, near, 2.0 * largest + reach)
    entry, last = near.entry_start[e], near.entry_start[e + 1]
    for i in range(begin, end):
        near.row_begin[i] = entry
        near.row_end[i] = entry
        near.origin[i, 0] = position[i, 0]
        near.origin[i, 1] = position[i, 1]
        if not state.active[i]:
            continue
        column, row = near.cell_of[i] % columns, near.cell_of[i] // columns
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            first = head + r * columns + max(column - 1, 0)
            stop = head + r * columns + min(column + 1, columns - 1)
            for item in range(begin + near.cell_start[first], begin + near.cell_start[stop + 1]):
                j = near.cell_item[item]
                if j <= i:
                    continue
                dx, dy = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1]
                limit = radius[i] + radius[j] + reach
                if dx * dx + dy * dy < limit * limit:
                    if entry == last:
                        return False
                    k = entry  # insertion sort by partner: rows are short
                    while k > near.row_begin[i] and near.partner[k - 1] > j:
                        near.partner[k] = near.partner[k - 1]
                        k -= 1
                    near.partner[k] = j
                    entry += 1
        limit = radius[i] + reach
        entry = _add_walls(e, g, boundary, door_open, position[i, 0], position[i, 1], limit, near.partner, entry, last)
        if entry < 0:
            return False
        near.row_end[i] = entry
        _carry_history(i, near)
    return True


@kernel
def _add_walls(
    e: int,
    g: int,
    boundary: Boundary,
    door_open: Bools,
    x: float,
    y: float,
    limit: float,
    partner: Ints,
    entry: int,
    last: int,
) -> int:
    """Append the wall features nearer than ``limit``, but for open doors; returns the next free entry, -1 if there is none."""
    first, stop = boundary.wall_start[g], boundary.wall_start[g + 1]
    for k in range(first, stop):
        ax, ay = boundary.wall[k, 0, 0], boundary.wall[k, 0, 1]
        bx, by = boundary.wall[k, 1, 0], boundary.wall[k, 1, 1]
        if x < min(ax, bx) - limit or x > max(ax, bx) + limit or y < min(ay, by) - limit or y > max(ay, by) + limit:
            continue
        if boundary.wall_door[k] >= 0 and door_open[e, boundary.wall_door[k]]:
            continue
        length = np.hypot(bx - ax, by - ay)
        if abs((bx - ax) * (y - ay) - (by - ay) * (x - ax)) < limit * length:
            if entry == last:
                return -1
            partner[entry] = -1 - (k - first)
            entry += 1
    walls = stop - first
    for k in range(boundary.corner_start[g], boundary.corner_start[g + 1]):
        dx, dy = x - boundary.corner[k, 0], y - boundary.corner[k, 1]
        if dx * dx + dy * dy < limit * limit:
            if boundary.corner_door[k] >= 0 and door_open[e, boundary.corner_door[k]]:
                continue
            if entry == last:
                return -1
            partner[entry] = -1 - walls - (k - boundary.corner_start[g])
            entry += 1
    return entry


@kernel
def _carry_history(i: int, near: NeighbourList) -> None:
    """Give every entry of row ``i`` the history its pair had in the previous list."""
    for c in range(near.row_begin[i], near.row_end[i]):
        near.history[c, 0] = 0.0
        near.history[c, 1] = 0.0
        for old in range(near.old_begin[i], near.old_end[i]):
            if near.old_partner[old] == near.partner[c]:
                near.history[c, 0] = near.old_history[old, 0]
                near.history[c, 1] = near.old_history[old, 1]
                break
