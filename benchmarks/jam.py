"""A crowd at 6 people/m2 that pushes to a door of 1.2 m: bodies touch, forces travel through the crowd.

People start where they touch, and push for 0.1 s (or as long as there is patience) before anything is measured; then 1 s counts
(0.2 s of 100,000 people), before everyone is put back.  How many touch and how deep they overlap belongs to the speed: a solver
that stops early is fast.  "Saw only" marks who did not get to the end of that time.
"""

from benchmarks.crowds import JAM_PAIRS, measure
from benchmarks.measuring import Effort, Row
from benchmarks.peers import rivals
from benchmarks.scenes import jam

SIZES = (1_000, 5_000, 10_000, 100_000)


def rows(effort: Effort) -> list[Row]:
    """Return the figures of every scheme and size."""
    found: list[Row] = []
    for count in effort.sizes(SIZES):
        scene = jam(count)
        pairs = (
            JAM_PAIRS if count <= 10_000 else [pair for pair in JAM_PAIRS if pair[0] not in ("nsm1 loose", "nsm1 1e-3")]
        )
        found += measure(scene, effort, pairs, rivals("jam", scene, effort))
    return found
