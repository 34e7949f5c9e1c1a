"""Many runs side by side: every run once, the longest first, each kept as soon as it is finished."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

from crowd_env.reproduce.result import Progress
from crowd_env.reproduce.run import AnyRun, Record, Run
from crowd_env.reproduce.store import Store


class Interrupted(Exception):
    """The user stopped the work; finished runs are kept."""


def distinct(runs: Iterable[AnyRun]) -> list[AnyRun]:
    """Return every run once, such that its record serves all that are equal to it."""
    found: dict[AnyRun, AnyRun] = {}
    for run in runs:
        found[run] = found[run].merge(run) if run in found else run
    return list(found.values())


def all_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def complete(
    runs: Iterable[Run[Record]], store: Store, *, workers: int = 1, fresh: bool = False, progress: Progress
) -> dict[Run[Record], Record]:
    """Return the record of every run, from the store or computed now.

    Parameters
    ----------
    workers : number of processes; the records do not depend on it.
    fresh : compute all of them, whatever is in the store.
    progress : called with the number of runs just done; in all, the number of distinct runs.

    Raises
    ------
    Interrupted
        On Ctrl-C, in one sentence; the runs finished by then are in the store.
    ValueError
        If a file cannot be written or a process has died.
    FloatingPointError
        If a position is no longer finite.
    """
    wanted = distinct(runs)
    records: dict[Run[Record], Record] = {}
    try:
        for run in wanted:
            record = None if fresh else store.load(run)
            if record is not None:
                records[run] = record
                progress(1)
        todo = sorted((run for run in wanted if run not in records), key=lambda run: run.cost(), reverse=True)
        for run, record in _computed(todo, store, min(workers, len(todo))):
            records[run] = record
            progress(1)
    except KeyboardInterrupt:
        raise Interrupted(_kept(wanted, store)) from None
    except OSError as error:
        raise ValueError(f"cannot keep the runs in {store.folder}: {error}") from None
    except BrokenProcessPool:
        raise ValueError(
            f"a process that computed runs has died (too little memory?): {_kept(wanted, store)}"
        ) from None
    return records


def _kept(wanted: Sequence[Run[Any]], store: Store) -> str:
    kept = sum(store.load(run) is not None for run in wanted)
    return (
        f"{kept} of {len(wanted)} runs are kept in {store.folder}; without --fresh, the same command goes on from there"
    )


def _computed(todo: Sequence[Run[Record]], store: Store, workers: int) -> Iterator[tuple[Run[Record], Record]]:
    """Yield runs with their records as they are finished and kept."""
    if workers <= 1:
        for run in todo:
            record = run.simulate()
            store.keep(run, record)
            yield run, record
        return
    # Compile here, once: processes that start together would each compile for themselves.
    todo[0].smallest().simulate()
    context = multiprocessing.get_context("spawn")
    stop = context.Event()
    pool = ProcessPoolExecutor(workers, context, _begin, (stop,))
    try:
        with _interrupts_blocked():
            started = {pool.submit(_complete, run, store.folder): run for run in todo}
        for future in as_completed(started):
            yield started[future], future.result()
    finally:
        stop.set()  # those under way end within a simulated second
        pool.shutdown(wait=True, cancel_futures=True)


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
    """Prepare a process: it leaves Ctrl-C to its parent, and ends with it however that ends."""
    global _stop
    _stop = stop
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_follow_parent, daemon=True).start()


def _follow_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _complete(run: Run[Record], folder: Path) -> Record:
    assert _stop is not None
    record = run.simulate(_stop.is_set)
    Store(folder).keep(run, record)
    return record
