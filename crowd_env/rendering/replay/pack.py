"""Numbers as text in a page: one array behind the other, gzip, base64; the browser unpacks both (browser/decode.js)."""

import base64
import gzip
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints

_LARGEST = 2**15 - 1


class Column(NamedTuple):
    """Numbers (L,) to be packed: whole ones as they are, others as float32, or (those of samples) in steps.

    Steps are differences from number to number in 16 bits: of somebody who walks steadily they are small and much alike.
    """

    name: str
    values: Floats | Ints
    step: float | None = None  # what they are rounded to; coarser if 16 bits would not do


def pack(columns: Sequence[Column]) -> tuple[list[dict[str, Any]], str]:
    """Return what each column is (name, length, kind, step), and the text of all.

    Raises
    ------
    ValueError
        If a number is not finite.
    """
    about, parts = [], []
    for name, values, step in columns:
        if not np.isfinite(values).all():
            raise ValueError(f"{name} of a recording has a value that is not finite")
        kind = "steps" if step else "whole" if values.dtype.kind in "iu" else "real"
        if step:
            step = max(step, float(np.abs(values).max(initial=0.0)) / _LARGEST)
            values = np.diff(np.rint(values / step).astype("<i2"), prepend=np.int16(0))
        about.append({"name": name, "length": len(values), "kind": kind, "step": step})
        parts.append(values.astype({"steps": "<i2", "whole": "<i4", "real": "<f4"}[kind]).tobytes())
    packed = gzip.compress(b"".join(parts), compresslevel=9, mtime=0)
    return about, base64.b64encode(packed).decode("ascii")
