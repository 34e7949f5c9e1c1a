"""The heights of people, by which lists leave out other storeys: looked up now and then, by the clock alone."""

import numpy as np

from crowd_env.core.arrays.state import Bodies, CrowdState, Floats, Ints
from crowd_env.core.clock import DueClock, next_multiple
from crowd_env.core.kernels.jit import index, kernel
from crowd_env.geometry.surface import Surface, height_at

EVERY = 0.1  # s; people climb a third of a step of stairs meanwhile, at most


class Heights:
    """Looks up the heights of people in places of several sheets.

    Lists of neighbors are built at other moments in a run that went on from a checkpoint.  Heights are looked up at multiples
    of a time, so the lists leave out the same pairs.

    Parameters
    ----------
    surface : of all places.
    geometry_of_env : (E,)
    due : (E,) s, when the heights of each environment are due again; a part of the history.
    """

    def __init__(self, surface: Surface, geometry_of_env: Ints, due: Floats) -> None:
        several = (np.diff(surface.sheet_start) > 1) | (np.diff(surface.slope_start[surface.sheet_start]) > 0)
        self._surface, self._first = surface, surface.sheet_start[geometry_of_env]
        self._environments = np.flatnonzero(several[geometry_of_env]).tolist()
        self._clock = DueClock(0)
        self._clock.due = due

    def steps_until_due(self, time: Floats, dt: float, inside: Ints) -> int | None:
        """Return the number of steps until heights are due; None if there is no building."""
        return self._clock.steps_until_due((e for e in self._environments if inside[e] > 0), time, dt)

    def update(self, bodies: Bodies, state: CrowdState, height: Floats) -> list[int]:
        """Write the heights (P,) [m] that are due, and return the environments."""
        due = [e for e in self._environments if self._clock.is_due(e, state.time[e])]
        for e in due:
            self._clock.due[e] = next_multiple(EVERY, float(state.time[e]))
            slots = bodies.env_start[e], bodies.env_start[e + 1]
            _look_up(self._surface, self._first[e], slots[0], slots[1], state.sheet, state.position, height)
        return due


@kernel
def _look_up(
    surface: Surface, first: int, slot_start: int, slot_stop: int, sheet: Ints, position: Floats, height: Floats
) -> None:
    for i in range(index(slot_start), index(slot_stop)):
        height[i] = height_at(surface, first + sheet[i], position[i, 0], position[i, 1])
