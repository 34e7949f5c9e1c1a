"""Work for executors that another process can import."""

import os
import signal
import time
import warnings
from pathlib import Path

ENDLESS = 600.0  # s  far longer than any test waits


def square(number, stopped):
    """Return a square; negative numbers are refused."""
    if number < 0:
        raise ValueError(f"{number} is negative")
    return number**2


def note(text, stopped):
    """Warn of something."""
    warnings.warn(text, stacklevel=1)


def process(number, stopped):
    """Return the number of the process that works on a piece."""
    return os.getpid()


def die_at_first(marker, stopped):
    """Kill the process that works on the piece, unless the file ``marker`` says that this has happened before."""
    if marker and not Path(marker).exists():
        Path(marker).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return os.path.basename(marker)


def die(number, stopped):
    """Kill the process that works on the piece, whenever it is tried."""
    os.kill(os.getpid(), signal.SIGKILL)


def wait(folder, stopped):
    """Leave a file that says that work has begun, and go on until asked to stop; without a folder be done at once."""
    if folder:
        (Path(folder) / str(os.getpid())).touch()
        end = time.monotonic() + ENDLESS
        while time.monotonic() < end:
            if stopped():
                raise RuntimeError("given up")
            time.sleep(0.02)
    return folder
