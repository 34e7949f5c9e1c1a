"""JSON files, written whole or not at all."""

import json
import math
from pathlib import Path
from typing import Any

from crowd_env.core.files.atomic import write_text
from crowd_env.core.files.foreign import require_file


def json_number(value: float) -> float | int | None:
    """Return a number as JSON can hold it: None for nan and infinite numbers, which JSON does not know."""
    if isinstance(value, int):
        return value
    return float(value) if math.isfinite(value) else None


def write_json(path: Path, content: Any) -> None:
    """Write a JSON file, whole or not at all.

    Raises
    ------
    ValueError
        If the content holds nan or an infinite number, which JSON does not know.
    """
    write_text(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def read_json(path: Path) -> Any:
    """Return the content of a JSON file.

    Raises
    ------
    ValueError
        If the file is missing or is not JSON.
    """
    require_file(path)
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:  # of the encoding, of JSON, of its depth
        raise ValueError(f"cannot read {path}: {error}") from None
