"""Gates: open doors that let people through one by one, at most at a given flow.

A gate is a wall for all but admitted people, which may pass it from then on.  It admits the nearest person
within `REACH` with a way through it, and the next one after the reciprocal of its flow.
"""

from collections.abc import Sequence

import numpy as np

from crowd_env.core.arrays.state import Bodies, CrowdState, Floats, Ints, slots_of
from crowd_env.core.clock import DueClock, next_multiple
from crowd_env.geometry.geometry import Geometry
from crowd_env.routing.door_schedule import CHECK_EVERY
from crowd_env.routing.spec import Gate

REACH = 0.3  # m, from the body to the leaf
MOST_DOORS = 62  # of a place with gates: bits of a mask


class Gates:
    """The gates of a batch.

    Parameters
    ----------
    geometries, gates : of every place.
    geometry_of_env : (E,)

    Raises
    ------
    ValueError
        If a place with gates has too many doors.
    """

    def __init__(self, geometries: Sequence[Geometry], gates: Sequence[Sequence[Gate]], geometry_of_env: Ints) -> None:
        self._numbers, self._leaves, self._interval = [], [], []
        self._geometries = list(geometries)
        for place, own in zip(geometries, gates, strict=True):
            if own and len(place.doors) > MOST_DOORS:
                raise ValueError(f"{len(place.doors)} doors; a place with gates may have at most {MOST_DOORS}")
            doors = [place.doors.index(gate.door) for gate in own]
            self._numbers.append(doors)
            self._leaves.append([place.walls[place.door_of_wall == k] for k in doors])
            self._interval.append(np.array([1.0 / gate.flow for gate in own]))
        self._place = geometry_of_env
        most = max(map(len, self._numbers))
        self.free_from = np.zeros((len(geometry_of_env), most))  # (E, G) s, when each gate may admit the next
        self._clock = DueClock(len(geometry_of_env))
        self._watched = [e for e, g in enumerate(geometry_of_env) if self._numbers[g]]

    def __bool__(self) -> bool:
        """Whether there are any."""
        return bool(self._watched)

    def doors_of(self, e: int) -> list[int]:
        """Return the numbers of the doors of environment ``e`` that are gates."""
        return self._numbers[self._place[e]]

    def restart(self, e: int) -> None:
        """Begin an episode of environment ``e``."""
        self.free_from[e], self._clock.due[e] = 0.0, 0.0

    def moment(self) -> tuple[Floats, Floats]:
        """Return a copy of the state."""
        return self.free_from.copy(), self._clock.due.copy()

    def restore(self, then: tuple[Floats, Floats]) -> None:
        """Restore the state of a copy."""
        self.free_from[:], self._clock.due[:] = then

    def steps_until_due(self, time: Floats, dt: float, inside: Ints) -> int | None:
        """Return after how many steps the next gate must be looked at; None if there is none."""
        return self._clock.steps_until_due((e for e in self._watched if inside[e] > 0), time, dt)

    def update(self, bodies: Bodies, state: CrowdState, direction: Floats, admitted: Ints) -> list[int]:
        """Admit people; returns the environments in which someone is.

        ``direction`` (P, 2) of the ways and ``admitted`` (P,), which is written, are in slot order.
        """
        changed = []
        for e in self._watched:
            now, place = float(state.time[e]), int(self._place[e])
            if not self._clock.is_due(e, now):
                continue
            here, free_from = slots_of(bodies, e), self.free_from[e]
            for k, (door, leaves) in enumerate(zip(self._numbers[place], self._leaves[place], strict=True)):
                if now < free_from[k] - 1e-9:
                    continue
                outside = np.flatnonzero(state.active[here] & ((admitted[here] >> door) & 1 == 0))
                at = self._geometries[place].laid_out(state.position[here][outside], state.sheet[here][outside])
                dx, dy = _nearest_on(leaves, at)
                far = np.hypot(dx, dy)
                ahead = dx * direction[here][outside, 0] + dy * direction[here][outside, 1] > 0.0
                near = ahead & (far < bodies.radius[here][outside] + REACH)
                if near.any():
                    first = outside[np.argmin(np.where(near, far, np.inf))]
                    admitted[here.start + first] |= np.int64(1) << np.int64(door)
                    saturated = now - free_from[k] < CHECK_EVERY and free_from[k] > 0.0
                    free_from[k] = (free_from[k] if saturated else now) + self._interval[place][k]
                    changed.append(e)
            waits = [at if at > now + 1e-9 else next_multiple(CHECK_EVERY, now) for at in free_from.tolist()]
            self._clock.due[e] = min(waits[: len(self._numbers[place])])
        return changed


def _nearest_on(leaves: Floats, points: Floats) -> tuple[Floats, Floats]:
    """Return the ways (K,) along x and y [m] from points (K, 2) to the nearest point of lines (L, 2, 2)."""
    a, along = leaves[:, 0], leaves[:, 1] - leaves[:, 0]
    part = ((points[:, None] - a) * along).sum(axis=2) / (along**2).sum(axis=1)
    way = a + np.clip(part, 0.0, 1.0)[..., None] * along - points[:, None]
    nearest = np.argmin((way**2).sum(axis=2), axis=1)
    chosen = way[np.arange(len(points)), nearest]
    return chosen[:, 0], chosen[:, 1]
