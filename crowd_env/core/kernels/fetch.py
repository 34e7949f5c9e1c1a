"""Prefetch: memory is requested before it is needed, and arrives during other work.

A look-up in a table beyond the caches waits a hundred nanoseconds for a few of work.  The processor cannot guess the place of
the next look-up, so the kernel names it.  No result depends on it.
"""

from typing import Any

from llvmlite import ir
from numba import config, types
from numba.extending import intrinsic


def _declare_fetch(_context: Any, array: Any, place: Any) -> Any:
    """Ask for the cache line of element ``place`` of an array, counted through all its rows; it need not exist."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        address, number = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [address, number, number, number])
        ask = builder.module.declare_intrinsic("llvm.prefetch.p0", [], kind)
        to_read_soon_of_data = [number(0), number(3), number(1)]
        builder.call(ask, [builder.bitcast(builder.gep(data, [args[1]]), address), *to_read_soon_of_data])
        return context.get_dummy_value()

    return types.void(array, types.int64), generate


def _need_not(_array: Any, _place: int) -> None:
    """Do nothing: without numba's compiler there are no instructions to choose."""


fetch: Any = _need_not if config.DISABLE_JIT else intrinsic(_declare_fetch)  # type: ignore[attr-defined]
