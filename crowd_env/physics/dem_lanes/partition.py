"""One big crowd on several threads: slabs of people that are stepped side by side, and where threads wait for each other.

A crowd is cut into as many slabs as its size says, whatever the number of threads, and every sum has the order of the slabs:
the result is the same, bit by bit, for any number of threads.  A slab is a range of people; people lie in the order of space
(`crowd_env.physics.spatial_order`), so few pairs reach from one slab into another.
"""

import os
import threading
import time
from typing import Any, NamedTuple

import numpy as np
from numba import config, types
from numba.extending import intrinsic

from crowd_env._kernels.jit import inner_kernel, kernel
from crowd_env.physics.neighbors.lists import Places
from crowd_env.state import Bools, Floats, Ints

_MANY = 4000  # people from which on a crowd is cut
SLABS = 16
_SPINS = 2000  # looks at the counter before a thread lets others run


class Cut(NamedTuple):
    """How crowds are cut, and where their steps stand: what the threads of a step tell each other."""

    gate: Ints  # (8,)     [0] counts who has come to `wait_for_all`
    go: Bools  # (E,)     another step is to be done
    stray: Bools  # (E,)     someone may have gone further than the list allows for
    look: Ints  # (E,)     what this step has to do about where people want to go
    turn: Ints  # (E,)     whose turn it is to look, see `forces.choose_turn`
    inside: Ints  # (E,)     people
    pressed: Bools  # (E,)     external or social forces act
    last_response: Floats  # (E,)  s    when the last one begins to walk
    smallest: Floats  # (E,)  m    least radius
    inside_start: Ints  # (E * SLABS,)  places of each slab in `Workspace.inside`
    inside_stop: Ints
    pair_start: Ints  # (E * SLABS,)  entries of each slab
    pair_stop: Ints
    wall_start: Ints
    wall_stop: Ints
    seen: Floats  # (E * SLABS, 8)  overlaps of the step, and more; see `soft_contact`


def allocate_cut(environments: int) -> Cut:
    """Return the cuts of so many environments."""

    def counts(size: int) -> Ints:
        return np.zeros(size, dtype=np.int64)

    rows = environments * SLABS
    return Cut(
        gate=counts(8),
        go=np.zeros(environments, dtype=np.bool_),
        stray=np.zeros(environments, dtype=np.bool_),
        look=counts(environments),
        turn=counts(environments),
        inside=counts(environments),
        pressed=np.zeros(environments, dtype=np.bool_),
        last_response=np.zeros(environments),
        smallest=np.zeros(environments),
        inside_start=counts(rows),
        inside_stop=counts(rows),
        pair_start=counts(rows),
        pair_stop=counts(rows),
        wall_start=counts(rows),
        wall_stop=counts(rows),
        seen=np.zeros((rows, 8)),
    )


@kernel
def slabs_of(people: int) -> int:
    """Return into how many slabs so many people are cut."""
    return SLABS if people >= _MANY else 1


@inner_kernel
def slab_start(s: int, slabs: int, begin: int, end: int) -> int:
    """Return the first person of slab ``s`` of the people ``begin:end``."""
    return begin + s * (end - begin) // slabs


@inner_kernel
def first_entry(person: int, first: int, last: int, owner: Places) -> int:
    """Return the first of the sorted entries ``first:last`` whose owner is not before ``person``."""
    while first < last:
        middle = (first + last) // 2
        if owner[middle] < person:
            first = middle + 1
        else:
            last = middle
    return first


def _declare_atomic_add(_context: Any, array: Any, index: Any, value: Any) -> Any:
    """Add to an element and return what it was; all threads see one order of such calls."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        return builder.atomic_rmw("add", builder.gep(data, [args[1]]), args[2], "seq_cst")

    return types.int64(array, types.int64, types.int64), generate


_CAN_YIELD = hasattr(os, "sched_yield")  # not on Windows: there a thread that waits only spins
_sched_yield = types.ExternalFunction("sched_yield", types.int32())


@inner_kernel
def _yield_processor() -> None:
    if _CAN_YIELD:
        _sched_yield()


_one_at_a_time = threading.Lock()


def _add_in_turn(array: Ints, index: int, value: int) -> int:
    with _one_at_a_time:
        before = int(array[index])
        array[index] += value
    return before


def _release_interpreter() -> None:
    time.sleep(0.0)


# Without numba's compiler there are neither atomics nor foreign functions.
_add_atomically: Any = _add_in_turn if config.DISABLE_JIT else intrinsic(_declare_atomic_add)  # type: ignore[attr-defined]
_let_others_run: Any = _release_interpreter if config.DISABLE_JIT else _yield_processor  # type: ignore[attr-defined]


@inner_kernel
def wait_for_all(gate: Ints, threads: int) -> None:
    """Return when all ``threads`` have come here; ``gate`` is a counter that starts at 0 and is used for nothing else."""
    if threads == 1:
        return
    turn = _add_atomically(gate, 0, 1) // threads + 1
    looks = 0
    while _add_atomically(gate, 0, 0) < turn * threads:
        looks += 1
        if looks > _SPINS:
            _let_others_run()
