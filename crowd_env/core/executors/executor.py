"""What does pieces of work that do not depend on each other: one after the other here, or in processes beside this one."""

import multiprocessing
import os
import signal
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.synchronize import Event
from typing import Any, Protocol, TypeVar

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

    def close(self) -> None:
        """Let go of what the executor has started."""


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


def all_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Processes:
    """Does pieces in processes of this machine, which end with this one however that ends.

    Parameters
    ----------
    workers : number of processes; never more are started than there are pieces.
    """

    apart = True

    def __init__(self, workers: int | None = None) -> None:
        self.workers = all_cores() if workers is None else workers

    def run(self, work: Work[Piece, Outcome], pieces: Sequence[Piece], done: Done[Outcome]) -> None:
        """Do the pieces; those under way end when they next ask whether to give up, if one fails or at Ctrl-C.

        Raises
        ------
        WorkerDied
            If a process has died: too little memory is the likely reason, and there would be no more next time.
        """
        if not pieces:
            return
        context = multiprocessing.get_context("spawn")
        stop = context.Event()
        pool = ProcessPoolExecutor(min(self.workers, len(pieces)), context, _begin, (stop,))
        started: dict[Future[Any], int] = {}
        try:
            with _interrupts_blocked():
                for k, piece in enumerate(pieces):
                    started[pool.submit(_do, work, piece)] = k
            for future in as_completed(list(started)):
                done(started[future], future.result())
                del started[future]
        except BrokenProcessPool:
            raise WorkerDied("a process that computed runs has died (too little memory?)") from None
        finally:
            stop.set()
            pool.shutdown(wait=True, cancel_futures=True)
            for future, k in started.items():
                if future.done() and not future.cancelled() and future.exception() is None:
                    done(k, future.result())

    def close(self) -> None:
        """Nothing to let go of: the processes ended with their last piece."""


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Let processes that start here inherit that Ctrl-C is not for them; what comes meanwhile reaches us afterwards."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


# ------------------------------------------------------------------------------------------- in the other processes

_stop: Event | None = None


def _begin(stop: Event) -> None:
    """Prepare a process: it leaves Ctrl-C to its parent, and ends with it however that ends.

    What is to be noted of the work, its parent has noted: here it would come once a process, without its style.
    """
    global _stop
    _stop = stop
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    warnings.simplefilter("ignore", UserWarning)
    threading.Thread(target=_follow_parent, daemon=True).start()


def _follow_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _do(work: Work[Piece, Outcome], piece: Piece) -> Outcome:
    assert _stop is not None
    return work(piece, _stop.is_set)
