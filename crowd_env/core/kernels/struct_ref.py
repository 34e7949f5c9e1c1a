"""How kernels see a NamedTuple of arrays: as the address of a table that says where the arrays lie.

numba hands a NamedTuple over by value.  The tuples of a step hold 130 arrays of 7 to 9 words each: at every call a thousand
words were copied, and every copy compiled.  A `StructRef` is one word.  In a kernel its attributes are the arrays, numbers and
further references of the tuple, read where they are used::

    batch = struct_ref(Batch(world, bodies, state, ...))  # once; `StructRef.replace` hands it other arrays
    kernel(batch)                                         # def kernel(batch): ... batch.state.position[i, 0] ...

What a kernel can do with a reference is to read attributes; it cannot be unpacked, indexed or changed (the arrays can).  No
table changes while a kernel runs, which is told to the compiler: a loop reads it once.  Outside of compiled code, which is all
code under ``NUMBA_DISABLE_JIT=1``, attributes are those of the tuple, and tuples in it are references too.
"""

from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.imputils import impl_ret_borrowed, lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import NativeValue, models, register_model, typeof_impl, unbox
from numba.np import numpy_support
from numba.np.arrayobj import populate_array


class StructRefType(types.Type):
    """numba's type of a `StructRef`: names and types of its fields, each at a fixed place of the table."""

    def __init__(self, fields: tuple[tuple[str, types.Type], ...]) -> None:
        self.fields = fields
        super().__init__(f"Reference({', '.join(f'{name}: {kind}' for name, kind in fields)})")

    def find(self, name: str) -> tuple[int, types.Type] | None:
        """Return the place [words] and type of a field; None if there is none of that name."""
        place = 0
        for known, kind in self.fields:
            if known == name:
                return place, kind
            place += _words(kind)
        return None


def _words(kind: types.Type) -> int:
    """An array is its address and shape; all else is one word."""
    return 1 + kind.ndim if isinstance(kind, types.Array) else 1


class StructRef:
    """The table of a NamedTuple; it keeps the arrays alive.

    Attributes
    ----------
    address : of the table.
    fields : what it refers to, as Python sees it: the tuple, with references in place of the tuples in it.
    """

    def __init__(self, fields: Any) -> None:
        kinds: list[tuple[str, types.Type]] = []
        words: list[int] = []
        kept: list[Any] = []
        for name, value in zip(fields._fields, fields, strict=True):
            value = struct_ref(value) if hasattr(value, "_fields") else value
            kind, its_words = _describe(name, value)
            kinds.append((name, kind))
            words += its_words
            kept.append(value)
        self._table = np.array(words, dtype=np.int64)
        self._table.flags.writeable = False
        self.address = int(self._table.ctypes.data)
        self.fields = fields._make(kept)
        self._numba_type_ = StructRefType(tuple(kinds))

    def __getattr__(self, name: str) -> Any:
        """Return a field: this is what a kernel reads when it runs as plain Python."""
        if name == "fields" or name.startswith(
            "_"
        ):  # no field, but what a half-made object lacks or a library looks for
            raise AttributeError(f"a reference has no attribute {name!r}")
        return getattr(self.fields, name)

    def replace(self, **values: Any) -> None:
        """Refer to other arrays from the next call of a kernel on, and so do all references that this one is part of.

        A field that is a reference itself is replaced in place, field by field.

        Raises
        ------
        TypeError
            If a value has not the type of the one before: kernels are compiled for that.
        """
        words = []
        for name, value in values.items():
            found = self._numba_type_.find(name)
            assert found is not None, f"a reference has no field {name!r}"
            place, kind = found
            if not isinstance(kind, StructRefType):
                now, its_words = _describe(name, value)
                if now != kind:
                    raise TypeError(f"{name} is {now}; kernels are compiled for {kind}")
                words.append((place, its_words))
        self._table.flags.writeable = True
        for place, its_words in words:
            self._table[place : place + len(its_words)] = its_words
        self._table.flags.writeable = False
        for name, value in values.items():
            known = getattr(self.fields, name)
            if isinstance(known, StructRef):
                known.replace(**value._asdict())
            else:
                self.fields = self.fields._replace(**{name: value})

    def __reduce__(self) -> tuple[Any, ...]:
        """Copies and pickles refer to arrays of their own: an address means nothing elsewhere."""
        return struct_ref, (self.fields,)


def struct_ref(fields: Any) -> StructRef:
    """Return a reference to a NamedTuple of C-contiguous arrays, floats, and NamedTuples or references of such.

    Raises
    ------
    TypeError
        If a field is anything else.
    """
    return fields if isinstance(fields, StructRef) else StructRef(fields)


def _describe(name: str, value: Any) -> tuple[types.Type, list[int]]:
    """Return the type of a field and its words."""
    if isinstance(value, np.ndarray) and value.flags.c_contiguous:
        return _array_type(value.dtype, value.ndim), [int(value.ctypes.data), *value.shape]
    if isinstance(value, StructRef):
        return value._numba_type_, [value.address]
    if isinstance(value, float):
        return types.float64, [int(np.float64(value).view(np.int64))]
    if isinstance(value, int | np.integer):  # bool too
        return types.int64, [int(value)]
    raise TypeError(f"{name} is {type(value).__name__}; kernels can be referred to C-contiguous arrays and numbers")


@cache
def _array_type(dtype: np.dtype[Any], ndim: int) -> types.Type:
    """Return numba's type of an array; to make one takes as long as to describe ten arrays by it."""
    return types.Array(numpy_support.from_dtype(dtype), ndim, "C")


@typeof_impl.register(StructRef)
def _typeof(reference: StructRef, _: Any) -> types.Type:
    return reference._numba_type_


@register_model(StructRefType)
class _Model(models.PrimitiveModel):
    """A pointer to the words."""

    def __init__(self, manager: Any, kind: StructRefType) -> None:
        super().__init__(manager, kind, ir.IntType(64).as_pointer())


@unbox(StructRefType)
def _unbox(kind: StructRefType, thing: Any, c: Any) -> NativeValue:
    number = c.pyapi.object_getattr_string(thing, "address")
    address = c.pyapi.long_as_longlong(number)
    c.pyapi.decref(number)
    return NativeValue(
        c.builder.inttoptr(address, c.context.get_value_type(kind)),
        is_error=cgutils.is_not_null(c.builder, c.pyapi.err_occurred()),
    )


@infer_getattr
class _Attributes(AttributeTemplate):
    key = StructRefType

    def generic_resolve(self, value: StructRefType, attr: str) -> types.Type | None:  # type: ignore[override]
        found = value.find(attr)
        return None if found is None else found[1]


@lower_getattr_generic(StructRefType)
def _get(context: Any, builder: Any, reference: StructRefType, table: Any, name: str) -> Any:
    """Read a field where it is used; the compiler may do so once and early, since no table ever changes."""
    found = reference.find(name)
    assert found is not None  # or it would not have been typed
    place, kind = found
    integer = ir.IntType(64)

    def word(k: int) -> Any:
        loaded = builder.load(builder.gep(table, [integer(place + k)]))
        loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
        return loaded

    if isinstance(kind, StructRefType):
        return builder.inttoptr(word(0), context.get_value_type(kind))
    if isinstance(kind, types.Array):
        item = context.get_abi_sizeof(context.get_data_type(kind.dtype))
        shape = [word(1 + k) for k in range(kind.ndim)]
        strides = [integer(item)]
        for size in shape[:0:-1]:
            strides.insert(0, builder.mul(strides[0], size))
        array = context.make_array(kind)(context, builder)
        data = builder.inttoptr(word(0), array.data.type)
        populate_array(array, data=data, shape=shape, strides=strides, itemsize=integer(item), meminfo=None)
        return impl_ret_borrowed(context, builder, kind, array._getvalue())
    return builder.bitcast(word(0), context.get_value_type(kind)) if kind == types.float64 else word(0)
