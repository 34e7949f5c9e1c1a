"""Drawing an environment while it runs."""

import numpy as np

from crowd_env.envs.crowd import CrowdEnv
from crowd_env.physics.pressure import contact_pressure
from crowd_env.rendering.frames import Renderer
from crowd_env.rendering.palette import FULL_PRESSURE


def draw_env(env: CrowdEnv, renderer: Renderer | None = None, e: int = 0) -> tuple[np.ndarray, Renderer]:
    """Return a frame (H, W, 3) uint8 of environment ``e``, and the renderer to hand in the next time."""
    if renderer is None:
        renderer = Renderer(env.scenario_of_env[e].geometry)
    people, simulation = env.people(e), env.simulation
    radius, state = simulation.bodies.radius[people], simulation.state
    impulse = simulation.results.impulse_magnitude[people]
    frame = renderer.frame(
        state.position[people],
        radius,
        active=state.active[people],
        color_value=contact_pressure(impulse, env.decision_dt, radius) / FULL_PRESSURE,
        velocity=state.velocity[people],
        angle=state.angle[people],
        outline=simulation.outline,
        clock=float(state.time[e]),
    )
    return frame, renderer
