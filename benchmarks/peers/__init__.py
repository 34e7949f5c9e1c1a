"""Other programs, in the same scenes and in turn with ours; each by its public interface, imported only when asked for.

They bring many packages: install them with ``pip install -e '.[train,bench]' -c constraints.txt`` in an environment of its own.
"""

import importlib
import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from benchmarks.measuring import Effort, quiet
from benchmarks.scenes import Scene

INSTALL = "pip install -e '.[train,bench]' -c constraints.txt, in an environment of its own"

# Case -> package, which is a module of this folder too, and the largest crowd that it is asked for.
CROWDS = {
    "room20": (("jupedsim", 20), ("cromosim", 20)),
    "big": (("jupedsim", 300), ("cromosim", 300)),
    "hall": (("jupedsim", 20_000), ("cromosim", 20_000)),
    "jam": (("pymunk", 10_000), ("cromosim", 10_000)),
}
BATCHES = ("vmas", "magent2", "mpe2")


def rivals(case: str, scene: Scene, effort: Effort) -> list[Any]:
    """Return the other programs that take part in a case, none unless asked for."""
    found: list[Any] = []
    for package, most in CROWDS.get(case, ()) if effort.peers else ():
        if scene.people <= most and installed(package):
            with quiet():
                found += importlib.import_module(f"benchmarks.peers.{package}").crowds(scene, effort)
    return found


def batch_rivals(rooms: int, people: int, effort: Effort) -> list[Any]:
    """Return other batch environments, none unless asked for."""
    found: list[Any] = []
    for package in BATCHES if effort.peers else ():
        makers = importlib.import_module("benchmarks.peers.batches").BATCHES[package] if installed(package) else None
        for make in makers(rooms, people) if makers else ():
            try:
                with quiet():
                    found.append(make())
            except (RuntimeError, ValueError) as error:
                say(f"a peer is left out: {error}")
    return found


@cache
def installed(package: str) -> bool:
    """Return whether a package is there; say once how to get it if not."""
    try:
        with quiet():  # pygame greets
            importlib.import_module(package)
    except ImportError as error:
        why = "is not installed" if getattr(error, "name", None) == package else f"cannot be imported ({error})"
        say(f"{package} {why} and is left out: {INSTALL}")
        return False
    return True


def named(package: str) -> str:
    """Return name and version of a package."""
    try:
        return f"{package} {version(package)}"
    except PackageNotFoundError:
        return package


@cache
def say(line: str) -> None:
    """Print a line to stderr, once."""
    print(line, file=sys.stderr, flush=True)
