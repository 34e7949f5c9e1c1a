"""The arrays of a step: world, commands, results, history and scratch."""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Annotated, Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from crowd_env.core.arrays.state import Bodies, Bools, CrowdState, Floats, Indices, Ints
from crowd_env.core.behaviors.behavior import Behavior, record
from crowd_env.core.kernels.struct_ref import StructRef, struct_ref
from crowd_env.geometry.geometry import Boundary
from crowd_env.geometry.surface import Surface
from crowd_env.geometry.wall_grid import WallGrid
from crowd_env.physics.allocation import Arrays, allocate, shapes_of
from crowd_env.physics.constraints import Constraints
from crowd_env.physics.contacts import Contacts, move_contacts
from crowd_env.physics.dem_lanes.buffers import SoABuffers
from crowd_env.physics.dem_lanes.partition import SLABS, Partition, count_slabs
from crowd_env.physics.neighbors.lists import NeighborList, allocate_neighbors, entries_per_person
from crowd_env.routing.fields.lookup import FieldArrays
from crowd_env.routing.rules import Guidance

BLOCK = 128  # pedestrians in front that a decision handles together
_QUANTITIES = 12  # numbers for each of them
NOTHING: Mapping[str, tuple[type[Behavior], bool]] = {}  # acts
LOOKUP_PERIOD = 4  # look-ups between two refreshes where the field is uniform


class World(NamedTuple):
    """Everything that stands still."""

    boundary: Boundary  # walls, corners and exits of all geometries
    field: FieldArrays  # directions and travel times of all routes
    geometry_of_env: Ints  # (E,)
    guidance: Guidance  # routes, regions and control rules
    wall_grid: WallGrid  # walls that may hide people from each other; empty without a headway
    surface: Surface  # sheets and heights


class Control(NamedTuple):
    """The commands of all pedestrians during one call."""

    command: Annotated[Floats, "P 2"]  # desired velocity over desired speed
    relative: Annotated[Bools, "P"]  # command turns with the direction of the shortest path; else along the world axes
    external_force: Annotated[Floats, "P 2"]  # N
    gives_way: Annotated[Bools, "P"]  # keeps the headway, if the simulation has one
    driving: bool  # pedestrians (eq 11) or passive grains
    bounded: bool  # limits on speed, path of a step and crossing of walls: see `crowd_env.physics.bounds`


class Command(NamedTuple):
    """The command of a caller; None = the default."""

    command: Floats | None  # (1, 0): straight along the way
    relative: Bools | None  # True
    external_force: Floats | None  # 0
    gives_way: Bools | None  # True


class Diagnostics(NamedTuple):
    """Sums and maxima over the steps of one call or of a whole episode, per environment."""

    max_overlap: Annotated[Floats, "E"]  # m    deepest overlap of two bodies or of a body and a wall
    overlap_sum: Annotated[Floats, "E"]  # m    over all overlapping contacts of all steps
    overlap_count: Annotated[Ints, "E"]
    max_outside: Annotated[Floats, "E"]  # m    furthest that a body reached beyond a wall
    max_speed: Annotated[Floats, "E"]  # m/s  of any body, after any step
    residual: Annotated[Floats, "E"]  # m/s  worst complementarity residual left by the solver
    iterations: Annotated[Ints, "E"]  # solver sweeps in all
    unconverged: Annotated[Ints, "E"]  # steps that ended above the tolerance

    def copy(self) -> "Diagnostics":
        """Return an independent copy."""
        return Diagnostics._make(array.copy() for array in self)


class Results(NamedTuple):
    """Results of the current or last call of `Simulation.advance`."""

    impulse: Annotated[Floats, "P 2"]  # N s  sum of the contact impulses on each body
    impulse_magnitude: Annotated[Floats, "P"]  # N s  sum of their magnitudes
    wall_impulse: Annotated[Floats, "P 2"]  # N s  sum of the impulses from walls, which bear the opposite
    diagnostics: Diagnostics

    def copy(self) -> "Results":
        """Return an independent copy."""
        return Results._make(part.copy() for part in self)


class History(NamedTuple):
    """What the next step depends on besides bodies, state and command: a checkpoint keeps it."""

    contacts: Contacts  # of the last step, and what a scheme keeps of them
    force: Annotated[Floats, "P 2", "force"]  # N    all but contact; hertz: of the end of the last step, contact too
    torque: Annotated[Floats, "P", "torque"]  # N m
    phase: Annotated[Ints, "E"]  # stage of a step that needs the forces of the previous one; 0 = forces unknown
    direction: Annotated[Floats, "P 2"]  # of the route when it was last looked up
    directions_known: Annotated[Bools, "E"]  # else they must be looked up for everyone
    direction_age: Annotated[Floats, "E"]  # s  since the last look-up
    is_uniform: Annotated[Bools, "P"]  # the direction is nearly the same all around, so it is looked up less often
    lookup_turn: Annotated[NDArray[np.uint8], "P"]  # turn of that look-up, 0 to LOOKUP_PERIOD - 1
    turn: Annotated[Ints, "E"]  # which of these turns was the last
    followed: Annotated[Ints, "P"]  # route followed: that of `CrowdState`, or of a control rule
    region_bits: Annotated[Ints, "P"]  # regions that contain the pedestrian
    local_speed: Annotated[Floats, "P"]  # m/s  desired speed there
    height: Annotated[Floats, "P"]  # m    of the feet, when it was last looked up
    height_due: Annotated[Floats, "E"]  # s    when it is looked up again
    rule_on: Annotated[Bools, "E R"]  # control rules of each environment
    rule_since: Annotated[Floats, "E R"]  # s  when they were switched on
    door_open: Annotated[Bools, "E D"]
    is_gate: Annotated[Bools, "E D"]  # an open one is a wall for all but the people that are admitted
    admitted: Annotated[Ints, "P", "gates"]  # gates (bits) that let the pedestrian through
    stay: Annotated[Floats, "P", "waiting"]  # s  time to wait at the goal of the route
    spot: Annotated[Floats, "P 2", "waiting"]  # m  where
    arrived: Annotated[Floats, "P", "waiting"]  # s  since when; < 0 = not yet there
    waits: Annotated[Bools, "P", "waiting"]
    walking_velocity: Annotated[Floats, "P 2", "walking"]  # m/s  chosen in the last decision
    have_decided: Annotated[Bools, "E"]  # a decision has been made since the start
    decision_age: Annotated[Floats, "E"]  # s  since the last decision
    memory: Any  # of each behavior its `Behavior.MEMORY`, by name; empty arrays where it does not act


class NarrowPhase(NamedTuple):
    """Scratch of the search for contacts."""

    candidates: Annotated[Indices, "M"]  # entries of the neighbor list that may be contacts
    old_key: Annotated[Ints, "M"]  # keys and history of the contacts of the last step
    old_history: Annotated[Floats, "M 2"]
    old_disc: Annotated[Ints, "M 2", "discs"]  # which discs touched; empty without an outline


class Discs(NamedTuple):
    """Places of the discs of all bodies, K consecutive ones a body; empty without an outline."""

    x: Annotated[Floats, "N", "discs"]  # m    from the center of the body
    y: Annotated[Floats, "N", "discs"]  # m
    radius: Annotated[Floats, "N", "discs"]  # m
    cosine: Annotated[Floats, "P", "discs"]  # where a body faces
    sine: Annotated[Floats, "P", "discs"]


class SocialPairs(NamedTuple):
    """Scratch of the social force: the pairs near enough for it, (M,) each."""

    entry: Annotated[Indices, "M", "social_pairs"]  # of the neighbor list
    x: Annotated[Floats, "M", "social_pairs"]  # unit vector from the second to the first
    y: Annotated[Floats, "M", "social_pairs"]
    size: Annotated[Floats, "M", "social_pairs"]  # N


class Walkers(NamedTuple):
    """Scratch of a decision."""

    way_x: Annotated[Floats, "P", "walking"]  # unit vector along the desired way
    way_y: Annotated[Floats, "P", "walking"]
    speed: Annotated[Floats, "P", "walking"]  # m/s  desired
    reach: Annotated[Floats, "P", "walking"]  # m    gap up to which others matter
    # In the order of cells: slot; position, radius, velocity, way, and 1 if the pedestrian gives way.
    slot: Annotated[Indices, "P", "walking"]
    record: Annotated[Floats, "P 8", "walking"]
    columns: Annotated[Ints, "E"]  # of cells
    rows: Annotated[Ints, "E"]
    # For each part of a cut crowd: places in that order of the people seen in front, and scratch of `walking.ahead`.
    seen: Annotated[Indices, "S", "walking"]
    ahead: Annotated[Floats, f"W {_QUANTITIES * BLOCK}", "walking"]
    # Groups by their number: the first of the members, and the sum of their positions [m] and their number; -1 = none.
    first: Annotated[Ints, "P", "pulls"]
    following: Annotated[Ints, "P", "pulls"]  # the next member of the same group
    sums: Annotated[Floats, "P 3", "pulls"]


class Workspace(NamedTuple):
    """Scratch arrays; a step computes them again where they are missing."""

    neighbors: NeighborList
    narrow_phase: NarrowPhase
    discs: Discs
    constraints: Constraints
    soa: SoABuffers
    partition: Partition
    social_pairs: SocialPairs
    walkers: Walkers
    inside: Annotated[Indices, "P"]  # slots with a body, environment e from env_start[e] on: see `step.list_present`
    looking: Annotated[Indices, "P"]  # slots that look up the direction, at their rank in `inside` or before
    desired_velocity: Annotated[Floats, "P 2", "desired_velocity"]  # m/s
    # Desired direction times the anisotropy of the social force (2); the desired velocity it comes from (2).
    heading: Annotated[Floats, "P 4", "heading"]
    previous_position: Annotated[Floats, "P 2", "previous_position"]  # m    at the start of the step
    previous_velocity: Annotated[Floats, "P 2", "previous_velocity"]  # m/s  at the start of the step
    trial_velocity: Annotated[Floats, "P 2", "trial_velocity"]  # m/s  before contacts change it
    correction_velocity: Annotated[Floats, "P 2", "correction_velocity"]  # m/s  that takes back overlaps, for one step
    substep: Annotated[Ints, "E"]  # steps done in the current call
    status: Annotated[Ints, "E"]  # OK, FULL, DIVERGED or TOO_FAST


class Batch(NamedTuple):
    """All arrays of a step; kernels take it as one argument.

    Arrays that may be replaced are held by reference (`StructRef`): the fields of the world, the contacts of the history, and
    all arrays of the workspace with as many rows as the neighbor list.
    """

    world: World
    behaviors: Any  # parameters of each behavior, by name: see `Behavior.params_of`
    acts: Any  # whether it acts, by name
    bodies: Bodies
    state: CrowdState
    control: Control
    results: Results
    history: History
    workspace: Workspace


def allocate_control(people: int, driving: bool, bounded: bool) -> Control:
    """Return the commands of ``people`` pedestrians, all zero or True."""
    return allocate(
        Control,
        {"P": people},
        relative=np.ones(people, dtype=bool),
        gives_way=np.ones(people, dtype=bool),
        driving=driving,
        bounded=bounded,
    )


def set_command(control: Control, asked: Command, copy: Callable[[Any, Any], None] = np.copyto) -> None:
    """Write a command into the arrays of ``control``; ``copy`` takes an array and its new values."""
    defaults: tuple[Any, ...] = ((1.0, 0.0), True, 0.0, True)
    for array, values, default in zip(control[:4], asked, defaults, strict=True):
        if values is None:
            array[:] = default
        else:
            copy(array, values)


def no_diagnostics(environments: int) -> Diagnostics:
    """Return diagnostics before the first step: zeros."""
    return allocate(Diagnostics, {"E": environments})


def add_diagnostics(total: Diagnostics, call: Diagnostics) -> None:
    """Add the diagnostics of a call to the total, in place."""
    for name in ("max_overlap", "max_outside", "max_speed", "residual"):
        np.maximum(getattr(total, name), getattr(call, name), out=getattr(total, name))
    for name in ("overlap_sum", "overlap_count", "iterations", "unconverged"):
        getattr(total, name)[:] += getattr(call, name)


def allocate_results(people: int, environments: int) -> Results:
    """Return results before the first step: zeros."""
    return allocate(Results, {"P": people}, diagnostics=no_diagnostics(environments))


def allocate_history(
    bodies: Bodies,
    neighbors: NeighborList,
    rules: int = 0,
    doors: int = 0,
    uses: Collection[str] | None = None,
    acting: Mapping[str, tuple[type[Behavior], bool]] = NOTHING,
) -> History:
    """Return the history before the first step, for a number of control rules and of doors (all open).

    ``acting`` maps the name of each behavior to its class and whether it acts: only then is its memory allocated.
    """
    people, environments = len(bodies.radius), len(bodies.env_start) - 1
    slots = np.arange(people) - np.repeat(bodies.env_start[:-1], np.diff(bodies.env_start))  # within the environment
    sizes = {"P": people, "E": environments, "M": len(neighbors.owner), "R": rules, "D": doors}
    return allocate(
        History,
        sizes,
        uses,
        contacts=by_reference(allocate(Contacts, sizes, uses)),
        lookup_turn=(slots % LOOKUP_PERIOD).astype(np.uint8),
        local_speed=bodies.desired_speed.copy(),
        door_open=np.ones((environments, doors), dtype=bool),
        memory=record(
            **{name: _memory(kind, sizes if acts else {"P": 0, "E": 0}) for name, (kind, acts) in acting.items()}
        ),
    )


def _memory(kind: type[Behavior], sizes: Mapping[str, int]) -> Any:
    return record() if kind.MEMORY is None else allocate(kind.MEMORY, sizes)


def begin_history(chosen: Sequence[int], people: Ints, history: History, bodies: Bodies, route: Ints) -> None:
    """Reset the history of ``chosen`` environments: no contacts, no forces, no directions."""
    for name in ("phase", "directions_known", "turn", "rule_on", "have_decided", "height_due"):
        getattr(history, name)[chosen] = 0
    history.contacts.number[chosen], history.door_open[chosen] = 0, True
    history.followed[people], history.region_bits[people] = route, 0
    history.local_speed[people] = bodies.desired_speed[people]
    for name, value in (("walking_velocity", 0.0), ("admitted", 0), ("stay", 0.0), ("arrived", -1.0), ("waits", False)):
        array = getattr(history, name)
        if len(array):
            array[people] = value
    for memory in history.memory:
        for array, shape in zip(memory, shapes_of(type(memory)).values(), strict=True):
            if len(array):
                array[people if shape[0] == "P" else chosen] = 0


def begin_results(chosen: Sequence[int], people: Ints, results: Results, total: Diagnostics) -> None:
    """Set the results and the diagnostics of ``chosen`` environments to zero."""
    results.impulse[people], results.impulse_magnitude[people], results.wall_impulse[people] = 0.0, 0.0, 0.0
    for array in (*total, *results.diagnostics):
        array[chosen] = 0


def allocate_workspace(
    bodies: Bodies, per_person: int = 12, uses: Collection[str] | None = None, discs: int = 1
) -> Workspace:
    """Return scratch with ``per_person`` neighbor entries a pedestrian; arrays not in ``uses`` are empty.

    ``discs`` is the number of discs of an outline.
    """
    people, environments = len(bodies.radius), len(bodies.env_start) - 1
    neighbors = allocate_neighbors(bodies, per_person)
    entries, slabs = len(neighbors.owner), count_slabs(int(np.diff(bodies.env_start).max()))
    sizes = {"P": people, "E": environments, "M": entries, "N": discs * people}
    sizes |= {"S": slabs * people, "W": slabs * environments}
    # One slab alone carries no forces.
    sizes |= {"B": people + environments, "L": SLABS * environments, "T": entries if slabs > 1 else 0}
    return allocate(
        Workspace,
        sizes,
        uses,
        neighbors=by_reference(neighbors),
        narrow_phase=by_reference(allocate(NarrowPhase, sizes, uses)),
        discs=allocate(Discs, sizes, uses),
        constraints=by_reference(allocate(Constraints, sizes, uses)),
        soa=allocate(SoABuffers, sizes, uses),
        partition=by_reference(allocate(Partition, sizes, uses)),
        social_pairs=by_reference(allocate(SocialPairs, sizes, uses)),
        walkers=allocate(Walkers, sizes, uses),
    )


def by_reference(arrays: Arrays) -> Arrays:
    """Return a reference to arrays that `grow` replaces by longer ones, for all holders at once."""
    return cast(Arrays, struct_ref(arrays))


def grow(history: History, workspace: Workspace, bodies: Bodies, uses: Collection[str] | None = None) -> None:
    """Double the capacity for neighbors, in place; contacts are kept, the list is built at the next step."""
    before = workspace.neighbors
    larger = allocate_workspace(bodies, 2 * entries_per_person(before, bodies), uses)
    sizes = {"E": len(bodies.env_start) - 1, "M": len(larger.neighbors.owner)}
    contacts = allocate(Contacts, sizes, uses)
    move_contacts(history.contacts, before, contacts, larger.neighbors)
    replace_arrays(history.contacts, contacts)
    for part, new in zip(workspace, larger, strict=True):
        if isinstance(new, StructRef):
            replace_arrays(part, new.fields)


def replace_arrays(reference: Any, arrays: Any) -> None:
    """Replace the arrays of a part of a batch that is held by reference; no other function replaces any."""
    reference.replace(**arrays._asdict())
