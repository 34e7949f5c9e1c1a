"""Variants of a place in which one thing is another, by a factor or as an amount: what a sweep compares."""

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import segment_lengths
from crowd_env.core.checks import at, known
from crowd_env.geometry.geometry import Geometry
from crowd_env.scenarios.cohorts import people_of
from crowd_env.scenarios.population import BOUNDS
from crowd_env.scenarios.scenario import Scenario


def with_times(place: Scenario, name: str, factor: float) -> Scenario:
    """Return the place with a number of its people multiplied: their number, or the distribution of a field.

    The draws of a seed stay the same but for the factor.

    Raises
    ------
    ValueError
        If the field has no distribution, or a value is out of range.
    """
    known("number of people", name, ("people", *BOUNDS))
    parts = [part.changed(**{name: _times(name, getattr(part, name), factor)}) for part in place.population.parts]
    return replace(place, population=people_of(parts))


def _times(name: str, value: Any, factor: float) -> Any:
    if value is None:
        raise ValueError(f"{name} is not set: give numbers, not factors")
    if name == "people":
        return max(1, round(factor * value))
    moved = {one.name: factor * getattr(value, one.name) for one in fields(value) if one.name != "sigma"}
    return replace(value, **moved)  # a distribution


def with_exit_widths(place: Scenario, width_of: Callable[[float], float]) -> Scenario:
    """Return the place with exits of other widths [m] around the same middles.

    Raises
    ------
    ValueError
        If an exit is no straight line, jambs are round, or a wider exit leaves its wall.
    """
    old = place.geometry
    if old.arcs.radius > 0.0:
        raise ValueError(f"{place.name}: exits with round jambs keep their width")
    if len(old.exits) > len(place.exits):
        raise ValueError(f"{place.name}: an exit is no straight line: it keeps its width")
    lengths = segment_lengths(old.exits)
    middle = old.exits.mean(axis=1, keepdims=True)
    lines = middle + (old.exits - middle) * np.array([width_of(one) / one for one in lengths.tolist()])[:, None, None]
    thin = old.walls[old.two_sided & (old.door_of_wall < 0)]
    doors = {
        name: closes or [leaf[0] for leaf in leaves] + [leaves[-1][1]]
        for k, (name, closes) in enumerate(zip(old.doors, old.exits_of_door, strict=True))
        if len(leaves := old.walls[old.door_of_wall == k])
    }
    with at("an exit of this width leaves its wall"):
        made = Geometry.from_polygon(
            old.walkable,
            exits=dict(zip(old.exit_names, lines, strict=True)),
            thin_walls=list(thin),
            regions=old.regions,
            doors=doors,
        )
    return replace(place, geometry=made)
