"""The distance to the walls of a place on a grid, and the basins and passes of that landscape."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowd_env.core.arrays.state import Bools, Floats, Ints
from crowd_env.core.kernels.jit import kernel
from crowd_env.core.kernels.struct_ref import struct_ref
from crowd_env.geometry.geometry import Geometry
from crowd_env.geometry.inside import border_of, mark_outside
from crowd_env.routing.fields.grid import capped_distance, node_points

_FINEST = 0.05  # m; spacing of the nodes, finer in plans of a few meters ...
_LEAST_NODES = 100  # ... along the longer side
_NODES = 1.2e6  # large plans get a coarser grid
_CAP = 5.0  # m; of passages twice as wide it does not matter where they are


class Terrain(NamedTuple):
    """The distance to the walls on a grid, its basins and the passes between them."""

    origin: Floats  # (2,)  m
    spacing: float  # m
    clearance: Floats  # (rows, cols)  m   to the nearest wall, 5 m at most; 0 outside of the walkable area
    basin: NDArray[np.int32]  # (rows, cols)  -1 = not free
    passes: Ints  # (P, 3)  two basins, and the node where they meet

    def free(self, radius: float) -> Bools:
        """Return (rows, cols) where the center of a body of ``radius`` [m] may be."""
        return (self.basin >= 0) & (self.clearance >= radius)

    def at(self, node: int) -> Floats:
        """Return where a node lies (2,) [m]."""
        row, col = divmod(node, self.clearance.shape[1])
        return self.origin + self.spacing * np.array([col, row])


def survey(geometry: Geometry) -> Terrain:
    """Return the distance to the walls of a place, all doors open, with its basins and passes."""
    x0, y0, x1, y1 = geometry.bounds
    spacing = min(_FINEST, max(x1 - x0, y1 - y0) / _LEAST_NODES)
    spacing = max(spacing, float(np.sqrt((x1 - x0) * (y1 - y0) / _NODES)))
    shape, origin = (int((y1 - y0) / spacing) + 2, int((x1 - x0) / spacing) + 2), np.array([x0, y0])
    origin = origin - 0.5 * (spacing * np.array([shape[1] - 1, shape[0] - 1]) - (x1 - x0, y1 - y0))
    walls, _ = geometry.walls_when(())
    # With coordinates of millions of meters, differences are taken first.
    clearance = capped_distance(walls - origin, shape, np.zeros(2), spacing, _CAP)
    points, outside = node_points(origin, spacing, shape).reshape(-1, 2), np.zeros(clearance.size, dtype=bool)
    everyone = np.array([0, clearance.size]), np.ones(clearance.size, dtype=bool)
    mark_outside(struct_ref(border_of([geometry.walkable])), np.zeros(1, dtype=np.int64), *everyone, points, outside)
    clearance.ravel()[outside] = 0.0
    # Of two neighbors on both sides of a thin wall one is nearer to it than half their distance: no way leads across.
    free = np.flatnonzero(clearance.ravel() > 0.7072 * spacing)
    order = free[np.argsort(-clearance.ravel()[free], kind="stable")]
    basin = np.full(clearance.size, -1, dtype=np.int32)
    root, passes = np.empty(len(order), dtype=np.int32), np.empty((len(order), 3), dtype=np.int64)
    count = np.zeros(1, dtype=np.int64)
    _flood(order, shape[1], basin, root, passes, count)
    return Terrain(origin, spacing, clearance, basin.reshape(shape), passes[: count[0]].copy())


@kernel
def _flood(
    order: Ints, cols: int, basin: NDArray[np.int32], root: NDArray[np.int32], passes: Ints, count: Ints
) -> None:
    """Give nodes to basins in this ``order``, from the highest down, and note where two basins meet for the first time."""
    basins, found = 0, 0
    for node in order:
        row, col = node // cols, node % cols
        for side in range(9):
            i, j = row + side // 3 - 1, col + side % 3 - 1
            other = i * cols + j
            if side == 4 or i < 0 or j < 0 or j >= cols or other >= len(basin) or basin[other] < 0:
                continue
            if basin[node] < 0:
                basin[node] = basin[other]
                continue
            a, b = basin[node], basin[other]
            while root[a] != a:
                root[a] = root[root[a]]
                a = root[a]
            while root[b] != b:
                root[b] = root[root[b]]
                b = root[b]
            if a != b:
                root[max(a, b)] = min(a, b)
                passes[found, 0], passes[found, 1], passes[found, 2] = basin[node], basin[other], node
                found += 1
        if basin[node] < 0:
            basin[node] = basins
            root[basins] = basins
            basins += 1
    count[0] = found
