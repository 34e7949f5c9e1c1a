"""Projects of JuPedSim: of its web editor, and geometries of jpscore."""

import json

import pytest

from crowd_env import make_scenario
from crowd_env.scenarios.plans.floor_plan import Start
from crowd_env.scenarios.plans.reading import read_plan

ROOM = "POLYGON ((0 0, 10 0, 10 6, 0 6, 0 0), (4 2, 4 3, 5 3, 5 2, 4 2))"


def corners(x0, y0, x1, y1):
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]


def project(tmp_path, **others):
    """Exits in the east and the west, 12 people in the west that walk to the east."""
    content = {
        "project_version": "2.0",
        "config": {"simulation_settings": {"baseSeed": 1}},
        "exits": {
            "jps-exits_0": {"type": "polygon", "coordinates": corners(9.5, 2, 10, 3.2)},
            "jps-exits_1": {"type": "polygon", "coordinates": corners(0, 2, 0.5, 3.2)},
        },
        "distributions": {
            "jps-distributions_0": {"coordinates": corners(1, 1, 3, 5), "parameters": {"number": 12, "v0": 1.3}}
        },
        "checkpoints": {"jps-checkpoints_0": {"coordinates": corners(6, 1, 7, 2)}},
        "zones": {},
        "journeys": [{"id": "j", "stages": ["jps-distributions_0", "jps-exits_0"]}],
        **others,
    }
    path = tmp_path / "config.json"
    path.write_text(json.dumps(content))
    return path


def test_a_project_of_the_editor_has_people_that_walk_to_their_exit(tmp_path):
    path = project(tmp_path)
    (tmp_path / "geometry.wkt").write_text(ROOM)
    plan = read_plan(path)
    assert plan.starts == {"jps-distributions_0": Start(12, ("jps-exits_0",))}
    assert "jps-checkpoints_0" in plan.regions and any("waiting at checkpoints" in note for note in plan.notes)
    with pytest.warns(UserWarning, match="left out: speeds, radii"):
        place = make_scenario(path)
    assert place.population.people == 12 and place.population.parts[0].exits == ("jps-exits_0",)
    assert place.geometry.area == pytest.approx(59.0 - 2 * 0.5 * 1.2)
    assert read_plan(project(tmp_path, walkable_area_wkt=ROOM.replace("10 6", "10 7"))).walkable.area > 60.0


def test_what_a_project_lacks_is_named(tmp_path):
    with pytest.raises(
        ValueError, match=r"its geometry is missing: neither geometry\.wkt nor config\.wkt lies beside it"
    ):
        read_plan(project(tmp_path))
    exits = {"jps-exits_0": {"coordinates": [[1, 2], ["a", 3], [4, 5]]}}
    with pytest.raises(ValueError, match="jps-exits_0: x"):
        read_plan(project(tmp_path, walkable_area_wkt=ROOM, exits=exits))


def lines(tag, *segments, **attributes):
    words = " ".join(f'{key}="{value}"' for key, value in attributes.items())
    vertices = ("".join(f'<vertex px="{x}" py="{y}"/>' for x, y in line) for line in segments)
    return "".join(f"<{tag} {words}>{one}</{tag}>" for one in vertices)


def geometry(tmp_path, gap=3.2):
    """A hall of 6 x 6 m and a room of 4 x 6 m beside it, a transition between them and one out, a table of 1 m2."""
    wall = {"caption": "wall"}
    hall = lines("polygon", [(6, 2), (6, 0), (0, 0), (0, 6), (6, 6), (6, gap)], **wall)
    table = [(2, 2), (3, 2)], [(3, 2), (3, 3)], [(3, 3), (2, 3)], [(2, 3), (2, 2)]
    hall += f"<obstacle id='0'>{lines('polygon', *table)}</obstacle>"
    room = lines("polygon", [(6, 2), (6, 0), (10, 0), (10, 2)], [(10, 3), (10, 6), (6, 6), (6, gap)], **wall)
    inner = lines("transition", [(6, 2), (6, 3.2)], id=0, room1_id=0, subroom1_id=0, room2_id=1, subroom2_id=0)
    outer = lines(
        "transition",
        [(10, 2), (10, 3)],
        id=1,
        caption="main exit",
        room1_id=1,
        subroom1_id=0,
        room2_id=-1,
        subroom2_id=-1,
    )
    rooms = f"<room id='0'><subroom id='0'>{hall}</subroom></room>"
    rooms += f"<room id='1'><subroom id='0' class='stair'>{room}</subroom></room>"
    path = tmp_path / "geometry.xml"
    path.write_text(f"<geometry unit='m'><rooms>{rooms}</rooms><transitions>{inner}{outer}</transitions></geometry>")
    return path


def test_rooms_of_jpscore_are_joined_by_their_doors_alone(tmp_path):
    plan = read_plan(geometry(tmp_path))
    assert plan.walkable.geom_type == "Polygon" and list(plan.exits) == ["main exit"]
    assert plan.walkable.area == pytest.approx(59.0, abs=0.45)  # walls are 2 cm thick
    place = make_scenario(geometry(tmp_path), people=5)
    assert place.geometry.exit_widths["main exit"] == pytest.approx(1.0, abs=0.03)
    walk, _ = place.longest_walk()
    assert walk > 10.0 / 1.9  # through the door, not through the wall
    assert any("stairs are floor" in note for note in plan.notes)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<geometry>", "no whole XML"),
        ("<project/>", "begins with 'project'"),
        ("<!DOCTYPE a [<!ENTITY b 'c'>]><geometry><rooms/></geometry>", "declares entities"),
    ],
)
def test_other_xml_is_named(tmp_path, text, words):
    path = tmp_path / "geometry.xml"
    path.write_text(text)
    with pytest.raises(ValueError, match=words):
        read_plan(path)


def test_a_subroom_that_is_open_is_named(tmp_path):
    with pytest.raises(ValueError, match="do not enclose subroom 0 of room 0"):
        read_plan(geometry(tmp_path, gap=4.0))
