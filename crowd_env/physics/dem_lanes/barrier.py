"""The barrier of threads that step one crowd: a counter in memory, which enters no sum."""

import os
import threading
import time
from typing import Any

from numba import config, types
from numba.extending import intrinsic

from crowd_env.core.arrays.state import Ints
from crowd_env.core.kernels.jit import inner_kernel

_SPINS = 2000  # looks at the counter before a thread lets others run


def _declare_atomic_add(_context: Any, array: Any, index: Any, value: Any) -> Any:
    """Add to an element and return its former value; all threads see one order of such calls."""

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
def wait_for_all(barrier: Ints, threads: int) -> None:
    """Return when all ``threads`` have come here; ``barrier`` is a counter for this use alone, 0 at first."""
    if threads == 1:
        return
    turn = _add_atomically(barrier, 0, 1) // threads + 1
    looks = 0
    while _add_atomically(barrier, 0, 0) < turn * threads:
        looks += 1
        if looks > _SPINS:
            _let_others_run()
