"""Who looks: the observations of a batch of crowds, and how far everyone still has to go."""

import numpy as np

from crowd_env._kernels.struct_ref import struct_ref
from crowd_env._kernels.threads import Workers
from crowd_env.envs.buffers import BufferPool
from crowd_env.envs.observation.layout import ObservationLayout, View
from crowd_env.envs.observation.perception import perceive
from crowd_env.simulation.simulation import Simulation
from crowd_env.state import Bools, Ints

_ENOUGH_FOR_THREADS = 1000  # people; calling the threads costs as much as observing two hundred


class Observer:
    """Observes the people of a simulation.

    Parameters
    ----------
    simulation, layout : whom, and what of them.
    in_world : vectors along x and y, else along and to the left of the shortest path.
    threads : spread environments over so many; observations do not depend on it.

    Attributes
    ----------
    direction : (P, 2) of the shortest path, of whoever was last seen.
    travel_time : (P,) s, of the rest of the way at the own desired speed.
    potential : (P,) s, travel time by which progress is counted, see `crowd_env.routing.route_set.RouteField.potential`.
    rows : where the memory of observations comes from.
    """

    def __init__(self, simulation: Simulation, layout: ObservationLayout, *, in_world: bool, threads: int) -> None:
        people, rooms = len(simulation.bodies.radius), len(simulation.state.time)
        self.simulation, self.layout = simulation, layout
        self.direction = np.zeros((people, 2))
        self.travel_time = np.zeros(people)
        self.potential = np.zeros(people)
        self.rows = BufferPool((people, layout.size), np.float32)
        self._axis = np.tile([1.0, 0.0], (people, 1)) if in_world else self.direction
        self._seen = np.zeros(people, dtype=np.bool_)
        self._who = np.zeros(people, dtype=np.int32)
        self._all_rooms = np.arange(rooms)
        side_by_side = min(threads, rooms) if people >= _ENOUGH_FOR_THREADS else 1
        largest = int(np.diff(simulation.bodies.env_start).max())
        self._plans = [struct_ref(layout.plan(largest)) for _ in range(side_by_side)]
        self._workers = Workers()
        world, batch, history, results = simulation.world, simulation.batch, simulation.history, simulation.results
        # The parts of `simulation.batch` stay the same references when doors or growth replace what they refer to.
        self._view = struct_ref(
            View(
                boundary=world.boundary,
                door_open=history.door_open,
                geometry_of_env=world.geometry_of_env,
                field=batch.world.field,
                field_of_route=world.guidance.field_of_route,
                potential_of_route=simulation.planner.potential_of_route,
                followed=history.followed,
                bodies=simulation.bodies,
                state=simulation.state,
                near=batch.workspace.neighbors,
                push=results.impulse,
                crush=results.impulse_magnitude,
                seen=self._seen,
                who=self._who,
                axis=self._axis,
                direction=self.direction,
                travel_time=self.travel_time,
                potential=self.potential,
            )
        )

    def observe(self, seen: Bools, rooms: Ints | None = None, out: np.ndarray | None = None) -> np.ndarray:
        """Return the observation (P, D) of those ``seen`` (P,), or write that of some rooms; the others' rows are zero."""
        view = self._view
        self._seen[:] = seen
        rows = self.rows.take() if out is None else out
        if rooms is not None or len(self._plans) == 1:
            perceive(self._all_rooms if rooms is None else rooms, view, self._plans[0], rows)
        else:
            parts = np.array_split(self._all_rooms, len(self._plans))
            self._workers.run(
                lambda part, plan: perceive(part, view, plan, rows), list(zip(parts, self._plans, strict=True))
            )
        if self.layout.own_terms:
            self.layout.add_own_terms(view.fields, self._all_rooms if rooms is None else rooms, rows)
        return rows

    @property
    def kept(self) -> tuple[np.ndarray, ...]:
        """What the next observation and reward depend on besides the simulation."""
        return self.direction, self.travel_time, self.potential
