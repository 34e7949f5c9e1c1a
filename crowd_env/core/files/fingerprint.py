"""One short text for everything that a description holds: equal for equal ones, another for any other."""

import dataclasses
import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np

UNSAID = "unsaid"


def fingerprint(*parts: Any) -> str:
    """Return a hash of data: numbers, texts, arrays, shapes, mappings, sequences, and objects made of these.

    An object counts by its class and its fields (of a dataclass; of others all attributes), never by where it lies in memory.
    A field does not count while it has the value `UNSAID` in its metadata: it is younger than files that hold a hash.
    """
    digest = hashlib.sha256()
    for part in parts:
        _add(digest, part)
    return digest.hexdigest()[:16]


def _add(digest: Any, value: Any) -> None:
    """Add a value, with its kind and length before it, so that no two values are spelt alike."""
    if isinstance(value, np.ndarray):
        _spell(digest, f"array {value.dtype.str} {value.shape}", np.ascontiguousarray(value).tobytes())
    elif value is None or isinstance(value, bool | int | float | str | bytes | np.generic):
        _spell(digest, type(value).__name__, repr(value).encode())
    elif hasattr(value, "wkb"):  # a shape
        _spell(digest, "shape", value.wkb)
    elif isinstance(value, Mapping):
        _spell(digest, f"mapping {len(value)}", b"")
        for key in sorted(value, key=repr):
            _add(digest, key)
            _add(digest, value[key])
    elif isinstance(value, list | tuple | set | frozenset):
        _spell(digest, f"{type(value).__name__} {len(value)}", b"")
        for one in sorted(value, key=repr) if isinstance(value, set | frozenset) else value:
            _add(digest, one)
    else:
        names = counting_fields(value) if dataclasses.is_dataclass(value) else vars(value)
        _spell(digest, f"object {type(value).__module__}.{type(value).__qualname__}", b"")
        _add(digest, {name: getattr(value, name) for name in names})


def counting_fields(value: Any) -> list[str]:
    """Return the names of the fields of a dataclass that count in its `fingerprint`."""
    every = [(field.name, field.metadata) for field in dataclasses.fields(value)]
    return [name for name, noted in every if UNSAID not in noted or getattr(value, name) != noted[UNSAID]]


def _spell(digest: Any, kind: str, content: bytes) -> None:
    digest.update(f"{kind} {len(content)}\0".encode() + content)
