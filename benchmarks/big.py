"""A room of 15 m with a door of 1 m and 100 to 300 people: the first 20 s, in which the crowd packs in front of the door."""

from benchmarks.crowds import DEFAULT_PAIRS, measure
from benchmarks.measuring import Effort, Row
from benchmarks.peers import rivals
from benchmarks.scenes import big

SIZES = (100, 200, 300)
_PAIRS = tuple(pair for pair in DEFAULT_PAIRS if pair[0] != "nsm1-inertial")


def rows(effort: Effort) -> list[Row]:
    """Return the figures of every scheme and size."""
    found: list[Row] = []
    for count in effort.sizes(SIZES):
        scene = big(count)
        found += measure(scene, effort, _PAIRS, rivals("big", scene, effort))
    return found
