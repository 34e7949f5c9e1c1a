"""How cost grows with the crowd and falls with threads.

CPU time of a person-step in the jam against the number of people, with the exponent of the whole step that a line through the
logarithms fits: 1 is a cost that grows as the number of people, 2 as that of their pairs.  And the speed on the clock with more
threads over that with one, of a batch of rooms and of one crowd.
"""

import os

import numpy as np

from benchmarks.batch import Rooms
from benchmarks.crowds import Crowd, Way
from benchmarks.measuring import Effort, Row, Sample, in_turn
from benchmarks.scenes import jam

SIZES = (1_000, 3_000, 10_000, 30_000, 100_000)
WAYS = (Way("dem", 0.001), Way("nsm1", 0.01), Way("nsm2", 0.01), Way("hertz", 0.001))


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


def against_threads(effort: Effort, rooms: int = 256, people: int = 100_000) -> list[Row]:
    """Return speed and CPU time with 2, 4 ... threads over those with one thread."""
    counts = [threads for threads in (1, 2, 4, 8, 16, 32) if threads <= max(2, os.cpu_count() or 1)]
    scene = jam(min(people, effort.max_people))
    field = scene.scenario.field()
    groups: dict[str, list[Rooms] | list[Crowd]] = {
        f"dem, {rooms} x 20": [Rooms("dem", rooms, 20, threads=threads) for threads in counts],
        f"dem 0.001 s, {scene.people} people": [Crowd(scene, WAYS[0], field, threads) for threads in counts],
    }
    found: list[Row] = []
    for name, contenders in groups.items():
        samples: list[Sample] = in_turn(contenders, effort)
        for threads, sample in zip(counts, samples, strict=True):
            speed = (sample.steps / sample.clock) / (samples[0].steps / samples[0].clock)
            who = f"{name}, {threads} threads"
            found.append(Row(who, "speed on the clock, of one thread", speed))
            found.append(Row(who, "CPU time, of one thread", samples[0].rate / sample.rate))
    return found
