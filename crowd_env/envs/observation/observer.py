"""Observations of a batch of crowds, and the rest of each pedestrian's way."""

import numpy as np

from crowd_env.core.arrays.state import Bools, Ints
from crowd_env.core.kernels.struct_ref import struct_ref
from crowd_env.envs.observation.layout import ALL_PAIRS, ObservationLayout
from crowd_env.envs.observation.perception import perceive
from crowd_env.envs.observation.view import View, Ways
from crowd_env.physics.neighbors.lists import allocate_neighbors
from crowd_env.physics.simulation.simulation import Simulation
from crowd_env.physics.workspace import by_reference, replace_arrays
from crowd_env.routing.fields.bottlenecks import bottlenecks_of, no_bottlenecks
from crowd_env.routing.fields.field import NavigationField


class Observer:
    """Observes the people of a simulation.

    Parameters
    ----------
    simulation, layout : the crowds, and the terms to observe.
    ways : that people may choose among.
    in_world : vectors along x and y, else along and to the left of the shortest path.
    all_pairs : see `ObservationLayout.plan`; cells hold all pedestrians inside, observed or not.

    Attributes
    ----------
    view : a reference to the `View`.
    """

    def __init__(
        self,
        simulation: Simulation,
        layout: ObservationLayout,
        ways: Ways,
        *,
        in_world: bool,
        all_pairs: int = ALL_PAIRS,
    ) -> None:
        people, environments = len(simulation.bodies.radius), len(simulation.state.time)
        self.layout, self._width = layout, layout.size
        direction = np.zeros((people, 2))
        self._simulation, self._known = simulation, list[NavigationField | None]()
        self._openings = by_reference(no_bottlenecks())
        if "opening" in layout.names:
            self._update_openings()
            simulation.told_of_fields.append(self._update_openings)  # a door may move within a step, before `look`
        self._everywhere = np.arange(environments)
        largest = int(np.diff(simulation.bodies.env_start).max())
        self._plans = {first: struct_ref(layout.plan(largest, all_pairs)) for first, _ in simulation.ranges}
        world, batch, history, results = simulation.world, simulation.batch, simulation.history, simulation.results
        # The parts of `simulation.batch` stay the same references when doors or growth replace what they refer to.
        self.view = struct_ref(
            View(
                boundary=world.boundary,
                door_open=history.door_open,
                geometry_of_env=world.geometry_of_env,
                surface=world.surface,
                field=batch.world.field,
                field_of_route=world.guidance.field_of_route,
                potential_of_route=simulation.planner.potential_of_route,
                followed=history.followed,
                bodies=simulation.bodies,
                state=simulation.state,
                near=allocate_neighbors(simulation.bodies, per_person=0),
                impulse=results.impulse,
                impulse_magnitude=results.impulse_magnitude,
                seen=np.zeros(people, dtype=bool),
                listed=np.zeros(people, dtype=np.int32),
                axis=np.tile([1.0, 0.0], (people, 1)) if in_world else direction,
                direction=direction,
                travel_time=np.zeros(people),
                potential=np.zeros(people),
                reached=np.tile([np.inf, 0.0], (people, 1)),
                distance_to_go=np.zeros(people),
                openings=self._openings,
                ways=ways,
                length_of_way=np.zeros((people, layout.routes)),
                group_sums=np.zeros((people, 3)),
                heads_for=np.zeros(people, dtype=np.int64),
            )
        )

    def observe(self, seen: Bools, environments: Ints | None = None, out: np.ndarray | None = None) -> np.ndarray:
        """Return the observation (P, D) float32 of pedestrians ``seen`` (P,), zero elsewhere.

        Parameters
        ----------
        environments : write the rows of these alone; None = of all.
        out : (P, D) float32 to write into instead of a new array.
        """
        rows = self.begin(seen) if out is None else out
        self.view.fields.seen[:] = seen
        chosen = self._everywhere if environments is None else environments
        perceive(chosen, self.view, self._plans[0], rows)
        return self.finish(rows, chosen)

    def begin(self, seen: Bools) -> np.ndarray:
        """Return an array (P, D) for pedestrians ``seen`` (P,), to `look` and `finish`: `observe` does all three."""
        self.view.fields.seen[:] = seen
        return np.empty((len(seen), self._width), np.float32)

    def look(self, rows: np.ndarray, first: int, stop: int) -> None:
        """Write the rows of environments ``first:stop``, one of `Simulation.ranges`: threads do so side by side."""
        perceive(self._everywhere[first:stop], self.view, self._plans[first], rows)

    def _update_openings(self) -> None:
        """Find the openings of new fields: at first all, later the fields that doors have caused."""
        planner = self._simulation.planner
        if self._known == planner.fields:
            return
        self._known = list(planner.fields)
        geometries = [self._simulation.geometries[g] for g in planner.geometry_of_field]
        replace_arrays(self._openings, bottlenecks_of(self._known, geometries))

    def finish(self, rows: np.ndarray, environments: Ints | None = None) -> np.ndarray:
        """Return the rows, with the custom terms of these environments; None = of all."""
        if self.layout.own_terms:
            self.layout.add_own_terms(
                self.view.fields, self._everywhere if environments is None else environments, rows
            )
        return rows
