"""What a step reads and what it remembers: the world around the crowd, what is asked of it, and the working memory."""

from collections.abc import Callable, Collection
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowd_env.geometry.geometry import Boundary
from crowd_env.navigation.field import FieldArrays
from crowd_env.physics.constraints import Problem, allocate_problem
from crowd_env.physics.contacts import Contacts, allocate_contacts, move_contacts
from crowd_env.physics.dem_lanes.buffers import SoABuffers, allocate_buffers
from crowd_env.physics.dem_lanes.partition import Partition, allocate_partition
from crowd_env.physics.neighbors.lists import NeighborList, Places, allocate_neighbors
from crowd_env.routing.rules import Guidance
from crowd_env.state import Bodies, Bools, CrowdState, Floats, Ints

LOOKUP_PERIOD = 4  # in which those look for their way who need not do so every time


class World(NamedTuple):
    """Everything that stands still."""

    boundary: Boundary  # walls, corners and exits of all geometries
    field: FieldArrays  # directions and travel times of all routes
    geometry_of_env: Ints  # (E,)
    guidance: Guidance  # routes, regions and control rules


class Control(NamedTuple):
    """What is asked of everyone during one call."""

    command: Floats  # (P, 2)  desired velocity as a multiple of the own desired speed
    relative: Bools  # (P,)    command turns with the direction of the shortest path; else along the world axes
    external_force: Floats  # (P, 2)  N
    driving: bool  # pedestrians (eq 11) or passive grains
    bounded: bool  # nobody is too fast, goes too far in a step, or through a wall: see `crowd_env.physics.bounds`


class Command(NamedTuple):
    """What a caller asks for; None: what everyone does unless told otherwise."""

    command: Floats | None  # (1, 0): straight along the way
    relative: Bools | None  # True
    external_force: Floats | None  # 0


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


class Noticed(NamedTuple):
    """Scratch of the social force: the pairs near enough for it, (M,) each."""

    x: Floats  # unit vector from the second to the first
    y: Floats
    size: Floats  # N


class Memory(NamedTuple):
    """Working memory of a batch, allocated once; nothing is allocated inside a step."""

    near: NeighborList
    contacts: Contacts
    problem: Problem
    lanes: SoABuffers
    cut: Partition
    inside: Places  # (P,)   who is inside, environment e from env_start[e] on: see `step.list_active`
    way: Floats  # (P, 2) direction of the shortest path when it was last looked up
    direction_age: Floats  # (E,)   s since then; infinite = it must be looked up for everyone
    steady: Bools  # (P,)   the way is nearly the same all around: one need not look every time
    shift: NDArray[np.uint8]  # (P,)   when it is one's turn, 0 to SHIFTS - 1
    turn: Ints  # (E,)   whose turn it was to look
    followed: Ints  # (P,)   route that one follows: one's own, or that of a control rule
    here: Ints  # (P,)   regions that one stands in (bits)
    pace: Floats  # (P,)   m/s  desired speed there
    rule_on: Bools  # (E, K) control rules of each environment
    rule_since: Floats  # (E, K) s  when they were switched on
    door_open: Bools  # (E, D)
    desired: Floats  # (P, 2) m/s
    force: Floats  # (P, 2) N
    previous: Floats  # (P, 2) position at the start of the step
    before: Floats  # (P, 2) velocity at the start of the step
    heading: Floats  # (P, 4) desired direction times the anisotropy of the social force; the desired velocity it is of
    noticed: Noticed
    torque: Floats  # (P,)   N m
    phase: Ints  # (E,)   how far a step is that needs the forces of the one before; 0 = they are not known
    push: Floats  # (P, 2) N s  sum of contact impulses on each person during the call
    crush: Floats  # (P,)   N s  sum of their magnitudes
    progress: Ints  # (E,)   steps done in the current call
    status: Ints  # (E,)   OK, FULL, DIVERGED or TOO_FAST
    diagnostics: Diagnostics  # of the current call


class Batch(NamedTuple):
    """All a step works on; kernels take it as one argument."""

    world: World
    bodies: Bodies
    state: CrowdState
    control: Control
    memory: Memory


def allocate_control(people: int, driving: bool, bounded: bool = True) -> Control:
    """Return room for what is asked of so many people."""
    return Control(np.zeros((people, 2)), np.ones(people, dtype=np.bool_), np.zeros((people, 2)), driving, bounded)


def set_command(control: Control, asked: Command, copy: Callable[[Any, Any], None] = np.copyto) -> None:
    """Write what is asked for to where kernels read it; ``copy`` is given an array and what goes there."""
    defaults: tuple[Any, ...] = ((1.0, 0.0), True, 0.0)
    for array, values, default in zip(control[:3], asked, defaults, strict=True):
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


# What not every scheme works with: the fields of `Memory` that are left empty unless it says so (`SchemeInfo.uses`).
SCRATCH = ("problem", "lanes", "desired", "force", "previous", "before", "heading", "noticed", "torque")


def allocate_memory(
    bodies: Bodies, per_person: int = 12, rules: int = 0, doors: int = 0, uses: Collection[str] = SCRATCH
) -> Memory:
    """Return working memory with ``per_person`` neighbor entries a pedestrian and so many control rules and doors.

    Of the `SCRATCH` only what is in ``uses`` gets any room.
    """
    people, environments = len(bodies.radius), len(bodies.env_start) - 1
    near = allocate_neighbors(bodies, per_person)

    def reals(*shape: int) -> Floats:
        return np.zeros(shape)

    def counts() -> Ints:
        return np.zeros(environments, dtype=np.int64)

    def room(name: str) -> int:
        return people if name in uses else 0

    return Memory(
        near=near,
        contacts=allocate_contacts(near),
        problem=allocate_problem(room("problem"), len(near.touch) if "problem" in uses else 0, environments),
        lanes=allocate_buffers(room("lanes")),
        cut=allocate_partition(bodies.env_start, len(near.touch) if "lanes" in uses else 0),
        inside=np.zeros(people, dtype=np.uint32),
        way=reals(people, 2),
        direction_age=np.full(environments, np.inf),
        steady=np.zeros(people, dtype=np.bool_),
        shift=(
            (np.arange(people) - np.repeat(bodies.env_start[:-1], np.diff(bodies.env_start))) % LOOKUP_PERIOD
        ).astype(np.uint8),
        turn=counts(),
        followed=np.zeros(people, dtype=np.int64),
        here=np.zeros(people, dtype=np.int64),
        pace=bodies.desired_speed.copy(),
        rule_on=np.zeros((environments, rules), dtype=np.bool_),
        rule_since=reals(environments, rules),
        door_open=np.ones((environments, doors), dtype=np.bool_),
        desired=reals(room("desired"), 2),
        force=reals(room("force"), 2),
        previous=reals(room("previous"), 2),
        before=reals(room("before"), 2),
        heading=reals(room("heading"), 4),
        noticed=allocate_noticed(len(near.touch) if "noticed" in uses else 0),
        torque=reals(room("torque")),
        phase=counts(),
        push=reals(people, 2),
        crush=reals(people),
        progress=counts(),
        status=counts(),
        diagnostics=no_diagnostics(environments),
    )


def allocate_noticed(entries: int) -> Noticed:
    """Return room for so many pairs."""
    return Noticed._make(np.zeros(entries) for _ in Noticed._fields)


def grow_memory(memory: Memory, bodies: Bodies, uses: Collection[str] = SCRATCH) -> Memory:
    """Return the same memory with twice the room for neighbors; contacts are kept, the list is built at the next step."""
    people = len(bodies.radius)
    now = (int(memory.near.entry_start[-1]) - 16 * (len(bodies.env_start) - 1)) // max(people, 1)
    near = allocate_neighbors(bodies, 2 * now)
    contacts = allocate_contacts(near)
    move_contacts(memory.contacts, memory.near.entry_start, contacts, near.entry_start)
    if "noticed" in uses:
        memory = memory._replace(noticed=allocate_noticed(len(near.touch)))
    if "problem" in uses:
        memory = memory._replace(problem=allocate_problem(people, len(near.touch), len(bodies.env_start) - 1))
    if "lanes" in uses:
        memory = memory._replace(cut=allocate_partition(bodies.env_start, len(near.touch)))
    return memory._replace(near=near, contacts=contacts)
