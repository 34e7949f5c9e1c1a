"""What other crowd programs have in common here: runs of a scene, put back at its end, cut short when they take too long."""

from abc import abstractmethod

import numpy as np

from benchmarks.measuring import Contender, Sample, timed
from benchmarks.peers import named, say
from benchmarks.scenes import Floats, Scene, chosen
from crowd_env import Bodies

DT = 0.01  # s


class PeerCrowd(Contender):
    """A scene in another program."""

    is_peer = True

    def __init__(self, name: str, package: str, scene: Scene) -> None:
        self.name, self.whole, self._scene = f"{named(package)} {name} {DT:g} s", scene.horizon, scene
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
        """Return the numbers (K,) of the people inside and their positions (K, 2) [m]."""

    def now(self) -> tuple[Bodies, Floats]:
        """Return the bodies of the people inside and their positions (K, 2) [m]."""
        numbers, position = self._people()
        inside = np.zeros(self._scene.people, dtype=bool)
        inside[numbers] = True
        return chosen(self._scene.bodies, inside), position[np.argsort(numbers)]

    def _start(self) -> None:
        self.failed, self._left = False, round((self._scene.settle + self.whole) / DT)
        self._build()
        while self._left > round(self.whole / DT):
            self._one()

    def _one(self) -> None:
        """Make a step, unless the program gives up."""
        self._left -= 1
        try:
            self._step()
        except RuntimeError as error:
            self.failed, self._left = True, min(self._left, 0)
            say(f"{self.name}, {self._scene.people} people: stopped: {str(error)[:90]}")

    def once(self) -> Sample:
        """Make a step, of a new run where the last is over."""
        if self._left <= 0 or not self.inside:
            self._start()
        people = self.inside
        return Sample(*timed(self._one), DT, people)
