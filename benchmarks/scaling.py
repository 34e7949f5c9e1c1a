"""How cost grows with the crowd and falls with threads.

CPU time of a person-step in the jam against the number of people, with the exponent that a line through the logarithms fits:
1 would be a cost that grows as the number of people, 2 as that of their pairs.  And the speed on the clock with more threads
over that with one, of a batch of rooms and of one crowd; whoever shares the machine takes part of it away.
"""

import os

import numpy as np

from benchmarks.batch import Rooms
from benchmarks.crowds import Crowd
from benchmarks.measuring import Effort, Row, Sample, in_turn, significant
from benchmarks.scenes import jam

SIZES = (1_000, 3_000, 10_000, 30_000, 100_000)
_PAIRS = (("dem", 0.001), ("nsm1", 0.01), ("nsm2", 0.01), ("hertz", 0.001))
_HORIZON = 0.1  # s    the same phase of the jam for all sizes
_THREAD_CROWD = 100_000


def rows(effort: Effort) -> list[Row]:
    """Return the figures of every scheme, size and number of threads."""
    return against_people(effort) + against_threads(effort)


def against_people(effort: Effort) -> list[Row]:
    """Return CPU time per person-step against the number of people, and the exponent of the whole step.

    A crowd whose settling was cut short is in another phase: it is shown, but left out of the exponent.
    """
    found: list[Row] = []
    fitted: dict[str, list[tuple[int, float]]] = {}
    for count in effort.sizes(SIZES):
        effort.tell(f"{count} people")
        scene = jam(count)._replace(horizon=_HORIZON)
        field = scene.scenario.field()
        crowds = [Crowd(scene, scheme, dt, effort, field) for scheme, dt in _PAIRS]
        for crowd, sample in zip(crowds, in_turn(crowds, effort), strict=True):
            cost, name = sample.cpu / sample.steps, f"{crowd.name}, {count} people"
            found.append(Row(f"{name}: a person-step", significant(1e9 * cost, 3), "CPU ns"))
            points = fitted.setdefault(crowd.name, [])
            if crowd.settled >= 0.999 * scene.settle:
                points.append((count, cost))
            else:
                found.append(Row(f"{name}: settled for", significant(crowd.settled, 3), "s"))
    found.sort(key=lambda row: [f"{scheme} {dt:g} s" for scheme, dt in _PAIRS].index(row.what.partition(",")[0]))
    for name, points in fitted.items():
        if len(points) > 1:
            people, logs = np.log(np.array(points).T)
            found.append(Row(f"{name}: exponent", significant(1.0 + np.polyfit(people, logs, 1)[0], 3), "of people"))
    return found


def against_threads(effort: Effort, rooms: int = 256, settle: int = 50) -> list[Row]:
    """Return speed and CPU time with 2, 4 ... threads over those with one thread."""
    most = max(2, os.cpu_count() or 1)
    counts = [threads for threads in (1, 2, 4, 8, 16, 32) if threads <= most]
    scene = jam(min(_THREAD_CROWD, effort.max_people))
    field = scene.scenario.field()
    groups: dict[str, list[Rooms] | list[Crowd]] = {
        f"dem, {rooms} x 20": [Rooms("dem", rooms, 20, settle, effort, threads) for threads in counts],
    }
    for dt in (0.001, 0.01):
        crowds = [Crowd(scene, "dem", dt, effort, field, threads) for threads in counts]
        groups[f"dem {dt:g} s, {scene.people} people"] = crowds
    found: list[Row] = []
    for name, contenders in groups.items():
        effort.tell(f"{name}: threads")
        samples: list[Sample] = in_turn(contenders, effort)
        alone = samples[0]
        for threads, sample in zip(counts, samples, strict=True):
            speed = (sample.steps / sample.clock) / (alone.steps / alone.clock)
            found.append(Row(f"{name}, {threads} threads: speed on the clock", significant(speed, 3), "of one thread"))
            if "people" in name:
                pace = significant(sample.simulated / sample.clock, 3)
                found.append(Row(f"{name}, {threads} threads: simulated", pace, "s per s on the clock"))
            found.append(
                Row(f"{name}, {threads} threads: CPU time", significant(alone.rate / sample.rate, 3), "of one thread")
            )
    return found
