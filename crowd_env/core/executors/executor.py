"""What does pieces of work that do not depend on each other, and the simplest that does: one after the other, here."""

from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

Piece = TypeVar("Piece")
Outcome = TypeVar("Outcome")
Stopped = Callable[[], bool]  # called now and then by a piece under way: whether to give up, by any exception
Work = Callable[[Piece, Stopped], Outcome]
Done = Callable[[int, Outcome], None]  # called with the number of a piece and its outcome


class WorkerDied(Exception):
    """A process that worked on a piece has died, and so it will again; the sentence says what is known."""


class Executor(Protocol):
    """Does pieces of work in any order and hands over each outcome as soon as it is there.

    Attributes
    ----------
    workers : about how many pieces are worked on at a time.
    apart : whether other processes do the work: pieces, outcomes and the work itself then travel as pickles, and what is
        compiled here first need not be compiled by each of them.
    """

    workers: int
    apart: bool

    def run(self, work: Work[Piece, Outcome], pieces: Sequence[Piece], done: Done[Outcome]) -> None:
        """Call ``done(k, work(pieces[k], stopped))`` for every piece, here, one outcome at a time.

        Pieces are begun in their order.  However it ends, every outcome that was there by then has been handed over, and
        nothing is worked on any more.

        Raises
        ------
        WorkerDied
            If a process has died and the piece is not tried again.
        Exception
            What a piece or ``done`` raises, Ctrl-C included; all that is under way is given up.
        """
        ...

    def close(self) -> None:
        """Let go of what the executor has started."""
        ...


class Serial:
    """Does the pieces one after the other in this process."""

    workers = 1
    apart = False

    def run(self, work: Work[Piece, Outcome], pieces: Sequence[Piece], done: Done[Outcome]) -> None:
        """Call ``done(k, work(pieces[k], stopped))`` for every piece; nothing here asks a piece to give up."""
        for k, piece in enumerate(pieces):
            done(k, work(piece, never))

    def close(self) -> None:
        """Nothing to let go of."""


def never() -> bool:
    """Return False: nothing asks a piece to give up."""
    return False
