"""How far anyone may go in one step: refused before it runs where desired speeds alone ask for too much, else explained."""

import numpy as np

from crowd_env.core.arrays.state import Bodies, CrowdState
from crowd_env.physics.neighbors.update import DIVERGED

STRIDE = 0.5  # radii that a desired speed may lead in one step; the rest of the radius is for what others push


def check_stride(bodies: Bodies, dt: float) -> None:
    """Raise ValueError if anyone's desired speed alone would lead further in one step of ``dt`` [s] than `STRIDE` radii."""
    strides = bodies.desired_speed * dt / bodies.radius
    if len(strides) and strides.max() > STRIDE:
        i = int(np.argmax(strides))
        speed, radius = bodies.desired_speed[i], bodies.radius[i]
        raise ValueError(
            f"dt = {dt:g} s is too long for pedestrian {i}: desired speed x dt = {speed:.3g} m/s x {dt:g} s = "
            f"{speed * dt:.3g} m, and it must be at most {STRIDE:g} of the radius of {radius:.3g} m; take dt <= "
            f"{STRIDE * radius / speed:.3g} s"
        )


def why_stopped(scheme: str, e: int, status: int, bodies: Bodies, state: CrowdState, dt: float) -> str:
    """Say in one sentence who of environment ``e`` went too far in a step, where and when."""
    people = slice(int(bodies.env_start[e]), int(bodies.env_start[e + 1]))
    paths = np.where(state.active[people], dt * np.hypot(*state.velocity[people].T), 0.0)
    when = f"at t = {state.time[e]:g} s with dt = {dt:g} s"
    if status == DIVERGED or not np.isfinite(paths).all():
        return f"{scheme}: positions of environment {e} are no longer finite {when}; take a smaller dt"
    radius = bodies.radius[people]
    i = int(np.argmax(paths / radius))
    x, y = state.position[people][i]
    if paths[i] <= radius[i]:  # so it was not the velocity that led too far
        return (
            f"{scheme}: people of environment {e} would be moved apart by more than their radius in one step {when}: their "
            "overlaps are deeper than a step may take back; take a smaller position_correction or dt"
        )
    return (
        f"{scheme}: pedestrian {i} of environment {e} would move {paths[i]:.3g} m in one step near ({x:.2f}, {y:.2f}) "
        f"{when}, further than its radius of {radius[i]:.3g} m ({paths[i] / dt:.3g} m/s); take a smaller dt"
    )
