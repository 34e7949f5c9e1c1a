"""A batch of crowds that walk, touch and leave.  No rewards, no agents: give it commands, advance it, read its arrays."""

import itertools
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from crowd_env._reference import Reference, refer
from crowd_env.doors import Doorkeeper
from crowd_env.geometry import Geometry, join_boundaries
from crowd_env.geometry_inside import border_of, mark_outside
from crowd_env.limits import check_stride, why_stopped
from crowd_env.navigation import NavigationField, travel_time_field
from crowd_env.ordering import SortedCrowd
from crowd_env.physics import ContactScheme, make_scheme
from crowd_env.physics.neighbors import DIVERGED, FULL, OK, TOO_FAST
from crowd_env.physics.scheme import scratch_of
from crowd_env.physics.world import (
    Asked,
    Batch,
    Diagnostics,
    World,
    add_diagnostics,
    allocate_control,
    allocate_memory,
    ask,
    grow_memory,
    no_diagnostics,
)
from crowd_env.state import Bodies, Bools, CrowdState, Floats, Ints
from crowd_env.wayfinding import Wayfinder
from crowd_env.ways import Ways


class ContactList(NamedTuple):
    """Contacts of one environment at the start of its last physics step (hertz: at its end), and the impulses of that step."""

    i: Ints  # (C,)    person, counted within the environment
    j: Ints  # (C,)    other person > i, or -1 - k: wall feature k
    gap: Floats  # (C,)    m, < 0 is overlap
    normal: Floats  # (C, 2)  unit vector from j to i
    impulse: Floats  # (C, 2)  N s, normal and tangential
    converged: bool  # whether every solve of the episode so far met its tolerance


class Simulation:
    """A batch of crowds under one contact scheme.

    Parameters
    ----------
    geometry : one for all environments, or several together with ``geometry_of_env``.
    bodies, state : arrays of all environments; the simulation works on them in place.
    scheme : name in ``SCHEMES`` or a scheme with its own parameters.
    dt : s, physics step; by default the scheme's own, 0.01 or (hertz) 0.001.
    fields : travel-time field, or all the ways, of each geometry; made here for geometries with exits if not given.
    replan_every : s, how often the fastest ways are found anew.
    driving : True for pedestrians (driving force, eq 11, and social force), False for passive grains.
    threads : spread environments, or with `dem` the parts of one large crowd, over this many threads; the result does not
        depend on it.
    allow_unstable : accept a ``dt`` above the scheme's stable step, and let everyone go as fast, as far in a step and through
        whatever the contact law alone allows (to show what happens); else see `crowd_env.physics.bounds`.

    Raises
    ------
    ValueError
        If ``dt`` is not positive or above the stable step, a position is not finite, or the scheme refuses the use.
    """

    def __init__(
        self,
        geometry: Geometry | Sequence[Geometry],
        bodies: Bodies,
        state: CrowdState,
        *,
        scheme: str | ContactScheme = "nsm2",
        dt: float | None = None,
        fields: Sequence[Ways | NavigationField | None] | None = None,
        geometry_of_env: Ints | None = None,
        driving: bool = True,
        threads: int = 1,
        replan_every: float = 1.0,
        allow_unstable: bool = False,
    ) -> None:
        self.geometries = [geometry] if isinstance(geometry, Geometry) else list(geometry)
        self.bodies, self.state = bodies, state
        self.scheme = make_scheme(scheme)
        self.dt = dt = self.scheme.info.default_dt if dt is None else dt
        self.driving = driving
        self.threads = threads
        if threads < 1:
            raise ValueError(f"threads is {threads}; it must be at least 1")
        self.scheme.check(driving)
        check_step(self.scheme, bodies, dt, allow_unstable)
        if driving and not allow_unstable:
            check_stride(bodies, dt)
        _check_people(bodies, state)
        if fields is None:
            radius = bodies.radius
            fields = [
                travel_time_field(g, float(radius.max()), min_radius=float(radius.min())) if len(g.exits) else None
                for g in self.geometries
            ]
        self.fields = list(fields)
        boundary = join_boundaries(self.geometries)
        environments = len(state.time)
        which = np.zeros(environments, dtype=np.int64) if geometry_of_env is None else geometry_of_env
        if len(which) != environments or min(which) < 0 or max(which) >= len(self.geometries):
            raise ValueError(
                f"geometry_of_env must name, for each of {environments} environments, "
                f"one of {len(self.geometries)} geometries, 0 to {len(self.geometries) - 1}"
            )
        which = np.asarray(which, dtype=np.int64)
        if len(self.fields) != len(self.geometries):
            raise ValueError(
                f"{len(self.fields)} fields for {len(self.geometries)} geometries; give one (or None) for each"
            )
        self.wayfinder = Wayfinder(self.fields, which, boundary, replan_every)
        guidance = self.wayfinder.guidance
        self.world = World(boundary, self.wayfinder.field, which, guidance)
        doors_of_places = [(p.closed_at_start, p.events) if isinstance(p, Ways) else ((), ()) for p in self.fields]
        self._doorkeeper = Doorkeeper(
            self.geometries, [closed for closed, _ in doors_of_places], [events for _, events in doors_of_places], which
        )
        doors = max(len(place.doors) for place in self.geometries)
        rules = int(np.diff(guidance.rule.start).max(initial=0))
        self._scratch = scratch_of(self.scheme)
        self.memory = allocate_memory(bodies, rules=rules, doors=doors, uses=self._scratch)
        known = (guidance.field_of_route >= 0).sum(axis=1)
        self._routes_of_person = np.repeat(known, np.diff(bodies.env_start))
        _check_routes(state.route, self._routes_of_person)
        self.memory.followed[:] = state.route
        for e in range(environments):
            self.close_doors(e, self._doorkeeper.restart(e))
        # Overlaps, residuals and solver effort since the start of each environment.
        self.diagnostics = no_diagnostics(environments)
        # (P,) who was found outside of the walkable area after any call since the start of the environment: by position
        # alone, whatever the contacts say.  Nobody should be.
        self.escaped = np.zeros(len(bodies.radius), dtype=np.bool_)
        self._border = refer(border_of([place.walkable for place in self.geometries]))
        self._sorted = SortedCrowd(bodies, state, self.memory) if SortedCrowd.is_needed(bodies) else None
        self._control = allocate_control(len(bodies.radius), driving, bounded=not allow_unstable)
        self._batch: Reference | None = None  # what kernels work on
        self._made_of: tuple[object, ...] = ()  # and the tuples that it refers to
        self._pool: ThreadPoolExecutor | None = None

    @property
    def last_diagnostics(self) -> Diagnostics:
        """Overlaps, residuals and solver effort of the last call of `advance`; with one substep, of that step."""
        return self.memory.diagnostics

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
    ) -> None:
        """Advance every environment by ``n_substeps`` physics steps in one compiled call.

        Parameters
        ----------
        command : (P, 2), desired velocity as a multiple of the own desired speed; default (1, 0), straight to the exit.
        relative : (P,), True where the command turns with the direction of the shortest path (default), False where its
            axes are those of the world.
        external_force : (P, 2) N.

        Raises
        ------
        ValueError
            If an array has the wrong shape or holds something that is not finite.
        FloatingPointError
            If someone would move further in one step than the own radius, or a position is no longer finite.
        """
        people = len(self.bodies.radius)
        if relative is not None:
            relative = np.ascontiguousarray(relative, dtype=np.bool_)
            if relative.shape != (people,):
                raise ValueError(f"relative must have the shape ({people},), not {relative.shape}")
        asked = Asked(
            _checked("command", command, (people, 2)),
            relative,
            _checked("external_force", external_force, (people, 2)),
        )
        if n_substeps < 0:
            raise ValueError(f"n_substeps is {n_substeps}; it must be >= 0")
        _check_routes(self.state.route, self._routes_of_person)
        memory = self.memory
        memory.status[:] = OK
        for sums in (memory.push, memory.crush, memory.progress, memory.cut.gate, *memory.diagnostics):
            sums[:] = 0
        if self._sorted is None:
            ask(self._control, asked)
        target = 0
        while target < n_substeps:
            for e in self._doorkeeper.update(self.bodies, self.state):
                self.close_doors(e, self._doorkeeper.closed[e])
            self.wayfinder.update(self.bodies, self.state)
            inside = self.inside
            if self._sorted is not None:
                self._sorted.update(self.bodies, self.state, self.memory)
            waits = [
                self._sorted.steps_until_due(self.state.time, self.dt, inside) if self._sorted is not None else None,
                self.wayfinder.steps_until_due(self.state.time, self.dt, inside),
                self._doorkeeper.steps_until_due(self.state.time, self.dt, inside),
            ]
            target = min([n_substeps, *(target + wait for wait in waits if wait is not None)])
            self._run_until(target, asked)
        add_diagnostics(self.diagnostics, self.memory.diagnostics)
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
        if not len(names) or (self.memory.door_open[e, : len(names)] == stands_open).all():
            return
        self._doorkeeper.closed[e] = shut
        self.memory.door_open[e, : len(names)] = stands_open
        self.memory.near.reach[e] = -1.0
        self.memory.way_age[e] = np.inf
        self.wayfinder.close(e, shut)
        self.world = self.world._replace(field=self.wayfinder.field)

    def _referred(self) -> Reference:
        """Return all that kernels work on, anew if something was replaced."""
        parts = (self.world, self.bodies, self.state, self._control, self.memory)
        if self._batch is None or any(now is not then for now, then in zip(parts, self._made_of, strict=True)):
            batch = Batch(*parts)
            self._made_of = parts
            self._batch = refer(batch if self._sorted is None else self._sorted.stands_in(batch))
        return self._batch

    def _run_until(self, n_substeps: int, asked: Asked) -> None:
        """Advance every environment to step ``n_substeps`` of this call."""
        while True:
            if self._sorted is not None:
                self._sorted.take_in(self.state, self.memory, self._control, asked)
            self._run(self._referred(), n_substeps)
            if self._sorted is not None:
                self._sorted.give_back(self.state, self.memory)
            status = self.memory.status
            stopped = np.flatnonzero((status == DIVERGED) | (status == TOO_FAST))
            if len(stopped):
                e, who = int(stopped[0]), (self.bodies, self.state)
                raise FloatingPointError(why_stopped(self.scheme.info.name, e, int(status[e]), *who, self.dt))
            if not (status == FULL).any():
                return
            # the environments that were full go on where they were
            self.memory = grow_memory(self.memory, self.bodies, self._scratch)

    def _run(self, batch: Reference, n_substeps: int) -> None:
        """Advance the batch on all threads: the kernels hold no lock.

        Either ranges of environments side by side, which share no memory; or, where a crowd is large and the scheme knows how,
        all threads go through all environments together.
        """
        count, threads = len(self.state.time), self.threads
        if threads > 1 and self._is_shared():
            parts = [(0, count, thread, threads) for thread in range(threads)]
        else:
            edges = np.linspace(0, count, min(threads, count) + 1).astype(int).tolist()
            parts = [(first, stop, 0, 1) for first, stop in itertools.pairwise(edges)]
        if len(parts) == 1:
            self.scheme.advance(batch, self.dt, n_substeps, *parts[0])
            return
        if self._pool is None:
            self._pool = ThreadPoolExecutor(threads)
        list(self._pool.map(lambda part: self.scheme.advance(batch, self.dt, n_substeps, *part), parts))

    def _is_shared(self) -> bool:
        """Whether several threads step one crowd together."""
        return bool(self.scheme.slabs(int(np.diff(self.bodies.env_start).max()), self.driving) > 1)

    def restart(
        self, e: int, bodies: Bodies, position: Floats, velocity: Floats | None = None, route: Ints | int = 0
    ) -> None:
        """Begin a new episode in environment ``e`` with other people, as many as before; the others are not touched.

        ``route`` is the number of the way that each means to take; `send` changes it later.

        Raises
        ------
        ValueError
            If the number of people differs.
        """
        people = slice(int(self.bodies.env_start[e]), int(self.bodies.env_start[e + 1]))
        if len(bodies.radius) != people.stop - people.start:
            raise ValueError(f"environment {e} holds {people.stop - people.start} people, not {len(bodies.radius)}")
        _check_routes(np.broadcast_to(route, (people.stop - people.start,)), self._routes_of_person[people])
        for name in Bodies._fields[:-1]:
            getattr(self.bodies, name)[people] = getattr(bodies, name)
        state = self.state
        state.position[people] = position
        state.velocity[people] = 0.0 if velocity is None else velocity
        state.angle[people] = 0.0
        state.spin[people] = 0.0
        state.active[people] = True
        state.exit_time[people] = np.nan
        state.exit_index[people] = -1
        state.route[people] = route
        self.memory.followed[people] = route
        self.wayfinder.restart(e)
        if self._sorted is not None:
            self._sorted.restart(e)
        self.close_doors(e, self._doorkeeper.restart(e))
        self.memory.rule_on[e] = False
        state.time[e] = 0.0
        self.memory.phase[e] = 0
        self.memory.way_age[e] = np.inf
        self.memory.near.reach[e] = -1.0
        self.memory.contacts.number[e] = 0
        self.memory.push[people] = 0.0
        self.memory.crush[people] = 0.0
        for total in (*self.diagnostics, *self.memory.diagnostics):
            total[e] = 0
        self.escaped[people] = False

    def send(self, e: int, route: Ints | int) -> None:
        """Let everyone in environment ``e`` take another way: one number for all, or one each.

        Raises
        ------
        ValueError
            If there is no such way.
        """
        people = slice(int(self.bodies.env_start[e]), int(self.bodies.env_start[e + 1]))
        wanted = np.broadcast_to(np.asarray(route, dtype=np.int64), (people.stop - people.start,))
        _check_routes(wanted, self._routes_of_person[people])
        self.state.route[people] = wanted
        self.memory.followed[people] = wanted
        self.memory.way_age[e] = np.inf

    def contacts(self, e: int = 0) -> ContactList:
        """Return a copy of the contacts of environment ``e``."""
        contacts, begin = self.memory.contacts, int(self.memory.near.entry_start[e])
        rows = slice(begin, begin + int(contacts.number[e]))
        first, i, j, normal = self.bodies.env_start[e], contacts.i[rows], contacts.j[rows], contacts.normal[rows]
        order = np.arange(len(i))
        if self._sorted is not None:
            i, j, normal, order = self._sorted.by_slot(i, j, normal)
        return ContactList(
            i - first,
            np.where(j >= 0, j - first, j),
            contacts.gap[rows][order].copy(),
            normal.copy(),
            contacts.impulse[rows][order].copy(),
            bool(self.diagnostics.unconverged[e] == 0),
        )


def _checked(name: str, values: Floats | None, shape: tuple[int, int]) -> Floats | None:
    """Return ``values`` as kernels want them: a kernel would read past the end of an array that is too short."""
    if values is None:
        return None
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.shape != shape:
        raise ValueError(f"{name} must have the shape {shape}, not {array.shape}")
    if not np.isfinite(array).all():
        bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
        raise ValueError(f"{name} of pedestrian {bad[0]} is {array[bad[0]].tolist()}; it must be finite")
    return array


def check_step(scheme: ContactScheme, bodies: Bodies, dt: float, allow_unstable: bool = False) -> None:
    """Raise ValueError unless ``dt`` is positive and, if that matters, at most the scheme's stable step."""
    if not (np.isfinite(dt) and dt > 0):
        raise ValueError(f"dt is {dt!r} s; it must be finite and > 0")
    limit = scheme.stable_dt(bodies)
    if dt > limit and not allow_unstable:
        raise ValueError(
            f"dt = {dt:g} s is above the stable step of {scheme.info.name}, {limit:.4g} s for these people: "
            f"{scheme.info.stable_step}"
        )


def _check_routes(route: Ints, known: Ints) -> None:
    """Raise ValueError unless everyone's route is one of those that are known to him: kernels look it up unseen."""
    if ((route < 0) | (route >= known)).any():
        bad = np.flatnonzero((route < 0) | (route >= known))
        raise ValueError(f"route of pedestrian {bad[0]} is {route[bad[0]]}; it must be from 0 to {known[bad[0]] - 1}")


def _check_people(bodies: Bodies, state: CrowdState) -> None:
    if len(bodies.radius) != len(state.position):
        raise ValueError(f"{len(bodies.radius)} bodies but {len(state.position)} positions")
    if int(bodies.env_start[-1]) != len(bodies.radius) or len(bodies.env_start) != len(state.time) + 1:
        raise ValueError("env_start must run from 0 to the number of people, with one entry more than state.time")
    for name in ("position", "velocity"):
        bad = np.flatnonzero(~np.isfinite(getattr(state, name)).all(axis=1))
        if len(bad):
            raise ValueError(f"{name} of pedestrian {bad[0]} is not finite")
