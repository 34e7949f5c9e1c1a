"""The simulation of a batch of crowds.  No rewards, no agents: give it commands, advance it, read its arrays."""

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Bodies, Bools, CrowdState, Floats, Ints, check_bodies, check_state, make_state
from crowd_env.core.behaviors.behavior import record
from crowd_env.core.behaviors.headway import Headway
from crowd_env.core.behaviors.outline import Outline, room_of
from crowd_env.core.behaviors.pulls import has_groups
from crowd_env.core.checks import NOT_NEGATIVE, known, whole
from crowd_env.core.files.fingerprint import fingerprint
from crowd_env.core.kernels.struct_ref import struct_ref
from crowd_env.geometry.entrances import Entries
from crowd_env.geometry.geometry import Boundary, Geometry, join_all_surfaces, join_boundaries
from crowd_env.geometry.inside import border_of, mark_outside
from crowd_env.geometry.wall_grid import make_wall_grid
from crowd_env.physics.contacts import ContactList, rows_of
from crowd_env.physics.driving_force import desire_of
from crowd_env.physics.neighbors.lists import invalidate_lists
from crowd_env.physics.scheme import arrays_of
from crowd_env.physics.settings import AsPhysics, AsWalking, Physics, Walking, check_behaviors, kinds_of
from crowd_env.physics.simulation import arguments
from crowd_env.physics.simulation.checkpoint import (
    Checkpoint,
    load_history,
    require_checkpoint,
    require_same,
    save_history,
    write_arrays,
)
from crowd_env.physics.simulation.entrances import Entrances
from crowd_env.physics.simulation.gates import Gates
from crowd_env.physics.simulation.heights import Heights
from crowd_env.physics.simulation.stepper import Stepper
from crowd_env.physics.social_force import social_forces_of_walls
from crowd_env.physics.spatial_order import SortedCrowd, between
from crowd_env.physics.step import pass_time
from crowd_env.physics.workspace import (
    Batch,
    Command,
    World,
    add_diagnostics,
    allocate_control,
    allocate_history,
    allocate_results,
    allocate_workspace,
    begin_history,
    begin_results,
    by_reference,
    no_diagnostics,
    replace_arrays,
)
from crowd_env.routing.door_schedule import DoorSchedule
from crowd_env.routing.fields.field import NavigationField
from crowd_env.routing.replanning import RoutePlanner
from crowd_env.routing.route_set import RouteSet

_IN_PLACE = ("world", "state", "bodies", "results", "history", "workspace")  # callers hold references to their arrays


class Simulation:
    """A batch of crowds under one contact scheme.

    Parameters
    ----------
    geometry : one for all environments, or several together with ``geometry_of_env``.
    bodies, state : arrays of all environments; the simulation works on them in place.  Arrays may be written to, but not
        replaced: `checkpoint` and `restore` go back to another moment.
    physics : a `Physics`, a name in ``SCHEMES`` or a contact scheme, or a table of the fields of one of them.  Its step is by
        default the scheme's longest, 0.01 or (hertz) 0.005 s, less with several discs a body.  An outline sets
        ``bodies.inertia``, and its pedestrians face their way at the start, unless an angle in ``state`` is set.
    walking : a `Walking`, a name in ``MANNERS`` or a `Headway`, or a table of the fields of one of them; by default people walk
        at full speed whatever is in front of them.  Its pulls keep groups (``bodies.group``) together.
    fields : travel-time field or routes of each geometry; made here by default for geometries with exits.
    driving : True for pedestrians (driving force, eq 11, and social force), False for passive grains.

    Raises
    ------
    ValueError
        If ``dt`` is not positive or above the stable step, an array has the wrong shape or type or does not fit the others, a
        position is not finite, a body is impossible, or the scheme refuses the use.
    """

    def __init__(
        self,
        geometry: Geometry | Sequence[Geometry],
        bodies: Bodies,
        state: CrowdState,
        *,
        physics: AsPhysics = "nsm2",
        walking: AsWalking = None,
        fields: Sequence[RouteSet | NavigationField | None] | None = None,
        geometry_of_env: Ints | None = None,
        driving: bool = True,
    ) -> None:
        self.geometries = [geometry] if isinstance(geometry, Geometry) else list(geometry)
        check_bodies(bodies)
        check_state(state, bodies)
        self.bodies, self.state, self.driving = bodies, state, driving
        self.physics, self.walking = physics, walking = Physics.of(physics), Walking.of(walking)
        self.scheme, self.threads, self.allow_unstable = physics.law, physics.threads, physics.allow_unstable
        self.scheme.check(driving)
        self.behaviors = arguments.behaviors_of_simulation(physics, walking, len(self.geometries))
        check_behaviors(self.behaviors, self.scheme, driving)
        self.outline: Outline | None = self.behaviors[Outline.NAME]
        # Independent of the batch: a crowd alone has the same bits.
        parts = 1.0 if self.outline is None else np.ceil(1.0 / self.outline.step_share)
        self.dt = dt = self.scheme.info.default_dt / parts if physics.dt is None else physics.dt
        arguments.check_step(self.scheme, bodies, dt, self.allow_unstable, self.outline)
        self.fields = arguments.fields_of(self.geometries, fields, bodies)
        which = arguments.which_geometry(geometry_of_env, len(state.time), len(self.geometries))
        boundary = join_boundaries(self.geometries)
        keep_distance = self.behaviors[Headway.NAME] is not None
        self.planner = RoutePlanner(self.fields, which, boundary, keep_distance=keep_distance)
        self._set_inertia(slice(None))
        plans = [place.plan if isinstance(place, RouteSet) else None for place in self.fields]
        closed, events = ([getattr(plan, name, ()) for plan in plans] for name in ("closed_at_start", "events"))
        self._door_schedule = DoorSchedule(self.geometries, closed, events, which)
        gates = [getattr(plan, "gates", ()) for plan in plans]
        self._gates = Gates(self.geometries, gates, which)
        self._waits = any(getattr(route, "via", None) for plan in plans for route in getattr(plan, "routes", ()))
        self.entrances = Entrances(bodies, room_of(self.outline))
        routes = (self.planner.guidance.field_of_route >= 0).sum(axis=1)
        self._routes_of_person = np.repeat(routes, np.diff(bodies.env_start))
        arguments.check_routes(state.route, self._routes_of_person)
        sheets = np.array([1 if place.building is None else len(place.building.sheets) for place in self.geometries])
        self._sheets_of_person = np.repeat(sheets[which], np.diff(bodies.env_start))
        arguments.check_sheets(state.sheet, self._sheets_of_person)
        batch = self._build(boundary, which)
        self.world, self.results = batch.world, batch.results
        self.history, self.workspace = batch.history, batch.workspace
        # Overlaps, residuals and solver effort since the start of each environment.
        self.diagnostics = no_diagnostics(len(state.time))
        # (P,) found outside of the walkable area after any call since the start of the environment, by position alone,
        # whatever the contacts.  All should be False.
        self.escaped = np.zeros(len(bodies.radius), dtype=bool)
        self._heights = Heights(self.world.surface, which, self.history.height_due)
        self._border = struct_ref(border_of([place.walkable for place in self.geometries]))
        self._sorted = SortedCrowd(batch) if SortedCrowd.is_needed(bodies) else None
        desire = desire_of(walking.others)
        self._stepper = Stepper(self.scheme, batch, self._sorted, self.threads, self._uses, desire)
        self.batch, self.ranges = self._stepper.batch, self._stepper.ranges  # what kernels work on, and side by side
        self.told_of_fields: list[Callable[[], object]] = []  # called when the planner has other fields
        for e in range(len(state.time)):
            self.close_doors(e, self._door_schedule.restart(e))
        self.listeners: list[Callable[[], object]] = []  # called after every physics step: same bits, but slower
        self.times_restored = 0  # shows callers that their records are of another moment

    def _build(self, boundary: Boundary, geometry_of_env: Ints) -> Batch:
        """Return the arrays of a step: world, commands, results, history and scratch."""
        bodies, guidance, kinds = self.bodies, self.planner.guidance, kinds_of(self.walking)
        params = record(**{name: kind.params_of(self.behaviors[name]) for name, kind in kinds.items()})
        acts = {name: kind.acts(self.behaviors[name], bodies) for name, kind in kinds.items()}
        uses = arrays_of(self.scheme, [kind for name, kind in kinds.items() if acts[name]])
        uses |= {name for name, used in (("gates", bool(self._gates)), ("waiting", self._waits)) if used}
        self._uses = uses
        control = allocate_control(len(bodies.radius), self.driving, not self.allow_unstable)
        headway = self.behaviors[Headway.NAME]
        workspace = allocate_workspace(bodies, uses=uses, discs=len(params.outline.radius))
        signs = int(np.diff(guidance.rule.start).max(initial=0))
        doors = max(len(place.doors) for place in self.geometries)
        acting = {name: (kind, acts[name]) for name, kind in kinds.items()}
        history = allocate_history(bodies, workspace.neighbors, signs, doors, uses, acting)
        history.followed[:] = self.state.route
        for e in range(len(self.state.time)):
            history.is_gate[e, self._gates.doors_of(e)] = True
        surface = join_all_surfaces(self.geometries)
        walls = make_wall_grid(boundary, None if headway is None else headway.sight + 1.0, surface)
        world = World(boundary, by_reference(self.planner.field), geometry_of_env, guidance, walls, surface)
        results = allocate_results(len(bodies.radius), len(self.state.time))
        return Batch(world, params, record(**acts), bodies, self.state, control, results, history, workspace)

    def __setattr__(self, name: str, value: Any) -> None:
        """Refuse to replace arrays that observers and environments refer to: they would read dead arrays."""
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

    @property
    def laid_out(self) -> Floats:
        """Where people are in the layout of their place (P, 2) [m]: in a place of one sheet, their positions."""
        surface, first = self.world.surface, self.world.surface.sheet_start[self.world.geometry_of_env]
        if not surface.offset.any():
            return self.state.position
        return self.state.position + surface.offset[np.repeat(first, np.diff(self.bodies.env_start)) + self.state.sheet]

    @cached_property
    def has_groups(self) -> bool:
        """Whether any group had two members when the simulation was made."""
        return has_groups(self.bodies)

    def _set_inertia(self, people: slice | Ints) -> None:
        """Set the inertia of bodies with an outline."""
        if self.outline is not None:
            self.bodies.inertia[people] = self.outline.inertia(self.bodies.mass[people], self.bodies.radius[people])

    def advance(
        self,
        command: Floats | None = None,
        *,
        relative: Bools | None = None,
        n_substeps: int = 1,
        external_force: Floats | None = None,
        gives_way: Bools | None = None,
        then: Callable[[int, int], object] | None = None,
    ) -> None:
        """Advance every environment by ``n_substeps`` physics steps in one compiled call.

        Parameters
        ----------
        command : (P, 2), desired velocity over desired speed; default (1, 0), straight to the exit.
        relative : (P,), True where the command turns with the direction of the shortest path (default), False where its
            axes are the world's.
        external_force : (P, 2) N.
        gives_way : (P,), False for people that follow their command exactly and keep no headway; default True.
        then : called with ``first, stop`` after the last step of these environments; several threads may call it at once.

        Raises
        ------
        ValueError
            If an array has the wrong shape, a value is not finite, or ``n_substeps`` is no whole number from 0.
        FloatingPointError
            If a body would move further in one step than its radius, or a position is no longer finite.
        """
        asked = arguments.check_command(Command(command, relative, external_force, gives_way), len(self.bodies.radius))
        if type(n_substeps) is not int or n_substeps < 0:
            n_substeps = whole("n_substeps", n_substeps, NOT_NEGATIVE)
        arguments.check_routes(self.state.route, self._routes_of_person)
        self._stepper.begin(asked)
        target = 0
        while target < n_substeps:
            self._let_in()
            for e, closed in self._door_schedule.update(self.bodies, self.state, self.history.door_open):
                self.close_doors(e, closed)
            self.planner.update(self.bodies, self.state)
            self._admit()
            self._look_up_heights()
            inside = self.inside
            if self._sorted is not None:
                self._sorted.update(self.history.contacts, self.workspace.neighbors)
            busy = inside + self.entrances.coming if self.entrances.are_used else inside
            tasks: list[tuple[Any, Ints]] = [(self._sorted, busy), (self._door_schedule, busy), (self.entrances, busy)]
            tasks += [(self.planner, inside), (self._gates, inside), (self._heights, inside)]
            waits = [task.steps_until_due(self.state.time, self.dt, n) for task, n in tasks if task is not None]
            waits += [1] if self.listeners else []
            target = min([n_substeps, *(target + wait for wait in waits if wait is not None)])
            self._stepper.run_until(target, self.dt, self._finish(target, then if target == n_substeps else None))
            for listen in self.listeners:
                listen()
        add_diagnostics(self.diagnostics, self.results.diagnostics)
        state, geometry_of_env = self.state, self.world.geometry_of_env
        at = self.laid_out
        mark_outside(self._border, geometry_of_env, self.bodies.env_start, state.active, at, self.escaped)

    def _let_in(self, only: int | None = None) -> None:
        """Let in the people that are due, into ``only`` one environment or all."""
        for e in self.entrances.update(self.state, only):
            invalidate_lists(self.workspace.neighbors, e)
            self.history.directions_known[e] = False
            if self._sorted is not None:
                self._sorted.gather_bodies(self._people(e))

    def _admit(self) -> None:
        """Let gates admit people."""
        if not self._gates:
            return
        direction, admitted = self.in_slots(self.history.direction), self.in_slots(self.history.admitted)
        for e in self._gates.update(self.bodies, self.state, direction, admitted):
            self.history.admitted[:] = admitted if self._sorted is None else admitted[self._sorted.slot]
            invalidate_lists(self.workspace.neighbors, e)

    def _look_up_heights(self) -> None:
        """Look up the heights of people in buildings, by which neighbors are listed."""
        height = self.history.height if self._sorted is None else self.in_slots(self.history.height)
        for e in self._heights.update(self.bodies, self.state, height):
            invalidate_lists(self.workspace.neighbors, e)
            if self._sorted is not None:
                self.history.height[:] = height[self._sorted.slot]

    def _finish(self, target: int, then: Callable[[int, int], object] | None) -> Callable[[int, int], object]:
        """Return what is done after step ``target``: the clock of an empty place goes on while people are to come."""
        waiting, batch = self.entrances.coming > 0 if self.entrances.are_used else None, self.batch

        def finish(first: int, stop: int) -> None:
            if waiting is not None:
                pass_time(batch, self.dt, target, first, stop, waiting)
            if then is not None:
                then(first, stop)

        return finish

    def close_doors(self, e: int, closed: Iterable[str]) -> None:
        """Close these doors of environment ``e`` and open all others; routes follow.

        Raises
        ------
        ValueError
            If a name is unknown.
        """
        names, shut = self.geometries[self.world.geometry_of_env[e]].doors, frozenset(closed)
        for name in shut:
            known("door", name, names)
        stands_open = np.array([name not in shut for name in names], dtype=bool)
        if not len(names) or (self.history.door_open[e, : len(names)] == stands_open).all():
            return
        self.history.door_open[e, : len(names)] = stands_open
        invalidate_lists(self.workspace.neighbors, e)
        self.history.directions_known[e] = False
        self.planner.close(e, shut)
        self._take_fields()

    def _take_fields(self) -> None:
        replace_arrays(self.world.field, self.planner.field)
        for tell in self.told_of_fields:
            tell()

    def _people(self, e: int) -> slice:
        """Return the slots of environment ``e``; ValueError if there is no such environment."""
        if not 0 <= e < len(self.state.time):
            raise ValueError(f"there is no environment {e!r}; they are numbered 0 to {len(self.state.time) - 1}")
        return slice(int(self.bodies.env_start[e]), int(self.bodies.env_start[e + 1]))

    def restart(
        self,
        e: int | Sequence[int],
        bodies: Bodies,
        position: Floats,
        velocity: Floats | None = None,
        route: Ints | int = 0,
        entries: Sequence[Entries | None] | None = None,
        sheet: Ints | int = 0,
    ) -> None:
        """Begin a new episode in environment ``e`` with the same number of people; other environments are not touched.

        Several environments at once are quicker: then all people are given in the order of ``e``.  ``route`` is the number of
        the route of each pedestrian; `send` changes it later.  Routes that depend on the crowd are computed at once.
        ``entries`` are given for each environment of ``e``; by default all people are there at the start.

        Raises
        ------
        ValueError
            If the number of people differs, an array has the wrong shape, or a value is out of range.
        """
        chosen = [e] if isinstance(e, int | np.integer) else [*e]
        people = np.concatenate([np.arange(*self._people(each).indices(len(self.state.route))) for each in chosen])
        count = len(people)
        check_bodies(bodies)
        if len(bodies.radius) != count:
            raise ValueError(f"environment {e} holds {count} people, not {len(bodies.radius)}")
        if not self.has_groups and has_groups(bodies):
            raise ValueError(
                "no group had two members when the simulation was made, so bodies.group must be -1 here too"
            )
        arguments.check_step(self.scheme, bodies, self.dt, self.allow_unstable, self.outline)
        stand = arguments.vectors("position", position, count)
        walk = None if velocity is None else arguments.vectors("velocity", velocity, count)
        routes = arguments.routes_of(route, self._routes_of_person[people])
        start = make_state(stand, walk, sheet=sheet)
        arguments.check_sheets(start.sheet, self._sheets_of_person[people])
        arrays = (*self.bodies[:-1], *self.state[:-1])
        for array, values in zip(arrays, (*bodies[:-1], *start[:-1]), strict=True):
            array[people] = values
        self._set_inertia(people)
        self.state.route[people], self.state.time[chosen], self.escaped[people] = routes, 0.0, False
        begin_history(chosen, people, self.history, self.bodies, routes)
        for late in (self.history.force, self.history.torque) if entries else ():
            late[people[: len(late)]] = 0.0  # the first forces are of people inside alone
        begin_results(chosen, people, self.results, self.diagnostics)
        invalidate_lists(self.workspace.neighbors, chosen)
        for each, come in zip(chosen, entries or [None] * len(chosen), strict=True):
            self.entrances.restart(each, come, self.state)
            self._let_in(each)
            self._gates.restart(each)
            if self._sorted is not None:
                self._sorted.restart(each)
            self.planner.restart(each)
            self.close_doors(each, self._door_schedule.restart(each))
            self.planner.update(self.bodies, self.state, only=each)

    def _made_by(self) -> dict[str, Any]:
        """Return what a simulation must have in common with this one to restore a checkpoint of it."""
        chosen = {"scheme": self.scheme, **self.behaviors, "dt": self.dt, "driving": self.driving}
        chosen["has_groups"] = self.has_groups
        env_start, sorting = self.bodies.env_start.tolist(), self._sorted is not None
        world, guidance = self.world, self.world.guidance
        place, routing = (
            fingerprint(world.boundary, world.geometry_of_env),
            fingerprint(guidance.goal, guidance.following),
        )
        batch = {"env_start": env_start, "sorting": sorting, "place": place, "routing": routing}
        return {**chosen, **batch}

    def checkpoint(self) -> Checkpoint:
        """Return a copy of all that the future depends on, to `restore` here or in a simulation made in the same way."""
        return Checkpoint(
            self._made_by(),
            Bodies._make(array.copy() for array in self.bodies),
            self.state.copy(),
            save_history(self.history, self.workspace.neighbors),
            self.results.copy(),
            self.diagnostics.copy(),
            self._door_schedule.moment(),
            self.planner.moment(),
            None if self._sorted is None else self._sorted.order(),
            self.escaped.copy(),
            self.entrances.moment(),
            self._gates.moment(),
        )

    def restore(self, checkpoint: Checkpoint) -> None:
        """Go back to a moment; the same commands then lead bit by bit to the same future.

        All arrays of `state`, `bodies`, `results` and `history` are written in place, so all references to them stay valid.

        Raises
        ------
        TypeError
            If it is no checkpoint of a simulation.
        ValueError
            If the simulation of the checkpoint has other people, places, scheme or steps.
        """
        require_checkpoint(checkpoint, Checkpoint, "a simulation")
        require_same(self._made_by(), checkpoint.made_by)
        while (checkpoint.history.contacts > np.diff(self.workspace.neighbors.entry_start)).any():
            self._stepper.grow()
        load_history(self.history, self.workspace, checkpoint.history)
        for name in ("bodies", "state", "results", "diagnostics"):
            write_arrays(getattr(self, name), getattr(checkpoint, name))
        self.escaped[:] = checkpoint.escaped
        self._door_schedule.restore(checkpoint.doors)
        self.entrances.restore(checkpoint.entries)
        self._gates.restore(checkpoint.gates)
        self.planner.restore(checkpoint.route_set)
        self._take_fields()
        if self._sorted is not None and checkpoint.order is not None:
            self._sorted.restore(checkpoint.order)
        self.times_restored += 1

    def send(self, e: int, route: Ints | int) -> None:
        """Give the people in environment ``e`` another route: one number for all, or one each.

        Raises
        ------
        ValueError
            If there is no such route.
        """
        people = self._people(e)
        wanted = arguments.routes_of(route, self._routes_of_person[people])
        self.state.route[people] = wanted
        self.history.followed[people] = wanted
        self.history.directions_known[e] = False

    def hold(self, e: int, stay: Floats, spot: Floats) -> None:
        """Set how long (N,) [s] and where (N, 2) [m] people of environment ``e`` wait in the region of their route.

        It holds until the environment restarts, and is set before the first step.  Where the spot is nan, people stand where
        they come into the region.
        """
        people = self._people(e)
        self.history.stay[people], self.history.spot[people] = stay, spot

    def set_motivation(
        self, e: int, *, time_gap: Floats | float | None = None, push: Floats | float | None = None
    ) -> None:
        """Change time gap or push of the people in environment ``e`` until the environment restarts.

        The change acts from the next decision on, at most `Headway.interval` later.

        Parameters
        ----------
        time_gap : s, one number for all or one each (N,); nan = that of the manner; None = as before.
        push : share of the desired speed that is kept with no gap in front, given as ``time_gap``.

        Raises
        ------
        ValueError
            If there is no such environment, a value is out of range, or people keep no headway.
        """
        people = self._people(e)
        if self.behaviors[Headway.NAME] is None:
            needed = "a motivation needs a manner of the simulation"
            raise ValueError(f"people walk at full speed here, whatever is in front: {needed}")
        count = people.stop - people.start
        given = {name: value for name, value in (("time_gap", time_gap), ("push", push)) if value is not None}
        wanted = {name: arguments.motivation_of(name, value, count) for name, value in given.items()}
        for name, values in wanted.items():
            getattr(self.bodies, name)[people] = values
        if self._sorted is not None:
            self._sorted.gather_bodies(people)

    def social_forces_of_walls(self) -> Floats:
        """Return the social force [N] of walls on all people (P, 2) at the present positions; 0 where walls have none."""
        force, social = np.zeros((len(self.bodies.radius), 2)), self.scheme.social
        if social is None or social.wall_strength == 0.0:
            return force
        social_forces_of_walls(self.batch, social.params(), force)
        return self.in_slots(force)

    def in_slots(self, values: Any) -> Any:
        """Return a copy of an array (P, ...) of the history in slot order."""
        found = values.copy()
        if self._sorted is not None:
            found[self._sorted.slot] = values
        return found

    def contacts(self, e: int = 0) -> ContactList:
        """Return a copy of the contacts of environment ``e``."""
        first, contacts = self._people(e).start, self.history.contacts
        rows, converged = rows_of(e, contacts, self.workspace.neighbors), bool(self.diagnostics.unconverged[e] == 0)
        names = ("i", "j", "gap", "normal", "impulse", "disc_i", "disc_j")
        i, j, gap, normal, impulse, disc_i, disc_j = (getattr(contacts, name)[rows].copy() for name in names)
        if self._sorted is not None:
            i, j, normal, disc_i, disc_j, order = between(self._sorted.slot, i, j, normal, disc_i, disc_j)
            gap, impulse = gap[order], impulse[order]
        discs = (disc_i, disc_j) if len(contacts.disc_i) else (None, None)
        return ContactList(i - first, np.where(j >= 0, j - first, j), gap, normal, impulse, converged, *discs)
