"""Slabs of one large crowd, which several threads step side by side.

The number of slabs depends on the size of the crowd alone, and every sum has the order of the slabs, so the result is the same,
bit by bit, for any number of threads.  A slab is a range of slots.  People lie in spatial order
(`crowd_env.physics.spatial_order`), so few pairs reach from one slab into another.
"""

from typing import Annotated, NamedTuple

from crowd_env.core.arrays.state import Bools, Floats, Indices, Ints
from crowd_env.core.kernels.jit import inner_kernel, kernel

_MANY = 4000  # people from which on a crowd is cut
SLABS = 16

# Results of a slab in a step: the columns of `Partition.found`.
DEEPEST = 0  # m    deepest overlap of two people
OUTSIDE = 1  # m    deepest overlap with a wall
OVERLAP = 2  # m    sum of all overlaps
OVERLAPS = 3  # number of overlaps
FASTEST = 4  # m/s
TOO_FAR = 5  # number of people beyond the allowed path of the neighbor list
CARRIED = 6  # forces on people of later slabs
LAST_REACHED = 7  # the last slot among these people, -1 if there are none


class Partition(NamedTuple):
    """Slabs of crowds, and messages between the threads of a step; slab s of environment e is row SLABS * e + s."""

    barrier: Annotated[Ints, "8"]  # [0] counts arrivals at `wait_for_all`
    run: Annotated[Bools, "E"]  # another step is to be done
    list_is_stale: Annotated[Bools, "E"]  # a path may exceed the one that the neighbor list allows
    is_listing: Annotated[Bools, "E"]  # all threads are to list pairs, see `neighbors.update.list_slabs`
    steering: Annotated[Ints, "E"]  # task of this step for desired velocities, see `stages.plan_steering`
    turn: Annotated[Ints, "E"]  # turn of this look-up of directions, see `steering.begin_look_up`
    desired_until: Annotated[Floats, "E"]  # s    until then each step computes desired velocities
    people_inside: Annotated[Ints, "E"]
    smallest_radius: Annotated[Floats, "E"]  # m
    has_regular_force: Annotated[Bools, "E"]  # external forces or forces at a distance act
    slot_start: Annotated[Ints, "L"]  # people of each slab
    slot_stop: Annotated[Ints, "L"]
    rank_start: Annotated[Ints, "L"]  # their range in the list of people inside
    rank_stop: Annotated[Ints, "L"]
    pair_start: Annotated[Ints, "L"]  # pairs of each slab in the neighbor list
    pair_stop: Annotated[Ints, "L"]
    wall_start: Annotated[Ints, "L"]  # walls near each slab in the neighbor list
    wall_stop: Annotated[Ints, "L"]
    # Results of each slab in this step: a cache line each, so no two threads share one.
    found: Annotated[Floats, "L 8"]
    # People of later slabs with a force found by a slab, from the first pair of the slab on.
    carried_to: Annotated[Indices, "T", "soa"]
    carried_force: Annotated[Floats, "T 2", "soa"]  # N    and the opposite of that force


@kernel
def count_slabs(people: int) -> int:
    """Return the number of slabs of a crowd of ``people``."""
    return SLABS if people >= _MANY else 1


@inner_kernel
def first_entry(slot: int, entry: int, entry_end: int, owner: Indices) -> int:
    """Return the first of the sorted entries ``entry:entry_end`` with an owner not before ``slot``."""
    while entry < entry_end:
        middle = (entry + entry_end) // 2
        if owner[middle] < slot:
            entry = middle + 1
        else:
            entry_end = middle
    return entry
