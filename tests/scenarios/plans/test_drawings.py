"""DXF drawings: layers, blocks, curves, gaps and slivers, and the unit that the header does not decide."""

import warnings

import numpy as np
import pytest
import shapely
from cases import looped
from plan_files import box_of, drawing, outline, room_drawing

from crowd_env import make_scenario
from crowd_env.scenarios.plans.floor_plan import Start
from crowd_env.scenarios.plans.lines import enclosed
from crowd_env.scenarios.plans.reading import read_plan


def read(document, tmp_path, **options):
    path = tmp_path / "plan.dxf"
    document.saveas(path)
    return read_plan(path, **options)


def test_layers_say_what_things_are_whatever_their_case(tmp_path):
    document, space = drawing()
    box_of(space, 0, 0, 10, 6, "JPS-WalkableArea")
    box_of(space, 4, 2, 5, 4, "jps-obstacles-columns")
    space.add_line((10, 2), (10, 3), dxfattribs={"layer": "JPS-Exits-North"})
    box_of(space, 0, 4, 0.2, 5, "exits")
    box_of(space, 1, 1, 3, 3, "Distributions-Hall")
    box_of(space, 6, 1, 8, 3, "jps-distributions")
    outline(space, [(0, 0), (1, 1)], "jps-journeys", close=False)
    space.add_text("Hall", dxfattribs={"layer": "A-TEXT"})
    plan = read(document, tmp_path)
    assert plan.walkable.area == pytest.approx(58.0)
    assert {name: shape.geom_type for name, shape in plan.exits.items()} == {"North": "LineString", "exit-0": "Polygon"}
    assert plan.starts == {"Hall": Start(), "start-0": Start()}
    assert plan.notes == ("left out: 1 thing on layers of other names, jps-journeys",)


def test_blocks_are_exploded_with_their_scale_and_layer(tmp_path):
    document, space = drawing()
    box_of(space, 0, 0, 20, 10, "walkablearea")
    leg = document.blocks.new("LEG")
    box_of(leg, 0, 0, 1, 1, "0")
    table = document.blocks.new("TABLE")
    table.add_blockref("LEG", (0, 0), dxfattribs={"layer": "0"})
    table.add_blockref("LEG", (2, 0), dxfattribs={"layer": "jps-obstacles"})
    space.add_blockref("TABLE", (2, 2), dxfattribs={"layer": "obstacles", "xscale": 0.5, "yscale": 2.0})
    space.add_blockref("TABLE", (8, 2), dxfattribs={"layer": "furniture"})  # its second leg says for itself what it is
    rows = {"layer": "obstacles", "column_count": 3, "row_count": 2, "column_spacing": 2, "row_spacing": 2}
    space.add_blockref("LEG", (12, 5), dxfattribs=rows)
    plan = read(document, tmp_path)
    assert plan.walkable.area == pytest.approx(200.0 - 2 * 1.0 - 1.0 - 6.0)


def test_curves_hatches_and_lines_make_areas(tmp_path):
    document, space = drawing()
    corners = [(0, 0), (10, 0), (10, 6), (0, 6)]
    for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
        space.add_line(a, b, dxfattribs={"layer": "walkablearea"})
    space.add_circle((2, 2), 0.5, dxfattribs={"layer": "obstacles"})
    space.add_lwpolyline([(5, 2, 1.0), (6, 2, 1.0)], format="xyb", close=True, dxfattribs={"layer": "obstacles"})
    hatch = space.add_hatch(dxfattribs={"layer": "obstacles"})
    hatch.paths.add_polyline_path([(7, 3), (9, 3), (9, 5), (7, 5)])
    hatch.paths.add_polyline_path([(7.5, 3.5), (8.5, 3.5), (8.5, 4.5), (7.5, 4.5)], flags=16)
    space.add_arc((2, 5), 0.5, 0, 180, dxfattribs={"layer": "obstacles"})
    space.add_line((1.5, 5), (2.5, 5), dxfattribs={"layer": "obstacles"})
    space.add_spline([(4, 4), (5, 4), (5, 5), (4, 5), (4, 4)], dxfattribs={"layer": "obstacles"})
    plan = read(document, tmp_path)
    blob = 60.0 - plan.walkable.area - np.pi * 0.25 * 2.5 - 3.0
    assert 0.8 < blob < 1.4  # the spline through a square of 1 m
    assert plan.notes == ()


@looped("gap", [0.0, 0.004, 0.009])
def test_ends_that_were_meant_to_meet_do(gap, tmp_path):
    document, space = drawing()
    layer = {"layer": "walkablearea"}
    space.add_line((0, 0), (10, 0), dxfattribs=layer)
    space.add_line((10, gap), (10, 6), dxfattribs=layer)
    space.add_lwpolyline([(10, 6), (0, 6), (0, gap)], dxfattribs=layer)
    space.add_line((4, gap), (4, 6 - gap), dxfattribs=layer)  # a line that ends on two others
    plan = read(document, tmp_path)
    assert plan.walkable.area == pytest.approx(60.0, abs=0.1)
    assert [f"the widest {1000 * gap:.2g} mm" in note for note in plan.notes] == ([True] if gap else [])


def test_an_open_outline_is_refused_and_the_gap_is_named(tmp_path):
    document, space = drawing()
    outline(space, [(0, 0), (10, 0), (10, 6), (0, 6), (0, 0.5)], "walkablearea", close=False)
    with pytest.raises(
        ValueError, match=r"plan.dxf: layer walkablearea encloses nothing.*\(0, 0\) and \(0, 0.5\) are 0.5 m"
    ):
        read(document, tmp_path)


def test_open_lines_among_obstacles_are_walls(tmp_path):
    document, space = drawing()
    box_of(space, 0, 0, 10, 6, "walkablearea")
    outline(space, [(5, 0), (5, 4)], "obstacles", close=False)
    plan = read(document, tmp_path)
    assert not plan.walkable.contains(shapely.Point(5, 3))
    assert plan.notes == ("obstacles: 1 line taken as walls 0.02 m thick",)


def test_slivers_and_what_encloses_nothing_are_dropped(tmp_path):
    document, space = drawing()
    box_of(space, 0, 0, 10, 6, "walkablearea")
    outline(space, [(12, 0), (14, 0), (13, 0), (12, 0)], "walkablearea")
    outline(space, [(12, 2), (14, 2.0001), (12.5, 2), (13, 2.0001)], "walkablearea")
    outline(space, [(2, 2), (4, 2), (3, 2)], "jps-obstacles")
    plan = read(document, tmp_path)
    assert plan.walkable.area == pytest.approx(60.0)
    assert any("left out 2 slivers" in note for note in plan.notes)


def test_hidden_layers_are_left_out(tmp_path):
    document, space = drawing()
    box_of(space, 0, 0, 10, 6, "walkablearea")
    document.layers.add("jps-obstacles-old").off()
    box_of(space, 2, 2, 4, 4, "jps-obstacles-old")
    plan = read(document, tmp_path)
    assert plan.walkable.area == pytest.approx(60.0)
    assert plan.notes == ("left out: 1 thing on layers of other names, jps-obstacles-old (hidden)",)


def test_without_a_layer_to_walk_on_the_layers_are_named(tmp_path):
    document, space = drawing()
    document.layers.add("A-WALL")
    box_of(space, 0, 0, 10, 6, "A-WALL")
    with pytest.raises(ValueError, match="its layers: 0, A-WALL; name them jps-walkablearea"):
        read(document, tmp_path)


# What the header says, the factor of the coordinates, what the user says -> factor to meters, and a word of the note.
@looped(
    ("header", "scale", "unit", "meters", "note"),
    [
        (0, 1.0, None, 1.0, ""),
        (6, 1.0, None, 1.0, ""),
        (4, 1.0, None, 1.0, "the file says that it is in mm"),  # drawn in meters, whatever it says
        (1, 1.0, None, 1.0, "the file says that it is in inches"),
        (4, 1000.0, None, 0.001, "taken as mm, as the file says"),
        (5, 100.0, None, 0.01, "taken as cm, as the file says"),
        (4, 1000.0, "mm", 0.001, ""),
        (5, 15.0, None, 1.0, "the file says that it is in cm"),  # 120 m or 1.2 m: both can be
        (6, 1000.0, "mm", 0.001, ""),
        (4, 1.0, "m", 1.0, ""),
    ],
)
def test_the_header_alone_never_scales(header, scale, unit, meters, note, tmp_path):
    plan = read_plan(room_drawing(tmp_path / "room.dxf", header, scale), unit=unit)
    x0, _, x1, _ = plan.walkable.bounds
    assert x1 - x0 == pytest.approx(8.0 * scale * meters)
    assert plan.exits["exit-0"].length == pytest.approx(1.2 * scale * meters)
    assert [note in one for one in plan.notes] == ([True] if note else [])


@looped("header", [0, 6])
def test_a_drawing_in_millimeters_that_does_not_say_so_is_asked_for_its_unit(header, tmp_path):
    with pytest.raises(ValueError, match=r"8000 m x 6000 m.*--unit mm"):
        read_plan(room_drawing(tmp_path / "room.dxf", header, 1000.0))


def test_a_drawing_is_the_same_place_as_the_plan_in_text(tmp_path):
    (tmp_path / "room.wkt").write_text(shapely.box(0, 0, 8, 6).wkt)
    drawn = make_scenario(room_drawing(tmp_path / "room.dxf"))
    written = make_scenario(tmp_path / "room.wkt", exits=["8,2,8,3.2"])
    assert shapely.equals(drawn.geometry.walkable, written.geometry.walkable)
    np.testing.assert_array_equal(drawn.geometry.exits, written.geometry.exits)


def test_the_example_office_is_what_its_program_draws(tmp_path):
    from repository import ROOT

    office = __import__("examples.office_plan", fromlist=["main"])
    office.main(tmp_path / "office.dxf")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        new, shipped = (make_scenario(path) for path in (tmp_path / "office.dxf", ROOT / "examples/office.dxf"))
    assert shapely.equals(new.geometry.walkable, shipped.geometry.walkable)
    assert new.exits == shipped.exits == ("west", "east")


def test_blocks_of_other_layers_are_not_exploded(tmp_path):
    document, space = drawing()
    box_of(space, 0, 0, 10, 6, "walkablearea")
    tree = document.blocks.new("TREE")
    for k in range(60):
        tree.add_line((k, 0), (k, 1), dxfattribs={"layer": "leaves"})
    for k in range(1000):  # 60000 lines
        space.add_blockref("TREE", (k, 0), dxfattribs={"layer": "garden"})
    plan = read(document, tmp_path)
    assert plan.walkable.area == pytest.approx(60.0)
    assert plan.notes == ("left out: 1000 things on layers of other names, garden",)


def test_an_outline_within_another_is_told(tmp_path):
    document, space = drawing()
    box_of(space, 0, 0, 10, 6, "walkablearea")
    box_of(space, 0, 0, 5, 6, "walkablearea")  # touches the outline
    assert read(document, tmp_path).notes == ()
    box_of(space, 4, 2, 5, 3, "walkablearea")
    plan = read(document, tmp_path)
    assert plan.walkable.area == pytest.approx(60.0)
    assert ["within another one" in note for note in plan.notes] == [True]


def test_an_outline_with_its_hatch_is_one_exit(tmp_path):
    document, space = drawing()
    box_of(space, 0, 0, 10, 6, "walkablearea")
    box_of(space, 10, 2, 11, 3, "exits")
    hatch = space.add_hatch(dxfattribs={"layer": "exits"})
    hatch.paths.add_polyline_path([(10, 2), (11, 2), (11, 3), (10, 3)])
    assert list(read(document, tmp_path).exits) == ["exit-0"]


def test_a_region_may_be_called_like_an_exit(tmp_path):
    document, space = drawing()
    box_of(space, 0, 0, 10, 6, "walkablearea")
    space.add_line((10, 2), (10, 3), dxfattribs={"layer": "exits-hall"})
    box_of(space, 1, 1, 3, 3, "distributions-hall")
    path = tmp_path / "plan.dxf"
    document.saveas(path)
    place = make_scenario(path, people=3)
    assert place.exits == ("hall",) and place.population.parts[0].start_region == "hall (area)"


@pytest.mark.more
@looped("corners", [30, 3000, 20_000])
def test_lines_shorter_than_the_gap_make_an_outline_too(corners, tmp_path):
    angle = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    ring = np.round(np.column_stack([9 * np.cos(angle), 9 * np.sin(angle)]), 9)
    found = enclosed([np.stack(pair) for pair in zip(ring, np.roll(ring, -1, axis=0), strict=True)], gap=0.01)
    assert len(found.areas) == 1 and found.open == [] and found.closed_gap == 0.0
    assert found.areas[0].area == pytest.approx(shapely.Polygon(ring).area)


def test_three_ends_that_nearly_meet_are_one_corner():
    ends = np.array([[0, 0], [0.004, 0], [0, 0.004]])
    outer = [np.array([ends[0], [-5, 0], [-5, 5]]), np.array([ends[1], [5, 0], [5, 5]]), np.array([ends[2], [0, 5]])]
    top = [np.array([[-5, 5], [0, 5]]), np.array([[0, 5], [5, 5]])]
    found = enclosed([*outer, *top], gap=0.01)
    assert sorted(round(area.area) for area in found.areas) == [25, 25] and found.open == []
    assert 0.003 < found.closed_gap <= 0.01
