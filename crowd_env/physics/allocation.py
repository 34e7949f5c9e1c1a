"""Allocation of arrays from the annotations of a NamedTuple.

An annotation holds the type of an array and its shape, in letters and numbers: P people, E environments, M entries of the
neighbor list, R control rules, D doors, N discs of all bodies, S people seen in front, W lists of them, C heads of cells,
B bodies of a solver (people and a wall an environment), L slabs of all crowds, T forces carried between slabs.  A name behind
the shape marks an optional array.  It is empty unless a scheme (`SchemeInfo.uses`), its social force or a behavior
(`Behavior.USES`) needs it.
"""

from collections.abc import Collection, Mapping
from functools import cache
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

Arrays = TypeVar("Arrays", bound=tuple[Any, ...])
Sizes = Mapping[str, int]


@cache
def _arrays_of(kind: type[Any]) -> dict[str, tuple[Any, list[str], str]]:
    """Return the annotated arrays of a NamedTuple: name -> type of a number, shape, name of its use."""
    found = {}
    for name, hint in get_type_hints(kind, include_extras=True).items():
        if get_origin(hint) is Annotated:
            array, shape, *needs = get_args(hint)
            found[name] = get_args(get_args(array)[1])[0], shape.split(), "".join(needs)
    return found


def shapes_of(kind: Any) -> dict[str, list[str]]:
    """Return the shape of each field of a NamedTuple, in letters and numbers; empty without an annotated one."""
    known = _arrays_of(kind)
    return {name: known[name][1] if name in known else [] for name in kind._fields}


def arrays_of_people(fields: Any) -> dict[str, np.ndarray]:
    """Return the arrays of an annotated NamedTuple that have one row a pedestrian, by name."""
    kind: Any = type(fields)
    known = _arrays_of(kind)
    return {name: getattr(fields, name) for name, (_, shape, _) in known.items() if shape[0] == "P"}


def allocate(kind: type[Arrays], sizes: Sizes, uses: Collection[str] | None = None, **given: Any) -> Arrays:
    """Return a NamedTuple of zeros and ``given`` arrays; optional arrays not in ``uses`` are empty (None = all are used)."""
    for name, (number, letters, needs) in _arrays_of(kind).items():
        if name not in given:
            shape = [sizes[one] if one.isalpha() else int(one) for one in letters]
            if uses is not None and needs and needs not in uses:
                shape[0] = 0
            given[name] = np.zeros(shape, dtype=number)
    return kind(**given)
