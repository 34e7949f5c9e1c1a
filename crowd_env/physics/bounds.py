"""Bounds of every step: the speed of a pedestrian, one radius a step, and the walls.

A contact law pushes back in proportion to the depth or the speed of an overlap; it does not guarantee that a wall holds.  Under
thousands of people a soft wall gives way by more than a radius, and a center behind a wall is no longer in contact with it.  So
every step ends with three bounds:

* No speed exceeds `MAX_SPEED`: a faster velocity is cut to it and keeps its direction.
* No path exceeds the radius of the body: a longer one is an error, since obstacles in between could be missed.
* No center crosses a wall: a path that would do so slides along the wall instead, and the velocity into the wall is lost, as
  against a perfectly inelastic obstacle.  The center stays `MARGIN` away from the wall.

The path of a step can reach a wall only if the wall lay within it at the start.  Such a wall is a contact deeper than the
radius less the path; without one in a step there is nothing to do.  The contacts of a body of several discs do not bound the
distance of its center from a wall, so that distance is always tested.
"""

import numpy as np

from crowd_env.core.arrays.state import MAX_SPEED, Floats, Indices
from crowd_env.core.kernels.jit import index, inner_kernel
from crowd_env.geometry.geometry import Boundary
from crowd_env.physics.narrow_phase import is_beyond_walls
from crowd_env.physics.neighbors.update import TOO_FAST
from crowd_env.physics.workspace import Batch

# m; far above the rounding of map coordinates (1e-9 m at 5000 km), far below any measured length.
MARGIN = 1e-6


@inner_kernel
def least_radius(e: int, rank_stop: int, batch: Batch) -> float:
    """Return the smallest radius [m] of the people in `Workspace.inside` up to ``rank_stop``."""
    inside, radius, least = batch.workspace.inside, batch.bodies.radius, np.inf
    for rank in range(index(batch.bodies.env_start[e]), index(rank_stop)):
        least = min(least, radius[inside[rank]])
    return least


@inner_kernel
def speed_limit(batch: Batch) -> float:
    """Return the largest speed [m/s] of pedestrians; infinite for grains."""
    return MAX_SPEED if batch.control.driving and batch.control.bounded else np.inf


@inner_kernel
def hold_to_speed(e: int, rank_stop: int, batch: Batch, velocity: Floats, limit: float) -> float:
    """Limit ``velocity`` (P, 2) to ``limit`` [m/s]; return the largest speed [m/s], which also enters the diagnostics."""
    inside, fastest = batch.workspace.inside, 0.0
    for rank in range(index(batch.bodies.env_start[e]), index(rank_stop)):
        i = inside[rank]
        fastest = max(fastest, velocity[i, 0] * velocity[i, 0] + velocity[i, 1] * velocity[i, 1])
    return hold_fastest(e, rank_stop, batch, velocity, limit, fastest)


@inner_kernel
def hold_fastest(e: int, rank_stop: int, batch: Batch, velocity: Floats, limit: float, fastest: float) -> float:
    """Do as `hold_to_speed` if ``fastest``, the largest square of a speed [m2/s2], is known."""
    inside, most = batch.workspace.inside, limit * limit
    if fastest > most:
        for rank in range(index(batch.bodies.env_start[e]), index(rank_stop)):
            i = inside[rank]
            square = velocity[i, 0] * velocity[i, 0] + velocity[i, 1] * velocity[i, 1]
            if square > most:
                share = limit / np.sqrt(square)
                velocity[i, 0] *= share
                velocity[i, 1] *= share
        fastest = most
    speed, sums = float(np.sqrt(fastest)), batch.results.diagnostics.max_speed
    sums[e] = max(sums[e], speed)
    return speed


@inner_kernel
def stay_within_bounds(e: int, rank_stop: int, batch: Batch, deepest: float, smallest: float, longest: float) -> bool:
    """Keep environment ``e`` within its walls after a move; False (with the reason in `status`) if a path is too long.

    ``deepest`` [m] is the deepest contact with a wall at the start of the step, ``smallest`` the least radius and
    ``longest`` the longest path.  `Workspace.inside` lists the people up to ``rank_stop``.
    """
    if deepest + longest <= smallest - 2.0 * MARGIN or not batch.control.bounded:
        return True
    if longest > smallest and _is_too_far(e, rank_stop, batch):
        batch.workspace.status[e] = TOO_FAST
        return False
    _hold_at_walls(e, batch)
    return True


@inner_kernel
def _is_too_far(e: int, rank_stop: int, batch: Batch) -> bool:
    """Whether any body has moved further than its radius in this step."""
    inside, previous = batch.workspace.inside, batch.workspace.previous_position
    position, radius = batch.state.position, batch.bodies.radius
    for rank in range(index(batch.bodies.env_start[e]), index(rank_stop)):
        i = inside[rank]
        dx, dy = position[i, 0] - previous[i, 0], position[i, 1] - previous[i, 1]
        if dx * dx + dy * dy > radius[i] * radius[i]:
            return True
    return False


@inner_kernel
def _hold_at_walls(e: int, batch: Batch) -> None:
    """Stop all paths of environment ``e`` at walls, from `Workspace.previous_position` to `CrowdState.position`."""
    near, state, bodies = batch.workspace.neighbors, batch.state, batch.bodies
    entry_start, entry_end = near.pair_end[e], near.wall_end[e]
    boundary, g, owner, partner = batch.world.boundary, batch.world.geometry_of_env[e], near.owner, near.partner
    position, velocity, present = state.position, state.velocity, state.present
    previous = batch.workspace.previous_position
    entry = entry_start
    while entry < entry_end:
        i, entry_stop = owner[entry], entry + 1
        while entry_stop < entry_end and owner[entry_stop] == i:
            entry_stop += 1
        if present[i]:
            x, y, nx, ny, mx, my = stop_at_walls(
                boundary, g, partner, entry, entry_stop, previous[i, 0], previous[i, 1], position[i, 0], position[i, 1]
            )
            if nx != 0.0 or ny != 0.0:
                position[i, 0], position[i, 1] = x, y
                ux, uy = slide(velocity[i, 0], velocity[i, 1], nx, ny, mx, my)
                px, py = bodies.mass[i] * (ux - velocity[i, 0]), bodies.mass[i] * (uy - velocity[i, 1])
                batch.results.impulse[i, 0] += px
                batch.results.impulse[i, 1] += py
                batch.results.wall_impulse[i, 0] += px
                batch.results.wall_impulse[i, 1] += py
                batch.results.impulse_magnitude[i] += np.sqrt(px * px + py * py)
                velocity[i, 0], velocity[i, 1] = ux, uy
        entry = entry_stop


@inner_kernel
def stop_at_walls(
    boundary: Boundary, g: int, partner: Indices, begin: int, stop: int, x0: float, y0: float, x1: float, y1: float
) -> tuple[float, float, float, float, float, float]:
    """Return the end of a path from 0 to 1 that crosses none of the walls ``begin:stop``, and the normals of the walls met.

    The path slides along the first wall, or round jamb, and ends at a second one.  A normal of zero: no wall was met.
    """
    part, met, nx, ny, px, py = 2.0, np.int64(-1), 0.0, 0.0, 0.0, 0.0
    for entry in range(begin, stop):
        k = np.int64(partner[entry])
        share, ax, ay, bx, by = _crossing(boundary, g, k, x0, y0, x1, y1)
        if share < part:
            part, met, nx, ny, px, py = share, k, ax, ay, bx, by
    if met < 0:
        return x1, y1, 0.0, 0.0, 0.0, 0.0
    height = nx * (x1 - px) + ny * (y1 - py)
    x1, y1 = x1 + (MARGIN - height) * nx, y1 + (MARGIN - height) * ny
    part, mx, my = 1.0, 0.0, 0.0
    for entry in range(begin, stop):
        k = np.int64(partner[entry])
        if k != met:
            share, ax, ay, _, _ = _crossing(boundary, g, k, x0, y0, x1, y1)
            if share < part:
                part, mx, my = share, ax, ay
    if part < 1.0:
        x1, y1 = x0 + part * (x1 - x0), y0 + part * (y1 - y0)
    return x1, y1, nx, ny, mx, my


@inner_kernel
def _crossing(
    boundary: Boundary, g: int, feature: int, x0: float, y0: float, x1: float, y1: float
) -> tuple[float, float, float, float, float]:
    """Return the part of the path from 0 to 1 before a wall feature (2 if not met), the normal towards 0, and a point of the
    feature with that normal.
    """
    start = boundary.wall_start[g]
    walls = boundary.chord_start[g] - start
    if feature < walls:
        part, nx, ny = _crossing_wall(boundary, start + feature, x0, y0, x1, y1)
        return part, nx, ny, boundary.wall[start + feature, 0, 0], boundary.wall[start + feature, 0, 1]
    v = boundary.corner_start[g] + feature - walls
    rho = boundary.corner_radius[v]
    if rho > 0.0:
        part, nx, ny = _crossing_arc(boundary, v, x0, y0, x1, y1)
        return part, nx, ny, boundary.corner[v, 0] + rho * nx, boundary.corner[v, 1] + rho * ny
    return 2.0, 0.0, 0.0, 0.0, 0.0  # a point is on the walls that end there


@inner_kernel
def _crossing_arc(boundary: Boundary, v: int, x0: float, y0: float, x1: float, y1: float) -> tuple[float, float, float]:
    """Return as `_crossing`, for round jamb ``v``: the path first comes within the margin of its circle."""
    x, y, dx, dy = x0 - boundary.corner[v, 0], y0 - boundary.corner[v, 1], x1 - x0, y1 - y0
    near = boundary.corner_radius[v] + MARGIN
    square, inwards, away = dx * dx + dy * dy, -(x * dx + y * dy), x * x + y * y
    behind = near - 2.0 * MARGIN
    if inwards <= 0.0 or away < behind * behind:
        return 2.0, 0.0, 0.0
    part, before = 0.0, away - near * near
    if before > 0.0:
        under = inwards * inwards - square * before
        if under <= 0.0:
            return 2.0, 0.0, 0.0
        part = before / (inwards + np.sqrt(under))
        if part >= 1.0:
            return 2.0, 0.0, 0.0
    x, y = x + part * dx, y + part * dy
    if not is_beyond_walls(x0 + part * dx, y0 + part * dy, boundary, v, MARGIN):
        return 2.0, 0.0, 0.0
    distance = np.sqrt(x * x + y * y)
    return part, x / distance, y / distance


@inner_kernel
def _crossing_wall(
    boundary: Boundary, k: int, x0: float, y0: float, x1: float, y1: float
) -> tuple[float, float, float]:
    """Return as `_crossing`, for wall ``k``."""
    ax, ay = boundary.wall[k, 0, 0], boundary.wall[k, 0, 1]
    tx, ty, length = boundary.tangent[k, 0], boundary.tangent[k, 1], boundary.length[k]
    after = tx * (y1 - ay) - ty * (x1 - ax)
    if after >= MARGIN and not boundary.two_sided[k]:
        return 2.0, 0.0, 0.0
    nx, ny, before = -ty, tx, tx * (y0 - ay) - ty * (x0 - ax)
    if boundary.two_sided[k] and before < 0.0:
        nx, ny, before, after = -nx, -ny, -before, -after
    if before < -MARGIN or after >= MARGIN or after >= before:
        return 2.0, 0.0, 0.0
    part = max(0.0, (before - MARGIN) / (before - after))
    along = tx * (x0 + part * (x1 - x0) - ax) + ty * (y0 + part * (y1 - y0) - ay)
    if along < -MARGIN or along > length + MARGIN:
        if before < 0.0 or after >= 0.0:
            return 2.0, 0.0, 0.0
        # A path onto the tip of two walls comes within the margin of either only beyond its end.
        line = before / (before - after)
        along = tx * (x0 + line * (x1 - x0) - ax) + ty * (y0 + line * (y1 - y0) - ay)
        if along < -MARGIN or along > length + MARGIN:
            return 2.0, 0.0, 0.0
    return part, nx, ny


@inner_kernel
def slide(vx: float, vy: float, nx: float, ny: float, mx: float, my: float) -> tuple[float, float]:
    """Return a velocity without its components against the normals n and m; zero between two converging walls."""
    into = min(0.0, vx * nx + vy * ny)
    vx, vy = vx - into * nx, vy - into * ny
    into = min(0.0, vx * mx + vy * my)
    vx, vy = vx - into * mx, vy - into * my
    if vx * nx + vy * ny < -1e-12:
        return 0.0, 0.0
    return vx, vy


@inner_kernel
def limited(fx: float, fy: float, most: float) -> tuple[float, float]:
    """Return the vector (fx, fy), shortened to the length ``most`` if it is longer."""
    size = np.sqrt(fx * fx + fy * fy)
    if size > most:
        fx, fy = fx * (most / size), fy * (most / size)
    return fx, fy
