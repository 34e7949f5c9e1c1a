"""Plans to find ways in, and the length of the shortest way by a visibility graph: nothing of the code under test."""

import functools

import numpy as np
import shapely
from late import late
from shapely.geometry import Point, Polygon, box

from crowd_env.geometry.geometry import Geometry
from crowd_env.routing.fields.field import join_fields, travel_time_field

dijkstra = late("scipy.sparse.csgraph", "dijkstra")

RADIUS = 0.25
ROOM = box(0, 0, 5, 5)
DOOR = [[5, 2.09], [5, 2.91]]
C_SHAPE = Polygon([(3, 1), (5, 1), (5, 5), (3, 5), (3, 4.8), (4.8, 4.8), (4.8, 1.2), (3, 1.2)])


PLANS = {
    "room": lambda: Geometry.from_polygon(ROOM, exits=[DOOR]),
    "corner": lambda: Geometry.from_polygon(
        [(0, 0), (6, 0), (6, 6), (4.5, 6), (4.5, 1.5), (0, 1.5)], exits=[[[4.5, 6], [6, 6]]]
    ),
    "u-turn": lambda: Geometry.from_polygon(
        [(0, 0), (5, 0), (5, 5), (0, 5), (0, 3.5), (3.5, 3.5), (3.5, 1.5), (0, 1.5)], exits=[[[0, 3.5], [0, 5]]]
    ),
    "column before the door": lambda: Geometry.from_polygon(ROOM, exits=[DOOR], obstacles=[Point(4, 2.5).buffer(0.3)]),
    "block in the room": lambda: Geometry.from_polygon(ROOM, exits=[DOOR], obstacles=[box(2, 1.8, 2.8, 3.2)]),
    "c-shaped obstacle": lambda: Geometry.from_polygon(
        box(0, 0, 8, 6), exits=[[[8, 2.5], [8, 3.5]]], obstacles=[C_SHAPE]
    ),
    "thin wall": lambda: Geometry.from_polygon(ROOM, exits=[DOOR], thin_walls=[[(3.02, 0), (3.02, 4.03)]]),
    "slanted": lambda: Geometry.from_polygon(
        [(0, 0), (2, -2), (7, 3), (5, 5)], exits=[[[7, 3], [5, 5]]], thin_walls=[[(1.5, -0.2), (4.1, 2.8)]]
    ),
    "two exits": lambda: Geometry.from_polygon(
        box(0, 0, 10, 4), exits={"west": [[0, 1], [0, 2]], "east": [[10, 1], [10, 2]]}
    ),
    "exit in the middle": lambda: Geometry.from_polygon(box(0, 0, 10, 8), exits=[box(4, 3, 6, 4)]),
}


@functools.cache
def plan(name):
    geometry = PLANS[name]()
    field = travel_time_field(geometry, RADIUS)
    return geometry, field, join_fields([field], geometry.boundary)


def exit_targets(geometry):
    """Return places on the exits where the center of a disc can be, those beyond the jambs left out."""
    targets = []
    for a, b in geometry.exits:
        width = np.hypot(*(b - a))
        targets.append(a + np.linspace(RADIUS, width - RADIUS, 41)[:, None] / width * (b - a))
    return np.concatenate(targets)


def shortest(geometry, points, targets, *, lines, quad_segs):
    """Return the length of the shortest way of a disc that keeps off ``lines`` from each of ``points`` to ``targets``."""
    return shortest_ways(geometry, points, targets, lines=lines, quad_segs=quad_segs)[0]


def shortest_ways(geometry, points, targets, *, lines, quad_segs):
    """Return these lengths, and where the first straight line of each way ends."""
    free = geometry.walkable.difference(
        shapely.buffer(shapely.MultiLineString(lines), RADIUS - 1e-4, quad_segs=quad_segs)
    )
    nodes = np.concatenate([targets, shapely.get_coordinates(free)])
    tolerant = shapely.buffer(free, 2e-4)
    shapely.prepare(tolerant)

    def distances(from_points, to_points):
        """Return how far each point is from another that it sees, inf if it does not see it."""
        seen = shapely.covers(tolerant, shapely.linestrings(np.stack([from_points, to_points], axis=1)))
        return np.where(seen, np.hypot(*(from_points - to_points).T), np.inf)

    count = len(nodes)
    one, other = np.triu_indices(count, 1)
    between = np.zeros((count, count))
    between[one, other] = distances(nodes[one], nodes[other])
    between[~np.isfinite(between)] = 0  # no edge
    rest = dijkstra(between, directed=False, indices=np.arange(len(targets)), min_only=True)
    first = distances(points.repeat(count, axis=0), np.tile(nodes, (len(points), 1)))
    length = first.reshape(-1, count) + rest
    return length.min(axis=1), nodes[length.argmin(axis=1)]
