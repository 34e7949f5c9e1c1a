"""Keeps the fastest ways of every environment up to date with its own crowd."""

import math
import time as clock
from collections.abc import Sequence

import numpy as np

from crowd_env.navigation import NavigationField, regions_along
from crowd_env.physics.world import World
from crowd_env.remarching import write_field
from crowd_env.state import Bodies, CrowdState, Ints
from crowd_env.ways import Ways, region_masks_of


class Replanner:
    """Marches the dynamic ways anew, each environment at its own times: every ``interval`` seconds since its start.

    Parameters
    ----------
    places : the ways of every geometry.
    geometry_of_env : (E,)
    interval : s.

    Attributes
    ----------
    seconds : processor time spent so far, for reports.
    marches : fields made so far.
    """

    def __init__(
        self, places: Sequence[Ways | NavigationField | None], geometry_of_env: Ints, interval: float = 1.0
    ) -> None:
        if not 0 < interval < np.inf:
            raise ValueError(f"the interval of replanning is {interval!r} s; it must be > 0 and finite")
        self.interval = interval
        self.seconds, self.marches = 0.0, 0
        self._ways = []
        for e, g in enumerate(geometry_of_env):
            place = places[g]
            if isinstance(place, Ways):
                self._ways += [(e, r, place) for r, way in enumerate(place.ways) if way.remarcher is not None]
        self._due = np.zeros(len(geometry_of_env))

    def restart(self, e: int) -> None:
        """Begin environment ``e`` anew."""
        self._due[e] = 0.0

    def steps_until_due(self, state: CrowdState, dt: float, inside: Ints) -> int | None:
        """Return after how many steps the next environment is due; None if there is nothing to plan."""
        waits = [
            max(1, math.ceil((self._due[e] - state.time[e]) / dt - 1e-9)) for e, _, _ in self._ways if inside[e] > 0
        ]
        return min(waits, default=None)

    def update(self, world: World, bodies: Bodies, state: CrowdState) -> None:
        """March the ways of the environments that are due, in place."""
        if not self._ways:
            return
        begin, done = clock.process_time(), set()
        for e, r, place in self._ways:
            if state.time[e] < self._due[e] - 1e-9:
                continue
            people = slice(int(bodies.env_start[e]), int(bodies.env_start[e + 1]))
            remarcher = place.ways[r].remarcher
            assert remarcher is not None
            field = remarcher.march(state.position[people][state.active[people]])
            f = int(world.guidance.field_of_route[e, r])
            first = int(world.field.node_start[f])
            write_field(field, world.field.travel_time, world.field.direction, first)
            if place.rules:
                through = regions_along(field, region_masks_of(field, place.geometry))
                world.field.through[first : first + through.size] = through.ravel()
            self.marches += 1
            done.add(e)
        for e in done:
            self._due[e] = state.time[e] + self.interval
        self.seconds += clock.process_time() - begin
