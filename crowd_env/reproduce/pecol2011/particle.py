"""The particle of section 4.1: one disc that runs into a wall at x = 0."""

from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import make_bodies, make_state
from crowd_env.geometry.geometry import Geometry, box
from crowd_env.physics import ContactScheme
from crowd_env.physics.settings import Physics
from crowd_env.physics.simulation.simulation import Simulation

RADIUS = 0.3  # m
START, VELOCITY = (0.6, 0.0), (-2.0, -1.0)  # m, m/s
STEP = 0.1  # s
# The mass is not printed.  A density of 300 kg/m^2 gives the digits of Table 3, and nothing else was found to.
MASS = 300.0 * np.pi * RADIUS**2
MASS_READING = "mass 300 π r² = 84.823 kg: inferred from the digits, not printed"


class Instant(NamedTuple):
    """Where the particle is at a step."""

    time: float  # s
    x: float  # m
    y: float  # m
    u_x: float  # m/s
    u_y: float  # m/s


def particle(scheme: ContactScheme, dt: float) -> Simulation:
    """Return the particle on its way to the wall: no drive, no friction."""
    wall = Geometry.from_polygon(box(0.0, -500.0, 1000.0, 500.0))
    state = make_state(np.array([START]), np.array([VELOCITY]))
    bodies = make_bodies(np.array([RADIUS]), np.array([MASS]))
    return Simulation(wall, bodies, state, physics=Physics(scheme, dt=dt, allow_unstable=True), driving=False)


def instants(scheme: ContactScheme, dt: float, duration: float) -> list[Instant]:
    """Return the particle at t = 0 and after every step until ``duration`` [s]."""
    simulation = particle(scheme, dt)
    trace = [Instant(0.0, *START, *VELOCITY)]
    for k in range(round(duration / dt)):
        simulation.advance()
        (x, y), (u_x, u_y) = simulation.state.position[0], simulation.state.velocity[0]
        trace.append(Instant((k + 1) * dt, float(x), float(y), float(u_x), float(u_y)))
    return trace
