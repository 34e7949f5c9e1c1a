"""What a step of the soft scheme does besides pushing and walking: one thread does it, for all slabs of an environment."""

from crowd_env._jit import index, inlined_kernel, inner_kernel
from crowd_env.geometry import Boundary
from crowd_env.physics.lanes import Lanes, enter_lanes
from crowd_env.physics.leaving import leave_lanes_anywhere, leave_lanes_by_list, take_out_of_lanes
from crowd_env.physics.neighbor_list import NeighbourList
from crowd_env.physics.slabs import SLABS, Cut, first_entry, slab_start
from crowd_env.physics.soft_contact import COUNT, DEEPEST, OUTSIDE, STRAYS, SUM
from crowd_env.physics.world import Control, Diagnostics, Memory
from crowd_env.state import Bodies, Bools, CrowdState, Floats


@inlined_kernel
def begin_call(
    e: int,
    begin: int,
    end: int,
    bodies: Bodies,
    state: CrowdState,
    control: Control,
    memory: Memory,
    near: NeighbourList,
    lanes: Lanes,
    cut: Cut,
) -> None:
    """Copy everyone into the lanes; whether the list still holds is to be seen."""
    cut.inside[e], cut.pressed[e] = enter_lanes(
        begin,
        end,
        state.position,
        state.velocity,
        state.active,
        bodies.mass,
        bodies.relaxation_time,
        control.external_force,
        control.driving,
        memory.push,
        memory.crush,
        lanes,
        near.origin_x,
        near.origin_y,
    )
    latest = 0.0
    for i in range(index(begin), index(end)):
        latest = max(latest, bodies.response_time[i])
    cut.last_response[e], cut.stray[e] = latest, True


@inlined_kernel
def follow_list(
    e: int, begin: int, end: int, slabs: int, active: Bools, near: NeighbourList, lanes: Lanes, cut: Cut
) -> None:
    """Note which entries belong to which slab; whoever is parked stays so."""
    for i in range(index(begin), index(end)):
        if not active[i]:
            near.origin_x[i], near.origin_y[i] = lanes.x[i], lanes.y[i]
    cut.stray[e] = False
    first, pair_end, wall_end = near.entry_start[e], near.pair_end[e], near.wall_end[e]
    for s in range(slabs):
        row, low, high = SLABS * e + s, slab_start(s, slabs, begin, end), slab_start(s + 1, slabs, begin, end)
        cut.pair_start[row] = first_entry(low, first, pair_end, near.owner)
        cut.pair_stop[row] = first_entry(high, first, pair_end, near.owner)
        cut.wall_start[row] = first_entry(low, pair_end, wall_end, near.owner)
        cut.wall_stop[row] = first_entry(high, pair_end, wall_end, near.owner)


@inlined_kernel
def finish(
    e: int,
    g: int,
    begin: int,
    end: int,
    slabs: int,
    boundary: Boundary,
    state: CrowdState,
    near: NeighbourList,
    lanes: Lanes,
    cut: Cut,
    sums: Diagnostics,
    dt: float,
) -> None:
    """Add up what the slabs have seen, and take out whoever crossed an exit."""
    strays, count = 0.0, 0.0
    for row in range(SLABS * e, SLABS * e + slabs):
        seen = cut.seen
        sums.max_overlap[e] = max(sums.max_overlap[e], seen[row, DEEPEST], seen[row, OUTSIDE])
        sums.max_outside[e] = max(sums.max_outside[e], seen[row, OUTSIDE])
        sums.overlap_sum[e] += seen[row, SUM]
        count += seen[row, COUNT]
        strays += seen[row, STRAYS]
    sums.overlap_count[e] += int(count)
    cut.stray[e] = strays > 0.0
    near.age[e] += 1
    exits, stop = boundary.exit_start[g], boundary.exit_start[g + 1]
    left = 0
    if strays > 0.0:
        left = leave_lanes_anywhere(
            begin,
            end,
            boundary.exit,
            exits,
            stop,
            lanes.x,
            lanes.y,
            lanes.vx,
            lanes.vy,
            state.time[e],
            dt,
            state.active,
            state.exit_time,
            state.exit_index,
        )
    elif near.wall_end[e] < near.exit_end[e]:
        left = leave_lanes_by_list(
            near.wall_end[e],
            near.exit_end[e],
            near.owner,
            near.partner,
            boundary.exit,
            exits,
            lanes.x,
            lanes.y,
            lanes.vx,
            lanes.vy,
            state.time[e],
            dt,
            state.active,
            state.exit_time,
            state.exit_index,
        )
    if left > 0:
        cut.inside[e] -= left
        take_out_of_lanes(begin, end, state.active, lanes, near.origin_x, near.origin_y, state.position, state.velocity)


@inner_kernel
def write_impulses(first: int, number: int, gap: Floats, impulse: Floats, dt: float, stiffness: float) -> None:
    """The contacts of the last step of a call are listed for those who ask; their forces are those that it pushed with."""
    for c in range(first, first + number):
        impulse[c, 0], impulse[c, 1] = -stiffness * gap[c] * dt, 0.0


@inner_kernel
def copy_forces(begin: int, end: int, source: Floats, target: Floats) -> None:
    """Begin the regular forces with the external ones."""
    for i in range(index(begin), index(end)):
        target[i, 0], target[i, 1] = source[i, 0], source[i, 1]


@inner_kernel
def press(begin: int, end: int, active: Bools, force: Floats, gx: Floats, gy: Floats) -> None:
    """Put the regular forces on those inside into their lanes."""
    for i in range(index(begin), index(end)):
        if active[i]:
            gx[i], gy[i] = force[i, 0], force[i, 1]
