"""What it costs that people keep a distance: each scheme with a manner, in turn with itself without one.

A hall at 1.33 people/m2 in which people walk, and a jam at 6 people/m2 in which everyone sees forty others.
"""

from collections.abc import Callable, Sequence

from benchmarks.crowds import COST, DEFAULT_PAIRS, Crowd
from benchmarks.measuring import Effort, Row, in_turn, significant
from benchmarks.scenes import Scene, hall, jam

MANNER = "calm"
SIZES = (1_000, 10_000)
SCENES: dict[str, Callable[[int], Scene]] = {"hall": hall, "jam": jam}


def rows(effort: Effort, pairs: Sequence[tuple[str, float]] = DEFAULT_PAIRS) -> list[Row]:
    """Return the CPU time of every scheme, scene and size, without a manner and with one, and how many times as much it is."""
    return [
        row
        for name, make in SCENES.items()
        for count in effort.sizes(SIZES)
        for row in _compare(name, make(count), effort, pairs)
    ]


def _compare(place: str, scene: Scene, effort: Effort, pairs: Sequence[tuple[str, float]]) -> list[Row]:
    effort.tell(f"{place}, {scene.people} people: placing them")
    field, found = scene.scenario.field(), []
    for scheme, dt in pairs:
        crowds = [Crowd(scene, scheme, dt, effort, field, manner=manner) for manner in (None, MANNER)]
        without, with_manner = (sample.cost for sample in in_turn(crowds, effort))
        name = f"{scheme} {dt:g} s, {place}, {scene.people} people"
        found.append(Row(f"{name}: without", significant(without, 3), COST))
        found.append(Row(f"{name}: {MANNER}", significant(with_manner, 3), COST))
        found.append(Row(f"{name}: times", significant(with_manner / without, 3), "1"))
    return found
