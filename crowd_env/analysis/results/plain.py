"""Objects as plain data that JSON can hold, to be read by people and compared with each other."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from crowd_env.core.files.fingerprint import counting_fields, fingerprint

_LONGEST = 20  # entries of an array that are written down; of longer ones their shape and fingerprint


def plain(value: Any) -> Any:
    """Return plain data for numbers, texts, arrays, mappings, sequences, and dataclasses made of these.

    A distribution names its kind, as in a scenario file; numbers that JSON does not know become texts.  Fields younger
    than files are left out as in a `fingerprint`.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, np.ndarray):
        if value.size <= _LONGEST:
            return plain(value.tolist())
        return {"shape": list(value.shape), "fingerprint": fingerprint(value)}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        kind = {"distribution": type(value).__name__.lower()} if hasattr(value, "sample") else {}
        return {**kind, **{name: plain(getattr(value, name)) for name in counting_fields(value)}}
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    return value if value is None or isinstance(value, bool | int | float | str) else str(value)
