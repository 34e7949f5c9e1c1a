"""The way out of a building: the ways of its sheets, each from the seams on, which begin at the times of the sheets beyond.

A sheet is solved like any place, with its exits and the seams that lead on as ends.  Sheets follow each other by the least time
at a seam (Dijkstra 1959), and a sheet is solved again where another seam leads out sooner.  A way for larger bodies comes
before any that is too narrow for them.  People walk by the nodes of their sheet in true coordinates.  In the field of the
layout these are moved by half a distance between nodes at most.
"""

import heapq
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.geometry.geometry import Geometry
from crowd_env.geometry.parsing import Area, place
from crowd_env.geometry.parts import split_by_exits
from crowd_env.geometry.sheets import Building, bare_surface, seam_name
from crowd_env.geometry.surface import heights, slopes_at
from crowd_env.routing.fields import grid
from crowd_env.routing.fields.domain import open_exits
from crowd_env.routing.fields.lookup import ALONE, BLEND

Field: TypeAlias = Any  # a `crowd_env.routing.fields.field.NavigationField`, which is made of this

_NOTHING = 1e-6  # m, m2
_WALK = 1.34  # m/s; ways on a moving belt are made for this speed, ...
_AGAINST = 0.02  # ... and at least this share of it
_SOONER = 0.05  # s; a seam that leads out sooner by less changes nothing


class Window(NamedTuple):
    """Where the nodes of a sheet lie among the nodes of the layout."""

    nodes: tuple[slice, slice]  # rows, columns
    origin: Floats  # (2,)  m   of the first of them, in true coordinates
    shift: tuple[float, float]  # m   from there to the layout


NOWHERE = Window(np.s_[0:0, 0:0], np.zeros(2), (0.0, 0.0))  # of a sheet without a way


class SheetGround(NamedTuple):
    """One sheet to solve, in true coordinates.

    The seams that its ways may lead over are exits, with the times from there on.
    """

    geometry: Geometry
    offset: Floats  # (2,)  m   to the layout
    start: Mapping[str, tuple[float, float]]  # s, and the radius of the largest body that gets out from there on [m]
    has_goal: bool
    # Relative speed (...) at points (..., 2) [m] of ways to this exit or over this seam; None = it is level.
    speed_to: Callable[[str | None, Floats], Floats] | None


def field_of_sheets(
    geometry: Geometry,
    solve: "Callable[[SheetGround, list[str], float | None], Field]",
    exits: Iterable[str] | None,
    goal: str | None,
    closed: Collection[str],
    least: float,
) -> Field:
    """Return the field of a building.

    Parameters
    ----------
    geometry : of the layout.
    solve : returns the field of one sheet, with a given distance between nodes or one of its own.
    exits : names; None = all.
    goal : region to lead into instead.
    closed : doors.
    least : m, radius of the smallest body.

    Raises
    ------
    ValueError
        If a sheet has no way out while all doors are open, or one of them cannot be solved.
    """
    assert geometry.building is not None
    wanted = [] if goal is not None else open_exits(geometry, exits, closed)
    ground = geometry.with_ways_to(wanted)
    sheets = _Sheets(ground, wanted, goal, solve, least)
    spacings = sheets.march(None)
    while len(spacings) > 1:
        spacings = sheets.march(min(spacings))
    for sheet, lost in zip(geometry.building.sheets, sheets.lost(), strict=True):
        if not closed and not lost.buffer(-least).is_empty:
            at = place(lost.representative_point().coords[0])
            raise ValueError(
                f"no exit can be reached from {sheet.name!r} around {at}; a stair or an exit must lead out"
            )
    behind = _least_behind(geometry, ground, wanted)
    return sheets.together(geometry, spacings.pop(), behind)


def _least_behind(geometry: Geometry, ground: Geometry, wanted: Collection[str]) -> float:
    use = np.isin(geometry.exit_names, list(wanted))
    ends, lines = ground.exits[use].mean(axis=1), geometry.exits[use].mean(axis=1)
    return float(np.hypot(*(ends - lines).T).min()) if use.any() else 0.0


class _Sheets:
    """The fields of the sheets of a building in the making."""

    def __init__(
        self,
        ground: Geometry,
        wanted: Collection[str],
        goal: str | None,
        solve: "Callable[[SheetGround, list[str], float | None], Field]",
        least: float,
    ) -> None:
        assert ground.building is not None
        self._building, self._wanted, self._goal, self._solve = ground.building, wanted, goal, solve
        self._parts = [ground.sheet_alone(s) for s in range(len(self._building.sheets))]
        self._from, self._to, self._offsets = (
            self._building.from_sheet,
            self._building.to_sheet,
            self._building.offsets,
        )
        self._least = least - 1e-6
        clear = [part.clear_widths(2.0 * least) for part in self._parts]
        names = [seam_name(k) for k in range(len(self._from))]
        self._room = [
            0.5 * min(clear[i][n], clear[j][names[self._twin(k)]])
            for k, (n, i, j) in enumerate(zip(names, self._from, self._to, strict=True))
        ]
        self.found: dict[int, Field] = {}
        self._used: dict[int, dict[str, tuple[float, float]]] = {}

    def march(self, spacing: float | None) -> set[float]:
        """Find all fields, with this distance between nodes [m] or one that suits each; returns the distances."""
        self.found, self._used = {}, {s: {} for s in range(len(self._parts))}
        heap: list[tuple[float, float, int]] = []
        for s, part in enumerate(self._parts):
            if self._has_goal(s) or any(self._is_end(s, name) for name in part.exit_names):
                self._find(s, spacing, heap)
        while heap:
            size, time, k = heapq.heappop(heap)
            s, name = int(self._from[k]), seam_name(k)
            known = self._at(s, k) if s in self.found else (np.inf, 0.0)
            if all(_is_better(time, -size, *one) for one in (known, self._used[s].get(name, (np.inf, 0.0)))):
                self._used[s][name] = time, -size
                self._find(s, spacing, heap)
        return {field.spacing for field in self.found.values()}

    def _find(self, s: int, spacing: float | None, heap: list[tuple[float, float, int]]) -> None:
        part, offset = self._parts[s], self._offsets[s]
        exits = [name for name in dict.fromkeys(part.exit_names) if self._is_end(s, name)]
        part = replace(part, walkable=self._on_ways(s))
        sheet = SheetGround(part, offset, self._used[s], self._has_goal(s), speeds_on(self._building, s, part))
        self.found[s] = self._solve(sheet, exits, spacing)
        for k in np.flatnonzero(self._to == s).tolist():
            time, fits = self._at(s, self._twin(k))
            size = min(fits, self._room[k])
            if np.isfinite(time) and size > self._least:
                heapq.heappush(heap, (-size, time, k))

    def _on_ways(self, s: int) -> Area:
        """Return the parts of sheet ``s`` from which the ways known so far lead on."""
        part = self._parts[s]
        ends = [line for line, name in zip(part.exits, part.exit_names, strict=True) if self._is_end(s, name)]
        return part.walkable if self._has_goal(s) else split_by_exits(part.walkable, np.array(ends))[0]

    def _is_end(self, s: int, name: str) -> bool:
        return name in self._wanted or name in self._used[s]

    def lost(self) -> list[Area]:
        """Return the parts of each sheet from which no way leads on."""
        areas = [self._parts[s].walkable for s in range(len(self._parts))]
        return [area.difference(self._on_ways(s)) if s in self.found else area for s, area in enumerate(areas)]

    def _has_goal(self, s: int) -> bool:
        return self._goal is not None and self._parts[s].area_of(self._goal) > _NOTHING

    def _twin(self, k: int) -> int:
        """Return the same seam on its other sheet."""
        same = np.flatnonzero((self._building.seam == self._building.seam[k]) & (self._from == self._to[k]))
        return int(same[0])

    def _at(self, s: int, k: int) -> tuple[float, float]:
        """Return the travel time [s] on sheet ``s`` in the middle of line ``k``, inf without a way, and what body fits."""
        line = (self._building.lines[k] - self._offsets[s])[None]
        if not self._on_ways(s).covers(split_by_exits(self._parts[s].walkable, line)[0]):
            return np.inf, 0.0
        field, middle = self.found[s], line.mean(axis=1)
        time, fits = (
            float(values[grid.nearest_known(middle, values, field.origin, field.spacing)][0])
            for values in (field.travel_time, field.fits)
        )
        return time, fits

    def together(self, geometry: Geometry, spacing: float, behind: float) -> Field:
        """Return the fields of all sheets as one over the layout."""
        high = np.array(geometry.bounds[2:])
        some = next(iter(self.found.values()))
        first = {s: field.origin + self._offsets[s] for s, field in self.found.items()}
        last = [at + spacing * (np.array(self.found[s].travel_time.shape[::-1]) - 1) for s, at in first.items()]
        high, low = np.max([high, *last], axis=0), np.min(list(first.values()), axis=0)
        cols, rows = (np.rint((high - low) / spacing).astype(int) + 2).tolist()
        names = list(geometry.exit_names)
        whole: dict[str, Any] = {
            "travel_time": np.full((rows, cols), np.nan),
            "direction": np.zeros((rows, cols, 2)),
            "direct": np.full((rows, cols), -1, dtype=np.int64),
            "cell": np.full((rows, cols), ALONE, dtype=np.int64),
            "free": np.zeros((rows, cols), dtype=bool),
            "fits": np.full((rows, cols), np.nan),
            "rest": np.full((rows, cols), np.nan),
        }
        windows = [NOWHERE] * len(self._parts)
        for s, field in self.found.items():
            col, row = np.rint((first[s] - low) / spacing).astype(int).tolist()
            window = np.s_[row : row + field.travel_time.shape[0], col : col + field.travel_time.shape[1]]
            windows[s] = Window(window, field.origin, self._building.sheets[s].offset)
            rows_of = _rows_of(geometry, self._parts[s], names, self._offsets[s])
            start = np.array([self._used[s].get(name, (0.0, 0.0))[0] for name in self._parts[s].exit_names])
            least = min([time for time, _ in self._used[s].values()], default=0.0)
            left = field.travel_time - np.where(field.direct >= 0, start[np.maximum(field.direct, 0)], least)
            direct = np.where(field.direct >= 0, rows_of[np.maximum(field.direct, 0)], -1)
            cell = np.where(field.cell >= 0, rows_of[np.maximum(field.cell, 0)], field.cell)
            inside = ~np.isnan(field.travel_time)
            values = {
                "travel_time": field.travel_time,
                "direction": field.direction,
                "direct": direct,
                "cell": np.where((field.cell >= 0) & (cell < 0), BLEND, cell),
                "free": field.free,
                "fits": field.fits,
                "rest": left,
            }
            for name, value in values.items():
                if value is not None:
                    whole[name][window] = np.where(
                        inside[..., None] if value.ndim == 3 else inside | (name == "cell"), value, whole[name][window]
                    )
        return replace(some, **whole, origin=low, spacing=spacing, behind=behind, windows=tuple(windows))


def _is_better(time: float, size: float, known: float, fits: float) -> bool:
    return size > fits + _NOTHING or (size > fits - _NOTHING and time < known - _SOONER)


def _rows_of(geometry: Geometry, part: Geometry, names: list[str], offset: Floats) -> Ints:
    """Return for each row of the exits of a sheet the row in the building; -1 for seams."""
    found = []
    for line, name in zip(part.exits + offset, part.exit_names, strict=True):
        rows = [r for r, other in enumerate(names) if other == name]
        off = [float(np.hypot(*(geometry.exits[r].mean(axis=0) - line.mean(axis=0)))) for r in rows]
        found.append(rows[int(np.argmin(off))] if rows else -1)
    return np.array(found, dtype=np.int64)


def speeds_on(building: Building, s: int, part: Geometry) -> Callable[[str | None, Floats], Floats] | None:
    """Return the speed on sheet ``s``, which is ``part`` alone, see `SheetGround.speed_to`."""
    if not building.sheets[s].slopes:
        return None
    surface, ends = bare_surface(building.sheets), dict(zip(part.exit_names, part.exits.mean(axis=1), strict=True))

    def speed_to(name: str | None, points: Floats) -> Floats:
        flat = points.reshape(-1, 2)
        on = slopes_at(surface, s, flat)
        found = np.ones(len(flat))
        sloped = on >= 0
        if sloped.any():
            plane = surface.plane[on[sloped]]
            belt = surface.belt[on[sloped]] / _WALK * plane[:, :2].any(axis=1)  # landings stand still
            up, down = surface.up[on[sloped]] + belt, surface.down[on[sloped]] - belt
            falls = np.full(len(plane), True)
            if name is not None:
                end = heights(surface, np.full(1, s), ends[name][None])[0]
                falls = heights(surface, np.full(len(plane), s), flat[sloped]) >= end
            rise = np.hypot(plane[:, 0], plane[:, 1])
            found[sloped] = np.maximum(np.where(falls, down, up), _AGAINST) / np.sqrt(1.0 + rise**2)
        return found.reshape(points.shape[:-1])

    return speed_to
