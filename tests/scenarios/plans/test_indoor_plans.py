"""Indoor plans that the world draws: OpenStreetMap's indoor tags, IMDF, rooms that share edges, and doors in them."""

import json

import pytest
import shapely
from cases import looped
from plan_files import feature, geojson

from crowd_env import make_scenario
from crowd_env.scenarios.plans.reading import read_plan

LINE, POINT, BOX = shapely.LineString, shapely.Point, shapely.box
EXIT = feature(LINE([(10, 4.4), (10, 5.6)]), kind="exit")


def read(path, *features, **options):
    return read_plan(geojson(path / "plan.geojson", *features), **options)


def flat(kind="room", corridor="corridor", key="kind"):
    """Return two rooms of 5 m x 4 m side by side, on a corridor of 10 m x 2 m, and an exit at its end."""
    rooms = [feature(BOX(x, 0, x + 5, 4), **{key: kind, "name": f"R{x}"}) for x in (0, 5)]
    return [*rooms, feature(BOX(0, 4, 10, 6), **{key: corridor}), EXIT]


def passes(plan, x, y, upright=True):
    """Return whether people can cross a wall at a point of it, 20 cm to each side, and 40 cm along it."""
    return plan.walkable.contains(BOX(x - 0.2, y - 0.2, x + 0.2, y + 0.2))


# ------------------------------------------------------------------------------------------------------------ names


@looped("name", ["Exit lobby", "Exits", "Wall", "Floor", "Source", "Distribution room", "Obstacle course", "exit"])
@looped("key", ["indoor", "kind"])
def test_a_name_is_never_a_role(name, key, tmp_path):
    """The lobby was an exit 6 m wide, the wall was gone."""
    hall, other = (
        feature(BOX(x, 0, x + 10, 6), **{key: "room", "name": word}) for x, word in ((0, "Hall"), (10, name))
    )
    plan = read(tmp_path, hall, other, feature(LINE([(0, 2), (0, 3.2)]), kind="exit", name="west"))
    assert plan.walkable.area == pytest.approx(120.0) and list(plan.exits) == ["west"] and not plan.regions


def test_a_prefix_is_a_role_in_layers_alone(tmp_path):
    west = LINE([(0, 2), (0, 3.2)])
    plan = read(tmp_path, *flat(), feature(west, layer="exits-west"), feature(west, type="exits-west"))
    assert list(plan.exits) == ["exit-0", "west"]
    assert plan.notes[0].startswith(
        "left out: 1 feature with type=exits-west; a property 'kind' may be one of walkable,"
    )


def test_what_is_not_understood_is_named(tmp_path):
    odd = [
        feature(BOX(1, 1, 2, 2), **{key: word}) for key, word in 2 * [("indoor", "yes_but")] + [("type", "furniture")]
    ]
    plan = read(tmp_path, *flat(), *odd, feature(POINT(1, 1), name="a lamp"), feature(BOX(7, 1, 8, 2), layer="3"))
    assert plan.walkable.area == pytest.approx(60.0)
    assert plan.notes[0].startswith(
        "left out: 2 features with indoor=yes_but, 2 without a word of what it is, 1 with type=furniture; a property"
    )
    with pytest.raises(ValueError, match="no area to walk on; left out: 1 feature with kind=yard"):
        read(tmp_path, feature(BOX(0, 0, 9, 9), kind="yard"))


# --------------------------------------------------------------------------------------------------- OpenStreetMap


def test_walls_and_columns_of_openstreetmap_are_none_of_its_floor(tmp_path):
    hall = [feature(BOX(0, 0, 20, 10), indoor="area"), feature(LINE([(20, 4), (20, 5.2)]), kind="exit")]
    solid = [feature(BOX(9, 4, 11, 6), indoor="column"), feature(BOX(5, 0, 5.2, 8), indoor="wall")]
    outside = [feature(BOX(-1, -1, 21, 11), building="yes"), feature(BOX(14, 1, 15, 2), indoor="no")]
    plan = read(tmp_path, *hall, *solid, *outside)
    assert plan.walkable.area == pytest.approx(200.0 - 4.0 - 1.6)
    assert plan.notes[0].startswith("left out: 1 feature with building=yes, 1 with indoor=no;")


def test_an_outline_of_a_building_is_floor_if_nothing_else_is(tmp_path):
    walls = [feature(BOX(5, 0, 5.2, 4), type="wall"), feature(BOX(5, 4, 5.2, 5), type="door")]
    stairs = feature(BOX(8, 0, 10, 2), type="stairs")
    plan = read(tmp_path, feature(BOX(0, 0, 10, 6), type="building_outline"), *walls, stairs, EXIT)
    assert plan.walkable.area == pytest.approx(60.0 - 0.8)


def test_stairs_are_floor_and_elevators_are_not(tmp_path):
    inside = [
        feature(BOX(1, 1, 2, 2), indoor="room", stairs="yes"),
        feature(BOX(3, 1, 4, 2), highway="steps"),
        feature(BOX(5, 1, 6, 2), indoor="room", room="elevator"),
        feature(BOX(7, 1, 8, 2), highway="elevator"),
        feature(LINE([(1, 5), (2, 5)]), highway="steps"),
    ]
    plan = read(tmp_path, feature(BOX(0, 0, 10, 6), indoor="area"), *inside, EXIT)
    assert plan.walkable.area == pytest.approx(58.0)
    lines = "stairs are left out where they are lines: 1 feature"
    assert plan.notes[:3] == (
        "stairs are floor like any other: 2 features",
        lines,
        "elevators are no floor: 2 features",
    )


@looped("value", ["yes", "main", "exit", "emergency"])
@looped("key", ["entrance", "exit"])
def test_an_entrance_is_an_exit_as_wide_as_it_says(key, value, tmp_path):
    area = feature(BOX(0, 0, 10, 6), indoor="area")
    nodes = [feature(POINT(10, 5), **{key: value}), feature(POINT(0.1, 2), **{key: value, "width": "1.4 m"})]
    ways = [feature(LINE([(3, -0.1), (4.2, -0.1)]), **{key: value, "door": "hinged", "name": "south"})]
    plan = read(
        tmp_path, area, *nodes, *ways, feature(POINT(5, 3), **{key: value}), feature(POINT(0, 4), **{key: "no"})
    )
    assert {name: shape.length for name, shape in plan.exits.items()} == pytest.approx(
        {"exit-0": 0.9, "exit-1": 1.4, "south": 1.2}
    )
    assert plan.exits["exit-0"].bounds == pytest.approx((10, 4.55, 10, 5.45))
    assert plan.exits["exit-1"].bounds == pytest.approx((0, 1.3, 0, 2.7))
    assert plan.exits["south"].bounds == pytest.approx((3, 0, 4.2, 0))
    assert "left out: 1 door away from all walls, such as at (5, 3)" in plan.notes
    given = read(tmp_path, area, *nodes, exits=["0,1,0,2"])
    assert given.exits["exit-0"].length == 1.0 and len(given.exits) == 1


@looped("width", ["1,5", "abc", "-2", 0.2, [1]])
def test_a_width_that_is_none_is_told(width, tmp_path):
    exit = feature(POINT(10, 5), kind="exit", name="main", width=width)
    plan = read(tmp_path, feature(BOX(0, 0, 10, 6), kind="walkable"), exit)
    assert plan.exits["main"].length == pytest.approx(0.9)
    assert plan.notes == (
        f"width {width!r} of exit 'main' is not a width in m of at least 0.3: it is 0.90 m wide here",
    )


@looped(
    ("level", "repeat", "on"),
    [
        ("0", None, "0"), ("0;1", None, "0 1"), ("0,1", None, "0 1"), ("-1-1", None, "-1 0 1"), ("-2--1", None, "-2 -1"),
        ("0.5", None, "0.5"), ("0.5-2.5", None, "0.5 1.5 2.5"), ([0, 1], None, "0 1"), (2, None, "2"), ("0", "1-3", "0 1 2 3"),
        ("0", "2;-1", "-1 0 2"), ("0", "1,3", "0 1 3"), ("EG;OG 1", None, "EG OG 1"), ("east, low", None, "east, low"),
    ],
)  # fmt: skip
def test_levels_are_lists_and_ranges(level, repeat, on, tmp_path):
    wall = feature(BOX(1, 1, 2, 2), kind="wall", level=level, **({"repeat_on": repeat} if repeat else {}))
    path = geojson(
        tmp_path / "plan.geojson",
        feature(BOX(0, 0, 5, 5), kind="room"),
        wall,
        feature(BOX(8, 8, 9, 9), kind="wall", level="99"),
    )
    for name in on.replace("OG 1", "OG1").replace("east, low", "east,low").split():
        name = name.replace("OG1", "OG 1").replace("east,low", "east, low")
        assert read_plan(path, level=name).walkable.area == pytest.approx(24.0)
    with pytest.raises(ValueError, match=f"it has {len(on.replace('OG 1', 'O').replace(', ', '').split()) + 1} levels"):
        read_plan(path)


def test_a_covering_of_the_floor_is_no_level(tmp_path):
    rooms = [feature(BOX(x, 0, x + 5, 4), kind="room", floor=word) for x, word in ((0, "tiles"), (5, "carpet"))]
    plan = read(tmp_path, *rooms, feature(LINE([(0, 2), (0, 3)]), kind="exit"))
    assert plan.walkable.area == pytest.approx(40.0)
    assert plan.notes[0] == "floors that are no numbers are no levels: carpet, tiles"
    for one, number in zip(rooms, (1, "2"), strict=True):
        one["properties"]["floor"] = number
    assert read(tmp_path, *rooms, level=2).walkable.area == pytest.approx(20.0)


# ---------------------------------------------------------------------------------------------- rooms that share edges


def test_rooms_without_doors_are_one_floor_and_a_note_says_it(tmp_path):
    plan = read(tmp_path, *flat())
    assert plan.walkable.equals(BOX(0, 0, 10, 6))
    assert plan.notes == ("3 rooms share edges of 14 m in all: taken as open floor; draw doors on them to get walls",)
    drawn = [feature(LINE([(5, 0), (5, 4)]), kind="wall"), feature(LINE([(0, 4), (2, 4)]), kind="wall")]
    notes = read(tmp_path, *flat(), *drawn).notes
    assert notes[0].startswith("2 rooms share edges of 5 m in all")
    assert read(tmp_path, *flat("walkable")).notes == ()


def test_an_entrance_beside_a_shared_edge_is_no_door_in_it(tmp_path):
    nodes = [feature(POINT(0, 4.2), entrance="yes"), feature(LINE([(10, 4), (10, 6)]), entrance="yes")]
    plan = read(tmp_path, *flat("room", key="indoor")[:3], *nodes)
    assert plan.notes == ("3 rooms share edges of 14 m in all: taken as open floor; draw doors on them to get walls",)
    assert len(plan.exits) == 2


def test_a_closed_line_is_a_room(tmp_path):
    rooms = [feature(LINE(BOX(x, 0, x + 5, 4).exterior.coords), indoor="room") for x in (0, 5)]
    assert read(tmp_path, *rooms, feature(BOX(0, 4, 10, 6), indoor="corridor"), EXIT).walkable.equals(BOX(0, 0, 10, 6))


DOORS = {
    "points": [(POINT(2.5, 4.05), {}, 0.9), (POINT(7.5, 3.8), {"width": 1.1}, 1.1)],
    "lines": [(LINE([(2, 4), (3, 4)]), {}, 1.0), (LINE([(7, 4.2), (8, 4.2)]), {"width": 3}, 1.0)],
    "areas": [(BOX(2, 3.95, 3.2, 4.05), {}, 1.2), (BOX(7, 4, 8, 4.1), {}, 1.0)],
}


@looped("drawn", DOORS)
def test_with_doors_the_edges_are_walls_and_the_doors_are_open(drawn, tmp_path):
    """All walls were gone."""
    doors = DOORS[drawn]
    plan = read(tmp_path, *flat(), *(feature(shape, kind="door", **more) for shape, more, _ in doors))
    wall = 4 * 0.02 + 10 * 0.02 - 0.01 * 0.02
    assert plan.walkable.area == pytest.approx(60.0 - wall + 0.02 * sum(width for *_, width in doors), abs=1e-3)
    assert plan.notes == ("3 rooms share edges of 14 m in all: taken as walls 0.02 m thick", "2 doors are open")
    assert passes(plan, 2.5, 4) and passes(plan, 7.5, 4)
    assert not any(passes(plan, x, y) for x, y in ((5, 2), (1, 4), (6.5, 4), (9, 4)))
    assert make_scenario(tmp_path / "plan.geojson", people=4).geometry.area == pytest.approx(plan.walkable.area)


def test_a_door_next_to_a_corner_opens_one_room(tmp_path):
    plan = read(tmp_path, *flat(), feature(POINT(4.7, 4), kind="door"), feature(POINT(7.5, 4), kind="door"))
    assert plan.walkable.contains(BOX(4.1, 3.5, 4.98, 4.5)) and not plan.walkable.intersects(LINE([(5.02, 4), (6, 4)]))
    assert not plan.walkable.intersects(LINE([(5, 0.1), (5, 3.95)]))


def test_rooms_a_wall_apart_are_joined_by_their_doors(tmp_path):
    """The doors were dropped, and two rooms could not get out."""
    rooms = [feature(BOX(0, 0, 4.95, 3.9), kind="room"), feature(BOX(5.05, 0, 10, 3.7), kind="room")]
    doors = [
        feature(BOX(2, 3.9, 3, 4), kind="door"),
        feature(POINT(7.5, 3.8), kind="door"),
        feature(POINT(5, 2), kind="door"),
    ]
    plan = read(tmp_path, *rooms, *doors, feature(BOX(0, 4, 10, 6), kind="corridor"), EXIT)
    passages = 1.0 * 0.1 + 0.9 * 0.3 + 0.9 * 0.1
    assert (
        plan.walkable.area == pytest.approx(4.95 * (3.9 + 3.7) + 20 + passages) and plan.walkable.geom_type == "Polygon"
    )
    assert plan.notes == ("3 doors are open",)
    apart = [feature(BOX(0, 0, 10, 3.4), kind="room"), feature(BOX(0, 4, 10, 6), kind="corridor")]
    plan = read(tmp_path, *apart, feature(POINT(5, 3.7), kind="door"), EXIT)
    assert plan.walkable.geom_type == "MultiPolygon"
    assert plan.notes[0].startswith("1 door on the outer edge, no exit unless it is named one, such as from (")


def test_a_door_opens_a_wall_that_is_drawn(tmp_path):
    walls = [feature(LINE([(5, 0), (5, 6)]), indoor="wall"), feature(BOX(8, 0, 8.3, 6), indoor="wall")]
    doors = [feature(POINT(5, 3), door="yes"), feature(LINE([(8.1, 1), (8.1, 2)]), indoor="door")]
    plan = read(tmp_path, feature(BOX(0, 0, 10, 6), indoor="area"), *walls, *doors, EXIT)
    assert passes(plan, 5, 3) and plan.walkable.contains(BOX(7.9, 1.01, 8.4, 1.99))
    assert plan.walkable.area == pytest.approx(60 - 5.1 * 0.02 - 5 * 0.3)


def test_doors_that_open_nothing_are_noted(tmp_path):
    odd = [feature(POINT(2.5, 2), kind="door"), feature(POINT(0, 2), kind="door"), feature(POINT(2, 0), kind="door")]
    plan = read(tmp_path, *flat(), feature(POINT(2.5, 4), kind="door"), *odd)
    assert plan.notes[2:] == (
        "left out: 1 door away from all walls, such as at (2.5, 2)",
        "2 doors on the outer edge, no exit unless it is named one, such as from (0, 2.45) to (0, 1.55)",
    )


def test_a_door_between_walls_that_are_drawn_stands_open(tmp_path):
    walls = [feature(BOX(5, low, 5.1, high), kind="wall") for low, high in ((0, 2), (3, 6))]
    plan = read(tmp_path, feature(BOX(0, 0, 10, 6), kind="floor"), *walls, feature(POINT(5, 2.5), kind="door"), EXIT)
    assert plan.walkable.area == pytest.approx(59.5) and plan.notes == ()


@looped("areas", [("area", "corridor"), ("corridor", "corridor")])
def test_between_areas_and_corridors_of_openstreetmap_is_no_wall(areas, tmp_path):
    rooms = [feature(BOX(0, 0, 5, 4), indoor="room"), feature(BOX(5, 0, 10, 4), indoor=areas[0])]
    plan = read(tmp_path, *rooms, feature(BOX(0, 4, 10, 6), indoor=areas[1]), feature(POINT(2, 4), door="yes"), EXIT)
    assert passes(plan, 2, 4) and passes(plan, 7, 4) and not passes(plan, 5, 2) and not passes(plan, 4, 4)


def test_a_room_within_an_area_has_walls_if_it_has_a_door(tmp_path):
    hall = [feature(BOX(0, 0, 10, 6), indoor="area"), feature(BOX(4, 2, 6, 4), indoor="room"), EXIT]
    assert passes(read(tmp_path, *hall), 4, 3)
    plan = read(tmp_path, *hall, feature(POINT(4, 3), door="yes"))
    assert passes(plan, 4, 3) and not passes(plan, 6, 3)
    assert plan.walkable.area == pytest.approx(60 - 0.02 * (8 - 0.9))


@looped("off", [0.004, -0.004])
def test_edges_within_a_centimeter_are_shared(off, tmp_path):
    """Plans in degrees have corners that are rounded to a centimeter."""
    rooms = [feature(BOX(0, 0, 5, 4), kind="room"), feature(BOX(5 + off, 0, 10, 4), kind="room")]
    corridor = feature(BOX(0, 4 + off, 10, 6), kind="corridor")
    plan = read(tmp_path, *rooms, corridor, *(feature(POINT(x, 4), kind="door") for x in (2.5, 7.5)), EXIT)
    assert plan.notes[0].startswith("3 rooms share edges of 14 m in all: taken as walls")
    assert passes(plan, 2.5, 4) and passes(plan, 7.5, 4) and not passes(plan, 5, 2) and not passes(plan, 4, 4)
    assert make_scenario(tmp_path / "plan.geojson", people=4).geometry.area == pytest.approx(59.76, abs=0.1)


# ------------------------------------------------------------------------------------------------------------ IMDF


def imdf(kind, shape, identity=None, **properties):
    return {**feature(shape, **properties), "feature_type": kind, "id": identity or f"{kind}-1"}


def venue(level="L1"):
    """Return two rooms, a walkway and a closet in meters, with doors, an emergency exit and an entrance."""
    units = {"room": (0, 0, 5, 4), "office": (5, 0, 10, 4), "walkway": (0, 4, 10, 6), "nonpublic": (10, 0, 12, 4)}
    openings = [("pedestrian", x, 4, x + 1, 4) for x in (2, 7)] + [
        ("pedestrian", 10, 1, 10, 2),
        ("pedestrian", 0, 4.5, 0, 5.5),
    ]
    openings += [("emergencyexit", 10, 4.4, 10, 5.6)]
    return [
        *(
            imdf("unit", BOX(*corners), category=word, level_id=level, name={"en": word})
            for word, corners in units.items()
        ),
        *(imdf("opening", LINE([(a, b), (c, d)]), category=word, level_id=level) for word, a, b, c, d in openings),
        imdf("fixture", BOX(4, 4.5, 5, 5.5), category="desk", level_id=level),
    ]


def test_units_openings_and_fixtures_of_imdf(tmp_path):
    """The walkway and all exits were lost."""
    plan = read(tmp_path, *venue(), imdf("venue", BOX(-1, -1, 13, 7), category="mall"))
    assert plan.walkable.area == pytest.approx(60 - 1 - 0.02 * (4 + 10 - 2), abs=1e-3)
    assert passes(plan, 2.5, 4) and passes(plan, 7.5, 4) and not passes(plan, 5, 2)
    assert {name: shape.bounds for name, shape in plan.exits.items()} == {
        "exit-0": pytest.approx((10, 4.4, 10, 5.6)), "exit-1": pytest.approx((0, 4.5, 0, 5.5))
    }  # fmt: skip
    assert plan.notes == ("3 rooms share edges of 14 m in all: taken as walls 0.02 m thick", "2 doors are open")


def test_levels_of_imdf_have_the_names_of_its_level_features(tmp_path):
    names = [({"en": "G"}, None, 0), (None, {"de": "Dach"}, 2), (None, None, 1), ({"en": "U"}, None, -1)]

    def written(*names):
        levels = [
            imdf("level", BOX(0, 0, 10, 6), f"L{k}", short_name=short, name=long, ordinal=ordinal)
            for k, (short, long, ordinal) in enumerate(names)
        ]
        units = [one for k in range(len(names)) for one in venue(f"L{k}")]
        return geojson(tmp_path / "plan.geojson", *units, *levels)

    with pytest.raises(ValueError, match=r"4 levels \(U, G, 1, Dach\)"):
        read_plan(written(*names))
    assert len(read_plan(written(*names), level="Dach").exits) == 2
    with pytest.raises(ValueError, match=r"5 levels \(-2, -1, 0, 1, 2\)"):  # two have one name
        read_plan(written(*names, ({"en": "U"}, None, -2)))


def test_a_building_of_imdf_in_degrees(tmp_path):
    content = json.loads(geojson(tmp_path / "plan.geojson", *venue()).read_text())
    for one in content["features"]:
        shape = shapely.geometry.shape(one["geometry"])
        one["geometry"] = shapely.geometry.mapping(
            shapely.transform(shape, lambda p: (8.54, 47.377) + p / (75_420, 111_180))
        )
    (tmp_path / "plan.geojson").write_text(json.dumps(content))
    plan = read_plan(tmp_path / "plan.geojson")
    assert plan.walkable.area == pytest.approx(58.76, rel=0.01) and len(plan.exits) == 2
    assert plan.notes[0].startswith("in degrees: projected to meters about 47.377")
