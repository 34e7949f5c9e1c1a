"""The spread of people that keep a distance over wide openings; shortest ways would file along the ends of these.

    div q = 1,  q = -grad phi,  q . n = 0 at walls,  phi = 0 at exits

``q`` is the flow of a floor full of people that empties evenly: it fills every opening over its whole width, and runs straight
through a corridor.  It does not cross the lines on which shortest ways part, so people keep to the exit, and to the side of
every obstacle, of the shortest way.  It is followed where it leads within 60 degrees of that way, and less and less up to 90
degrees, so every step makes the way shorter, and around a corner the outer people stay outside.  Right in front of a narrow
opening, which limits them, and in file people take the shortest way.  The model is ours; recorded flow per meter does not fall
with the width of an opening (Seyfried et al. 2009, doi 10.1287/trsc.1090.0263).
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from crowd_env.core.arrays.state import Bools, Floats
from crowd_env.routing.fields import grid
from crowd_env.routing.fields.directions import regions_on_the_way
from crowd_env.routing.fields.field import NavigationField
from crowd_env.routing.fields.fronts import parts_of_bands
from crowd_env.routing.fields.grid import RIGHT, UP
from crowd_env.routing.fields.lookup import BLEND

_SPACING = 0.1  # m; more in large places, which need about this number of nodes:
_NODES = 40_000
_WIDE = 1.0  # m that the middle of a body has of an opening over which people spread
_ABREAST = 0.7  # m, the same of a corridor in which they do not go in file; fitted
_BEFORE = (
    1.0  # m that people take the shortest way in front of what is narrower; further away it is one file around corners
)
_ROOMY = 1.25  # times as wide: a square off the axes fits into the corner of a corridor that it does not fit into
_PARTING = 0.3  # ways part where the unit vectors of two nodes differ by more, along the line from one to the other
_ALIKE = 0.5  # cosine between flow and shortest way from which on people follow the flow alone


def spread(field: NavigationField, walls: Floats, wide: float = _WIDE) -> NavigationField:
    """Return ``field`` with directions that spread over openings of at least ``wide`` [m] for the middle of a body.

    ``walls`` (W, 2, 2) [m] are the standing ones.
    """
    if field.free is None:
        return field
    stride = max(1, int(_SPACING / field.spacing + 1e-9), int(np.sqrt(field.free.sum() / _NODES)))
    spacing, nodes = stride * field.spacing, np.s_[::stride, ::stride]
    floor, time, way = field.free[nodes], field.travel_time[nodes], field.direction[nodes]
    reach, turning, abreast = (int(np.ceil(0.5 * width / spacing - 1e-9)) for width in (wide, _ROOMY * wide, _ABREAST))
    narrow, single = _narrow(floor, reach), _single(floor, abreast)
    through = regions_on_the_way(time, way, narrow + 2 * single.astype(np.int64))
    before, in_file = (_over_square(some, round(_BEFORE / spacing), np.any) for some in (narrow, single))
    limited = (before & ~_narrow(floor, turning) & (through > 0)) | (in_file & (through >= 2))
    blocked = grid.blocked_lines(walls, floor.shape, field.origin, spacing)
    right = (blocked[:, :-1] & RIGHT == 0) & (way[:, 1:, 0] - way[:, :-1, 0] < _PARTING) & floor[:, :-1] & floor[:, 1:]
    up = (blocked[:-1] & UP == 0) & (way[1:, :, 1] - way[:-1, :, 1] < _PARTING) & floor[:-1] & floor[1:]
    rest = time if field.rest is None else field.rest[nodes]
    ends, part = floor & (rest < spacing), parts_of_bands(np.where(floor, 0, -1), right, up)
    floor = np.isin(part, part[ends])
    if not floor.any():
        return field
    right, up = right & floor[:, 1:], up & floor[1:]  # parts without a way out have no numbers
    # What comes through narrow openings is part of the flow beyond them.
    flow = np.where(limited[..., None], 0.0, _drain(ends, floor, right, up))
    direction = _between(flow, stride, field.travel_time.shape)
    alike = (direction * field.direction).sum(axis=-1)
    spreads = field.free & (alike > 0.0) & (field.travel_time > spacing)
    share = np.clip(alike / _ALIKE, 0.0, 1.0)[..., None]
    direction = _unit(share * direction + (1.0 - share) * field.direction)
    corner = spreads.copy()
    corner[:-1] |= spreads[1:]
    corner[:, :-1] |= corner[:, 1:].copy()
    return replace(
        field,
        direction=np.where(spreads[..., None], direction, field.direction),
        cell=np.where((field.cell >= 0) & corner, BLEND, field.cell),
    )


def _narrow(floor: Bools, half: int) -> Bools:
    """Return where on the ``floor`` a square of 2 ``half`` + 1 nodes has no room, by more than a node."""
    return floor & ~_over_square(_over_square(floor, half, np.all), half + 1, np.any)


def _single(floor: Bools, half: int) -> Bools:
    """Return the same of discs of ``half`` nodes, which have room in a corridor or not however it is turned.

    Discs enter short openings further than squares do, and so miss some of these.
    """
    core = ~grid.near(~np.pad(floor, half + 1), half)[half + 1 : -half - 1, half + 1 : -half - 1]
    return floor & ~_over_square(core, half + 1, np.any)


def _over_square(nodes: Bools, half: int, fit: Callable[..., Bools]) -> Bools:
    """Return for every node whether all or any (``fit``) in the square of 2 ``half`` + 1 nodes around it are true."""
    for axis in (0, 1):
        padding = [(half, half) if axis == k else (0, 0) for k in (0, 1)]
        nodes = fit(np.lib.stride_tricks.sliding_window_view(np.pad(nodes, padding), 2 * half + 1, axis), axis=-1)
    return nodes


def _drain(ends: Bools, floor: Bools, right: Bools, up: Bools) -> Floats:
    """Return the unit vectors (rows, cols, 2) of the flow from every node of the ``floor``; 0 beside it.

    ``ends`` (rows, cols) lie next to the way out, one at least in every part; ``right`` (rows, cols - 1) and ``up``
    (rows - 1, cols) say between which neighbors one can walk.
    """
    number, phi = np.zeros(floor.shape, dtype=np.int64), np.zeros(floor.shape)
    number[floor] = np.arange(floor.sum())
    beside = np.tile(number[floor][:, None], 4)
    for k, (link, here, there) in enumerate(
        ((right, number[:, :-1], number[:, 1:]), (up, number[:-1], number[1:])),
    ):
        beside[here[link], 2 * k], beside[there[link], 2 * k + 1] = there[link], here[link]
    found, scratch = np.zeros(len(beside)), np.ones((3, len(beside)))
    grid.drain(beside, ends[floor], found, scratch)
    phi[floor] = found
    x, y = right * (phi[:, :-1] - phi[:, 1:]), up * (phi[:-1] - phi[1:])
    flow = np.zeros((*floor.shape, 2))
    flow[:, :-1, 0] += x
    flow[:, 1:, 0] += x
    flow[:-1, :, 1] += y
    flow[1:, :, 1] += y
    return _unit(flow)


def _between(vectors: Floats, stride: int, shape: tuple[int, ...]) -> Floats:
    """Return unit vectors of every ``stride``-th node as unit vectors of all nodes of a grid of ``shape`` (rows, cols)."""
    for axis in (0, 1):
        place = np.arange(shape[axis]) / stride
        first = place.astype(np.int64)
        then = np.minimum(first + 1, vectors.shape[axis] - 1)
        share = np.expand_dims(place - first, (1 - axis, 2))
        vectors = (1.0 - share) * np.take(vectors, first, axis=axis) + share * np.take(vectors, then, axis=axis)
    return _unit(vectors)


def _unit(vectors: Floats) -> Floats:
    norm = np.hypot(vectors[..., 0], vectors[..., 1])[..., None]
    return np.divide(vectors, norm, out=np.zeros_like(vectors), where=norm > 1e-12)
