"""Plain data, as JSON and TOML hold it."""

from collections.abc import Mapping
from typing import Any, TypeAlias

Plain: TypeAlias = Mapping[str, Any]
