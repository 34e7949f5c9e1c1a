"""Who looks: the observations of a batch of crowds, and how far everyone still has to go."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from crowd_env.observation import ObservationLayout, View
from crowd_env.perception import Plan
from crowd_env.progress import look_ahead
from crowd_env.recycled import Recycled
from crowd_env.simulation import Simulation
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
    travel_time, travel_time_before : (P,) s, to an exit at the own desired speed, now and at the observation before; that of
        someone who is on another way now is the same as now: another way is no progress.
    rows : where the memory of observations comes from.
    """

    def __init__(self, simulation: Simulation, layout: ObservationLayout, *, in_world: bool, threads: int) -> None:
        people, rooms = len(simulation.bodies.radius), len(simulation.state.time)
        self.simulation, self.layout = simulation, layout
        self.direction = np.zeros((people, 2))
        self.travel_time = np.zeros(people)
        self.travel_time_before = np.zeros(people)
        self.rows = Recycled((people, layout.size), np.float32)
        self._field = np.full(people, -1, dtype=np.int64)  # by which the travel time was found
        self._axis = np.tile([1.0, 0.0], (people, 1)) if in_world else self.direction
        self._all_rooms = np.arange(rooms)
        side_by_side = min(threads, rooms) if people >= _ENOUGH_FOR_THREADS else 1
        self._plans = [layout.plan() for _ in range(side_by_side)]
        self._pool: ThreadPoolExecutor | None = None

    def observe(self, seen: Bools, rooms: Ints | None = None, out: np.ndarray | None = None) -> np.ndarray:
        """Return the observation (P, D) of those ``seen`` (P,), or write that of some rooms; the others' rows are zero."""
        simulation = self.simulation
        world, bodies, state, memory = simulation.world, simulation.bodies, simulation.state, simulation.memory
        rows = self.rows.take() if out is None else out
        view = View(
            boundary=world.boundary,
            door_open=memory.door_open,
            geometry_of_env=world.geometry_of_env,
            bodies=bodies,
            state=state,
            near=memory.near,
            push=memory.push,
            crush=memory.crush,
            seen=seen,
            axis=self._axis,
            direction=self.direction,
            travel_time=self.travel_time,
        )

        def look(part: Ints, plan: Plan) -> None:
            look_ahead(
                part,
                world.field,
                world.boundary,
                world.guidance.field_of_route,
                memory.followed,
                bodies,
                state,
                seen,
                self._field,
                self.direction,
                self.travel_time,
                self.travel_time_before,
            )
            self.layout.observe(view, part, plan, rows)

        if rooms is not None or len(self._plans) == 1:
            look(self._all_rooms if rooms is None else rooms, self._plans[0])
        else:
            if self._pool is None:
                self._pool = ThreadPoolExecutor(len(self._plans))
            list(self._pool.map(look, np.array_split(self._all_rooms, len(self._plans)), self._plans))
        self.layout.add_own_terms(view, self._all_rooms if rooms is None else rooms, rows)
        return rows
