"""A batch of crowds that walk, touch and leave.  No rewards, no agents: give it commands, advance it, read its arrays."""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from crowd_env._kernels.struct_ref import StructRef, struct_ref
from crowd_env._kernels.threads import Workers
from crowd_env.geometry.geometry import Geometry, join_boundaries
from crowd_env.geometry.inside import border_of, mark_outside
from crowd_env.geometry.wall_grid import make_wall_grid, no_wall_grid
from crowd_env.navigation.field import NavigationField
from crowd_env.physics import ContactScheme, make_scheme
from crowd_env.physics.contacts import rows_of
from crowd_env.physics.neighbors.lists import invalidate_lists
from crowd_env.physics.neighbors.update import DIVERGED, FULL, OK, TOO_FAST
from crowd_env.physics.scheme import arrays_of
from crowd_env.physics.spatial_order import SortedCrowd
from crowd_env.physics.walking.headway import Headway, make_manner
from crowd_env.physics.workspace import (
    Batch,
    Command,
    World,
    add_diagnostics,
    allocate_control,
    allocate_history,
    allocate_results,
    allocate_workspace,
    grow,
    invalidate_directions,
    no_diagnostics,
    set_command,
)
from crowd_env.routing.door_schedule import DoorSchedule
from crowd_env.routing.replanning import RoutePlanner
from crowd_env.routing.route_set import RouteSet
from crowd_env.simulation.arguments import (
    check_routes,
    check_step,
    check_threads,
    fields_of,
    flags,
    routes_of,
    vectors,
    which_geometry,
)
from crowd_env.simulation.checkpoint import (
    Checkpoint,
    has_room,
    load_history,
    made_by,
    require_checkpoint,
    require_same,
    save_history,
    write_arrays,
    write_results,
)
from crowd_env.simulation.contact_list import ContactList, list_contacts
from crowd_env.simulation.limits import why_stopped
from crowd_env.simulation.restart import begin_history, begin_results, begin_state
from crowd_env.state import Bodies, Bools, CrowdState, Floats, Ints, check_bodies, check_state

_IN_PLACE = ("world", "state", "bodies", "results", "history", "workspace")  # others hold on to their arrays


class Simulation:
    """A batch of crowds under one contact scheme.

    Parameters
    ----------
    geometry : one for all environments, or several together with ``geometry_of_env``.
    bodies, state : arrays of all environments; the simulation works on them in place.  Their arrays may be written to, they
        themselves cannot be replaced: to go back to another moment is what `checkpoint` and `restore` are for.
    scheme : name in ``SCHEMES`` or a scheme with its own parameters.
    dt : s, physics step; by default the scheme's own, 0.01 or (hertz) 0.001.
    fields : travel-time field, or all the ways, of each geometry; made here for geometries with exits if not given.
    replan_every : s, how often the fastest ways are found anew.
    driving : True for pedestrians (driving force, eq 11, and social force), False for passive grains.
    threads : spread environments, or with `dem` the parts of one large crowd, over this many threads; the result does not
        depend on it.
    manner : how people walk before they touch: a name in ``MANNERS``, a Headway, or a table of its parameters; by default they
        walk at full speed whatever is in front of them.
    allow_unstable : accept a ``dt`` above the scheme's stable step, and let everyone go as fast, as far in a step and through
        whatever the contact law alone allows (to show what happens); else see `crowd_env.physics.bounds`.

    Raises
    ------
    ValueError
        If ``dt`` is not positive or above the stable step, an array has the wrong shape or type or does not fit the others, a
        position is not finite, a body cannot be, or the scheme refuses the use.
    """

    def __init__(
        self,
        geometry: Geometry | Sequence[Geometry],
        bodies: Bodies,
        state: CrowdState,
        *,
        scheme: str | ContactScheme = "nsm2",
        dt: float | None = None,
        fields: Sequence[RouteSet | NavigationField | None] | None = None,
        geometry_of_env: Ints | None = None,
        driving: bool = True,
        threads: int = 1,
        replan_every: float = 1.0,
        allow_unstable: bool = False,
        manner: str | Mapping[str, Any] | Headway | None = None,
    ) -> None:
        self.geometries = [geometry] if isinstance(geometry, Geometry) else list(geometry)
        check_bodies(bodies)
        check_state(state, bodies)
        self.bodies, self.state = bodies, state
        self.scheme = make_scheme(scheme)
        self.dt = dt = self.scheme.info.default_dt if dt is None else dt
        self.driving, self.allow_unstable = driving, allow_unstable
        self.manner = headway = make_manner(manner)
        self.threads = check_threads(threads)
        self.scheme.check(driving)
        check_step(self.scheme, bodies, dt, allow_unstable)
        self.fields = fields_of(self.geometries, fields, bodies)
        boundary = join_boundaries(self.geometries)
        environments = len(state.time)
        which = which_geometry(geometry_of_env, environments, len(self.geometries))
        self.planner = RoutePlanner(self.fields, which, boundary, replan_every)
        guidance = self.planner.guidance
        walls = no_wall_grid(len(self.geometries)) if headway is None else make_wall_grid(boundary, headway.sight + 1.0)
        self.world = World(boundary, self.planner.field, which, guidance, walls)
        plans = [place.plan if isinstance(place, RouteSet) else None for place in self.fields]
        closed, events = ([getattr(plan, name, ()) for plan in plans] for name in ("closed_at_start", "events"))
        self._door_schedule = DoorSchedule(self.geometries, closed, events, which)
        doors = max(len(place.doors) for place in self.geometries)
        rules = int(np.diff(guidance.rule.start).max(initial=0))
        self._uses = arrays_of(self.scheme, headway is not None)
        self.results = allocate_results(len(bodies.radius), environments)
        self.workspace = allocate_workspace(bodies, uses=self._uses)
        self.history = allocate_history(bodies, self.workspace.neighbors, rules, doors, self._uses)
        known = (guidance.field_of_route >= 0).sum(axis=1)
        self._routes_of_person = np.repeat(known, np.diff(bodies.env_start))
        check_routes(state.route, self._routes_of_person)
        self.history.followed[:] = state.route
        # Overlaps, residuals and solver effort since the start of each environment.
        self.diagnostics = no_diagnostics(environments)
        # (P,) who was found outside of the walkable area after any call since the start of the environment: by position
        # alone, whatever the contacts say.  Nobody should be.
        self.escaped = np.zeros(len(bodies.radius), dtype=np.bool_)
        self._border = struct_ref(border_of([place.walkable for place in self.geometries]))
        self._control = allocate_control(len(bodies.radius), driving, not allow_unstable, headway)
        batch = Batch(self.world, bodies, state, self._control, self.results, self.history, self.workspace)
        self._sorted = SortedCrowd(batch) if SortedCrowd.is_needed(bodies) else None
        # What kernels work on, always the same reference: see `_replace`.
        self.batch: StructRef = struct_ref(batch if self._sorted is None else self._sorted.batch)
        self._workers = Workers()
        for e in range(environments):
            self.close_doors(e, self._door_schedule.restart(e))
        self.times_restored = 0  # whoever keeps books beside the simulation sees that they are of another moment

    def __setattr__(self, name: str, value: Any) -> None:
        """Refuse to replace what observers and environments hold on to: they would go on looking at dead arrays."""
        if name in _IN_PLACE and name in self.__dict__:
            raise AttributeError(
                f"{name} cannot be replaced, others hold on to its arrays: write into them, or go back to another moment with "
                "checkpoint() and restore()"
            )
        super().__setattr__(name, value)

    @property
    def inside(self) -> Ints:
        """Number of people still inside, per environment (E,)."""
        return np.add.reduceat(self.state.active.astype(np.int64), self.bodies.env_start[:-1])

    def advance(
        self,
        command: Floats | None = None,
        *,
        relative: Bools | None = None,
        n_substeps: int = 1,
        external_force: Floats | None = None,
        gives_way: Bools | None = None,
    ) -> None:
        """Advance every environment by ``n_substeps`` physics steps in one compiled call.

        Parameters
        ----------
        command : (P, 2), desired velocity as a multiple of the own desired speed; default (1, 0), straight to the exit.
        relative : (P,), True where the command turns with the direction of the shortest path (default), False where its
            axes are those of the world.
        external_force : (P, 2) N.
        gives_way : (P,), False for people who walk as they are told, whatever the manner of the others; default True.

        Raises
        ------
        ValueError
            If an array has the wrong shape or holds something that is not finite.
        FloatingPointError
            If someone would move further in one step than the own radius, or a position is no longer finite.
        """
        people = len(self.bodies.radius)
        asked = Command(
            vectors("command", command, people),
            flags("relative", relative, people),
            vectors("external_force", external_force, people),
            flags("gives_way", gives_way, people),
        )
        if n_substeps < 0:
            raise ValueError(f"n_substeps is {n_substeps}; it must be >= 0")
        check_routes(self.state.route, self._routes_of_person)
        results, workspace = self.results, self.workspace
        workspace.status[:] = OK
        for sums in (*results[:-1], *results.diagnostics, workspace.substep, workspace.partition.barrier):
            sums[:] = 0
        if self._sorted is None:
            set_command(self._control, asked)
        target = 0
        while target < n_substeps:
            for e, closed in self._door_schedule.update(self.bodies, self.state, self.history.door_open):
                self.close_doors(e, closed)
            self.planner.update(self.bodies, self.state)
            inside = self.inside
            if self._sorted is not None:
                self._sorted.update(self.history.contacts, self.workspace.neighbors)
            tasks = (self._sorted, self.planner, self._door_schedule)
            waits = [task.steps_until_due(self.state.time, self.dt, inside) for task in tasks if task is not None]
            target = min([n_substeps, *(target + wait for wait in waits if wait is not None)])
            self._run_until(target, asked)
        add_diagnostics(self.diagnostics, self.results.diagnostics)
        state, geometry_of_env = self.state, self.world.geometry_of_env
        mark_outside(self._border, geometry_of_env, self.bodies.env_start, state.active, state.position, self.escaped)

    def close_doors(self, e: int, closed: Iterable[str]) -> None:
        """Close these doors of environment ``e`` and open all others; ways are found accordingly.

        Raises
        ------
        ValueError
            If a name is unknown.
        """
        names, shut = self.geometries[self.world.geometry_of_env[e]].doors, frozenset(closed)
        for name in shut:
            if name not in names:
                raise ValueError(f"unknown door {name!r}; known: {', '.join(names) or 'none'}")
        stands_open = np.array([name not in shut for name in names], dtype=np.bool_)
        if not len(names) or (self.history.door_open[e, : len(names)] == stands_open).all():
            return
        self.history.door_open[e, : len(names)] = stands_open
        invalidate_lists(self.workspace.neighbors, e)
        invalidate_directions(self.history, e)
        self.planner.close(e, shut)
        self._replace("world", self.world._replace(field=self.planner.field))

    def _people(self, e: int) -> slice:
        """Return whose slots are those of environment ``e``; ValueError if there is none of that number."""
        if not 0 <= e < len(self.state.time):
            raise ValueError(f"there is no environment {e!r}; they are numbered 0 to {len(self.state.time) - 1}")
        return slice(int(self.bodies.env_start[e]), int(self.bodies.env_start[e + 1]))

    def _run_until(self, n_substeps: int, asked: Command) -> None:
        """Advance every environment to step ``n_substeps`` of this call."""
        while True:
            if self._sorted is not None:
                self._sorted.gather(asked)
            try:
                self._run(n_substeps)
            finally:  # after Ctrl-C too, people stand where they have come to
                if self._sorted is not None:
                    self._sorted.scatter()
            status = self.workspace.status
            stopped = np.flatnonzero((status == DIVERGED) | (status == TOO_FAST))
            if len(stopped):
                e, who = int(stopped[0]), (self.bodies, self.state)
                raise FloatingPointError(why_stopped(self.scheme.info.name, e, int(status[e]), *who, self.dt))
            if not (status == FULL).any():
                return
            self._grow()  # the environments that were full go on where they were

    def _grow(self) -> None:
        """Make more room for neighbors; what others hold on to stays."""
        history, workspace = grow(self.history, self.workspace, self.bodies, self._uses)
        self._replace("history", history)
        self._replace("workspace", workspace)

    def _replace(self, part: str, new: Any) -> None:
        """Let a part of the batch have other arrays, here and for kernels: nowhere else are any replaced."""
        old = self.__dict__[part]
        changed = {name: value for name, value in new._asdict().items() if value is not getattr(old, name)}
        self.__dict__[part] = new
        getattr(self.batch, part).replace(**changed)

    def _run(self, n_substeps: int) -> None:
        """Advance the batch on all threads: the kernels hold no lock.

        Either ranges of environments side by side, which share no memory; or, where a crowd is large and the scheme knows how,
        all threads go through all environments together.
        """
        count, threads = len(self.state.time), self.threads
        largest = int(np.diff(self.bodies.env_start).max())
        if threads > 1 and self.scheme.slabs(largest, self.driving) > 1:
            parts = [(0, count, thread, threads) for thread in range(threads)]
        else:
            edges = np.linspace(0, count, min(threads, count) + 1).astype(int).tolist()
            parts = [(first, stop, 0, 1) for first, stop in itertools.pairwise(edges)]
        self._workers.run(lambda *part: self.scheme.advance(self.batch, self.dt, n_substeps, *part), parts)

    def restart(
        self, e: int, bodies: Bodies, position: Floats, velocity: Floats | None = None, route: Ints | int = 0
    ) -> None:
        """Begin a new episode in environment ``e`` with other people, as many as before; the others are not touched.

        ``route`` is the number of the way that each means to take; `send` changes it later.  Ways that follow the crowd are
        found at once.

        Raises
        ------
        ValueError
            If the number of people differs, an array has the wrong shape, or a value is not one that it can have.
        """
        people = self._people(e)
        count = people.stop - people.start
        check_bodies(bodies)
        if len(bodies.radius) != count:
            raise ValueError(f"environment {e} holds {count} people, not {len(bodies.radius)}")
        check_step(self.scheme, bodies, self.dt, self.allow_unstable)
        stand = vectors("position", position, count)
        assert stand is not None  # or there would be nobody to place
        walk = vectors("velocity", velocity, count)
        routes = routes_of(route, self._routes_of_person[people])
        for name in Bodies._fields[:-1]:
            getattr(self.bodies, name)[people] = getattr(bodies, name)
        begin_state(e, people, self.state, stand, walk, routes)
        begin_history(e, people, self.history, self.workspace, self.bodies, routes)
        begin_results(e, people, self.results, self.diagnostics)
        if self._sorted is not None:
            self._sorted.restart(e)
        self.planner.restart(e)
        self.close_doors(e, self._door_schedule.restart(e))
        self.escaped[people] = False
        self.planner.update(self.bodies, self.state, only=e)

    def checkpoint(self) -> Checkpoint:
        """Return a copy of all that the future depends on, to `restore` here, or in a simulation made like this one."""
        return Checkpoint(
            self._made_like(),
            Bodies._make(array.copy() for array in self.bodies),
            self.state.copy(),
            save_history(self.history, self.workspace.neighbors),
            self.results.copy(),
            self.diagnostics.copy(),
            self._door_schedule.moment(),
            self.planner.moment(),
            None if self._sorted is None else self._sorted.order(),
            self.escaped.copy(),
        )

    def restore(self, checkpoint: Checkpoint) -> None:
        """Go back to a moment; what follows is bit by bit what followed it then, as far as the same is asked for.

        All arrays of `state`, `bodies`, `results` and `history` are written in place: who holds one sees that moment.

        Raises
        ------
        TypeError
            If it is no checkpoint of a simulation.
        ValueError
            If the checkpoint is of a simulation of other people, places, scheme or steps.
        """
        require_checkpoint(checkpoint, Checkpoint, "a simulation")
        require_same(self._made_like(), checkpoint.made_by)
        while not has_room(self.workspace, checkpoint.history):
            self._grow()
        load_history(self.history, self.workspace, checkpoint.history)
        write_results(self.results, checkpoint.results)
        for ours, then in (
            (self.bodies, checkpoint.bodies),
            (self.state, checkpoint.state),
            (self.diagnostics, checkpoint.diagnostics),
        ):
            write_arrays(ours, then._asdict())
        self.escaped[:] = checkpoint.escaped
        self._door_schedule.restore(checkpoint.doors)
        self.planner.restore(checkpoint.route_set)
        self._replace("world", self.world._replace(field=self.planner.field))
        if self._sorted is not None and checkpoint.order is not None:
            self._sorted.restore(checkpoint.order)
        self.times_restored += 1

    def _made_like(self) -> dict[str, Any]:
        is_sorted, interval = self._sorted is not None, self.planner.interval
        return made_by(self.scheme, self.manner, self.dt, self.driving, interval, self.bodies, is_sorted, self.world)

    def send(self, e: int, route: Ints | int) -> None:
        """Let everyone in environment ``e`` take another way: one number for all, or one each.

        Raises
        ------
        ValueError
            If there is no such way.
        """
        people = self._people(e)
        wanted = routes_of(route, self._routes_of_person[people])
        self.state.route[people] = wanted
        self.history.followed[people] = wanted
        invalidate_directions(self.history, e)

    def contacts(self, e: int = 0) -> ContactList:
        """Return a copy of the contacts of environment ``e``."""
        first, rows = self._people(e).start, rows_of(e, self.history.contacts, self.workspace.neighbors)
        return list_contacts(
            self.history.contacts, rows, first, self._sorted, bool(self.diagnostics.unconverged[e] == 0)
        )
