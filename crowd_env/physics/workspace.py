"""All that a step works on: the world around the crowd, what is asked of it, results, history and scratch."""

from collections.abc import Callable, Collection
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from crowd_env.core.arrays.headway import Headway, HeadwayParams
from crowd_env.core.arrays.outline import OutlineParams
from crowd_env.core.arrays.state import Bodies, Bools, CrowdState, Floats, Indices, Ints
from crowd_env.core.kernels.struct_ref import StructRef, struct_ref
from crowd_env.geometry.geometry import Boundary
from crowd_env.geometry.wall_grid import WallGrid
from crowd_env.physics.constraints import Constraints, allocate_constraints
from crowd_env.physics.contacts import Contacts, allocate_contacts, move_contacts
from crowd_env.physics.dem_lanes.buffers import SoABuffers, allocate_buffers
from crowd_env.physics.dem_lanes.partition import Partition, allocate_partition, count_slabs
from crowd_env.physics.neighbors.lists import NeighborList, allocate_neighbors, entries_per_person
from crowd_env.routing.fields.lookup import FieldArrays
from crowd_env.routing.rules import Guidance

Arrays = TypeVar("Arrays", bound=tuple[Any, ...])

LOOKUP_PERIOD = 4  # in which those look for their way who need not do so every time


class World(NamedTuple):
    """Everything that stands still."""

    boundary: Boundary  # walls, corners and exits of all geometries
    field: FieldArrays  # directions and travel times of all routes
    geometry_of_env: Ints  # (E,)
    guidance: Guidance  # routes, regions and control rules
    wall_grid: WallGrid  # which walls may hide people from each other; empty where nobody keeps a headway
    outline: OutlineParams  # shape of all bodies; without discs where each is one disc


class Control(NamedTuple):
    """What is asked of everyone during one call."""

    command: Floats  # (P, 2)  desired velocity as a multiple of the own desired speed
    relative: Bools  # (P,)    command turns with the direction of the shortest path; else along the world axes
    external_force: Floats  # (P, 2)  N
    gives_way: Bools  # (P,)    keeps the headway, where people keep any
    headway: HeadwayParams
    keeps_headway: bool
    max_drive: float  # N  largest driving force of a person; infinite = no limit
    driving: bool  # pedestrians (eq 11) or passive grains
    bounded: bool  # nobody is too fast, goes too far in a step, or through a wall: see `crowd_env.physics.bounds`


class Command(NamedTuple):
    """What a caller asks for; None = the default."""

    command: Floats | None  # (1, 0): straight along the way
    relative: Bools | None  # True
    external_force: Floats | None  # 0
    gives_way: Bools | None  # True


class Diagnostics(NamedTuple):
    """What went on, over the steps of one call or of a whole episode, per environment."""

    max_overlap: Floats  # (E,)  m    deepest overlap of two bodies or of a body and a wall
    overlap_sum: Floats  # (E,)  m    over all overlapping contacts of all steps
    overlap_count: Ints  # (E,)
    max_outside: Floats  # (E,)  m    furthest that a body reached beyond a wall
    max_speed: Floats  # (E,)  m/s  of anyone, after any step
    residual: Floats  # (E,)  m/s  worst complementarity residual left by the solver
    iterations: Ints  # (E,)       solver sweeps in all
    unconverged: Ints  # (E,)       steps that ended above the tolerance

    def copy(self) -> "Diagnostics":
        """Return an independent copy."""
        return Diagnostics._make(array.copy() for array in self)


class Results(NamedTuple):
    """What a call of `Simulation.advance` tells: of the current or last call, for everyone to read."""

    impulse: Floats  # (P, 2)  N s  sum of the contact impulses on each person
    impulse_magnitude: Floats  # (P,)    N s  sum of their magnitudes
    diagnostics: Diagnostics

    def copy(self) -> "Results":
        """Return an independent copy."""
        return Results(self.impulse.copy(), self.impulse_magnitude.copy(), self.diagnostics.copy())


class History(NamedTuple):
    """What the next step depends on besides bodies, state and command: a checkpoint keeps it."""

    contacts: Contacts  # of the last step, and what a scheme keeps of them
    force: Floats  # (P, 2)  N    all but contact; hertz: of the end of the last step, contact too
    torque: Floats  # (P,)    N m
    phase: Ints  # (E,)    how far a step is that needs the forces of the one before; 0 = they are not known
    direction: Floats  # (P, 2)  of the route when it was last looked up
    directions_known: Bools  # (E,)    else they must be looked up for everyone
    direction_age: Floats  # (E,)    s  since the last look-up
    is_uniform: Bools  # (P,)    the direction is nearly the same all around: it need not be looked up every time
    lookup_turn: NDArray[np.uint8]  # (P,)    when it is, 0 to LOOKUP_PERIOD - 1
    turn: Ints  # (E,)    which of these turns was the last
    followed: Ints  # (P,)    route that one follows: one's own, or that of a control rule
    region_bits: Ints  # (P,)    regions that one stands in
    local_speed: Floats  # (P,)    m/s  desired speed there
    rule_on: Bools  # (E, K)  control rules of each environment
    rule_since: Floats  # (E, K)  s  when they were switched on
    door_open: Bools  # (E, D)
    walking_velocity: Floats  # (P, 2)  m/s  that everyone has last decided to walk at
    waited: Floats  # (P,)    s  stood still
    have_decided: Bools  # (E,)  how to walk, since the start
    decision_age: Floats  # (E,)    s  since then


class NarrowPhase(NamedTuple):
    """Scratch of the search for contacts."""

    candidates: Indices  # (M,)    entries of the neighbor list that may be contacts
    old_key: Ints  # (M,)    keys and history of the contacts of the last step
    old_history: Floats  # (M, 2)
    old_disc: Ints  # (M, 2)  which discs touched; empty without an outline


class Discs(NamedTuple):
    """Where the discs of all bodies are, K a person one behind the other; empty without an outline."""

    x: Floats  # (P K,)  m    from the center of the body
    y: Floats  # (P K,)  m
    radius: Floats  # (P K,)  m
    cosine: Floats  # (P,)    where a body faces
    sine: Floats  # (P,)


class SocialPairs(NamedTuple):
    """Scratch of the social force: the pairs near enough for it, (M,) each."""

    entry: Indices  # of the neighbor list
    x: Floats  # unit vector from the second to the first
    y: Floats
    size: Floats  # N


class Walkers(NamedTuple):
    """Scratch of a decision."""

    way_x: Floats  # (P,)  unit vector along the way that everyone wants to take
    way_y: Floats
    speed: Floats  # (P,)  m/s  desired
    reach: Floats  # (P,)  m    gap up to which others matter
    x: Floats  # (P,)  m    positions and radii in the order of cells
    y: Floats
    radius: Floats  # (P,)  m
    slot: Indices  # (P,)  whose they are
    columns: Ints  # (E,)  of cells
    rows: Ints
    seen: Indices  # (K P,)  places in that order of those in front of one; K lists side by side where a crowd is cut


class Workspace(NamedTuple):
    """Scratch: what is made anew whenever it is not there."""

    neighbors: NeighborList
    narrow_phase: NarrowPhase
    discs: Discs
    constraints: Constraints
    soa: SoABuffers
    partition: Partition
    social_pairs: SocialPairs
    walkers: Walkers
    inside: Indices  # (P,)   who is inside, environment e from env_start[e] on: see `step.list_active`
    desired_velocity: Floats  # (P, 2) m/s
    heading: Floats  # (P, 4) desired direction times the anisotropy of the social force; the desired velocity it is of
    previous_position: Floats  # (P, 2) m    at the start of the step
    previous_velocity: Floats  # (P, 2) m/s  at the start of the step
    trial_velocity: Floats  # (P, 2) m/s  before contacts change it
    correction_velocity: Floats  # (P, 2) m/s  that takes back overlaps, used for one step and forgotten
    substep: Ints  # (E,)   steps done in the current call
    status: Ints  # (E,)   OK, FULL, DIVERGED or TOO_FAST


class Batch(NamedTuple):
    """All a step works on; kernels take it as one argument.

    What may get other arrays is held by reference (`StructRef`): the fields of the world, the contacts of the history, and of
    the workspace all that has as many rows as the neighbor list.
    """

    world: World
    bodies: Bodies
    state: CrowdState
    control: Control
    results: Results
    history: History
    workspace: Workspace


def allocate_control(
    people: int,
    driving: bool,
    bounded: bool = True,
    headway: Headway | None = None,
    max_drive: float | None = None,
) -> Control:
    """Return room for what is asked of so many people."""
    return Control(
        np.zeros((people, 2)),
        np.ones(people, dtype=np.bool_),
        np.zeros((people, 2)),
        np.ones(people, dtype=np.bool_),
        (headway or Headway()).params(),
        headway is not None,
        np.inf if max_drive is None else max_drive,
        driving,
        bounded,
    )


def set_command(control: Control, asked: Command, copy: Callable[[Any, Any], None] = np.copyto) -> None:
    """Write what is asked for to where kernels read it; ``copy`` is given an array and what goes there."""
    defaults: tuple[Any, ...] = ((1.0, 0.0), True, 0.0, True)
    for array, values, default in zip(control[:4], asked, defaults, strict=True):
        if values is None:
            array[:] = default
        else:
            copy(array, values)


def no_diagnostics(environments: int) -> Diagnostics:
    """Return diagnostics of no step at all."""

    def reals() -> Floats:
        return np.zeros(environments)

    def counts() -> Ints:
        return np.zeros(environments, dtype=np.int64)

    return Diagnostics(reals(), reals(), counts(), reals(), reals(), reals(), counts(), counts())


def add_diagnostics(total: Diagnostics, call: Diagnostics) -> None:
    """Add those of a call to the total, in place."""
    for name in ("max_overlap", "max_outside", "max_speed", "residual"):
        np.maximum(getattr(total, name), getattr(call, name), out=getattr(total, name))
    for name in ("overlap_sum", "overlap_count", "iterations", "unconverged"):
        getattr(total, name)[:] += getattr(call, name)


# What not every scheme works with: arrays that are left empty unless it says so (`SchemeInfo.uses`).
OPTIONAL = (
    "discs",
    "constraints",
    "soa",
    "social_pairs",
    "desired_velocity",
    "heading",
    "previous_position",
    "previous_velocity",
    "trial_velocity",
    "correction_velocity",
    "force",
    "torque",
    "walking",
)


def allocate_results(people: int, environments: int) -> Results:
    """Return results of no step at all."""
    return Results(np.zeros((people, 2)), np.zeros(people), no_diagnostics(environments))


def allocate_history(
    bodies: Bodies, neighbors: NeighborList, rules: int = 0, doors: int = 0, uses: Collection[str] = OPTIONAL
) -> History:
    """Return the history of people whom nothing has happened to, with so many control rules and doors (all open)."""
    people, environments = len(bodies.radius), len(bodies.env_start) - 1
    slots = np.arange(people) - np.repeat(bodies.env_start[:-1], np.diff(bodies.env_start))  # within the environment
    return History(
        contacts=by_reference(allocate_contacts(neighbors, "discs" in uses)),
        force=np.zeros((people if "force" in uses else 0, 2)),
        torque=np.zeros(people if "torque" in uses else 0),
        phase=np.zeros(environments, dtype=np.int64),
        direction=np.zeros((people, 2)),
        directions_known=np.zeros(environments, dtype=np.bool_),
        direction_age=np.zeros(environments),
        is_uniform=np.zeros(people, dtype=np.bool_),
        lookup_turn=(slots % LOOKUP_PERIOD).astype(np.uint8),
        turn=np.zeros(environments, dtype=np.int64),
        followed=np.zeros(people, dtype=np.int64),
        region_bits=np.zeros(people, dtype=np.int64),
        local_speed=bodies.desired_speed.copy(),
        rule_on=np.zeros((environments, rules), dtype=np.bool_),
        rule_since=np.zeros((environments, rules)),
        door_open=np.ones((environments, doors), dtype=np.bool_),
        walking_velocity=np.zeros((people if "walking" in uses else 0, 2)),
        waited=np.zeros(people if "walking" in uses else 0),
        have_decided=np.zeros(environments, dtype=np.bool_),
        decision_age=np.zeros(environments),
    )


def allocate_workspace(
    bodies: Bodies, per_person: int = 12, uses: Collection[str] = OPTIONAL, discs: int = 1
) -> Workspace:
    """Return scratch with ``per_person`` neighbor entries a pedestrian; of the `OPTIONAL` only ``uses`` get any room.

    ``discs`` is the number of those of an outline.
    """
    people, environments = len(bodies.radius), len(bodies.env_start) - 1
    neighbors = allocate_neighbors(bodies, per_person)
    entries = len(neighbors.contact_distance)

    def room(name: str, length: int = people) -> int:
        return length if name in uses else 0

    def reals(length: int, *columns: int) -> Floats:
        return np.zeros((length, *columns))

    pairs = room("social_pairs", entries)
    return Workspace(
        neighbors=by_reference(neighbors),
        narrow_phase=by_reference(
            NarrowPhase(
                candidates=np.zeros(entries, dtype=np.uint32),
                old_key=np.zeros(entries, dtype=np.int64),
                old_history=reals(entries, 2),
                old_disc=np.zeros((room("discs", entries), 2), dtype=np.int64),
            )
        ),
        discs=Discs(
            x=reals(discs * room("discs")),
            y=reals(discs * room("discs")),
            radius=reals(discs * room("discs")),
            cosine=reals(room("discs")),
            sine=reals(room("discs")),
        ),
        constraints=by_reference(allocate_constraints(room("constraints"), room("constraints", entries), environments)),
        soa=allocate_buffers(room("soa")),
        partition=by_reference(allocate_partition(bodies.env_start, room("soa", entries))),
        social_pairs=by_reference(
            SocialPairs(np.zeros(pairs, dtype=np.uint32), reals(pairs), reals(pairs), reals(pairs))
        ),
        walkers=_allocate_walkers(room("walking"), bodies.env_start),
        inside=np.zeros(people, dtype=np.uint32),
        desired_velocity=reals(room("desired_velocity"), 2),
        heading=reals(room("heading"), 4),
        previous_position=reals(room("previous_position"), 2),
        previous_velocity=reals(room("previous_velocity"), 2),
        trial_velocity=reals(room("trial_velocity"), 2),
        correction_velocity=reals(room("correction_velocity"), 2),
        substep=np.zeros(environments, dtype=np.int64),
        status=np.zeros(environments, dtype=np.int64),
    )


def _allocate_walkers(people: int, env_start: Ints) -> Walkers:
    """Return room for the decisions of so many people."""
    numbers = {name: np.zeros(people) for name in ("way_x", "way_y", "speed", "reach", "x", "y", "radius")}
    shares = count_slabs(int(np.diff(env_start).max()))
    return Walkers(
        **numbers,
        slot=np.zeros(people, dtype=np.uint32),
        columns=np.zeros(len(env_start) - 1, dtype=np.int64),
        rows=np.zeros(len(env_start) - 1, dtype=np.int64),
        seen=np.zeros(shares * people, dtype=np.uint32),
    )


def by_reference(arrays: Arrays) -> Arrays:
    """Return a reference to arrays that `grow` replaces by longer ones, for all who hold it."""
    return cast(Arrays, struct_ref(arrays))


def grow(history: History, workspace: Workspace, bodies: Bodies, uses: Collection[str] = OPTIONAL) -> None:
    """Make twice the room for neighbors, in place; contacts are kept, the list is built at the next step."""
    before = workspace.neighbors
    larger = allocate_workspace(bodies, 2 * entries_per_person(before, bodies), uses)
    contacts = allocate_contacts(larger.neighbors, "discs" in uses)
    move_contacts(history.contacts, before, contacts, larger.neighbors)
    replace_arrays(history.contacts, contacts)
    for part, new in zip(workspace, larger, strict=True):
        if isinstance(new, StructRef):
            replace_arrays(part, new.fields)


def replace_arrays(reference: Any, arrays: Any) -> None:
    """Let a part of a batch that is held by reference have other arrays: nowhere else are any replaced."""
    reference.replace(**arrays._asdict())
