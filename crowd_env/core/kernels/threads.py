"""Threads that work side by side, and end together: no thread outlives the call, whatever happens."""

import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

_MOST_FAILURES = 100


class Workers:
    """Runs the parts of a piece of work at the same time.

    Threads are started when they are first needed, and kept.  A copy, a pickle or a forked process starts its own.
    """

    def __init__(self) -> None:
        self._pool: ThreadPoolExecutor | None = None
        self._threads = 0
        self._process = 0

    def __reduce__(self) -> tuple[Any, ...]:
        return Workers, ()

    def run(self, work: Callable[..., object], parts: Sequence[tuple[Any, ...]]) -> None:
        """Call ``work(*part)`` for all parts, each on a thread of its own; return or raise when all have ended.

        Parts may wait for each other.  An exception in the calling thread (Ctrl-C comes at any place) is raised when all
        parts have been begun and have ended, one of a part when the others have ended too.
        """
        if len(parts) == 1:
            work(*parts[0])
            return
        pool = self._ready(len(parts))
        left, errors, done = list(parts), list[BaseException | None](), threading.Event()

        def take_one() -> None:
            try:
                part = left.pop()
            except IndexError:  # asked for once too often, when a request was interrupted
                return
            error = None
            try:
                work(*part)
            except BaseException as caught:
                error = caught
            errors.append(error)
            if len(errors) == len(parts):
                done.set()

        requests, failures, interrupt = 0, 0, None
        while True:
            try:
                while requests < len(parts):
                    pool.submit(take_one)
                    requests += 1
                done.wait()
                break
            except BaseException as caught:
                interrupt, failures = interrupt or caught, failures + 1
                if failures > _MOST_FAILURES:  # the interpreter shuts down: nothing can be begun any more
                    raise
        for error in (interrupt, *errors):
            if error is not None:
                raise error

    def _ready(self, threads: int) -> ThreadPoolExecutor:
        """Return a pool with ``threads`` running threads: parts that wait for each other must not wait for one to start."""
        if self._pool is None or self._threads < threads or self._process != os.getpid():
            pool, all_here = ThreadPoolExecutor(threads), threading.Barrier(threads + 1)
            try:
                for _ in range(threads):
                    pool.submit(all_here.wait)
                all_here.wait()
            except BaseException:
                all_here.abort()
                raise
            self._pool, self._threads, self._process = pool, threads, os.getpid()
        return self._pool
