"""Plans in degrees: lengths are those on the ground, and all that is in a file has one origin."""

import math

import numpy as np
import pytest
import shapely
from cases import looped
from plan_files import ROOM, feature, geojson

from crowd_env.scenarios.plans.reading import read_plan

CRS84 = {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}


def vincenty(a, b):
    """Return the distance [m] of two places (longitude, latitude) [degrees] on the ellipsoid (Vincenty 1975, inverse)."""
    axis, flat = 6378137.0, 1 / 298.257223563
    u1, u2 = (math.atan((1 - flat) * math.tan(math.radians(y))) for _, y in (a, b))
    apart = lam = math.radians(b[0] - a[0])
    for _ in range(50):
        sin_s = math.hypot(
            math.cos(u2) * math.sin(lam), math.cos(u1) * math.sin(u2) - math.sin(u1) * math.cos(u2) * math.cos(lam)
        )
        cos_s = math.sin(u1) * math.sin(u2) + math.cos(u1) * math.cos(u2) * math.cos(lam)
        s = math.atan2(sin_s, cos_s)
        sin_a = math.cos(u1) * math.cos(u2) * math.sin(lam) / sin_s
        cos2 = 1 - sin_a**2
        mid = cos_s - 2 * math.sin(u1) * math.sin(u2) / cos2 if cos2 else 0.0
        c = flat / 16 * cos2 * (4 + flat * (4 - 3 * cos2))
        lam = apart + (1 - c) * flat * sin_a * (s + c * sin_s * (mid + c * cos_s * (-1 + 2 * mid**2)))
    u = cos2 * (axis**2 / (axis * (1 - flat)) ** 2 - 1)
    big = 1 + u / 16384 * (4096 + u * (-768 + u * (320 - 175 * u)))
    small = u / 1024 * (256 + u * (-128 + u * (74 - 47 * u)))
    part = cos_s * (-1 + 2 * mid**2) - small / 6 * mid * (-3 + 4 * sin_s**2) * (-3 + 4 * mid**2)
    return axis * (1 - flat) * big * (s - small * sin_s * (mid + small / 4 * part))


def degrees(shape, lon=8.54, lat=47.377):
    """Return a shape [m] in degrees, by a sphere: about right."""
    return shapely.transform(shape, lambda p: (lon, lat) + p / (111_195 * math.cos(math.radians(lat)), 111_195))


EXIT = shapely.LineString([(8, 2), (8, 3.2)])


def room(lon=8.54, lat=47.377):
    return [feature(degrees(shape, lon, lat), kind=kind) for shape, kind in ((ROOM, "room"), (EXIT, "exit"))]


def test_the_other_formula_is_right():
    """Flinders Peak to Buninyong, the example of Geoscience Australia, GDA technical manual: 54 972.271 m."""
    flinders = (144 + 25 / 60 + 29.52440 / 3600, -(37 + 57 / 60 + 3.72030 / 3600))
    buninyong = (143 + 55 / 60 + 35.38390 / 3600, -(37 + 39 / 60 + 10.15610 / 3600))
    assert vincenty(flinders, buninyong) == pytest.approx(54_972.271, abs=2e-3)


@looped(("lon", "lat"), [(8.54, 47.377), (-2.98, 56.46), (151.2, -33.87), (103.8, 1.3), (0.0, 0.0), (25.7, 66.5)])
@looped("shape", [shapely.box(0, 0, 100, 100), shapely.box(0, 0, 1500, 900)], quick=1)
def test_lengths_are_those_on_the_ground(lon, lat, shape, tmp_path):
    drawn = degrees(shape, lon, lat)
    plan = read_plan(geojson(tmp_path / "plan.geojson", feature(drawn, kind="room")))
    corners, ground = (shapely.get_coordinates(one)[:4] for one in (drawn, plan.walkable))
    corners, ground = (points[np.lexsort((points > points.mean(axis=0)).T)] for points in (corners, ground))
    for i in range(4):
        for j in range(i):
            assert np.hypot(*(ground[i] - ground[j])) == pytest.approx(vincenty(corners[i], corners[j]), rel=1e-3)


@looped("options", [{}, {"crs": CRS84}, {"crs": "EPSG:4326"}])
def test_degrees_are_projected_about_the_middle_of_the_file(options, tmp_path):
    plan = read_plan(geojson(tmp_path / "plan.geojson", *room(), **options))
    assert plan.walkable.area == pytest.approx(48.0, rel=0.01) and plan.exits["exit-0"].length == pytest.approx(
        1.2, rel=0.01
    )
    assert plan.walkable.bounds == pytest.approx((-4, -3, 4, 3), rel=0.01)
    assert plan.notes == ("in degrees: projected to meters about 47.37703 N, 8.54005 E",)
    south = read_plan(geojson(tmp_path / "south.geojson", *room(lon=-58.4, lat=-34.6), **options))
    assert south.notes[0].endswith("about 34.59997 S, 58.39996 W")


def test_levels_and_given_exits_have_one_origin(tmp_path):
    lower = feature(degrees(ROOM), kind="room", level=0)
    upper = feature(degrees(shapely.box(0, 0, 40, 6)), kind="room", level=1)
    path = geojson(tmp_path / "house.geojson", lower, upper)
    assert read_plan(f"{path}:0").walkable.bounds[:2] == pytest.approx(read_plan(f"{path}:1").walkable.bounds[:2])
    plan = read_plan(f"{path}:0", ["-20,-1,-20,1"])
    assert shapely.dwithin(plan.walkable, plan.exits["exit-0"], 0.2)
    assert all("about 47.37703 N" in note for note in plan.notes) and len(plan.notes) == 1


def test_meters_stay_meters(tmp_path):
    small = shapely.affinity.scale(ROOM, 2e-3, 2e-3, origin=(0, 0))  # of 16 mm
    path = geojson(tmp_path / "plan.geojson", feature(small, kind="room"))
    assert read_plan(path, unit="m").walkable.equals(small)
    assert read_plan(path).walkable.area > 1e6
    osm = geojson(tmp_path / "osm.geojson", feature(ROOM, indoor="room"))
    assert read_plan(osm).walkable.equals(ROOM) and read_plan(osm).notes == ()


@looped(
    ("shape", "options", "unit", "words"),
    [
        (degrees(ROOM), {"crs": CRS84}, "cm", "in degrees .CRS84., which are projected"),
        (ROOM, {"crs": CRS84}, None, "in degrees, and .* large; keep the features of one building"),
        (shapely.affinity.translate(ROOM, 5e5, 5e6), {"crs": CRS84}, "m", "no longitude and latitude"),
    ],
)
def test_what_cannot_be_projected_is_refused(shape, options, unit, words, tmp_path):
    with pytest.raises(ValueError, match=rf"plan.geojson: it is .*{words}"):
        read_plan(geojson(tmp_path / "plan.geojson", feature(shape, kind="room"), **options), unit=unit)
