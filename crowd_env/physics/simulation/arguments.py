"""Checks of the arguments of `Simulation`: kernels check nothing."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Bodies, Bools, Floats, Ints, check_personal
from crowd_env.core.behaviors.outline import Outline
from crowd_env.core.behaviors.pulls import Pulls, pulls_of
from crowd_env.core.checks import FINITE, Range, array, require_all
from crowd_env.geometry.geometry import Geometry
from crowd_env.physics.scheme import ContactScheme
from crowd_env.physics.settings import Physics, Walking, behaviors_of
from crowd_env.physics.workspace import Command
from crowd_env.routing.fields.field import no_ways, travel_time_field
from crowd_env.routing.replanning import Place

STRIDE = 0.5  # radii that the desired speed may cover in one step; the rest of the radius is left for pushes


def check_step(
    scheme: ContactScheme, bodies: Bodies, dt: float, allow_unstable: bool = False, outline: Outline | None = None
) -> None:
    """Raise ValueError unless ``dt`` is positive, at most the scheme's stable step, and no stride too long: see `STRIDE`."""
    if not (np.isfinite(dt) and dt > 0):
        raise ValueError(f"dt is {dt!r} s; it must be finite and > 0")
    limit, formula = scheme.stable_dt(bodies), scheme.info.stable_step
    if outline is not None:
        limit = min(limit * outline.step_share, outline.turning_time)
        formula = f"{formula}; less with several discs a body"
    if dt > limit and not allow_unstable:
        raise ValueError(
            f"dt = {dt:g} s is above the stable step of {scheme.info.name}, {limit:.4g} s for these people: {formula}"
        )
    strides = bodies.desired_speed * dt / bodies.radius
    if not allow_unstable and strides.max(initial=0.0) > STRIDE:
        i = int(np.argmax(strides))
        speed, radius = bodies.desired_speed[i], bodies.radius[i]
        raise ValueError(
            f"dt = {dt:g} s is too long for pedestrian {i}: desired speed x dt = {speed:.3g} m/s x {dt:g} s = "
            f"{speed * dt:.3g} m, and it must be at most {STRIDE:g} of the radius of {radius:.3g} m; take dt <= "
            f"{STRIDE * radius / speed:.3g} s"
        )


def behaviors_of_simulation(physics: Physics, walking: Walking, places: int) -> dict[str, Any]:
    """Return all behaviors of a simulation of ``places`` places by name; None where one is absent.

    Raises
    ------
    ValueError
        If pulls are given neither for all places nor for each.
    """
    chosen = behaviors_of(physics, walking) | {one.NAME: one for one in walking.others}
    return chosen | {Pulls.NAME: tuple(pulls_of(walking.pulls, places))}


def routes_of(route: Any, known: Ints) -> Ints:
    """Return the route of each pedestrian, given for all or for each; ``known`` (N,) is the number of routes of each.

    Raises
    ------
    ValueError
        If these are not N whole numbers, or a pedestrian does not have the route.
    """
    given = array("route", route, known.shape if np.ndim(route) else (), "iu")
    routes = np.array(np.broadcast_to(given, known.shape), dtype=np.int64)
    check_routes(routes, known)
    return routes


def check_routes(route: Ints, known: Ints) -> None:
    """Raise ValueError unless each route is from 0 to ``known`` - 1: kernels look it up unchecked."""
    if ((route < 0) | (route >= known)).any():
        bad = np.flatnonzero((route < 0) | (route >= known))
        raise ValueError(f"route of pedestrian {bad[0]} is {route[bad[0]]}; it must be from 0 to {known[bad[0]] - 1}")


def fields_of(geometries: Sequence[Geometry], fields: Sequence[Place] | None, bodies: Bodies) -> list[Place]:
    """Return the routes or the field of each geometry; by default a field is made for each geometry with exits.

    Raises
    ------
    ValueError
        If not one (or None) is given for each geometry.
    """
    if fields is None:
        widest, thinnest = float(bodies.radius.max()), float(bodies.radius.min())
        made = [travel_time_field(g, widest, min_radius=thinnest) if len(g.exits) else None for g in geometries]
        return [no_ways(g) if field is None else field for g, field in zip(geometries, made, strict=True)]
    if len(fields) != len(geometries):
        raise ValueError(f"{len(fields)} fields for {len(geometries)} geometries; give one (or None) for each")
    return [no_ways(g) if field is None else field for g, field in zip(geometries, fields, strict=True)]


def check_sheets(sheet: Ints, sheets: Ints) -> None:
    """Raise ValueError unless each pedestrian stands on one of the ``sheets`` (P,) of its place, from 0 on."""
    wrong = (sheet < 0) | (sheet >= sheets)
    if wrong.any():
        i = int(np.argmax(wrong))
        known = "0, the only one" if sheets[i] == 1 else f"0 to {sheets[i] - 1}"
        raise ValueError(f"pedestrian {i} is on sheet {sheet[i]}; its place has {known}")


def which_geometry(geometry_of_env: Any, environments: int, geometries: int) -> Ints:
    """Return the geometry of each environment (E,), by default the first one.

    Raises
    ------
    ValueError
        If it is not one number for each, or there is no such geometry.
    """
    if geometry_of_env is None:
        return np.zeros(environments, dtype=np.int64)
    which = array("geometry_of_env", geometry_of_env, (environments,), "iu")
    return np.array(require_all("geometry_of_env", which, Range(0, geometries - 1)), dtype=np.int64)


def vectors(name: str, values: Floats, people: int) -> Floats:
    """Return ``values`` (P, 2) as contiguous floats for kernels.

    Raises
    ------
    ValueError
        If they have another shape or are not finite.
    """
    return require_all(name, np.ascontiguousarray(array(name, values, (people, 2)), dtype=np.float64), FINITE)


def motivation_of(name: str, value: Any, people: int) -> Floats:
    """Return the time gap or push of ``people`` pedestrians, given for all or for each; nan = as in the manner.

    Raises
    ------
    ValueError
        If the shape is another, or a number is out of range.
    """
    given = array(name, value, (people,) if np.ndim(value) else ())
    values = np.broadcast_to(np.asarray(given, dtype=np.float64), (people,))
    check_personal(name, values)
    return values


def check_command(asked: Command, people: int) -> Command:
    """Return the command of ``people`` pedestrians as arrays for kernels.

    Raises
    ------
    ValueError
        If an array has another shape, or a value is not finite.
    """
    kinds: Any = zip((vectors, _flags, vectors, _flags), Command._fields, asked, strict=True)
    return Command._make(None if values is None else check(name, values, people) for check, name, values in kinds)


def _flags(name: str, values: Any, people: int) -> Bools:
    return np.ascontiguousarray(array(name, values, (people,), "biuf"), dtype=bool)
