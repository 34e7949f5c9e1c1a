"""The ways that pedestrians may choose among, compiled: the time of each, its followers, and its queue."""

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.envs.observation.neighbors import clipped
from crowd_env.envs.observation.view import SLOWEST, TIME_SCALE, Plan, Rows, View
from crowd_env.geometry.surface import ground_of
from crowd_env.routing.fields.lookup import travel_time_at, way_at

SHOWN_SCALE = 50.0  # people   a sign that shows this number is observed as 1/2


@inner_kernel
def way_features(e: int, begin: int, end: int, view: View, plan: Plan, out: Rows) -> None:
    """Find the ways of ``listed[begin:end]``; write the terms `routes` and `queues_shown` of environment ``e``."""
    first, length, heads_for = plan.column.routes, view.length_of_way, view.heads_for
    for n in range(index(begin), index(end)):
        i = view.listed[n]
        find_ways(e, i, view)
        if first >= 0:
            speed = max(view.bodies.desired_speed[i], SLOWEST)
            for k in range(length.shape[1]):
                time = length[i, k] / speed if view.state.active[i] else 0.0
                out[i, first + 2 * k] = clipped(time / (time + TIME_SCALE))
            out[i, first + 2 * heads_for[i] + 1] = 1.0
    if plan.column.queues_shown >= 0:
        for k in range(length.shape[1]):
            write_queue_shown(k, begin, end, view, plan, out)


@inner_kernel
def find_ways(e: int, i: int, view: View) -> None:
    """Write the length of each way of pedestrian ``i``, and the way that it goes.

    It is the way that is followed, or among the others the one in the desired direction: a pedestrian on the fastest way is
    seen to head for one exit, and may turn.
    """
    x, y, r, followed = view.state.position[i, 0], view.state.position[i, 1], view.bodies.radius[i], view.followed[i]
    heads_for, best, sheet = 0, -np.inf, view.state.sheet[i]
    ground = ground_of(view.surface, view.geometry_of_env[e], sheet)
    for k in range(view.ways.route.shape[1]):
        route = view.ways.route[e, k]
        f, p = view.field_of_route[e, route], view.potential_of_route[e, route]
        ex, ey, length = way_at(view.field, view.boundary, f + sheet, x, y, r, ground)
        if p != f:
            length = travel_time_at(view.field, view.boundary, p + sheet, x, y, r, ground)
        view.length_of_way[i, k] = length
        likeness = ex * view.direction[i, 0] + ey * view.direction[i, 1]
        if followed == route or followed == view.ways.then[e, k]:
            likeness = np.inf
        if likeness > best:
            heads_for, best = k, likeness
    view.heads_for[i] = heads_for


@inner_kernel
def write_queue_shown(k: int, begin: int, end: int, view: View, plan: Plan, out: Rows) -> None:
    """Write the number of pedestrians ahead on way ``k`` and heading for its end, for each in ``listed[begin:end]``."""
    length, sorted_lengths, count = view.length_of_way, plan.key, 0
    for n in range(index(begin), index(end)):
        i = view.listed[n]
        if view.state.active[i] and view.heads_for[i] == k:
            sorted_lengths[count] = length[i, k]
            count += 1
    sort(sorted_lengths, count)
    for n in range(index(begin), index(end)):
        i = view.listed[n]
        nearer = np.searchsorted(sorted_lengths[:count], length[i, k])
        out[i, plan.column.queues_shown + k] = nearer / (nearer + SHOWN_SCALE)


@inner_kernel
def sort(values: Floats, count: int) -> None:
    """Sort the first ``count`` values in place, by a heap: as quick for any order, and without memory of its own."""
    for root in range(count // 2 - 1, -1, -1):
        sink(values, root, count)
    for last in range(count - 1, 0, -1):
        values[0], values[last] = values[last], values[0]
        sink(values, 0, last)


@inner_kernel
def sink(values: Floats, root: int, count: int) -> None:
    """Let a value of a heap of ``count`` sink until no child of its is larger."""
    value, hole = values[root], root
    while 2 * hole + 1 < count:
        child = 2 * hole + 1
        if child + 1 < count and values[child + 1] > values[child]:
            child += 1
        if values[child] <= value:
            break
        values[hole] = values[child]
        hole = child
    values[hole] = value
