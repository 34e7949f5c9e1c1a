"""The fastest way over the sheets of a building: each is marched from its exits and its seams, in the order of their times.

A march from a seam does not depend on when people are out from there on: each seam is marched once, and the least sum counts.
"""

from collections.abc import Iterator
from heapq import heappop, heappush
from typing import NamedTuple

import numpy as np
import skfmm

from crowd_env.core.arrays.state import Bools, Floats, Ints
from crowd_env.geometry.geometry import Geometry
from crowd_env.geometry.sheets import Building, seam_name, sheets_at
from crowd_env.routing.fields import grid
from crowd_env.routing.fields.domain import SOURCE, Grid, source_distance
from crowd_env.routing.fields.extension import BEFORE, lead_over
from crowd_env.routing.fields.sheets import Field, Window, speeds_on


def coarse(windows: tuple[Window, ...], stride: int, spacing: float) -> tuple[Window, ...]:
    """Return where every ``stride``-th node of sheets lies, of nodes ``spacing`` [m] apart."""
    found = []
    for window in windows:
        first = np.array([-(-side.start // stride) for side in window.nodes])
        rows, cols = (slice(int(k), -(-side.stop // stride)) for k, side in zip(first, window.nodes, strict=True))
        off = first * stride - [side.start for side in window.nodes]
        found.append(Window((rows, cols), window.origin + spacing * off[::-1], window.shift))
    return tuple(found)


def reach(level: "np.ma.MaskedArray", first: Floats, free: Bools, speed: Floats, spacing: float) -> Floats:
    """Return the travel times [s] of ``free`` nodes (rows, cols) from where ``level`` is 0; ``first`` is how far away [m]."""
    seeds = free & (first < SOURCE * spacing)
    time = np.where(seeds, first / speed, np.nan)
    if (free & ~seeds).any():
        marched = skfmm.travel_time(level, speed, dx=spacing, order=1)
        far = free & ~seeds & ~np.ma.getmaskarray(marched)
        start = SOURCE * spacing / float(np.median(speed[seeds])) if seeds.any() else 0.0
        time[far] = np.ma.getdata(marched)[far] + start
    return time


class _Line(NamedTuple):
    """A seam, or the exits of a sheet, as what a sheet is marched from; all arrays are over the nodes of its sheet."""

    sheet: int
    level: "np.ma.MaskedArray"
    first: Floats  # m   distance
    free: Bools
    pace: Floats | None  # relative to the way down, of slopes that are climbed towards it
    time: Floats  # s   without people
    twin: int = -1  # the same seam on its other sheet
    end: tuple[int, int] = (0, 0)  # the node before its middle
    off: float = 0.0  # m   from there to the seam
    before: tuple[Ints, Ints] = (np.empty(0, np.int64),) * 2  # nodes right before it
    over: Floats = np.empty((0, 2))  # their way over it


class Crossings:
    """The seams of a building on the nodes of its layout.

    Parameters
    ----------
    geometry : of the layout, as ways end in it.
    windows : where the nodes of each sheet lie.
    fine : the field of the empty place.
    free, first, speed, spacing : of `crowd_env.routing.fields.congestion.CongestionField`; slopes change ``speed``, in place.

    Attributes
    ----------
    links : (2, N) rows of nodes, side by side on either side of a seam.
    """

    def __init__(
        self,
        geometry: Geometry,
        windows: tuple[Window, ...],
        fine: Field,
        free: Bools,
        first: Floats,
        speed: Floats,
        spacing: float,
    ) -> None:
        assert geometry.building is not None
        self._building: Building = geometry.building
        self._windows, self._free, self._speed, self._spacing = windows, free, speed, spacing
        self._exits: list[_Line] = []
        self._lines: dict[int, _Line] = {}
        from_sheet, seam = self._building.from_sheet, self._building.seam
        sheet = np.full(free.shape, -1)
        sheet[free] = sheets_at(grid.node_points(fine.origin, spacing, free.shape)[free], self._building.sheets)
        for s, (nodes, origin, _) in enumerate(windows):
            mine = sheet[nodes] == s
            if not mine.any():
                continue
            part, points = geometry.sheet_alone(s), grid.node_points(origin, spacing, mine.shape)
            pace, ground = speeds_on(self._building, s, part), Grid(origin, spacing, mine, mine)
            if pace is not None:
                speed[nodes][mine] *= pace(None, points)[mine]
            if (mine & (first[nodes] < SOURCE * spacing)).any():
                self._exits.append(self._line(s, mine, first[nodes], None))
            for k in np.flatnonzero(from_sheet == s).tolist():
                line = self._building.lines[k] - self._building.offsets[s]
                away = source_distance(line[None], ground, fine.radius, cap=4 * SOURCE * spacing)
                if not (mine & (away < SOURCE * spacing)).any():
                    continue
                climbs = None if pace is None else pace(seam_name(k), points) / pace(None, points)
                made = self._line(s, mine, away, None if climbs is None or (climbs == 1.0).all() else climbs)
                near = np.where(mine & (away < SOURCE * spacing), 0.0, np.nan)
                row, col = (int(n[0]) for n in grid.nearest_known(line.mean(axis=0)[None], near, origin, spacing))
                twin = int(np.flatnonzero((seam == seam[k]) & (from_sheet != s))[0])
                here, there = (
                    float(fine.fits[grid.nearest_known(middle[None], fine.fits, fine.origin, fine.spacing)][0])
                    for middle in self._building.lines[[k, twin]].mean(axis=1)
                )
                if there < here - 1e-6:  # too narrow for bodies that get out elsewhere
                    continue
                close, over = mine & (away < BEFORE * spacing), np.zeros((*mine.shape, 2))
                lead_over(line[None], close, origin, spacing, fine.radius, over)
                i, j = np.nonzero(close)
                self._lines[k] = made._replace(
                    twin=twin,
                    end=(row, col),
                    off=float(away[row, col]),
                    before=(i, j),
                    over=over[i, j],
                )
        self.links = self._links()

    def _line(self, s: int, free: Bools, first: Floats, pace: Floats | None) -> _Line:
        level, speed = first - SOURCE * self._spacing, self._speed[self._windows[s].nodes].copy()
        made = np.ma.MaskedArray(np.where(np.isfinite(level), level, 1e3), ~free)
        time = reach(made, first, free, speed if pace is None else speed * pace, self._spacing)
        return _Line(s, made, first, free, pace, time)

    def _links(self) -> Ints:
        found = [np.empty((2, 0), dtype=np.int64)]
        rows = np.arange(self._free.size).reshape(self._free.shape)
        for line in self._lines.values():
            twin = self._lines.get(line.twin)
            if twin is not None and line.sheet < twin.sheet:
                ends = []
                for one in (line, twin):
                    window, near = self._windows[one.sheet], np.nonzero(one.free & (one.first < SOURCE * self._spacing))
                    points = window.origin + self._spacing * np.column_stack(near[::-1])
                    ends.append((points, rows[window.nodes][near]))
                apart = np.hypot(*np.moveaxis(ends[0][0][:, None] - ends[1][0], -1, 0))
                found.append(np.stack([ends[0][1], ends[1][1][np.argmin(apart, axis=1)]]))
        return np.concatenate(found, axis=1)

    def march(self, speed: Floats) -> tuple[Floats, Ints]:
        """Return the travel times [s] at ``speed``, and the seam over which the way from each node leads; -1 = to an exit."""
        time, via = np.full(speed.shape, np.nan), np.full(speed.shape, -1)
        heap: list[tuple[float, int]] = []
        for line in self._exits:
            self._lower(line, -1, 0.0, speed, time, via, heap)
        done = set[int]()
        while heap:
            at, k = heappop(heap)
            line = self._lines[k]
            known = time[self._windows[line.sheet].nodes][line.end]
            if k not in done and not at >= known:  # nan = not known
                done.add(k)
                self._lower(line, k, at, speed, time, via, heap)
        return time, via

    def _lower(
        self, line: _Line, k: int, start: float, speed: Floats, time: Floats, via: Ints, heap: list[tuple[float, int]]
    ) -> None:
        nodes = self._windows[line.sheet].nodes
        here, found = speed[nodes].copy(), line.time  # scikit-fmm reads views wrongly
        if not np.array_equal(here, self._speed[nodes]):
            found = reach(
                line.level, line.first, line.free, here if line.pace is None else here * line.pace, self._spacing
            )
        sooner = ~(time[nodes] <= start + found) & ~np.isnan(found)
        time[nodes][sooner], via[nodes][sooner] = start + found[sooner], k
        for one in self._lines.values():
            if one.sheet == line.sheet and one.twin in self._lines and sooner[one.end]:
                heappush(heap, (float(time[nodes][one.end] + one.off / here[one.end]), one.twin))

    def before(self, via: Ints) -> Iterator[tuple[tuple[Ints, Ints], Floats]]:
        """Yield the nodes (rows, columns) right before the seams that ways lead over, and their directions (K, 2)."""
        for k, line in self._lines.items():
            (rows, cols), (i, j) = self._windows[line.sheet].nodes, line.before
            here = via[rows, cols][i, j] == k
            yield (i[here] + rows.start, j[here] + cols.start), line.over[here]
