"""What an environment is at the start of an episode: nothing is left of the one before."""

import numpy as np

from crowd_env.physics.workspace import Diagnostics, Memory
from crowd_env.state import Bodies, CrowdState, Floats, Ints


def begin_state(
    e: int, people: slice, state: CrowdState, position: Floats, velocity: Floats | None, route: Ints
) -> None:
    """Let the ``people`` of environment ``e`` stand at their ``position`` (N, 2) [m], all of them inside."""
    state.position[people] = position
    state.velocity[people] = 0.0 if velocity is None else velocity
    state.angle[people] = 0.0
    state.spin[people] = 0.0
    state.active[people] = True
    state.exit_time[people] = np.nan
    state.exit_index[people] = -1
    state.route[people] = route
    state.time[e] = 0.0


def begin_memory(e: int, people: slice, memory: Memory, bodies: Bodies, route: Ints, diagnostics: Diagnostics) -> None:
    """Forget what went on in environment ``e``, and what its people got."""
    memory.followed[people] = route
    memory.pace[people] = bodies.desired_speed[people]
    memory.here[people] = 0
    memory.rule_on[e] = False
    memory.door_open[e] = True
    memory.phase[e] = 0
    memory.turn[e] = 0
    memory.direction_age[e] = np.inf
    memory.near.reach[e] = -1.0
    memory.contacts.number[e] = 0
    memory.push[people] = 0.0
    memory.crush[people] = 0.0
    for total in (*diagnostics, *memory.diagnostics):
        total[e] = 0
