"""The content of a JSON file that somebody else has written."""

import json
from pathlib import Path
from typing import Any

from crowd_env.core.files.foreign import read_text


def read_json_text(path: Path) -> Any:
    """Return the content of a JSON file.

    Raises
    ------
    ValueError
        If it cannot be read or is no JSON; the message says where.
    """
    text = read_text(path, "the floor plan", "a floor plan in this file must be JSON", ("JSON", "GeoJSON"))
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    except ValueError as error:
        raise ValueError(f"it is no whole JSON: {error}") from None
