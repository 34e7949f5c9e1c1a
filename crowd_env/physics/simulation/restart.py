"""What an environment is at the start of an episode: nothing is left of the one before."""

from crowd_env.core.arrays.state import Bodies, CrowdState, Floats, Ints, make_state
from crowd_env.physics.neighbors.lists import invalidate_lists
from crowd_env.physics.workspace import Diagnostics, History, Results, Workspace


def begin_state(
    e: int, people: slice, state: CrowdState, position: Floats, velocity: Floats | None, route: Ints
) -> None:
    """Let the ``people`` of environment ``e`` stand at their ``position`` (N, 2) [m], all of them inside."""
    start = make_state(position, velocity)
    for name in CrowdState._fields[:-1]:
        getattr(state, name)[people] = getattr(start, name)
    state.route[people] = route
    state.time[e] = 0.0


def begin_history(e: int, people: slice, history: History, workspace: Workspace, bodies: Bodies, route: Ints) -> None:
    """Forget what went on in environment ``e``: no contact, no forces, nobody has looked for the route."""
    history.contacts.number[e] = 0
    history.phase[e] = 0
    history.directions_known[e] = False
    history.turn[e] = 0
    history.followed[people] = route
    history.region_bits[people] = 0
    history.local_speed[people] = bodies.desired_speed[people]
    history.rule_on[e] = False
    history.door_open[e] = True
    history.have_decided[e] = False
    if len(history.waited):
        history.waited[people] = 0.0
        history.walking_velocity[people] = 0.0
    invalidate_lists(workspace.neighbors, e)


def begin_results(e: int, people: slice, results: Results, total: Diagnostics) -> None:
    """Set to zero what the people of environment ``e`` got, and what went on since its start."""
    results.impulse[people] = 0.0
    results.impulse_magnitude[people] = 0.0
    for array in (*total, *results.diagnostics):
        array[e] = 0
