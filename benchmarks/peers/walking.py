"""What other crowd programs have in common here: runs of a scene, put back at its end, cut short when they take too long."""

import contextlib
import signal
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from types import FrameType

import numpy as np

from benchmarks.measuring import Effort, Sample
from benchmarks.peers import named, quiet, say
from benchmarks.scenes import Depths, Floats, Scene, chosen
from crowd_env import Bodies

DT = 0.01  # s


class PeerCrowd(ABC):
    """A scene in another program."""

    def __init__(self, name: str, package: str, scene: Scene, effort: Effort) -> None:
        self.name = f"{package} {name} {DT:g} s"
        self.peer = named(package)
        self.whole = scene.horizon
        self.failed_at: float | None = None  # s
        self._scene, self._effort = scene, effort
        self.depths = Depths(scene)
        self._time = 0.0
        self._begin = 0.0
        self._start()

    @abstractmethod
    def _build(self) -> None:
        """Put everyone where the scene begins."""

    @abstractmethod
    def _step(self) -> None:
        """Advance by `DT`."""

    @property
    @abstractmethod
    def inside(self) -> int:
        """Number of people inside."""

    @abstractmethod
    def _people(self) -> tuple[np.ndarray, Floats]:
        """Return the numbers (K,) of those who are inside and where they are (K, 2)."""

    def now(self) -> tuple[Bodies, Floats]:
        """Return those who are inside and where."""
        numbers, position = self._people()
        who = np.zeros(self._scene.people, dtype=np.bool_)
        who[numbers] = True
        return chosen(self._scene.bodies, who), position[np.argsort(numbers)]

    def _start(self) -> None:
        clock = time.perf_counter()
        self._time = 0.0
        with quiet():
            self._build()
            while self._time < self._scene.settle - 1e-9 and time.perf_counter() - clock < self._effort.peer_seconds:
                self._one()
        self._begin = self._time

    def _one(self) -> bool:
        """Make a step; False if the program gave up."""
        try:
            self._step()
        except RuntimeError as error:
            self.failed_at = self._time
            say(f"{self.name}, {self._scene.people} people: stopped at {self._time:.2f} s: {str(error)[:90]}")
            return False
        self._time += DT
        return True

    def block(self, effort: Effort) -> Sample:
        """Make whole runs of ``effort.seconds`` of CPU time or more, or as much as ``effort.peer_seconds`` allow."""
        sums = Sample(0.0, 0.0, 0.0, 0.0)
        failed = False
        while sums.clock < effort.peer_seconds and (sums.cpu < effort.seconds or sums.simulated < self.whole - 1e-9):
            if failed or self._time >= self._begin + self.whole - 1e-9 or not self.inside:
                if failed and sums.cpu >= effort.seconds:
                    break
                self._start()
            steps, people = 0, 0
            clock, begin = time.perf_counter(), time.process_time()
            with quiet():
                while steps < 10 and self.inside and not failed:
                    people += self.inside
                    failed = not self._one()
                    steps += not failed
            now = Sample(time.process_time() - begin, time.perf_counter() - clock, DT * steps, float(people))
            sums = Sample(*(a + b for a, b in zip(sums, now, strict=True)))
            self.depths.look(self._time - self._begin, self.now)
        return sums


@contextlib.contextmanager
def limit(seconds: float, what: str) -> Iterator[None]:
    """Raise TimeoutError if what is inside takes longer on the clock; does nothing where signals do not work."""
    if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def late(number: int, frame: FrameType | None) -> None:
        raise TimeoutError(f"{what} took longer than {seconds:g} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
