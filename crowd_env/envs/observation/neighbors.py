"""The neighbors of each pedestrian, compiled: the density, the nearest ones, and the ones nearer the exit."""

import numpy as np

from crowd_env.core.arrays.state import Bools, Floats
from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.envs.observation.view import SIGHT, SPEED_SCALE, Cells, Plan, Rows, View
from crowd_env.geometry.surface import ground_of
from crowd_env.physics.neighbors.lists import NeighborList, first_cell, sort_into_cells
from crowd_env.routing.fields.lookup import way_at

DENSITY_RADIUS = 1.0  # m
DENSITY_SCALE = 8.0  # 1/m2
AHEAD_SCALE = 10.0  # people   this number ahead is observed as 1/2

# The nearest are found by one number, gap before slot: gaps that differ by less than 0.2 nm count as equal.  It is whole and
# below 2**53, so that float64 holds it, as long as a room has fewer slots than half a million.
_GAP_STEPS = 4294967296.0  # 1/m
_SLOTS = 524288.0


@inner_kernel
def clipped(value: float) -> float:
    """Return the value moved into [-1, 1]; nan stays."""
    if value < -1.0:
        return -1.0
    if value > 1.0:
        return 1.0
    return value


@inner_kernel
def neighbor_features(e: int, begin: int, end: int, view: View, plan: Plan, out: Rows) -> None:
    """Write all terms about others for the rows of ``listed[begin:end]``, which are inside environment ``e``."""
    near, active, position = view.near, view.state.active, view.state.position
    if end - begin <= plan.all_pairs:
        head, columns, rows = put_into_one_cell(e, begin, end, view.listed, active, near)
    else:
        column = plan.column
        far = max(column.neighbors, column.lead, column.ahead, column.queues_seen) >= 0
        sight = SIGHT if far else DENSITY_RADIUS
        head, columns, rows = sort_into_cells(e, begin, view.bodies.env_start[e + 1], active, position, near, sight)
    for cell in range(head, head + rows * columns):
        first_item, end_item = begin + near.cell_start[cell], begin + near.cell_start[cell + 1]
        if first_item < end_item:
            count = gather_around(head, cell - head, columns, rows, begin, view, plan.around)
            write_neighbors(e, first_item, end_item, count, begin, view, plan, out)


@inner_kernel
def put_into_one_cell(
    e: int, begin: int, end: int, listed: Cells, active: Bools, near: NeighborList
) -> tuple[int, int, int]:
    """Put all listed pedestrians inside into one cell, so that all pairs are compared; return as `sort_into_cells` does."""
    head, count = first_cell(e, begin), 0
    for n in range(index(begin), index(end)):
        if active[listed[n]]:
            near.cell_item[begin + count] = listed[n]
            count += 1
    near.cell_start[head], near.cell_start[head + 1] = 0, count
    return head, 1, 1


@inner_kernel
def gather_around(head: int, cell: int, columns: int, rows: int, begin: int, view: View, around: Floats) -> int:
    """Write position, radius and slot of pedestrians in and beside a cell into ``around``; return their number."""
    near, position, radius = view.near, view.state.position, view.bodies.radius
    row, column, count = cell // columns, cell % columns, 0
    for other in range(max(row - 1, 0), min(row + 2, rows)):
        left, right = head + other * columns + max(column - 1, 0), head + other * columns + min(column + 2, columns)
        for n in range(begin + near.cell_start[left], begin + near.cell_start[right]):
            i = near.cell_item[n]
            around[0, count], around[1, count] = position[i, 0], position[i, 1]
            around[2, count], around[3, count] = radius[i], i - begin
            count += 1
    return count


@inner_kernel
def write_neighbors(
    e: int, first_item: int, end_item: int, count: int, begin: int, view: View, plan: Plan, out: Rows
) -> None:
    """Write what ``cell_item[first_item:end_item]`` observe of the ``count`` pedestrians in ``around``."""
    at_density, at_neighbors, at_lead = plan.column.density, plan.column.neighbors, plan.column.lead
    around, key, nearest = plan.around, plan.key, plan.nearest
    axis, position, velocity = view.axis, view.state.position, view.state.velocity
    for m in range(index(first_item), index(end_item)):
        i = view.near.cell_item[m]
        x, y, r, me = position[i, 0], position[i, 1], view.bodies.radius[i], float(i - begin)
        close = 0
        for n in range(count):
            dx, dy = x - around[0, n], y - around[1, n]
            square = dx * dx + dy * dy
            close += square < DENSITY_RADIUS * DENSITY_RADIUS
            known = np.floor((np.sqrt(square) - r - around[2, n]) * _GAP_STEPS) * _SLOTS + around[3, n]
            key[n] = known if square < SIGHT * SIGHT and around[3, n] != me else np.inf
        if at_density >= 0:
            out[i, at_density] = clipped(close * (1.0 / (np.pi * DENSITY_RADIUS**2 * DENSITY_SCALE)))
        if plan.column.ahead >= 0:
            write_ahead(e, i, count, begin, view, plan, out)
        if plan.column.queues_seen >= 0:
            write_queues_seen(i, count, begin, view, plan, out)
        if at_neighbors < 0 and at_lead < 0:
            continue
        if len(nearest) <= 6:
            smallest_six(key, count, nearest)
        else:
            smallest(key, count, nearest)
        ax, ay, u, v = axis[i, 0], axis[i, 1], velocity[i, 0], velocity[i, 1]
        for k in range(len(nearest)):
            if nearest[k] == np.inf:
                break
            gap = np.floor(nearest[k] * (1.0 / _SLOTS))
            j = begin + int(nearest[k] - gap * _SLOTS)
            if at_lead >= 0:
                out[i, at_lead + k] = clipped((view.distance_to_go[i] - route_from(e, i, j, view)[2]) * (1.0 / SIGHT))
            if at_neighbors < 0:
                continue
            dx, dy = position[j, 0] - x, position[j, 1] - y
            du, dv = velocity[j, 0] - u, velocity[j, 1] - v
            c = at_neighbors + 5 * k
            out[i, c], out[i, c + 1] = (dx * ax + dy * ay) * (1.0 / SIGHT), (dy * ax - dx * ay) * (1.0 / SIGHT)
            out[i, c + 2] = clipped((du * ax + dv * ay) / (2 * SPEED_SCALE))
            out[i, c + 3] = clipped((dv * ax - du * ay) / (2 * SPEED_SCALE))
            out[i, c + 4] = 1.0 - max(gap, 0.0) / _GAP_STEPS * (1.0 / SIGHT)


@inner_kernel
def route_from(e: int, i: int, j: int, view: View) -> tuple[float, float, float]:
    """Return the direction and length [m] of the route of pedestrian ``i``, from the position of pedestrian ``j``."""
    f = view.field_of_route[e, view.followed[i]]
    if view.field_of_route[e, view.followed[j]] == f:
        return view.direction[j, 0], view.direction[j, 1], view.distance_to_go[j]
    position, radius = view.state.position, view.bodies.radius
    ground = ground_of(view.surface, view.geometry_of_env[e], view.state.sheet[j])
    return way_at(view.field, view.boundary, f + view.state.sheet[j], position[j, 0], position[j, 1], radius[j], ground)


@inner_kernel
def write_ahead(e: int, i: int, count: int, begin: int, view: View, plan: Plan, out: Rows) -> None:
    """Write the term `ahead` of pedestrian ``i``: of equally near pedestrians the one in the first slot is the next.

    Pedestrians on other ways do not count: two streams that cross or meet would wait for each other for ever.
    """
    around, velocity, first = plan.around, view.state.velocity, plan.column.ahead
    x, y, own = view.state.position[i, 0], view.state.position[i, 1], view.distance_to_go[i]
    field, ahead, least, following = view.field_of_route[e, view.followed[i]], 0, np.inf, -1
    for n in range(count):
        dx, dy, j = x - around[0, n], y - around[1, n], begin + int(around[3, n])
        if j == i or dx * dx + dy * dy >= SIGHT * SIGHT or view.field_of_route[e, view.followed[j]] != field:
            continue
        lead = own - view.distance_to_go[j]
        if lead > 0.0:  # false for nan
            ahead += 1
            if lead < least or (lead == least and j < following):
                least, following = lead, j
    if ahead > 0:
        ex, ey = view.direction[following, 0], view.direction[following, 1]
        out[i, first] = max(1.0 - least * (1.0 / SIGHT), 0.0)
        out[i, first + 1] = clipped((velocity[following, 0] * ex + velocity[following, 1] * ey) / SPEED_SCALE)
        out[i, first + 2] = ahead / (ahead + AHEAD_SCALE)


@inner_kernel
def write_queues_seen(i: int, count: int, begin: int, view: View, plan: Plan, out: Rows) -> None:
    """Write the term `queues_seen` of person ``i``."""
    around, length, first = plan.around, view.length_of_way, plan.column.queues_seen
    x, y = view.state.position[i, 0], view.state.position[i, 1]
    for n in range(count):
        dx, dy, j = x - around[0, n], y - around[1, n], begin + int(around[3, n])
        k = view.heads_for[j]
        if dx * dx + dy * dy < SIGHT * SIGHT and length[j, k] < length[i, k]:
            out[i, first + k] += 1.0
    for k in range(length.shape[1]):
        nearer = out[i, first + k]
        out[i, first + k] = nearer / (nearer + AHEAD_SCALE)


@inner_kernel
def smallest(key: Floats, count: int, nearest: Floats) -> None:
    """Write the smallest of ``count`` keys in ascending order."""
    last = len(nearest) - 1
    for k in range(last + 1):
        nearest[k] = np.inf
    for n in range(count):
        if key[n] < nearest[last]:
            new = key[n]
            for k in range(last + 1):
                other = nearest[k]
                nearest[k], new = min(other, new), max(other, new)


@inner_kernel
def smallest_six(key: Floats, count: int, nearest: Floats) -> None:
    """Write the smallest of ``count`` keys, up to six, in ascending order.

    Six numbers stay in registers, and minima and maxima need no branch that a processor could guess wrong.
    """
    a, b, c, d, e, f = np.inf, np.inf, np.inf, np.inf, np.inf, np.inf
    for n in range(count):
        new = key[n]
        a, new = min(a, new), max(a, new)
        b, new = min(b, new), max(b, new)
        c, new = min(c, new), max(c, new)
        d, new = min(d, new), max(d, new)
        e, new = min(e, new), max(e, new)
        f = min(f, new)
    for k in range(len(nearest)):
        nearest[k] = a
        a, b, c, d, e = b, c, d, e, f
