"""Doors: walls that appear and disappear.

The leaf of a door ends a millimeter short of the jambs, so that no corner belongs to it and to a permanent wall.
"""

from collections.abc import Mapping

import numpy as np
import shapely

from crowd_env.core.arrays.state import Floats, Ints, segment_lengths
from crowd_env.geometry.parsing import Area, Shape, read_lines, require_inside, tangents

_SHORT = 1e-3  # m
_SHORTEST = 0.1  # m
_JAMB = 0.1  # m; greatest distance of a door from its jambs


def read_doors(
    doors: Mapping[str, Shape], area: Area, thin: Floats, exits: Floats, exit_names: tuple[str, ...]
) -> tuple[Floats, Ints, tuple[str | None, ...]]:
    """Return the leaves (L, 2, 2) [m] of all doors, the door of each (L,), and the exit that each door closes (or None).

    Raises
    ------
    ValueError
        If a door has the name of an exit, names an unknown exit, or its line leaves the walkable area, is too short
        or touches no wall.
    """
    leaves, owner = [np.empty((0, 2, 2))], []
    lines = {}
    closes: list[str | None] = []
    for number, (name, given) in enumerate(doors.items()):
        thing = given.strip() if isinstance(given, str) else given
        if name in exit_names and not (isinstance(thing, str) and thing == name):
            raise ValueError(f"door {name!r} has the name of an exit; it must close that exit")
        if isinstance(thing, str) and thing in exit_names:
            segments = exits[[k for k, other in enumerate(exit_names) if other == thing]]
            along, _ = tangents(segments)
            left = np.stack([-along[:, 1], along[:, 0]], axis=1)
            segments = segments + _SHORT * left[:, None, :]  # inside, so that no center is over the line when it closes
            closes.append(thing)
        else:
            if isinstance(thing, str) and not thing.lstrip().upper().startswith(("LINE", "MULTILINE")):
                known = ", ".join(dict.fromkeys(exit_names)) or "none"
                raise ValueError(f"door {name!r} names an unknown exit {thing!r}; known: {known}; or give a line")
            lines[name] = read_lines([thing], f"door {name!r}")[0]
            require_inside(f"door {name!r}", lines[name], area, "cross a passage inside")
            segments = np.stack([lines[name][:-1], lines[name][1:]], axis=1)
            closes.append(None)
        length = segment_lengths(segments)[:, None]
        if length.min() < _SHORTEST:
            raise ValueError(f"door {name!r} is {length.min():.3f} m wide; it must be at least {_SHORTEST:g} m")
        cut = _SHORT * (segments[:, 1] - segments[:, 0]) / length
        leaves.append(np.stack([segments[:, 0] + cut, segments[:, 1] - cut], axis=1))
        owner += [number] * len(segments)
    _require_jambs(lines, area, thin)
    return np.concatenate(leaves), np.array(owner, dtype=np.int64), tuple(closes)


def _require_jambs(lines: Mapping[str, Floats], area: Area, thin: Floats) -> None:
    """Refuse a door line that stands in the open, away from all walls and other doors."""
    for name, line in lines.items():
        others = [shapely.LineString(other) for other_name, other in lines.items() if other_name != name]
        fixed = shapely.union_all([shapely.boundary(area), *shapely.linestrings(thin), *others])
        away = float(shapely.distance(fixed, shapely.LineString(line)))
        if away > _JAMB:
            raise ValueError(
                f"door {name!r} touches no wall: it is {away:.2f} m from the nearest; it must cross a passage"
            )
