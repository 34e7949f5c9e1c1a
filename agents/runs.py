"""Folders of training runs: every file is written whole or not at all."""

import json
import os
import platform
from importlib import metadata
from pathlib import Path
from typing import Any

_PACKAGES = ("crowd-env", "gymnasium", "numba", "numpy", "pettingzoo", "scikit-fmm", "stable-baselines3", "torch")


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically."""
    part = path.with_name(f".{path.name}.part")
    part.write_text(text, encoding="utf-8")
    os.replace(part, path)


def write_json(path: Path, content: Any) -> None:
    """Write a JSON file atomically."""
    write_text(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def read_json(path: Path) -> Any:
    """Read a JSON file.

    Raises
    ------
    ValueError
        If it is missing or not JSON.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, json.JSONDecodeError) as error:
        raise ValueError(f"cannot read {path}: {error}") from None


def new_folder(root: Path, name: str) -> Path:
    """Make and return ``root/name``, or ``root/name-2`` and so on if that is taken: no run overwrites another."""
    number, folder = 1, root / name
    while folder.exists():
        number += 1
        folder = root / f"{name}-{number}"
    folder.mkdir(parents=True)
    return folder


def versions() -> dict[str, str]:
    """Return the versions of everything that can change a result."""
    found = {"python": platform.python_version(), "machine": platform.machine()}
    for package in _PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found
