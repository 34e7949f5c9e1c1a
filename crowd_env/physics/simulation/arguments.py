"""What a `Simulation` is given and asked for, checked before anything moves: kernels look at nothing."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from crowd_env.core.arrays.outline import Outline
from crowd_env.core.arrays.state import Bodies, Bools, Floats, Ints, check_motivation
from crowd_env.core.checks import POSITIVE, number, refuse
from crowd_env.geometry.geometry import Geometry
from crowd_env.physics.scheme import ContactScheme
from crowd_env.physics.simulation.limits import check_stride
from crowd_env.physics.workspace import Command
from crowd_env.routing.fields.field import travel_time_field
from crowd_env.routing.replanning import Place


def check_step(
    scheme: ContactScheme, bodies: Bodies, dt: float, allow_unstable: bool = False, outline: Outline | None = None
) -> None:
    """Raise ValueError unless ``dt`` is positive, at most the scheme's stable step, and no stride too long."""
    if not (np.isfinite(dt) and dt > 0):
        raise ValueError(f"dt is {dt!r} s; it must be finite and > 0")
    limit, formula = scheme.stable_dt(bodies), scheme.info.stable_step
    if outline is not None:
        limit, formula = (
            min(limit * outline.step_share, outline.turning_time),
            f"{formula}; less with several discs a body",
        )
    if dt > limit and not allow_unstable:
        raise ValueError(
            f"dt = {dt:g} s is above the stable step of {scheme.info.name}, {limit:.4g} s for these people: {formula}"
        )
    if not allow_unstable:
        check_stride(bodies, dt)


def check_drive(max_drive: Any, driving: bool) -> float | None:
    """Return the largest driving force [N] of a person, None = no limit.

    Raises
    ------
    ValueError
        If it is not positive, or nobody drives.
    """
    if max_drive is None:
        return None
    if not driving:
        raise ValueError(f"max_drive is {max_drive!r} N, but passive grains (driving=False) have no drive to limit")
    return number("max_drive", max_drive, POSITIVE, "N")


def routes_of(route: Any, known: Ints) -> Ints:
    """Return the route of each of some people, who know ``known`` (N,) routes each: one for all, or one each.

    Raises
    ------
    ValueError
        If these are not so many whole numbers, or someone does not know his.
    """
    routes = np.full(known.shape, route) if isinstance(route, int) else np.asarray(route)
    if routes.dtype.kind not in "iu" or routes.shape not in ((), known.shape):
        raise ValueError(
            f"route must be one whole number, or {len(known)}, not {routes.dtype} of the shape {routes.shape}"
        )
    if routes.shape != known.shape or routes.dtype != np.int64:
        routes = np.array(np.broadcast_to(routes, known.shape), dtype=np.int64)
    check_routes(routes, known)
    return routes


def check_routes(route: Ints, known: Ints) -> None:
    """Raise ValueError unless everyone's route is one of those that are known to him: kernels look it up unseen."""
    if ((route < 0) | (route >= known)).any():
        bad = np.flatnonzero((route < 0) | (route >= known))
        raise ValueError(f"route of pedestrian {bad[0]} is {route[bad[0]]}; it must be from 0 to {known[bad[0]] - 1}")


def fields_of(geometries: Sequence[Geometry], fields: Sequence[Place] | None, bodies: Bodies) -> list[Place]:
    """Return the ways or the field of each geometry; made for those with exits if none are given.

    Raises
    ------
    ValueError
        If there is not one (or None) for each geometry.
    """
    if fields is None:
        widest, thinnest = float(bodies.radius.max()), float(bodies.radius.min())
        return [travel_time_field(g, widest, min_radius=thinnest) if len(g.exits) else None for g in geometries]
    if len(fields) != len(geometries):
        raise ValueError(f"{len(fields)} fields for {len(geometries)} geometries; give one (or None) for each")
    return list(fields)


def which_geometry(geometry_of_env: Any, environments: int, geometries: int) -> Ints:
    """Return the geometry of each environment (E,), the first one if nothing is said.

    Raises
    ------
    ValueError
        If it is not one number for each, or there is no such geometry.
    """
    which = np.zeros(environments, dtype=np.int64) if geometry_of_env is None else np.asarray(geometry_of_env)
    if which.shape != (environments,) or which.dtype.kind not in "iu" or which.min() < 0 or which.max() >= geometries:
        raise ValueError(
            f"geometry_of_env must name, for each of {environments} environments, "
            f"one of {geometries} geometries, 0 to {geometries - 1}"
        )
    return np.array(which, dtype=np.int64)


def vectors(name: str, values: Floats, people: int) -> Floats:
    """Return ``values`` (P, 2) as kernels want them.

    Raises
    ------
    ValueError
        If they have another shape or are not finite.
    """
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.shape != (people, 2):
        raise ValueError(f"{name} must have the shape {(people, 2)}, not {array.shape}")
    if not np.isfinite(array).all():
        bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
        raise ValueError(f"{name} of pedestrian {bad[0]} is {array[bad[0]].tolist()}; it must be finite")
    return array


def motivation_of(name: str, value: Any, people: int) -> Floats:
    """Return the time gap or push of each of so many people: one number for all, or one each; nan = as in the manner.

    Raises
    ------
    ValueError
        If these are not so many numbers, or one is out of range.
    """
    form = f"one number, or an array of {people}"
    try:
        values = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        refuse(name, value, form)
    if values.shape not in ((), (people,)):
        refuse(name, value, form)
    values = np.broadcast_to(values, (people,))
    check_motivation(name, values)
    return values


def check_command(asked: Command, people: int) -> Command:
    """Return what is asked of so many people as kernels want it.

    Raises
    ------
    ValueError
        If an array has another shape or holds something that is not finite.
    """
    command, relative, force, gives_way = asked
    if command is not None:
        command = vectors("command", command, people)
    relative, gives_way = _flags("relative", relative, people), _flags("gives_way", gives_way, people)
    if force is not None:
        force = vectors("external_force", force, people)
    return Command(command, relative, force, gives_way)


def _flags(name: str, values: Any, people: int) -> Bools | None:
    if values is None:
        return None
    flags = np.ascontiguousarray(values, dtype=np.bool_)
    if flags.shape != (people,):
        raise ValueError(f"{name} must have the shape ({people},), not {flags.shape}")
    return flags
