"""The arrays that hold a batch of crowds: what is fixed within an episode, and what moves.

All people of all environments lie one behind the other (``P`` people, ``E`` environments); environment ``e`` owns the
slice ``env_start[e]:env_start[e + 1]``.  Slots never move: a pedestrian that has left is ``active = False`` in place.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowd_env.core.checks import POSITIVE, SHARE, Range

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Indices = NDArray[np.uint32]  # unsigned, because numba checks every signed index for being negative

# m/s; an upper bound under any push: the fastest recorded run is 12.4 (Bolt, 100 m, Berlin 2009).
MAX_SPEED = 12.5

_ON_STAIRS = Range(0.0, 2.0, above=True)
# What a pedestrian may have of its own, and which values are allowed; nan = the usual.
PERSONAL = {"time_gap": POSITIVE, "push": SHARE, "upstairs": _ON_STAIRS, "downstairs": _ON_STAIRS}


class Bodies(NamedTuple):
    """What does not change within an episode, but for time gap and push: see `Simulation.set_motivation`."""

    radius: Floats  #: (P,) m
    mass: Floats  #: (P,) kg
    inertia: Floats  #: (P,) kg m^2, about the vertical axis
    desired_speed: Floats  #: (P,) m/s
    relaxation_time: Floats  #: (P,) s
    response_time: Floats  #: (P,) s, stands still until then
    time_gap: Floats  #: (P,) s, of the headway that is kept; nan = that of the manner of the run
    push: Floats  #: (P,) share of the desired speed at which one presses on; nan = that of the manner
    upstairs: Floats  #: (P,) speed up stairs, along the slope, relative to the desired speed; nan = that of the stair
    downstairs: Floats  #: (P,) speed down stairs, likewise
    group: Ints  #: (P,) pedestrians of an environment with one number walk together; -1 = alone
    env_start: Ints  #: (E+1,) first slot of each environment


class CrowdState(NamedTuple):
    """What moves.  What else the future depends on is in `Simulation.checkpoint`."""

    position: Floats  #: (P, 2) m
    velocity: Floats  #: (P, 2) m/s
    angle: Floats  #: (P,) rad, 0 = facing +x
    spin: Floats  #: (P,) rad/s
    active: Bools  #: (P,) still inside
    present: Bools  #: (P,) a body: inside, or on the apron behind the exit that was crossed
    exit_time: Floats  #: (P,) s, when the center crossed an exit line, interpolated within the step; nan before
    exit_index: Ints  #: (P,) row of Geometry.exits that was crossed; -1 before
    route: Ints  #: (P,) way that one means to take: a number among those of the place
    sheet: Ints  #: (P,) storey or stair of the place; 0 where there is one
    time: Floats  #: (E,) s, clock of each environment

    def copy(self) -> "CrowdState":
        """Return an independent copy."""
        return CrowdState._make(array.copy() for array in self)


def row_starts(counts: ArrayLike) -> Ints:
    """Return where each of K rows begins that lie one behind the other, and where the last one ends (K+1,)."""
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def joined_starts(parts: Sequence[Ints]) -> Ints:
    """Return the starts of the rows of all ``parts`` (at least one), one behind the other, from the starts within each."""
    return row_starts(np.concatenate([np.diff(starts) for starts in parts]))


def make_bodies(
    radius: Floats,
    mass: Floats,
    *,
    desired_speed: Floats | float = 0.0,
    relaxation_time: Floats | float = 0.5,
    response_time: Floats | float = 0.0,
    time_gap: Floats | float = np.nan,
    push: Floats | float = np.nan,
    upstairs: Floats | float = np.nan,
    downstairs: Floats | float = np.nan,
    group: Ints | int = -1,
    env_start: Ints | None = None,
) -> Bodies:
    """Return `Bodies` with every array filled; the inertia is that of a solid disc, ``m r^2 / 2``.

    Raises
    ------
    ValueError
        If a radius, mass or relaxation time is not positive and finite, a speed or response time is negative, an array does
        not fit the others, or ``env_start`` does not ascend from 0 to the number of people.
    """
    radius = np.atleast_1d(_numbers("radius", radius)).copy()
    if radius.ndim != 1 or not len(radius):
        raise ValueError(f"radius has the shape {radius.shape}; it must be (P,), one number for each of P > 0 people")
    count = len(radius)

    def full(name: str, value: Floats | float) -> Floats:
        values = _numbers(name, value)
        if values.shape not in ((), (1,), (count,)):
            raise ValueError(f"{name} has the shape {values.shape}; it must be one number, or ({count},) as radius")
        return np.array(np.broadcast_to(values, (count,)), order="C")

    numbers = np.asarray(group)
    if numbers.shape not in ((), (count,)) or numbers.dtype.kind not in "iu":
        raise ValueError(f"group is {_short(numbers)}; it must be a whole number, or ({count},) of them as radius")
    bodies = Bodies(
        radius=radius,
        mass=full("mass", mass),
        inertia=0.5 * full("mass", mass) * radius**2,
        desired_speed=full("desired_speed", desired_speed),
        relaxation_time=full("relaxation_time", relaxation_time),
        response_time=full("response_time", response_time),
        time_gap=full("time_gap", time_gap),
        push=full("push", push),
        upstairs=full("upstairs", upstairs),
        downstairs=full("downstairs", downstairs),
        group=np.array(np.broadcast_to(numbers, (count,)), dtype=np.int64),
        env_start=np.array([0, count]) if env_start is None else _whole_numbers("env_start", env_start),
    )
    check_bodies(bodies)
    return bodies


def join_bodies(parts: Sequence[Bodies]) -> Bodies:
    """Return the bodies of all ``parts`` (at least one), one behind the other, as copies."""
    *columns, starts = zip(*parts, strict=True)
    return Bodies._make([*map(np.concatenate, columns), joined_starts(starts)])


def make_state(
    position: Floats, velocity: Floats | None = None, *, sheet: Ints | int = 0, environments: int = 1
) -> CrowdState:
    """Return a `CrowdState` at time zero with everyone inside; velocity defaults to rest.

    Raises
    ------
    ValueError
        If position or velocity are not one (x, y) for each person, sheet not one number for each, or there is no environment.
    """
    position = np.atleast_2d(_numbers("position", position)).copy(order="C")
    if position.ndim != 2 or position.shape[1] != 2:
        raise ValueError(f"position has the shape {position.shape}; it must be (P, 2), one (x, y) for each person")
    count = len(position)
    if velocity is None:
        velocity = np.zeros((count, 2))
    velocity = np.atleast_2d(_numbers("velocity", velocity)).copy(order="C")
    if velocity.shape != (count, 2):
        raise ValueError(f"velocity has the shape {velocity.shape}; it must be ({count}, 2) as position")
    sheets = np.asarray(sheet)
    if sheets.shape not in ((), (count,)) or sheets.dtype.kind not in "iu":
        raise ValueError(f"sheet is {_short(sheets)}; it must be a whole number, or ({count},) of them as position")
    if environments < 1:
        raise ValueError(f"environments is {environments}; it must be at least 1")
    return CrowdState(
        position=position,
        velocity=velocity,
        angle=np.zeros(count),
        spin=np.zeros(count),
        active=np.ones(count, dtype=bool),
        present=np.ones(count, dtype=bool),
        exit_time=np.full(count, np.nan),
        exit_index=np.full(count, -1, dtype=np.int64),
        route=np.zeros(count, dtype=np.int64),
        sheet=np.array(np.broadcast_to(sheets, (count,)), dtype=np.int64),
        time=np.zeros(environments),
    )


def check_bodies(bodies: Bodies) -> None:
    """Raise ValueError unless all arrays fit together, and every value is one that a body can have.

    Kernels look at nothing: they would read and write beyond an array that is too short.
    """
    count = len(bodies.radius) if np.ndim(bodies.radius) else 0
    if count < 1:
        raise ValueError("bodies.radius is empty; there must be at least one person")
    for name, array in zip(Bodies._fields[:-1], bodies, strict=False):
        _check_array(f"bodies.{name}", array, np.int64 if name == "group" else np.float64, (count,))
    for name in ("radius", "mass", "inertia", "relaxation_time"):
        values = getattr(bodies, name)
        _require(name, values, (values > 0.0) & (values < np.inf), "finite and > 0")
    for name in ("desired_speed", "response_time"):
        values = getattr(bodies, name)
        _require(name, values, (values >= 0.0) & (values < np.inf), "finite and >= 0")
    for name in PERSONAL:
        check_personal(name, getattr(bodies, name))
    _require("desired_speed", bodies.desired_speed, bodies.desired_speed <= MAX_SPEED, f"at most {MAX_SPEED} m/s")
    start = bodies.env_start
    _check_array("bodies.env_start", start, np.int64, np.shape(start)[:1])
    if len(start) < 2 or start[0] != 0 or start[-1] != count or (len(start) > 2 and (np.diff(start) < 1).any()):
        must = f"it must ascend from 0 to the number of people, {count}, with at least one person in each environment"
        raise ValueError(f"bodies.env_start is {_short(start)}; {must}")
    most = np.repeat(np.diff(start), np.diff(start)) - 1
    known = (bodies.group >= -1) & (bodies.group <= most)
    if not known.all():
        bad = int(np.argmin(known))
        raise ValueError(f"group of pedestrian {bad} is {bodies.group[bad]}; it must be from -1 to {most[bad]}")


def check_personal(name: str, values: Floats) -> None:
    """Raise ValueError unless all values (N,) of a name in `PERSONAL` are allowed; nan, the usual one, is."""
    allowed = PERSONAL[name]
    outside = (values <= allowed.low if allowed.above else values < allowed.low) | (values > allowed.high)
    _require(name, values, ~(outside | np.isinf(values)), str(allowed))


def check_state(state: CrowdState, bodies: Bodies) -> None:
    """Raise ValueError unless all arrays fit these bodies and each other, and positions and velocities are finite."""
    count, environments = len(bodies.radius), len(bodies.env_start) - 1
    pair, one = (count, 2), (count,)
    shapes = dict(zip(CrowdState._fields, (pair, pair, *[one] * 8, (environments,)), strict=True))
    kinds = {"active": np.bool_, "present": np.bool_, "exit_index": np.int64, "route": np.int64, "sheet": np.int64}
    for name, shape in shapes.items():
        _check_array(f"state.{name}", getattr(state, name), kinds.get(name, np.float64), shape)
    for name in ("position", "velocity", "angle", "spin"):
        bad = np.flatnonzero(~np.isfinite(getattr(state, name).reshape(count, -1)).all(axis=1))
        if len(bad):
            raise ValueError(f"{name} of pedestrian {bad[0]} is not finite")
    if not np.isfinite(state.time).all():
        raise ValueError(f"state.time of environment {int(np.argmin(np.isfinite(state.time)))} is not finite")


def _check_array(name: str, array: Any, kind: Any, shape: tuple[int, ...]) -> None:
    """Raise ValueError unless this is an array that kernels can work on in place."""
    if not isinstance(array, np.ndarray):
        raise ValueError(f"{name} is {type(array).__name__}; it must be a NumPy array")
    if array.shape != shape:
        raise ValueError(f"{name} has the shape {array.shape}; it must be {shape}")
    if array.dtype != kind:
        raise ValueError(f"{name} holds {array.dtype}; it must hold {np.dtype(kind)}")
    if not array.flags.c_contiguous or not array.flags.aligned:
        raise ValueError(f"{name} is not contiguous in memory; give np.ascontiguousarray({name.partition('.')[2]})")
    if not array.flags.writeable:
        raise ValueError(f"{name} is read-only; it is worked on in place: give a copy")


def _numbers(name: str, values: Any) -> Floats:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} is not made of numbers: {error}") from None


def _whole_numbers(name: str, values: Any) -> Ints:
    array = np.asarray(values)
    if array.ndim != 1 or array.dtype.kind not in "iu":
        raise ValueError(f"{name} is {_short(array)}; it must be a row of whole numbers")
    return np.array(array, dtype=np.int64)


def _short(values: np.ndarray) -> str:
    return str(values.tolist() if values.size <= 8 else [*values.ravel()[:7].tolist(), "..."])


def _require(name: str, values: Floats, allowed: Bools, must: str) -> None:
    """Raise ValueError, naming the first pedestrian with a value that is not ``allowed`` (N,)."""
    if not allowed.all():
        bad = int(np.argmin(allowed))
        raise ValueError(f"{name} of pedestrian {bad} is {values[bad]:g}; it must be {must}")


def segment_lengths(segments: Floats) -> Floats:
    """Return the length (K,) of segments (K, 2, 2)."""
    return np.hypot(*(segments[:, 1] - segments[:, 0]).T)


def unit_vectors(angle: np.ndarray) -> Floats:
    """Return the vectors (K, 2) of length 1 at angles (K,) [rad] to the left of the x axis."""
    return np.column_stack([np.cos(angle), np.sin(angle)])


def slots_of(bodies: Bodies, e: int) -> slice:
    """Return the slots of the pedestrians of environment ``e``."""
    return slice(int(bodies.env_start[e]), int(bodies.env_start[e + 1]))


def as_grid(values: np.ndarray, environments: int) -> np.ndarray:
    """Return an ``(E, N, ...)`` view of per-pedestrian ``values`` when all environments hold the same number."""
    return values.reshape(environments, -1, *values.shape[1:])
