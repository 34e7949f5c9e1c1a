"""Other programs, in the same scenes and in turn with ours; each by its public interface, imported only when asked for.

Install them apart from the rest: ``pip install -e '.[train,bench]' -c constraints.txt`` in an environment of its own.
"""

from collections.abc import Sequence

from benchmarks.measuring import Contender, Effort
from benchmarks.scenes import Scene


def rivals(case: str, scene: Scene, effort: Effort) -> Sequence[Contender]:
    """Return the other programs that take part in a case, none unless asked for."""
    return []


def batch_rivals(rooms: int, people: int, effort: Effort) -> Sequence[Contender]:
    """Return other batch environments, none unless asked for."""
    return []
