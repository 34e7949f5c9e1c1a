"""The arrays that hold a batch of crowds: what is fixed within an episode, and what moves.

All people of all environments lie one behind the other (``P`` people, ``E`` environments); environment ``e`` owns the
slice ``env_start[e]:env_start[e + 1]``.  Slots never move: someone who has left is ``active = False`` in place.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

# m/s; nobody is faster, whoever pushes: the fastest that anyone is known to have run is 12.4 (Bolt, 100 m, Berlin 2009).
MAX_SPEED = 12.5


class Bodies(NamedTuple):
    """What does not change within an episode."""

    radius: Floats  # (P,)    m
    mass: Floats  # (P,)    kg
    inertia: Floats  # (P,)    kg m^2   about the vertical axis
    desired_speed: Floats  # (P,)    m/s
    relaxation_time: Floats  # (P,)    s
    response_time: Floats  # (P,)    s        stands still until then
    env_start: Ints  # (E+1,)  first slot of each environment


class CrowdState(NamedTuple):
    """What moves; a copy of it is a checkpoint."""

    position: Floats  # (P, 2)  m
    velocity: Floats  # (P, 2)  m/s
    angle: Floats  # (P,)    rad
    spin: Floats  # (P,)    rad/s
    active: Bools  # (P,)    still inside
    exit_time: Floats  # (P,)    s        when the centre crossed an exit line, interpolated within the step; nan before
    exit_index: Ints  # (P,)    row of Geometry.exits that was crossed; -1 before
    route: Ints  # (P,)    way that one means to take: a number among those of the place
    time: Floats  # (E,)    s        clock of each environment

    def copy(self) -> "CrowdState":
        """Return an independent copy."""
        return CrowdState._make(array.copy() for array in self)


def make_bodies(
    radius: Floats,
    mass: Floats,
    *,
    desired_speed: Floats | float = 0.0,
    relaxation_time: Floats | float = 0.5,
    response_time: Floats | float = 0.0,
    env_start: Ints | None = None,
) -> Bodies:
    """Return `Bodies` with every array filled; the inertia is that of a solid disc, ``m r^2 / 2``.

    Raises
    ------
    ValueError
        If a radius, mass or relaxation time is not positive and finite, or a speed or response time is negative.
    """
    radius = np.atleast_1d(np.asarray(radius, dtype=np.float64))
    count = len(radius)

    def full(value: Floats | float) -> Floats:
        return np.ascontiguousarray(np.broadcast_to(np.asarray(value, dtype=np.float64), (count,))).copy()

    bodies = Bodies(
        radius=radius.copy(),
        mass=full(mass),
        inertia=0.5 * full(mass) * radius**2,
        desired_speed=full(desired_speed),
        relaxation_time=full(relaxation_time),
        response_time=full(response_time),
        env_start=np.array([0, count]) if env_start is None else np.asarray(env_start, dtype=np.int64),
    )
    for name in ("radius", "mass", "relaxation_time"):
        _require(name, getattr(bodies, name), "> 0", lambda x: x > 0)
    for name in ("desired_speed", "response_time"):
        _require(name, getattr(bodies, name), ">= 0", lambda x: x >= 0)
    _require("desired_speed", bodies.desired_speed, f"at most {MAX_SPEED} m/s", lambda x: x <= MAX_SPEED)
    return bodies


def _require(name: str, values: Floats, bound: str, holds) -> None:  # type: ignore[no-untyped-def]
    bad = np.flatnonzero(~(np.isfinite(values) & holds(values)))
    if len(bad):
        raise ValueError(f"{name} of pedestrian {bad[0]} is {values[bad[0]]:g}; it must be finite and {bound}")


def make_state(position: Floats, velocity: Floats | None = None, *, environments: int = 1) -> CrowdState:
    """Return a `CrowdState` at time zero with everyone inside; velocity defaults to rest."""
    position = np.array(position, dtype=np.float64).reshape(-1, 2)
    count = len(position)
    return CrowdState(
        position=position,
        velocity=np.zeros((count, 2)) if velocity is None else np.array(velocity, dtype=np.float64).reshape(count, 2),
        angle=np.zeros(count),
        spin=np.zeros(count),
        active=np.ones(count, dtype=np.bool_),
        exit_time=np.full(count, np.nan),
        exit_index=np.full(count, -1, dtype=np.int64),
        route=np.zeros(count, dtype=np.int64),
        time=np.zeros(environments),
    )


def as_grid(values: np.ndarray, environments: int) -> np.ndarray:
    """Return an ``(E, N, ...)`` view of per-pedestrian ``values`` when all environments hold the same number."""
    return values.reshape(environments, -1, *values.shape[1:])
