"""Arrays with the facts about them in one ``.npz`` file: numbers and text alone, so that opening one runs nobody's code."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from crowd_env.core.files.atomic import written

_FACTS = "facts"  # the member that holds a JSON object as text


def write_arrays(path: Path, arrays: Mapping[str, np.ndarray], facts: Mapping[str, Any]) -> None:
    """Write named arrays and a JSON object of facts, whole or not at all."""
    members: dict[str, Any] = {_FACTS: np.array(json.dumps(facts, allow_nan=False)), **arrays}
    with written(path) as part:
        np.savez_compressed(part, **members)


def read_arrays(path: Path) -> tuple[dict[str, np.ndarray], Any]:
    """Return the arrays of a file and the facts about them; nothing in the file is executed, whatever it holds.

    A damaged file fails in many ways (zip, header of an array, JSON), and each has an exception of its own.
    """
    with np.load(path, allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    return arrays, json.loads(str(arrays.pop(_FACTS)))
