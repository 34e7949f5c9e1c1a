"""How cost grows with the crowd and falls with threads.

CPU time of a person-step in the jam against the number of people, with the exponent of the whole step that a line through the
logarithms fits: 1 is a cost that grows as the number of people, 2 as that of their pairs.  And the speed on the clock with more
threads over that with one, of a batch of rooms and of one crowd; beside it that of as many processes, each with a share of the
work: what the machine gives without waiting.
"""

import multiprocessing
import os
from collections.abc import Callable

import numpy as np

from benchmarks.batch import Rooms
from benchmarks.crowds import Crowd, Way
from benchmarks.measuring import Contender, Effort, Row, Sample, in_turn
from benchmarks.scenes import jam

SIZES = (1_000, 3_000, 10_000, 30_000, 100_000)
WAYS = (Way("dem", 0.001), Way("nsm1", 0.01), Way("nsm2", 0.01), Way("hertz", 0.001))
_PART = 0.1  # s    of CPU time that processes go on for without waiting for each other


def rows(effort: Effort) -> list[Row]:
    """Return the figures of every scheme, size and number of threads."""
    return against_people(effort) + against_threads(effort)


def against_people(effort: Effort) -> list[Row]:
    """Return CPU time per person-step against the number of people, in the same phase of the jam, and the exponent."""
    found: list[Row] = []
    points: dict[str, list[tuple[int, float]]] = {}
    for count in effort.sizes(SIZES):
        scene = jam(count)._replace(horizon=0.1)
        field = scene.scenario.field()
        crowds = [Crowd(scene, way, field) for way in WAYS]
        for crowd, sample in zip(crowds, in_turn(crowds, effort), strict=True):
            points.setdefault(crowd.name, []).append((count, sample.cpu / sample.steps))
            found.append(Row(f"{crowd.name}, {count} people", "a person-step, CPU ns", 1e9 * sample.cpu / sample.steps))
    for name, some in points.items():
        if len(some) > 1:
            people, cost = np.log(np.array(some).T)
            found.append(Row(name, "exponent", 1.0 + float(np.polyfit(people, cost, 1)[0])))
    return found


def against_threads(effort: Effort, rooms: int = 256, people: int = 20_000) -> list[Row]:
    """Return speed and CPU time with 2, 4 ... threads, and with as many processes, over those with one thread."""
    counts = [threads for threads in (1, 2, 4, 8, 16, 32) if threads <= max(2, os.cpu_count() or 1)]
    people = min(people, effort.max_people)
    crowds = Way("dem", 0.01), Way("dem", 0.001)  # one thread moves a crowd under the other schemes
    work: dict[str, tuple[Callable[..., Contender], str | Way, int]] = {
        **{f"{scheme}, {rooms} x 20": (_rooms, scheme, rooms) for scheme in ("dem", "nsm2", "hertz")},
        **{f"{way.scheme} {way.dt:g} s, {people} people": (_crowd, way, people) for way in crowds},
    }
    found: list[Row] = []
    for name, (make, what, size) in work.items():
        apart = [Processes(count, make, what, max(1, size // count)) for count in counts[1:]]
        samples: list[Sample] = in_turn([*(make(what, size, threads) for threads in counts), *apart], effort)
        names = [
            *(f"{count} threads" for count in counts),
            *(f"{one.count} processes with a share each" for one in apart),
        ]
        for who, sample in zip(names, samples, strict=True):
            speed = (sample.steps / sample.clock) / (samples[0].steps / samples[0].clock)
            found.append(Row(f"{name}, {who}", "speed on the clock, of one thread", speed))
            found.append(Row(f"{name}, {who}", "CPU time, of one thread", samples[0].rate / sample.rate))
        for one in apart:
            one.end()
    return found


def _rooms(scheme: str, rooms: int, threads: int = 1) -> Rooms:
    return Rooms(scheme, rooms, 20, threads=threads)


def _crowd(way: Way, people: int, threads: int = 1) -> Crowd:
    scene = jam(people)
    return Crowd(scene, way, scene.scenario.field(), threads)


class Processes(Contender):
    """So many processes side by side, each with a contender of its own, which ``make`` makes of ``arguments``."""

    def __init__(self, count: int, make: Callable[..., Contender], *arguments: object) -> None:
        self.name, self.count = f"{count} processes", count
        pool = multiprocessing.get_context("spawn").Pool
        self._pools = [pool(1, _begin, (make, *arguments)) for _ in range(count)]

    def once(self) -> Sample:
        """Go on for a part of a block in all processes at the same time."""
        parts = [pool.apply_async(_go_on) for pool in self._pools]
        cpu, clock, simulated, steps = zip(*(part.get() for part in parts), strict=True)
        return Sample(sum(cpu), sum(clock) / self.count, max(simulated), sum(steps))

    def end(self) -> None:
        """Stop the processes."""
        for pool in self._pools:
            pool.terminate()


_mine: list[Contender] = []  # of this process


def _begin(make: Callable[..., Contender], *arguments: object) -> None:
    _mine[:] = [make(*arguments)]


def _go_on() -> Sample:
    return _mine[0].block(Effort(_PART))
