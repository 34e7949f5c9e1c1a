"""What a drawing shows is what is read: nothing that is hidden, lines as thick and gaps as wide as they are, at any size."""

import json

import numpy as np
import pytest
import shapely
from cases import looped
from plan_files import EAST, ROOM, box_of, drawing, outline

from crowd_env.scenarios.plans.reading import read_plan

pytestmark = pytest.mark.more


def read(document, tmp_path, **options):
    path = tmp_path / "plan.dxf"
    document.saveas(path)
    return read_plan(path, **options)


def sides(space, x0, y0, x1, y1, *layers):
    """Draw a box as four lines, on ``layers`` in turn."""
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    for k, ends in enumerate(zip(corners, [*corners[1:], corners[0]], strict=True)):
        space.add_line(*ends, dxfattribs={"layer": layers[k % len(layers)]})


@looped(("state", "area"), [("freeze", 60.0), ("off", 59.0)])
def test_a_block_on_a_frozen_layer_is_not_seen_and_one_on_a_layer_that_is_off_is(state, area, tmp_path):
    document, space = drawing()
    box_of(space, 0, 0, 10, 6, "walkablearea")
    box_of(document.blocks.new("DESK"), 0, 0, 1, 1, "jps-obstacles")
    getattr(document.layers.add("old"), state)()
    space.add_blockref("DESK", (3, 3), dxfattribs={"layer": "old"})
    plan = read(document, tmp_path)
    assert plan.walkable.area == pytest.approx(area)
    assert plan.notes == (("left out: 1 thing on layers of other names, old (hidden)",) if area == 60.0 else ())


def test_what_is_set_invisible_is_left_out(tmp_path):
    document, space = drawing()
    box_of(space, 0, 0, 10, 6, "walkablearea")
    box_of(space, 2, 2, 4, 4, "jps-obstacles")
    box_of(document.blocks.new("DESK"), 0, 0, 1, 1, "jps-obstacles")
    space.add_blockref("DESK", (5, 3))
    for entity in space:
        entity.dxf.invisible = int(entity.dxf.layer != "walkablearea")
    plan = read(document, tmp_path)
    assert plan.walkable.area == pytest.approx(60.0)
    assert plan.notes == ("left out: 2 things on layers of other names, jps-obstacles (hidden), 0 (hidden)",)


def test_layers_that_differ_in_case_are_one(tmp_path):
    document, space = drawing()
    sides(space, 0, 0, 10, 6, "walkablearea", "WalkableArea")
    assert read(document, tmp_path).walkable.area == pytest.approx(60.0)


@looped("unit", [None, "m"])
def test_doors_and_walls_of_a_plan_wider_than_300_m_are_as_wide_as_they_are_drawn(unit, tmp_path):
    document, space = drawing(6)
    box_of(space, 0, 0, 400, 200, "walkablearea")
    outline(space, [(100, 0), (100, 100)], "obstacles", close=False)
    outline(space, [(100, 100.8), (100, 200)], "obstacles", close=False)
    plan = read(document, tmp_path, unit=unit)
    assert plan.walkable.contains(shapely.LineString([(99, 100.4), (101, 100.4)]))
    assert plan.walkable.area == pytest.approx(80_000 - 0.02 * 199.2, abs=0.02)
    assert not any("gaps" in note for note in plan.notes)


def test_curves_of_a_large_plan_are_as_fine_as_those_of_a_small_one(tmp_path):
    document, space = drawing(6)
    space.add_circle((0, 0), 200, dxfattribs={"layer": "walkablearea"})
    ring = shapely.get_coordinates(read(document, tmp_path).walkable)
    middles = 0.5 * (ring[1:] + ring[:-1])
    assert 200.0 - np.hypot(*middles.T).min() < 0.011  # the arcs of 5 mm, and what simplifying may take


@looped("layer", ["walkablearea", "obstacles"])
def test_an_area_of_single_lines_within_another_is_like_one_of_closed_lines(layer, tmp_path):
    document, space = drawing()
    if layer == "obstacles":
        box_of(space, -5, -5, 15, 15, "walkablearea")
    sides(space, 0, 0, 10, 6, layer)
    sides(space, 4, 2, 5, 3, layer)
    plan = read(document, tmp_path)
    assert plan.walkable.area == pytest.approx(60.0 if layer == "walkablearea" else 340.0)
    assert ["within another one" in note for note in plan.notes] == ([True] if layer == "walkablearea" else [])


# What the header says, how many units the plan is wide, and how many meters a unit is taken for: those of the header where
# meters cannot be, and feet, which no template has.
@looped(
    ("header", "name", "wide", "taken"),
    [(1, "inches", 60, 1.0), (1, "inches", 600, 0.0254), (2, "feet", 60, 0.3048), (2, "feet", 600, 0.3048)],
)
def test_inches_and_feet_are_taken_as_other_units_are(header, name, wide, taken, tmp_path):
    document, space = drawing(header)
    box_of(space, 0, 0, wide, 12, "walkablearea")
    plan = read(document, tmp_path)
    assert plan.walkable.bounds[2] == pytest.approx(wide * taken)
    assert [name in note for note in plan.notes] == [True]
    unit, meters = {"inches": ("in", 0.0254), "feet": ("ft", 0.3048)}[name]
    said = read(document, tmp_path, unit=unit)
    assert said.walkable.bounds[2] == pytest.approx(wide * meters) and said.notes == ()


@looped(
    ("header", "name", "door", "taken"),
    [
        (2, "feet", 3.0, 0.3048),  # 0.91 m, or a wide one of 3 m
        (2, "feet", 8.0, 0.3048),
        (2, "feet", 1.0, 1.0),  # 0.30 m: nobody passes
        (10, "yards", 1.0, 0.9144),
        (14, "decimeters", 12.0, 0.1),
        (1, "inches", 3.0, 1.0),
    ],
)
def test_feet_are_believed_unless_the_doors_are_doors_in_meters(header, name, door, taken, tmp_path):
    """A plan of 60 x 40 feet became one of 2400 m2 with a door of 3 m."""
    document, space = drawing(header)
    box_of(space, 0, 0, 60, 40, "walkablearea")
    outline(space, [(60, 10), (60, 10 + door)], "exits", close=False)
    plan = read(document, tmp_path)
    assert plan.walkable.area == pytest.approx(2400 * taken**2)
    assert plan.exits["exit-0"].length == pytest.approx(door * taken)
    assert [name in note for note in plan.notes] == [True]


def features(path, *shapes, **others):
    """Write a room with an exit, and ``shapes``: (shape, kind)."""
    every = [(ROOM, "walkable"), (shapely.LineString([(8, 2), (8, 3.2)]), "exit"), *shapes]
    found = [
        {"type": "Feature", "properties": {"kind": kind} if kind else {}, "geometry": shapely.geometry.mapping(shape)}
        for shape, kind in every
    ]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": found, **others}))
    return path


def test_walls_that_are_lines_stand_in_the_way_in_geojson_too(tmp_path):
    lines = shapely.MultiLineString([[(4, 0), (4, 5)], [(2, 1), (2, 6), (2.5, 6)]])
    plan = read_plan(features(tmp_path / "plan.geojson", (lines, "wall"), (shapely.Point(6, 4), "column")))
    assert not plan.walkable.contains(shapely.Point(4, 2)) and not plan.walkable.contains(shapely.Point(2, 2))
    assert plan.walkable.area == pytest.approx(48.0 - 0.02 * 10, abs=0.02)
    assert plan.notes == ("obstacles: 2 lines taken as walls 0.02 m thick", "left out: 1 obstacle that is a point")


@looped("kind", ["walkable", "room"])
def test_a_floor_within_a_floor_is_told_in_geojson_too(kind, tmp_path):
    plan = read_plan(features(tmp_path / "plan.geojson", (shapely.box(2, 2, 3, 3), kind)))
    assert plan.walkable.area == pytest.approx(48.0)
    assert ["within another one" in note for note in plan.notes] == [True]


@looped("code", ["urn:ogc:def:crs:EPSG::3857", "EPSG:900913"])
def test_web_mercator_is_refused_since_its_meters_are_none(code, tmp_path):
    path = features(tmp_path / "plan.geojson", crs={"type": "name", "properties": {"name": code}})
    with pytest.raises(ValueError, match=r"Mercator.*stretched.*UTM"):
        read_plan(path)
    utm = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25832"}}
    assert read_plan(features(path, crs=utm), [EAST]).walkable.area == 48.0


def test_an_obstacle_over_a_part_of_an_exit_is_cut_out_of_it(tmp_path):
    plan = read_plan(features(tmp_path / "plan.geojson", (shapely.box(7.5, 1, 8, 2.4), "wall")))
    assert plan.exits["exit-0"].length == pytest.approx(0.8)
    assert plan.notes == ("exit 'exit-0': an obstacle covers 0.40 of 1.20 m; 1 opening of 0.80 m is left",)


@looped("shape", [shapely.box(20, 0, 22, 2), shapely.Point(2, 2)])
def test_a_start_area_without_floor_is_told_with_what_follows(shape, tmp_path):
    note = "left out: 1 start area with nothing of the walkable area, start-0"
    plan = read_plan(features(tmp_path / "plan.geojson", (shape, "start")))
    assert plan.notes == (note + ": pedestrians start anywhere on the plan",) and not plan.starts
    both = features(tmp_path / "plan.geojson", (shape, "start"), (shapely.box(1, 1, 3, 3), "start"), (shape, "zone"))
    plan = read_plan(both)
    assert plan.notes == ("left out: 1 region with nothing of the walkable area, region-0", note)
    assert list(plan.starts) == ["start-1"]
