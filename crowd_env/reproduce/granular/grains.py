"""Grains under gravity: discs as large as people, without a drive, between walls.

Gravity is the external force m g of `Simulation.advance`; nothing is added to any scheme.  Hard grains have no scale but their
size and g: flows are given by d, the mean diameter, and sqrt(g / d).
"""

import numpy as np

from crowd_env.core.arrays.state import Bodies, Floats, make_bodies, make_state
from crowd_env.core.executors import all_cores
from crowd_env.geometry.geometry import Geometry, box
from crowd_env.physics import NSM1, NSM2, ContactScheme, Hertz
from crowd_env.physics.settings import Physics
from crowd_env.physics.simulation.simulation import Simulation

RADIUS = 0.2  # m
DIAMETER = 2.0 * RADIUS  # m
DENSITY = 300.0  # kg/m², of the particle of Table 3
MASS = DENSITY * np.pi * RADIUS**2  # kg
SPREAD = 0.1  # of the radii in a silo, so that grains do not pack as a crystal
GATE = "gate"  # the door that closes an outlet
BELOW = 2.0 * DIAMETER  # m, how far below the outlet grains are taken out

# Exactly inelastic for two grains (K_N = 2 m_e); rigid.
INELASTIC = NSM2(MASS, tolerance=1e-3)
RIGID = NSM1(trial="inertial")


def sand(friction: float) -> Hertz:
    """Return grains so stiff that a silo of them overlaps by two percent, and damped at half the critical rate."""
    return Hertz(3e7, 0.25, 0.5, 0.5, "critical", friction, friction, rotation=friction > 0.0, social=None)


def weight(bodies: Bodies, gravity: float) -> Floats:
    """Return the force (P, 2) [N] that pulls each body down."""
    return np.stack([np.zeros(len(bodies.mass)), -gravity * bodies.mass], axis=1)


def passive(
    place: Geometry,
    radius: Floats,
    position: Floats,
    scheme: ContactScheme,
    dt: float,
    velocity: Floats | None = None,
    environments: int = 1,
) -> Simulation:
    """Return grains of `DENSITY`, as many in each of the environments, that nothing drives."""
    starts = np.linspace(0, len(radius), environments + 1).astype(np.int64)
    bodies = make_bodies(radius, DENSITY * np.pi * radius**2, env_start=starts)
    state = make_state(position, velocity, environments=environments)
    return Simulation(
        place,
        bodies,
        state,
        physics=Physics(scheme, dt=dt, threads=min(all_cores(), environments)),
        driving=False,
        fields=[None],
    )


def silo(width: float, outlet: float, height: float, slope: float = 0.0) -> Geometry:
    """Return a silo with an outlet [m] at the origin; its floor rises from there by ``slope``, for a hopper."""
    half, lip = 0.5 * width, 0.5 * outlet
    rise = slope * (half - lip)
    floor = [[(side * half, rise), (side * lip, 0.0)] for side in (-1.0, 1.0)]
    bottom = [(-half, -BELOW), (half, -BELOW)]
    gate = [(-lip, 0.0), (lip, 0.0)]
    place = box(-half, -BELOW, half, rise + height)
    return Geometry.from_polygon(place, exits=[np.array(bottom)], thin_walls=floor, doors={GATE: np.array(gate)})


def fill(grains: int, width: float, outlet: float, slope: float, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Return radii (K,) and loose positions (K, 2) [m] in rows above the floor of a silo."""
    largest, rows = RADIUS * (1.0 + SPREAD), []
    pitch, level, placed = 2.02 * largest, largest, 0
    while placed < grains:
        # Where the lower edge of a row touches a sloping floor, along the normal of it.
        room = 0.5 * width - largest
        if slope:
            room = min(room, 0.5 * outlet + level / slope - largest * np.hypot(1.0, 1.0 / slope))
        count = int(2.0 * max(room, 0.0) / pitch) + 1 if room >= 0.0 else 0
        count = min(count, grains - placed)
        slack = max(0.0, 2.0 * room - (count - 1) * pitch)
        start = -room + rng.uniform(0.0, slack)
        rows.append(np.stack([start + pitch * np.arange(count), np.full(count, level)], axis=1))
        placed, level = placed + count, level + pitch
    return RADIUS * rng.uniform(1.0 - SPREAD, 1.0 + SPREAD, grains), np.concatenate(rows)
