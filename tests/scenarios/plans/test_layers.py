"""Drawings whose layers have other names, or show walls alone; walls that are multilines and wide polylines."""

import warnings
from itertools import pairwise

import pytest
from plan_files import feature, geojson
from shapely import affinity
from shapely.geometry import LineString, box

from crowd_env import make_scenario
from crowd_env.scenarios.plans.dxf import read_dxf
from crowd_env.scenarios.plans.reading import drawn_layers, read_plan
from crowd_env.scenarios.plans.roles import ChosenRoles
from crowd_env.scenarios.population import Population
from crowd_env.scenarios.project import project_of

ezdxf = pytest.importorskip("ezdxf")

OFFICE = {"obstacles": ["a-wall", "A-FURN*"], "exits": ["A-Exit"]}


def drawn(path, draw, unit=6):
    document = ezdxf.new()
    document.header["$INSUNITS"] = unit
    draw(document.modelspace())
    document.saveas(path)
    return path


def on(layer, **others):
    return {"dxfattribs": {"layer": layer, **others}}


def two_rooms(space):
    """Walls of 0.2 m around and between two rooms, a gap of 0.9 m in between and one of 1.2 m in the east, a table."""
    boxes = [(0, 0, 10.4, 0.2), (0, 6.2, 10.4, 6.4), (0, 0.2, 0.2, 6.2), (5, 0.2, 5.2, 2.5), (5, 3.4, 5.2, 6.2)]
    boxes += [(10.2, 0.2, 10.4, 2.0), (10.2, 3.2, 10.4, 6.2)]
    for layer, (x0, y0, x1, y1) in [*(("A-WALL", one) for one in boxes), ("A-FURN-TABLE", (2, 2, 3, 3))]:
        space.add_lwpolyline([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], close=True, **on(layer))
    space.add_line((10.3, 2.0), (10.3, 3.2), **on("A-EXIT"))
    space.add_text("office", **on("A-TEXT"))


def test_walls_alone_are_rooms(tmp_path):
    plan = read_plan(drawn(tmp_path / "office.dxf", two_rooms), layers=OFFICE)
    floor = (
        4.8 * 6 + 0.2 * 0.9 + 5.0 * 6 + 0.1 * 1.2 - 1.0
    )  # rooms, the gap, the exit to the middle of its wall, the table
    assert plan.walkable.geom_type == "Polygon" and plan.walkable.area == pytest.approx(floor)
    assert any("floor is what the walls enclose, 1 area" in note for note in plan.notes)
    place = make_scenario(tmp_path / "office.dxf", layers=OFFICE, people=5)
    assert place.exits == ("exit-0",) and place.geometry.exit_widths["exit-0"] == pytest.approx(1.2)


def test_doors_open_walls_that_have_no_gap(tmp_path):
    def draw(space):
        for x0, x1 in ((0, 5), (5.2, 10)):
            space.add_lwpolyline([(x0, 0), (x1, 0), (x1, 6), (x0, 6)], close=True, **on("rooms"))
        space.add_line((5.1, 2.5), (5.1, 3.4), **on("doors"))
        space.add_line((10, 2), (10, 3), **on("ways out"))

    layers = {"walkable": ["rooms"], "doors": ["doors"], "exits": ["ways*"]}
    plan = read_plan(drawn(tmp_path / "rooms.dxf", draw), layers=layers)
    assert plan.walkable.area == pytest.approx(30.0 + 28.8 + 0.2 * 0.9, abs=1e-4) and list(plan.exits) == ["exit-0"]


@pytest.mark.parametrize("rotation", [0, 90, 217])
@pytest.mark.parametrize("mirrored", [1, -1])
@pytest.mark.parametrize("leaf", ["line", "box"])
def test_a_door_with_its_swing_is_the_opening_that_it_shuts(tmp_path, rotation, mirrored, leaf):
    def draw(space):
        block = space.doc.blocks.new("DOOR")
        block.add_arc((0, 0), 0.9, 0, 90)
        if leaf == "line":
            block.add_line((0, 0), (0, 0.9))
        else:
            block.add_lwpolyline([(0, 0), (0.04, 0), (0.04, 0.9), (0, 0.9)], close=True)
        block.add_line((-0.05, -0.05), (-0.05, 0.05))  # of the frame, left alone
        how = {"xscale": mirrored, "rotation": rotation}
        space.add_blockref("DOOR", (3, 2), **on("doors", **how))

    def floor(space):
        space.add_lwpolyline([(0, 0), (10, 0), (10, 6), (0, 6)], close=True, **on("jps-walkablearea"))
        draw(space)

    path = drawn(tmp_path / "door.dxf", floor)
    drawing = read_dxf(path, None, ChosenRoles({"doors": ["doors"]}))
    shut = affinity.rotate(
        affinity.scale(LineString([(0, 0), (0.9, 0)]), mirrored, 1, origin=(0, 0)), rotation, origin=(0, 0)
    )
    (opening,) = (one.shape for one in drawing.doors if one.shape.length > 0.2)
    assert opening.hausdorff_distance(affinity.translate(shut, 3, 2)) < 0.01


def test_swings_lead_out_of_rooms_between_walls(tmp_path):
    def draw(space):
        for x0, y0, x1, y1 in [(0, 0, 8, 0.2), (0, 5, 8, 5.2), (0, 0.2, 0.2, 5), (7.8, 0.2, 8, 2), (7.8, 2.9, 8, 5)]:
            space.add_lwpolyline([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], close=True, **on("WALL"))
        space.add_arc((7.9, 2), 0.9, 90, 180, **on("DOOR"))
        space.add_line((7.9, 2), (7.0, 2), **on("DOOR"))

    path = drawn(tmp_path / "room.dxf", draw)
    place = make_scenario(path, layers={"obstacles": ["WALL"], "exits": ["DOOR"]}, people=5)
    assert place.geometry.exit_widths["exit-0"] == pytest.approx(0.9, abs=0.01)
    assert place.geometry.area == pytest.approx(7.6 * 4.8 + 0.1 * 0.9, abs=0.01)


def test_a_layer_may_be_left_out_whatever_its_name_means(tmp_path):
    def draw(space):
        space.add_lwpolyline([(0, 0), (10, 0), (10, 6), (0, 6)], close=True, **on("jps-walkablearea"))
        space.add_lwpolyline([(2, 2), (4, 2), (4, 4), (2, 4)], close=True, **on("jps-obstacles"))

    path = drawn(tmp_path / "hall.dxf", draw)
    assert read_plan(path).walkable.area == pytest.approx(56.0)
    assert read_plan(path, layers={"left_out": ["JPS-Obs*"]}).walkable.area == pytest.approx(60.0)


def test_words_of_features_are_layers(tmp_path):
    features = [
        feature(box(0, 0, 10, 6), usage="hall"),
        feature(box(4, 2, 6, 4), usage="shaft"),
        feature(box(6, 5, 7, 6)),
    ]
    gate = feature(LineString([(0, 2), (0, 3)]), usage="gate")
    path = geojson(tmp_path / "hall.geojson", *features, gate)
    plan = read_plan(path, layers={"obstacles": ["usage=shaft", "no word"], "exits": ["usage=g*"]})
    assert plan.walkable.area == pytest.approx(55.0) and list(plan.exits) == ["exit-0"]
    layers = drawn_layers(path, layers={"obstacles": ["usage=shaft"]})
    assert {name: (one.role, len(one.shapes)) for name, one in layers.items()} == {
        "usage=hall": ("walkable", 1),
        "usage=shaft": ("obstacle", 1),
        "no word": ("", 1),
        "usage=gate": ("", 1),
    }


def test_layers_are_seen_before_they_make_a_plan(tmp_path):
    def draw(space):
        two_rooms(space)
        space.doc.layers.add("HIDDEN").off()
        space.add_line((0, 0), (1, 1), **on("HIDDEN"))

    path = drawn(tmp_path / "office.dxf", draw)
    layers = drawn_layers(path, layers=OFFICE)
    assert {name: (one.role, len(one.shapes)) for name, one in layers.items()} == {
        "A-WALL": ("obstacle", 7),
        "A-FURN-TABLE": ("obstacle", 1),
        "A-EXIT": ("exit", 1),
    }
    assert layers["A-EXIT"].shapes[0].equals(LineString([(10.3, 2.0), (10.3, 3.2)]))
    assert drawn_layers(path, meters=0.01)["A-EXIT"].shapes[0].length == pytest.approx(0.012)


def test_walls_may_be_single_lines(tmp_path):
    def draw(space):
        for line in ([(10, 2), (10, 0), (0, 0), (0, 6), (10, 6), (10, 3.2)], [(5, 0), (5, 2.5)], [(5, 3.4), (5, 6)]):
            space.add_lwpolyline([(1000 * x, 1000 * y) for x, y in line], **on("W"))
        space.add_line((10_000, 2_000), (10_000, 3_200), **on("X"))

    plan = read_plan(drawn(tmp_path / "lines.dxf", draw, unit=4), layers={"obstacles": ["W"], "exits": ["X"]})
    assert plan.walkable.area == pytest.approx(60.0 - 0.02 * (2.5 + 2.6), abs=1e-3)  # outer ones lie outside
    assert plan.exits["exit-0"].length == pytest.approx(1.2)


ROOM = [(0, 0), (14, 0), (14, 8), (0, 8)]
INNER = [(0.3, 0.3), (13.7, 0.3), (13.7, 7.7), (0.3, 7.7)]
RING = [(0, 0), (14, 0), (14, 3), (13.7, 3), (13.7, 0.3), (0.3, 0.3), (0.3, 7.7), (13.7, 7.7), (13.7, 4.2), (14, 4.2),
        (14, 8), (0, 8)]  # fmt: skip
GAP = [[(14, 4.2), (14, 8), (0, 8), (0, 0), (14, 0), (14, 3)]]
HALVES = [[(0, 0), (7, 0), (7, 8), (0, 8)], [(7, 0), (14, 0), (14, 8), (7, 8)]]
EXIT, WITHIN = [(14, 3), (14, 4.2)], [(13.7, 3), (13.7, 4.2)]


def sides(ring):
    return [[a, b] for a, b in zip(ring, [*ring[1:], ring[0]], strict=True)]


@pytest.mark.parametrize("by", ["layer", "typed", "project"])
@pytest.mark.parametrize(
    ("closed", "lines", "exit", "door", "area"),
    [
        ([], GAP, EXIT, None, 112.0),
        ([ROOM], [], EXIT, None, 112.0),
        ([], sides(ROOM), EXIT, None, 112.0),
        ([], [*sides(ROOM), [(7, 0), (7, 3)], [(7, 4), (7, 8)]], EXIT, None, 112.0 - 0.02 * 7),
        ([ROOM, INNER], [], WITHIN, None, 13.4 * 7.4),
        ([ROOM, INNER], [], EXIT, None, 13.4 * 7.4 + 0.3 * 1.2),
        ([], [*sides(ROOM), *sides(INNER)], EXIT, None, 13.4 * 7.4 + 0.3 * 1.2),
        ([RING], [], EXIT, None, 13.4 * 7.4 + 0.3 * 1.2),
        (HALVES, [], EXIT, [(7, 3), (7, 4)], 112.0 - 0.02 * 7),
        ([], [*sides(ROOM), [(7, 0), (7, 8)]], EXIT, [(7, 3), (7, 4)], 112.0 - 0.02 * 7),
        ([ROOM, [(2, 2), (3, 2), (3, 3), (2, 3)]], [], EXIT, None, 111.0),
    ],
    ids=["gap", "outline", "four lines", "and a partition", "inner face", "outer face", "faces of lines", "thick with a gap",
         "halves", "halves of lines", "a table"],
)  # fmt: skip
def test_walls_are_read_as_people_read_them(tmp_path, closed, lines, exit, door, area, by):
    def draw(space):
        for ring in closed:
            space.add_lwpolyline(ring, close=True, **on("W"))
        for a, b in (pair for line in lines for pair in pairwise(line)):
            space.add_line(a, b, **on("W"))
        for layer, line in (("X", exit if by == "layer" else None), ("D", door)):
            if line:
                space.add_line(*line, **on(layer))

    path = drawn(tmp_path / "room.dxf", draw)
    layers = {"obstacles": ["W"], **({"doors": ["D"]} if door else {}), **({"exits": ["X"]} if by == "layer" else {})}
    given = {
        "layer": {},
        "typed": {"exits": ["{},{},{},{}".format(*exit[0], *exit[1])]},
        "project": {"exits": {"out": exit}},
    }
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        place = make_scenario(path, layers=layers, people=5, **given[by])
    assert place.geometry.area == pytest.approx(area, abs=0.03)  # the door opens its wall
    assert place.geometry.exit_widths[place.exits[0]] == pytest.approx(1.2, abs=1e-6)
    assert any("taken as solid, the largest of 1 m2 around (2.5, 2.5)" in str(one.message) for one in said) == (
        area == 111
    )


def test_a_closed_line_is_a_room_before_it_has_an_exit(tmp_path):
    plan = read_plan(drawn(tmp_path / "room.dxf", lambda space: space.add_lwpolyline(ROOM, close=True, **on("W"))),
                     layers={"obstacles": ["W"]})  # fmt: skip
    assert plan.walkable.area == pytest.approx(112.0) and not plan.exits


@pytest.mark.parametrize("turned", [0, 30, 217])
@pytest.mark.parametrize("decimals", [3, 2])
def test_an_exit_that_is_drawn_to_a_centimeter_closes_turned_walls(tmp_path, turned, decimals):
    def at(points):
        return list(affinity.translate(affinity.rotate(LineString(points), turned, origin=(0, 0)), 98, 46).coords)

    path = drawn(tmp_path / "room.dxf", lambda space: space.add_lwpolyline([(1000 * x, 1000 * y) for x, y in at(GAP[0])],
                                                                            **on("W")), unit=4)  # fmt: skip
    exit = [[round(x, decimals), round(y, decimals)] for x, y in at(EXIT)]
    place = make_scenario(path, layers={"obstacles": ["W"]}, exits={"out": exit}, people=5)
    assert place.geometry.area == pytest.approx(112.0, abs=0.1)
    assert place.geometry.exit_widths["out"] == pytest.approx(1.2, abs=0.02)


def test_exits_are_typed_in_meters_too(tmp_path):
    path = drawn(tmp_path / "room.dxf", lambda space: space.add_lwpolyline([(1000 * x, 1000 * y) for x, y in GAP[0]],
                                                                           **on("W")), unit=4)  # fmt: skip
    for exit in ("14,3,14,4.2", "14000,3000,14000,4200"):
        plan = read_plan(path, [exit], layers={"obstacles": ["W"]})
        assert plan.walkable.area == pytest.approx(112.0) and plan.exits["exit-0"].length == pytest.approx(1.2)
        assert any("exits taken in meters" in note for note in plan.notes) == (exit == "14,3,14,4.2")


def test_what_is_drawn_has_the_name_of_its_layer(tmp_path):
    layers = OFFICE | {"starts": ["A-FURN*"], "obstacles": ["A-WALL"]}
    plan = read_plan(drawn(tmp_path / "office.dxf", two_rooms), layers=layers)
    assert plan.layer_of == {"exit-0": "A-EXIT", "start-0": "A-FURN-TABLE"}
    project = project_of(
        tmp_path / "p.toml", plan, Population(people=3), own_exits=False, drawing={}, of_all={}, others={}
    )
    assert 'exit-0 = "exit-0" # line of 1.20 m around (10.3, 2.6) on layer A-EXIT' in project.text
    given = read_plan(tmp_path / "office.dxf", ["10.3,2,10.3,3.2"], layers=layers)
    assert given.layer_of == {"start-0": "A-FURN-TABLE"}


def test_a_project_names_layers(tmp_path):
    drawn(tmp_path / "office.dxf", two_rooms)
    project = tmp_path / "office.toml"
    project.write_text(
        '[geometry]\nfile = "office.dxf"\nlayers = { obstacles = ["A-WALL"], exits = ["A-EXIT"] }\n'
        '[geometry.exits]\neast = "exit-0"\n'
    )
    assert make_scenario(project).exits == ("east",)


def test_multilines_and_wide_polylines_are_walls_as_thick_as_they_are_drawn(tmp_path):
    def draw(space):
        space.add_lwpolyline([(0, 0), (10, 0), (10, 6), (0, 6)], close=True, **on("jps-walkablearea"))
        space.add_line((10, 2), (10, 3), **on("jps-exits"))
        space.add_mline([(2, 2), (4, 2), (4, 4)], **on("jps-obstacles", scale_factor=0.2))
        space.add_mline([(6, 2), (8, 2), (8, 4), (6, 4)], close=True, **on("jps-obstacles", scale_factor=0.2))
        space.add_lwpolyline([(1, 5), (3, 5)], **on("jps-obstacles", const_width=0.3))

    plan = read_plan(drawn(tmp_path / "walls.dxf", draw))
    multiline = 2 * 2 * 0.2 + 0.2**2, 2.4**2 - 2.0**2  # its path runs along one side
    assert 60.0 - plan.walkable.area == pytest.approx(sum(multiline) + 2 * 0.3)
    assert not plan.walkable.intersects(LineString([(1.1, 5), (2.9, 5)]))


@pytest.mark.parametrize(
    ("layers", "words"),
    [
        (None, "none of its visible layers .*its layers: 0, A-WALL, A-FURN-TABLE, A-EXIT, A-TEXT; .* --layers walkable=NAME"),
        ({"obstacles": ["A-WALL"]}, "walls on A-WALL enclose no room: each opening that leads out needs an exit"),
        ({"obstacles": ["A-WALL"], "walkable": ["FLOR"]}, "layers.walkable names 'FLOR', and it has no such layer; .* A-WALL"),
        ({"wals": ["A-WALL"]}, "unknown key of layers 'wals'; known: walkable, obstacles, exits, doors, starts"),
        ({"walkable": "A-WALL"}, "layers.walkable is 'A-WALL'"),
    ],
)  # fmt: skip
def test_layers_that_do_not_do_are_named(tmp_path, layers, words):
    path = drawn(tmp_path / "office.dxf", two_rooms)
    with pytest.raises(ValueError, match=words):
        read_plan(path, layers=layers)


def test_a_file_without_layers_has_none_to_choose_from(tmp_path):
    path = tmp_path / "room.wkt"
    path.write_text("POLYGON ((0 0, 6 0, 6 5, 0 5, 0 0))")
    with pytest.raises(ValueError, match="it has no layers to choose from; DXF drawings and GeoJSON have"):
        read_plan(path, layers={"walkable": ["a"]})
