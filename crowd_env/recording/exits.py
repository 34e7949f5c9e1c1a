"""Positions of pedestrians in the two frames after they have crossed an exit line.

PedPy counts a crossing in the frame that ends beyond the line, but not if it is the last frame of a trajectory: movements span
no time there (`SpeedCalculation.BORDER_ADAPTIVE`).  So there are two.
"""

import numpy as np

from crowd_env.core.arrays.state import Bools, Floats, segment_lengths

APRON = 0.6  # m, depth of the ground outside of an exit that rows beyond it lie on
_LEAST, _MOST = 0.05, 0.5  # m beyond the line, and beyond the place before
_FROM_ENDS = 1e-3  # m, from the ends of the line


def places_beyond(
    line: Floats, before: Floats, position: Floats, velocity: Floats, since: Floats, interval: float
) -> Floats:
    """Return the positions of K people in the two frames after crossing an exit line (2, K, 2) [m].

    They lie on the straight way on, at least 5 cm further out each time, 55 cm at most, and within the width of the exit.  The
    straight way from the position in the frame before crosses the line: programs that read frames alone count it.

    Parameters
    ----------
    line : (K, 2, 2) m, ends of the exit line; the walkable area lies to the left.
    before : (K, 2) m, in the frame before.
    position, velocity : (K, 2) m and m/s, at the end of the physics step that crossed the line.
    since : (K,) s, from the crossing to the first of the two frames.
    interval : s, from that to the second.
    """
    length = segment_lengths(line)
    along = (line[:, 1] - line[:, 0]) / length[:, None]
    outward = np.stack([along[:, 1], -along[:, 0]], axis=1)

    def parts(vector: Floats) -> tuple[Floats, Floats]:
        return (vector * along).sum(axis=1), (vector * outward).sum(axis=1)

    def kept(at: Floats) -> Floats:
        margin = np.minimum(_FROM_ENDS, 0.25 * length)
        return np.clip(at, margin, length - margin)

    (at_before, depth_before), (at, depth) = parts(before - line[:, 0]), parts(position - line[:, 0])
    sideways, out = parts(velocity)
    back = np.divide(depth, out, out=np.zeros(len(out)), where=(out > 0.0) & (depth > 0.0))
    crossed = kept(at - back * sideways)
    on = kept(crossed + sideways * since), np.clip(out * since, _LEAST, _MOST)
    # Around the post of a door the straight way may miss the line: then on from the frame before through the crossing.
    through = np.divide(_LEAST, -depth_before, out=np.zeros(len(out)), where=depth_before < 0.0)
    aslant = kept(crossed + through * (crossed - at_before)), np.full(len(out), _LEAST)
    straight = crossed, np.full(len(out), _LEAST)
    place = straight
    for other in (aslant, on):
        counts = _crosses(at_before, depth_before, other[0], other[1], length)
        place = np.where(counts, other[0], place[0]), np.where(counts, other[1], place[1])
    later = kept(place[0] + interval * sideways), place[1] + np.clip(interval * out, _LEAST, _MOST)
    further = later[0], np.minimum(later[1], _MOST + _LEAST)
    return np.stack([line[:, 0] + a[:, None] * along + d[:, None] * outward for a, d in (place, further)])


def _crosses(at_before: Floats, depth_before: Floats, at: Floats, depth: Floats, length: Floats) -> Bools:
    """Return whether straight ways (K,) cross lines that reach from 0 to ``length``, not only the lines' extension."""
    part = np.maximum(-depth_before, 0.0) / (depth - np.minimum(depth_before, 0.0))
    meets = at_before + part * (at - at_before)
    margin = np.minimum(0.5 * _FROM_ENDS, 0.1 * length)
    return (depth_before <= 0.0) & (meets >= margin) & (meets <= length - margin)
