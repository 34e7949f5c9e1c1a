"""Numbers as text in a page: whole multiples of a step, as differences, their bytes side by side, gzip, base64.

A column of numbers ``v`` becomes

    w = round((v - offset) / step)             whole numbers of 32 bits
    d = differences of w, ``order`` times      each of the column and a zero before it; modulo 2^32
    z = (d << 1) ^ (d >> 31)                   small numbers of either sign are small
    all first bytes of z, all second, all third, all fourth (little end first)

Columns follow each other; gzip and base64 are over all of them.  Who walks steadily has second differences of a few
millimeters: a person takes about 4 bytes a frame before base64.
"""

import base64
import gzip
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowd_env.core.arrays.state import Floats, Ints

_LARGEST = 2**31 - 1


class Column(NamedTuple):
    """Numbers (L,) to be packed."""

    name: str
    values: Floats | Ints
    step: float = 1.0  # what they are rounded to
    order: int = 0  # how many times differences are taken
    offset: float = 0.0


def pack(columns: Sequence[Column]) -> tuple[list[dict[str, Any]], str]:
    """Return what each column is (name, length, step, order, offset) and the text of all.

    Raises
    ------
    ValueError
        If a number is not finite or too large.
    """
    about = [
        {
            "name": column.name,
            "length": len(column.values),
            "step": column.step,
            "order": column.order,
            "offset": column.offset,
        }
        for column in columns
    ]
    packed = gzip.compress(b"".join(_bytes(column) for column in columns), compresslevel=9, mtime=0)
    return about, base64.b64encode(packed).decode("ascii")


def _bytes(column: Column) -> bytes:
    scaled = (np.asarray(column.values, dtype=np.float64) - column.offset) / column.step
    if not (np.abs(scaled) <= _LARGEST).all():
        raise ValueError(
            f"{column.name} of a recording has a value that is not finite, or beyond {_LARGEST * column.step:g}"
        )
    whole: NDArray[np.uint32] = np.rint(scaled).astype(np.int64).astype(np.uint32)
    for _ in range(column.order):
        whole = np.diff(whole, prepend=np.uint32(0))
    signed = whole.view(np.int32)
    zigzag = ((signed << 1) ^ (signed >> 31)).astype(np.int32)
    return zigzag.astype("<i4").view(np.uint8).reshape(-1, 4).T.tobytes()
