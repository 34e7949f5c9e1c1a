"""Density and speed by the Voronoi method (Steffen, Seyfried 2010, doi 10.1016/j.physa.2009.12.015)."""

import itertools
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry import Polygon

from validation.cases.crowds import Bools, Crowds, Floats, Moment, mean_of

REACH = 1.0  # m: a pedestrian takes up no more room than a disc of this radius, as in PedPy's evaluations of these recordings
_LOOKS = 5  # tenths of a second between two looks at a field


def cells(position: Floats, floor: Polygon, reach: float = REACH) -> np.ndarray:
    """Return the cell (N,) of each of some people on the floor: what is nearer to them than to anyone else, and near."""
    discs = shapely.buffer(shapely.points(position), reach, quad_segs=8)
    shapely.prepare(floor)
    if len(position) > 1:
        around = shapely.envelope(shapely.union(floor, shapely.multipoints(position))).buffer(2.0 * reach)
        parts = shapely.get_parts(shapely.voronoi_polygons(shapely.multipoints(position), extend_to=around))
        person, part = shapely.STRtree(parts).query(shapely.points(position), predicate="intersects")
        own = np.empty(len(position), dtype=np.int64)
        own[person] = part
        discs = shapely.intersection(discs, parts[own])
    return shapely.intersection(discs, floor)


def density_and_speed(
    position: Floats, speed: Floats, floor: Polygon, field: Polygon, reach: float = REACH
) -> tuple[float, float]:
    """Return density [1/m2] and mean speed [m/s] in a measurement field; the speed is nan where no pedestrian is near.

    Parameters
    ----------
    position : (N, 2) m, of people on the floor.
    speed : (N,) m/s.
    floor : what their cells are cut at.
    field : part of the floor that is measured.
    """
    if not len(position):
        return 0.0, float("nan")
    room = cells(position, floor, reach)
    shared = shapely.area(shapely.intersection(room, field))
    if not shared.any():
        return 0.0, float("nan")
    density = float((shared / np.maximum(shapely.area(room), 1e-12)).sum() / field.area)
    return density, float((shared * speed).sum() / shared.sum())


class Look(NamedTuple):
    """The pedestrians near a measurement field at a moment."""

    crowd: int
    time: float  # s
    position: Floats  # (K, 2) m
    speed: Floats  # (K,) m/s


def looks_at(
    crowds: Crowds, moments: Iterable[tuple[Moment, Moment]], is_near: Callable[[Floats, Floats], Bools]
) -> list[Look]:
    """Return the pedestrians near a field every half second, crowd by crowd, with their speeds over the last tenth of a second.

    ``is_near`` says of places x, y (P,) [m] whether they are near.
    """
    looks = []
    for before, now in itertools.islice(moments, None, None, _LOOKS):
        speed = np.hypot(*(now.position - before.position).T) / (now.time - before.time)
        near = is_near(*now.position.T) & now.active
        for e in range(crowds.count):
            people = crowds.people(e)
            here = near[people]
            looks.append(Look(e, now.time, now.position[people][here], speed[people][here]))
    return looks


def samples_between(begin: float, end: float, looks: Sequence[Look], floor: Polygon, field: Polygon) -> Floats:
    """Return density [1/m2] and speed [m/s] in a field (K, 2) at each look between two times [s]."""
    seen = [density_and_speed(one.position, one.speed, floor, field) for one in looks if begin <= one.time <= end]
    return np.array(seen).reshape(-1, 2)


def steady(
    first: int, last: int, times: Floats, looks: Sequence[Look], floor: Polygon, field: Polygon
) -> tuple[Floats, float]:
    """Return densities and speeds (K, 2), and the flow [1/s], between two passages; nan if the last is missing.

    Parameters
    ----------
    first, last : numbers of the two, from 1 on.
    times : (N,) s, at which people pass, in order.
    """
    begin, end = times[first - 1], times[last - 1]
    if not np.isfinite(end):
        return np.empty((0, 2)), float("nan")
    return samples_between(begin, end, looks, floor, field), float((last - first) / (end - begin))


def mean_figures(draws: Sequence[tuple[Floats, float]]) -> dict[str, float]:
    """Return the means over draws of density [1/m2], speed [m/s] and flow [1/s] of what `steady` returns."""
    figures = [(mean_of(samples[:, 0]), mean_of(samples[:, 1]), flow) for samples, flow in draws]
    return {name: mean_of([one[k] for one in figures]) for k, name in enumerate(("density", "speed", "flow"))}


def fundamental_diagram(samples: Floats, width: float = 0.25, least: int = 10) -> dict[float, float]:
    """Return the mean speed [m/s] in bins of density [1/m2], by their middles, where there are enough of the samples (K, 2)."""
    density, speed = samples[np.isfinite(samples).all(axis=1)].T
    place = np.floor(density / width).astype(int)
    bins = [k for k in np.unique(place) if (place == k).sum() >= least]
    return {float((k + 0.5) * width): float(speed[place == k].mean()) for k in bins}
