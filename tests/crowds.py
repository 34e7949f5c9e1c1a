"""Random crowds for the physics tests, the plans they stand on, and a brute-force list of who touches what."""

from dataclasses import fields, replace
from typing import NamedTuple

import numpy as np
import pytest
import shapely
from shapely.geometry import box

from crowd_env.core.arrays.state import Bodies, CrowdState, make_bodies, make_state
from crowd_env.geometry.geometry import Geometry
from crowd_env.physics import SCHEMES, ContactScheme

every_scheme = pytest.mark.parametrize("name", SCHEMES)

HALL = Geometry.from_polygon(
    box(0, 0, 12, 8),
    obstacles=[box(5, 3, 7, 5)],
    exits={"door": [(12, 3), (12, 5)]},
    thin_walls=[[(2, 0), (2, 4)]],
    regions={"stage": box(8, 5, 12, 8), "aisle": box(0, 0, 1.2, 8), "corner": box(-3, -3, 1, 1)},
)


def clear(geometry, position, radius):
    """Return the least gap [m] between any two bodies or of a body and a wall; -inf if a center is outside."""
    if not geometry.contains(position).all():
        return -np.inf
    gap = np.hypot(*(position[:, None] - position[None]).transpose(2, 0, 1)) - radius[:, None] - radius[None]
    np.fill_diagonal(gap, np.inf)
    return min(gap.min(), (geometry.clearance(position) - radius).min())


def accepts_grains(scheme: ContactScheme) -> bool:
    """Return whether the scheme can move passive grains: some crowds have no inertia."""
    try:
        scheme.check(driving=False)
    except ValueError:
        return False
    return True


GRAIN_SCHEMES = [name for name, scheme in SCHEMES.items() if accepts_grains(scheme)]


def tight(scheme: ContactScheme, tolerance: float = 1e-11) -> ContactScheme:
    """Return the scheme with its solver, if it has one, run down to ``tolerance`` [m/s]."""
    if "tolerance" not in {field.name for field in fields(scheme)}:
        return scheme
    return replace(scheme, tolerance=tolerance, max_iterations=10_000_000)


# ------------------------------------------------------------------------------------------------------------- plans


def plain() -> Geometry:
    """Return ground with walls too far away to matter."""
    return Geometry.from_polygon(box(-1e3, -1e3, 1e3, 1e3))


def half_plane() -> Geometry:
    """Return ground right of a long wall at x = 0."""
    return Geometry.from_polygon(box(0, -500, 1000, 500))


def l_shape() -> Geometry:
    """Return a closed plan with a reentrant corner at (3, 3)."""
    return Geometry.from_polygon([(0, 0), (6, 0), (6, 3), (3, 3), (3, 6), (0, 6)])


def cluttered() -> Geometry:
    """Return a room with a door, an obstacle of five corners, a pillar on the wall and a bent thin wall."""
    return Geometry.from_polygon(
        box(0, 0, 7, 6),
        exits=[[(7, 2.6), (7, 3.4)]],
        obstacles=[[(2, 2), (3.5, 1.7), (4, 2.8), (3.2, 3.6), (2.1, 3.3)], box(5, 0, 6, 0.7)],
        thin_walls=[[(1, 4.4), (2.5, 4.6), (2.8, 5.6)]],
    )


def rounded() -> Geometry:
    """Return a closed plan with shallow corners of both kinds and a round pillar."""
    outline = [(0, 0), (3, 0.13), (6, 0), (6.2, 2.5), (6, 5), (2, 5.05), (0, 5)]
    return Geometry.from_polygon(outline, obstacles=[shapely.Point(3, 2.5).buffer(0.8)])


PLANS = {
    "room": lambda: Geometry.from_polygon(box(0, 0, 5, 5)),
    "l-shape": l_shape,
    "cluttered": cluttered,
    "rounded": rounded,
}


# ------------------------------------------------------------------------------------------------------------ crowds


def scatter(rng: np.random.Generator, geometry: Geometry, radius: np.ndarray, *, gap: float = 0.0) -> np.ndarray:
    """Return random positions with at least ``gap`` (which may be negative) between bodies and to walls."""
    x_low, y_low, x_high, y_high = geometry.bounds
    placed = np.empty((len(radius), 2))
    for i in range(len(radius)):
        while True:
            point = rng.uniform((x_low, y_low), (x_high, y_high))
            if (np.hypot(*(placed[:i] - point).T) < radius[:i] + radius[i] + gap).any():
                continue
            if geometry.contains(point) and geometry.clearance(point)[0] >= radius[i] + gap:
                placed[i] = point
                break
    return placed


def people(rng: np.random.Generator, count: int) -> Bodies:
    """Return the people of Table 4 of Pécol et al. 2011."""
    return make_bodies(
        rng.uniform(0.2, 0.25, count),
        rng.uniform(60, 100, count),
        desired_speed=rng.uniform(1.2, 2.0, count),
        relaxation_time=rng.uniform(0.1, 0.5, count),
    )


def converging(rng: np.random.Generator, count: int = 30, *, speed: float = 1.5) -> tuple[Bodies, CrowdState]:
    """Return a loose cloud around the origin that runs into itself."""
    bodies = people(rng, count)
    side = np.sqrt(count * 0.45)
    position = scatter(rng, Geometry.from_polygon(box(-side / 2, -side / 2, side / 2, side / 2)), bodies.radius)
    inwards = -position / np.maximum(np.hypot(*position.T), 0.1)[:, None]
    return bodies, make_state(position, speed * inwards + rng.normal(0, 0.3, (count, 2)))


def crowd_in(rng: np.random.Generator, geometry: Geometry, count: int) -> tuple[Bodies, CrowdState, np.ndarray]:
    """Return a crowd in a plan that moves and wants to go every way, and its commands along the world's axes."""
    bodies = people(rng, count)
    angle = rng.uniform(0, 2 * np.pi, count)
    state = make_state(scatter(rng, geometry, bodies.radius), rng.normal(0, 1.0, (count, 2)))
    return bodies, state, np.column_stack([np.cos(angle), np.sin(angle)])


def copied(bodies: Bodies, state: CrowdState) -> tuple[Bodies, CrowdState]:
    """Return copies that a simulation may work on in place."""
    return Bodies(*(array.copy() for array in bodies)), state.copy()


def joined(crowds: list[tuple[Bodies, CrowdState]]) -> tuple[Bodies, CrowdState]:
    """Return crowds as the environments of one batch."""
    parts = [np.concatenate([getattr(bodies, name) for bodies, _ in crowds]) for name in Bodies._fields[:-1]]
    start = np.cumsum([0, *(len(bodies.radius) for bodies, _ in crowds)])
    states = [np.concatenate([getattr(state, name) for _, state in crowds]) for name in CrowdState._fields]
    return Bodies(*parts, env_start=start.astype(np.int64)), CrowdState(*states)


def part(state: CrowdState, bodies: Bodies, e: int) -> dict[str, np.ndarray]:
    """Return the arrays of environment ``e`` alone."""
    rows = slice(bodies.env_start[e], bodies.env_start[e + 1])
    return {name: array[e] if name == "time" else array[rows] for name, array in state._asdict().items()}


def kinetic_energy(bodies: Bodies, velocity: np.ndarray) -> np.ndarray:
    """Return the kinetic energy [J] of each person."""
    return 0.5 * bodies.mass * (velocity**2).sum(axis=1)


# ------------------------------------------------------------------------------------------------------- brute force


class Touch(NamedTuple):
    """One touch: of person ``i`` with person ``j`` > i, or (j = -1) with the point of a wall that ``normal`` starts from."""

    i: int
    j: int
    gap: float
    normal: tuple[float, float]  # from j to i


def touches(geometry: Geometry, bodies: Bodies, state: CrowdState, below: float) -> list[Touch]:
    """Return every touch with a gap under ``below``, found among all pairs and all walls.

    A body touches a wall where the distance from its center to the walls has a local minimum.  The nearest point of a
    segment is one, unless it is an end of the segment and another segment that ends there comes nearer still.
    """
    x, r, inside = state.position, bodies.radius, np.flatnonzero(state.active)
    found = []
    for a, i in enumerate(inside):
        d = x[i] - x[inside[a + 1 :]]
        gap = np.hypot(*d.T) - r[i] - r[inside[a + 1 :]]
        for k in np.flatnonzero(gap < below):
            found.append(Touch(int(i), int(inside[a + 1 + k]), gap[k], tuple(d[k] / np.hypot(*d[k]))))
    lines = shapely.linestrings(geometry.walls)
    for i in inside:
        center = shapely.Point(x[i])
        near = shapely.get_coordinates(shapely.line_interpolate_point(lines, shapely.line_locate_point(lines, center)))
        for point in np.unique(near.round(9), axis=0):
            ending_here = np.hypot(*(geometry.walls - point).transpose(2, 0, 1)).min(axis=1) < 1e-6
            if not (np.hypot(*(near[ending_here] - point).T) < 1e-6).all():
                continue
            d = x[i] - near[np.hypot(*(near - point).T).argmin()]
            gap = np.hypot(*d) - r[i]
            if gap < below:
                found.append(Touch(int(i), -1, gap, tuple(d / np.hypot(*d))))
    return found
