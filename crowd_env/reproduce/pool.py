"""Many runs side by side: every run once, the longest first, each kept as soon as it is finished."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from crowd_env.core.executors import Executor, Serial, WorkerDied
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


def complete(
    runs: Iterable[Run[Record]],
    store: Store,
    *,
    executor: Executor | None = None,
    fresh: bool = False,
    progress: Progress,
) -> dict[Run[Record], Record]:
    """Return the record of every run, from the store or computed now.

    Parameters
    ----------
    executor : what computes the runs, by default one after the other here; the records do not depend on it.
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
    executor = executor or Serial()
    wanted = distinct(runs)
    records: dict[Run[Record], Record] = {}
    try:
        for run in wanted:
            record = None if fresh else store.load(run)
            if record is not None:
                records[run] = record
                progress(1)
        todo = sorted((run for run in wanted if run not in records), key=lambda run: run.cost(), reverse=True)

        def done(k: int, record: Record) -> None:
            store.keep(todo[k], record)
            records[todo[k]] = record
            progress(1)

        if executor.apart and todo:
            todo[0].smallest().simulate()  # compile here, once: processes that start together would each do it
        executor.run(_simulate, todo, done)
    except KeyboardInterrupt:
        raise Interrupted(_kept(wanted, store)) from None
    except OSError as error:
        raise ValueError(f"cannot keep the runs in {store.folder}: {error}") from None
    except WorkerDied as error:
        raise ValueError(f"{error}: {_kept(wanted, store)}") from None
    return records


def _simulate(run: Run[Record], stopped: Callable[[], bool]) -> Record:
    return run.simulate(stopped)


def _kept(wanted: Sequence[Run[Any]], store: Store) -> str:
    kept = sum(store.load(run) is not None for run in wanted)
    return (
        f"{kept} of {len(wanted)} runs are kept in {store.folder}; without --fresh, the same command goes on from there"
    )
