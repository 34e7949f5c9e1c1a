"""What a pedestrian wants: the desired velocity, and the driving force that seeks it.

Driving force (Pécol et al. 2011, eq 11, after Helbing and Molnár 1995):  f_a = m (v_d e_d - u) / tau.
"""

from crowd_env._jit import kernel
from crowd_env.navigation import direction_at
from crowd_env.physics.world import Batch


@kernel
def desired_velocities(e: int, batch: Batch) -> None:
    """Write the desired velocity [m/s] of everyone in environment ``e`` into `Memory.desired`.

    A command is a multiple of the own desired speed.  A relative one turns with the direction of the shortest path, which
    is looked up anew at every physics step: command (1, 0) is the rule "walk the shortest path".
    """
    world, bodies, state, control = batch.world, batch.bodies, batch.state, batch.control
    desired = batch.memory.desired
    g = world.geometry_of_env[e]
    for i in range(bodies.env_start[e], bodies.env_start[e + 1]):
        if not state.active[i]:
            continue
        speed = bodies.desired_speed[i]
        if state.time[e] < bodies.response_time[i]:
            speed = 0.0
        cx, cy = control.command[i, 0], control.command[i, 1]
        if control.relative[i]:
            x, y = state.position[i, 0], state.position[i, 1]
            ex, ey = direction_at(world.field, world.boundary, g, x, y, bodies.radius[i])
            cx, cy = cx * ex - cy * ey, cx * ey + cy * ex
        desired[i, 0], desired[i, 1] = speed * cx, speed * cy


@kernel
def regular_forces(e: int, batch: Batch) -> None:
    """Write the sum of all forces but contact [N] into `Memory.force`: the external one and, if on, the driving force."""
    bodies, state, control = batch.bodies, batch.state, batch.control
    desired, force = batch.memory.desired, batch.memory.force
    for i in range(bodies.env_start[e], bodies.env_start[e + 1]):
        if not state.active[i]:
            continue
        force[i, 0], force[i, 1] = control.external_force[i, 0], control.external_force[i, 1]
        if control.driving:
            rate = bodies.mass[i] / bodies.relaxation_time[i]
            force[i, 0] += rate * (desired[i, 0] - state.velocity[i, 0])
            force[i, 1] += rate * (desired[i, 1] - state.velocity[i, 1])
