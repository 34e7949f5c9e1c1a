"""Other programs, in the same scenes and in turn with ours; each by its public interface, imported only when asked for.

Install them apart from the rest, ``pip install -e '.[train,bench]' -c constraints.txt`` in an environment of its own: some of
them bring pygame-ce, which overwrites the pygame of the extra ``render``.
"""

import contextlib
import importlib
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version

from benchmarks.measuring import Contender, Effort
from benchmarks.scenes import Scene

INSTALL = "pip install -e '.[train,bench]' -c constraints.txt, in an environment of its own"

# Case -> package, module of this folder, and the largest crowd that it is asked for.
CROWDS = {
    "room20": (("jupedsim", "jupedsim", 20), ("cromosim", "cromosim", 20)),
    "big": (("jupedsim", "jupedsim", 300), ("cromosim", "cromosim", 300)),
    "hall": (("jupedsim", "jupedsim", 20_000), ("cromosim", "cromosim", 20_000)),
    "jam": (("pymunk", "pymunk", 10_000), ("cromosim", "cromosim", 10_000)),
}
BATCHES = ("vmas", "magent2", "mpe2")


def rivals(case: str, scene: Scene, effort: Effort) -> Sequence[Contender]:
    """Return the other programs that take part in a case, none unless asked for."""
    if not effort.peers:
        return []
    found: list[Contender] = []
    for package, module, most in CROWDS[case]:
        if scene.people <= most and installed(package):
            crowds = importlib.import_module(f"benchmarks.peers.{module}").crowds
            found += _made(crowds(scene, effort), effort)
    return found


def batch_rivals(rooms: int, people: int, effort: Effort) -> Sequence[Contender]:
    """Return other batch environments, none unless asked for."""
    if not effort.peers:
        return []
    found: list[Contender] = []
    for package in BATCHES:
        if installed(package):
            batches = importlib.import_module("benchmarks.peers.batches").BATCHES[package]
            found += _made(batches(rooms, people, effort), effort)
    return found


def _made(makers: Iterator[tuple[str, Callable[[], Contender]]], effort: Effort) -> list[Contender]:
    """Make those that can be made; say of the others why not."""
    made = []
    for name, make in makers:
        effort.tell(f"{name}: setting up")
        try:
            made.append(make())
        except (RuntimeError, ValueError, TimeoutError) as error:
            say(f"{name} is left out: {error}")
    return made


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


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep what others print off the standard output, which is ours."""
    with contextlib.redirect_stdout(sys.stderr):
        yield
