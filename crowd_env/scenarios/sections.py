"""Sections: lines across the floor at which people are counted."""

import math
from dataclasses import dataclass

import numpy as np
import shapely

from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import check_fields, plain_name, refuse, shown
from crowd_env.geometry.geometry import Geometry
from crowd_env.geometry.parsing import parse_exit

_SHORTEST = 0.1  # m


@dataclass(frozen=True)
class Section:
    """A line at which people are counted, each direction apart."""

    name: str
    """name of the section in results and pictures."""
    line: tuple[tuple[float, float], ...]
    """[[x1, y1], [x2, y2]] in m; what lies on the floor counts."""

    def __post_init__(self) -> None:
        what = f"section {shown(self.name)}"
        must = f"[[x1, y1], [x2, y2]], {_SHORTEST:g} m long or more"
        if not isinstance(self.line, list | tuple):
            refuse(f"{what}: line", self.line, must)
        check_fields(what, self)
        plain_name("section: name", self.name)
        if [len(point) for point in self.line] != [2, 2] or math.dist(*self.line) < _SHORTEST:
            refuse(f"{what}: line", self.line, must)

    def length_on(self, geometry: Geometry) -> float:
        """Return how long the line is on the floor [m]."""
        return float(shapely.intersection(shapely.LineString(self.line), geometry.walkable).length)

    def moved(self, line: Floats) -> "Section":
        """Return the section at another ``line`` (2, 2) [m]."""
        (x1, y1), (x2, y2) = np.asarray(line, dtype=np.float64).tolist()
        return Section(self.name, ((x1, y1), (x2, y2)))


def require_sections(sections: tuple[Section, ...], geometry: Geometry) -> None:
    """Raise ValueError if two sections have one name, or one lies off the floor."""
    names = [section.name for section in sections]
    for k, section in enumerate(sections):
        if section.name in names[:k]:
            raise ValueError(f"two sections have the name {section.name!r}")
        if section.length_on(geometry) < _SHORTEST:
            raise ValueError(f"section {section.name!r} lies off the walkable area; it must cross it")


def parse_section(text: str, number: int, unit: float = 1.0) -> Section:
    """Return the section that is written as ``NAME=x1,y1,x2,y2`` or ``x1,y1,x2,y2``, in units of ``unit`` meters.

    One without a name has that of its ``number``.

    Raises
    ------
    ValueError
        If the text has neither form, or a number is not finite.
    """
    name, _, numbers = text.rpartition("=")
    try:
        line = parse_exit(numbers)
    except ValueError:
        line = shapely.Point()
    if line.geom_type != "LineString":
        raise ValueError(f"section {text!r} is not understood; it must be x1,y1,x2,y2 or NAME=x1,y1,x2,y2")
    points = unit * shapely.get_coordinates(line)
    return Section(name.strip() or f"section-{number}", tuple(map(tuple, points.tolist())))
