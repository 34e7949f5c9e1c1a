"""The routes of a batch as arrays: the fields, regions and rules that the compiled step reads."""

from collections.abc import Sequence

import numpy as np

from crowd_env.core.arrays.state import Ints, row_starts
from crowd_env.routing.fields.field import NavigationField, by_sheet
from crowd_env.routing.route_set import RouteSet, region_masks
from crowd_env.routing.rules import MOST_REGIONS, Guidance, RegionArrays, RuleArrays

_REGION_CELL = 0.05  # m
_REGION_CELLS = 4e6  # a place of more than 100 m x 100 m gets larger ones


def add_fields(
    route_set: RouteSet | NavigationField | None, fields: list[NavigationField | None]
) -> tuple[list[int], list[int]]:
    """Append the fields of a place to the batch's fields; return for each route the row of its field and of its potential.

    In a building these are the rows of its first sheet.
    """
    if not isinstance(route_set, RouteSet):
        row = len(fields)
        fields += by_sheet(route_set)
        return [row], [row]
    rows = []
    for route in route_set.routes:
        rows.append(len(fields))
        fields += by_sheet(route.field)
    potentials = list(rows)
    for r, route in enumerate(route_set.routes):
        # The field changes in place, or ends at the region.
        if route.congestion is not None or route.to_exit is not None:
            potentials[r] = len(fields)
            fields += by_sheet(route.potential)
    return rows, potentials


def join_routes(
    places: Sequence[RouteSet | NavigationField | None], geometry_of_env: Ints
) -> tuple[list[NavigationField | None], list[int], Guidance, Ints]:
    """Return all fields of a batch, the geometry of each, the guidance that maps routes to fields, and the potentials.

    A place that is one field has one route.  A route that follows the crowd has a field of its own in every environment.
    The potentials (E, R) are rows of the fields by which progress on each route is counted, see `RouteField.potential`.
    """
    fields: list[NavigationField | None] = []
    geometry_of_field: list[int] = []
    rows_of_place: list[tuple[list[int], list[int]]] = []
    for g, place in enumerate(places):
        rows_of_place.append(add_fields(place, fields))
        geometry_of_field += [g] * (len(fields) - len(geometry_of_field))
    most = max(len(rows) for rows, _ in rows_of_place)
    table = np.full((4, len(geometry_of_env), most), -1, dtype=np.int64)
    until = np.zeros(table.shape[1:])
    for e, g in enumerate(geometry_of_env):
        place = places[g]
        rows, potentials = rows_of_place[g]
        table[0, e, : len(rows)], table[3, e, : len(rows)] = rows, potentials
        for r, route in enumerate(place.routes if isinstance(place, RouteSet) else ()):
            table[1:3, e, r], until[e, r] = (route.goal, route.following), route.until
            if route.congestion is not None:
                table[0, e, r] = len(fields)
                fields += by_sheet(route.field)
                geometry_of_field += [int(g)] * (len(fields) - len(geometry_of_field))
    ways = table[0].copy(), table[1].copy(), table[2].copy()
    guidance = Guidance(*ways, until, _join_regions(places), _join_rules(places))
    return fields, geometry_of_field, guidance, table[3].copy()


def _join_regions(places: Sequence[RouteSet | NavigationField | None]) -> RegionArrays:
    count = len(places)
    shape, origin = np.zeros((count, 2), dtype=np.int64), np.zeros((count, 2))
    fixed, factor = np.full((count, MOST_REGIONS), np.nan), np.ones((count, MOST_REGIONS))
    spacing = np.full(count, _REGION_CELL)
    masks: list[Ints] = []
    for g, place in enumerate(places):
        if not isinstance(place, RouteSet) or not (
            place.plan.zones or place.plan.rules or any(route.goal >= 0 for route in place.routes)
        ):
            masks.append(np.zeros(0, dtype=np.int64))
            continue
        geometry = place.geometry
        x0, y0, x1, y1 = geometry.bounds
        cell = spacing[g] = max(_REGION_CELL, float(np.sqrt((x1 - x0) * (y1 - y0) / _REGION_CELLS)))
        cols, rows = (int(np.ceil(length / cell)) + 1 for length in (x1 - x0, y1 - y0))
        middle = np.meshgrid(x0 + cell * (np.arange(cols) + 0.5), y0 + cell * (np.arange(rows) + 0.5))
        masks.append(region_masks(geometry, np.stack(middle, axis=-1)).ravel())
        shape[g], origin[g] = (rows, cols), (x0, y0)
        names = list(geometry.regions)
        for zone in place.plan.zones:
            k = names.index(zone.region)
            fixed[g, k] = np.nan if zone.speed is None else zone.speed
            factor[g, k] = zone.factor
    start = row_starts([len(mask) for mask in masks])
    return RegionArrays(start, shape, origin, spacing, np.concatenate(masks), fixed, factor)


def _join_rules(places: Sequence[RouteSet | NavigationField | None]) -> RuleArrays:
    rows: list[tuple[int, int, int, float, int, bool]] = []
    start = [0]
    for place in places:
        if isinstance(place, RouteSet):
            names = list(place.geometry.regions)
            for rule in place.plan.rules:
                below = rule.at_least if rule.below is None else rule.below
                number = place.number(rule.route)
                rows.append((names.index(rule.region), rule.at_least, below, rule.hold, number, rule.commits))
        start.append(len(rows))
    columns = zip(*rows, strict=True) if rows else [()] * 6
    kinds: tuple[type, ...] = (np.int64, np.int64, np.int64, np.float64, np.int64, np.bool_)
    arrays: list[np.ndarray] = [np.array(column, dtype=kind) for column, kind in zip(columns, kinds, strict=True)]
    return RuleArrays(np.array(start, dtype=np.int64), *arrays)
