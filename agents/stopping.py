"""How a program is asked to stop: Ctrl-C, and the signal that service managers and job queues send, are one thing."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


def _interrupt(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


@contextmanager
def stops_by(handler: Callable[[int, FrameType | None], Any] = _interrupt) -> Iterator[None]:
    """Let SIGINT and SIGTERM call ``handler``, by default raise KeyboardInterrupt, until the block ends.

    Outside of the main thread, where Python handles no signals, nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = [signal.signal(number, handler) for number in _SIGNALS]
    try:
        yield
    finally:
        for number, old in zip(_SIGNALS, before, strict=True):
            signal.signal(number, old)
