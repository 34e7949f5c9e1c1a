"""A square hall at 1.33 people/m2 with an exit of 4 m: people walk, few touch; 4 s from the start."""

from benchmarks.crowds import PAIRS, measure
from benchmarks.measuring import Effort, Row
from benchmarks.peers import rivals
from benchmarks.scenes import hall

SIZES = (1_000, 5_000, 20_000, 100_000)


def rows(effort: Effort) -> list[Row]:
    """Return the figures of every scheme and size."""
    found: list[Row] = []
    for count in effort.sizes(SIZES):
        scene = hall(count)
        found += measure(scene, effort, PAIRS, rivals("hall", scene, effort), detail=False)
    return found
