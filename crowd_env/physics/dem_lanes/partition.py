"""How one large crowd is shared out to several threads: slabs of people that are stepped side by side.

A crowd is cut into as many slabs as its size says, whatever the number of threads, and every sum has the order of the slabs:
the result is the same, bit by bit, for any number of threads.  A slab is a range of slots; people lie in the order of space
(`crowd_env.physics.spatial_order`), so few pairs reach from one slab into another.
"""

from typing import Annotated, NamedTuple

from crowd_env.core.arrays.state import Bools, Floats, Indices, Ints
from crowd_env.core.kernels.jit import inner_kernel, kernel

_MANY = 4000  # people from which on a crowd is cut
SLABS = 16

# What a slab has found in a step: the columns of `Partition.found`.
DEEPEST = 0  # m    deepest overlap of two people
OUTSIDE = 1  # m    deepest overlap with a wall
OVERLAP = 2  # m    sum of all overlaps
OVERLAPS = 3  # how many they are
FASTEST = 4  # m/s
TOO_FAR = 5  # people who have gone further than the neighbor list allows for
CARRIED = 6  # forces on people of later slabs
LAST_REACHED = 7  # the last slot among these people, -1 if there are none


class Partition(NamedTuple):
    """How crowds are cut, and what the threads of a step tell each other; slab s of environment e is row SLABS * e + s."""

    barrier: Annotated[Ints, "8"]  # [0] counts who has come to `wait_for_all`
    run: Annotated[Bools, "E"]  # another step is to be done
    list_is_stale: Annotated[Bools, "E"]  # someone may have gone further than the neighbor list allows for
    is_listing: Annotated[Bools, "E"]  # all threads are to list pairs, see `neighbors.update.list_slabs`
    steering: Annotated[Ints, "E"]  # what this step has to do about desired velocities, see `stages.plan_steering`
    turn: Annotated[Ints, "E"]  # whose turn it is to look up the direction, see `steering.begin_look_up`
    desired_until: Annotated[Floats, "E"]  # s    up to when each step has to compute desired velocities anew
    people_inside: Annotated[Ints, "E"]
    smallest_radius: Annotated[Floats, "E"]  # m
    has_regular_force: Annotated[Bools, "E"]  # external or social forces act
    slot_start: Annotated[Ints, "L"]  # people of each slab
    slot_stop: Annotated[Ints, "L"]
    rank_start: Annotated[Ints, "L"]  # where they stand in the list of people inside
    rank_stop: Annotated[Ints, "L"]
    pair_start: Annotated[Ints, "L"]  # pairs of each slab in the neighbor list
    pair_stop: Annotated[Ints, "L"]
    wall_start: Annotated[Ints, "L"]  # walls near each slab in the neighbor list
    wall_stop: Annotated[Ints, "L"]
    # What each slab has found in this step: a cache line each, no two threads share one.
    found: Annotated[Floats, "L 8"]
    # People of later slabs whom a slab has found a force on, from its first pair on.
    carried_to: Annotated[Indices, "T", "soa"]
    carried_force: Annotated[Floats, "T 2", "soa"]  # N    and the opposite of that force


@kernel
def count_slabs(people: int) -> int:
    """Return into how many slabs so many people are cut."""
    return SLABS if people >= _MANY else 1


@inner_kernel
def first_entry(slot: int, entry: int, entry_end: int, owner: Indices) -> int:
    """Return the first of the sorted entries ``entry:entry_end`` whose owner is not before ``slot``."""
    while entry < entry_end:
        middle = (entry + entry_end) // 2
        if owner[middle] < slot:
            entry = middle + 1
        else:
            entry_end = middle
    return entry
