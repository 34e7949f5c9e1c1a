"""What a run must offer to be computed side by side with others, kept in a folder and shared by figures."""

from collections.abc import Callable
from typing import Any, Protocol, TypeVar

Record = TypeVar("Record")
AnyRun = TypeVar("AnyRun", bound="Run[Any]")


class Run(Protocol[Record]):
    """All that decides one simulation: hashable, picklable, and equal to a run that has the same outcome.

    ``Record`` is what comes of it.
    """

    def simulate(self, stopped: Callable[[], bool] | None = None) -> Record:
        """Return what comes of the run; ``stopped`` is called now and then and says whether to give up, by any exception."""
        ...

    def merge(self: AnyRun, other: AnyRun) -> AnyRun:
        """Return this run such that its record also serves an equal one, which may ask for more to be kept."""
        ...

    def smallest(self: AnyRun) -> AnyRun:
        """Return the shortest run that needs the same compiled kernels."""
        ...

    def cost(self) -> float:
        """Return roughly how long it takes, in any unit."""
        ...

    def label(self) -> str:
        """Return the beginning of the name of its file."""
        ...

    def identity(self) -> dict[str, Any]:
        """Return all that decides the record but the compiled kernels, ready for JSON."""
        ...

    def encode(self, record: Record) -> dict[str, Any]:
        """Return the record, ready for JSON."""
        ...

    def decode(self, content: dict[str, Any]) -> Record:
        """Return the record that was encoded.

        Raises
        ------
        ValueError, KeyError, TypeError
            If it cannot be a record of this run, or lacks something that this run asks for.
        """
        ...
