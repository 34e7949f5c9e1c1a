"""Projects: a scenario file that names a drawing, and adds people, doors, zones and all else to it."""

import json

import numpy as np
import pytest
from commands import call
from shapely.geometry import box, mapping

from crowd_env import OUTLINES, CrowdEnv, LogNormal, Outline, Section, SpeedZone, make_scenario

PROJECT = """
time_limit = 90
closed_doors = ["gate"]

[geometry]
file = "drawings/hall.geojson"
obstacles = [{ box = [4, 4, 5, 5] }]

[geometry.exits]
main = "east"
side = [[0, 3], [0, 5]]

[geometry.regions]
stage = "corner"
stairs = { box = [6, 2, 8, 6] }

[geometry.doors]
gate = "side"

[[cohorts]]
density = 0.5
start_region = "stage"

[[cohorts]]
people = 7
response_time = 5

[[zones]]
region = "stairs"
speed = 0.6
"""


def drawing(tmp_path, **others):
    """A hall of 12 m x 8 m in millimeters, an exit on each long side, a corner of 4 m2 to start in."""
    shapes = {
        "hall": ("walkable", box(0, 0, 12, 8)),
        "east": ("exit", box(12, 3, 12.1, 5)),
        "north": ("exit", box(3, 8, 5, 8.1)),
        "corner": ("start", box(0, 0, 2, 2)),
        **others,
    }
    features = [
        {"type": "Feature", "properties": {"kind": role, "name": name}, "geometry": mapping(shape)}
        for name, (role, shape) in shapes.items()
    ]
    path = tmp_path / "drawings" / "hall.geojson"
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def project(tmp_path, text=PROJECT):
    drawing(tmp_path)
    path = tmp_path / "hall.toml"
    path.write_text(text)
    return path


def test_a_project_adds_to_its_drawing(tmp_path):
    place = make_scenario(project(tmp_path))
    assert place.name == "hall" and "hall.geojson" in place.title and place.time_limit == 90.0
    assert place.exits == ("main", "side")  # the north one is not among them
    assert place.geometry.area == pytest.approx(12 * 8 - 1)
    assert set(place.geometry.regions) == {"stage", "stairs"} and place.geometry.area_of("stage") == pytest.approx(4.0)
    assert [part.people for part in place.population.parts] == [2, 7]
    assert place.population.parts[0].start_region == "stage"
    assert place.closed_doors == ("gate",) and place.zones[0].region == "stairs"
    env = CrowdEnv(place, physics="dem")
    env.reset(seed=0)
    env.step(None)


def test_what_a_project_leaves_out_is_that_of_the_drawing(tmp_path):
    path = project(tmp_path, '[geometry]\nfile = "drawings/hall.geojson"\n')
    place, alone = make_scenario(path), make_scenario(drawing(tmp_path))
    assert place.exits == alone.exits == ("east", "north") and place.time_limit == alone.time_limit
    for ours, theirs in zip((place, alone), (alone, place), strict=True):
        np.testing.assert_array_equal(ours.geometry.walls, theirs.geometry.walls)
        assert ours.population.start_region == "corner" and ours.population.people == theirs.population.people
    more = project(tmp_path, '[geometry]\nfile = "drawings/hall.geojson"\n[population]\npeople = 9\nradius = 0.2\n')
    crowd = make_scenario(more).population
    assert (crowd.people, crowd.radius.high, crowd.start_region) == (9, 0.2, "corner")


def test_a_drawing_that_changes_keeps_its_project(tmp_path):
    path = project(tmp_path)
    drawing(tmp_path, hall=("walkable", box(0, 0, 12, 9)), north=("exit", box(3, 9, 5, 9.1)))
    place = make_scenario(path)
    assert place.geometry.area == pytest.approx(12 * 9 - 1) and place.exits == ("main", "side")


def test_names_of_a_drawing_may_look_like_shapes(tmp_path):
    """They were taken for well-known text in the project that the command had written."""
    path = drawing(tmp_path, **{"side, (A)": ("exit", box(0, 3, 0.1, 5)), "desk (B)": ("region", box(8, 1, 9, 2))})
    saved = tmp_path / "saved.toml"
    assert call(f"plan {path} --save {saved} --out {tmp_path / 'plan.png'}").exit_code == 0
    place = make_scenario(saved)
    assert "side, (A)" in place.exits and "desk (B)" in place.geometry.regions


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (('main = "east"', 'main = "west"'), r"hall.toml: geometry: exits.main is 'west', which hall.geojson does not have; "
         "its exits are east, north"),
        (('stage = "corner"', 'stage = "edge"'), "regions.stage is 'edge', .* its regions are corner"),
        (('start_region = "stage"', 'start_region = "corner"'), r"cohorts\[0\]: unknown region 'corner'; known: "),
        (("density = 0.5", "density = -1"), r"cohorts\[0\].density is -1"),
        (("density = 0.5", "density = 1\npeople = 3"), r"cohorts\[0\]: people or density, not both"),
        (('file = "drawings/hall.geojson"', 'file = "drawings/hull.geojson"'), "hull.geojson"),
        (('file = "drawings/hall.geojson"', "file = 5"), "geometry: file is 5"),
        (('file = "drawings/hall.geojson"', ""), "geometry: key 'walkable' is missing"),
        (('side = [[0, 3], [0, 5]]', "side = [[1, 3], [1, 5]]"), "exit 'side' is not on the boundary"),
        (("[geometry]", "[geometry]\nunit = 'parsec'"), "unknown unit 'parsec'"),
        (("[geometry]", "[geometry]\nlevel = 3"), "it has no level '3'"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_named(tmp_path, change, words):
    text = PROJECT.replace(*change)
    assert text != PROJECT
    with pytest.raises(ValueError, match=words):
        make_scenario(project(tmp_path, text))


def test_density_of_a_plan_in_the_file_itself(tmp_path):
    path = tmp_path / "room.toml"
    plan = "[geometry]\nwalkable = { box = [0, 0, 10, 5] }\nexits = { a = [[0, 1], [0, 2]] }\n"
    path.write_text(plan + "[population]\ndensity = 0.4\n")
    assert make_scenario(path).population.people == 20


# ------------------------------------------------------------------------------------------------ saved by a command


def saved(tmp_path, options, path=None):
    files = f"--out {tmp_path / 'plan.png'} --save {tmp_path / 'p.toml'}"
    done = call(f"plan {path or drawing(tmp_path)} {options} {files}")
    assert done.exit_code == 0, done.stderr
    return (tmp_path / "p.toml").read_text()


def test_what_was_understood_is_saved_and_is_the_same_place(tmp_path):
    text = saved(tmp_path, "--people 9 --set response_time=lognormal,5,0.5,30 --set outline=torso")
    place, alone = make_scenario(tmp_path / "p.toml"), make_scenario(drawing(tmp_path), people=9)
    assert place.exits == alone.exits and place.geometry.area == alone.geometry.area
    assert 'file = "drawings/hall.geojson"' in text and 'east = "east" # area of 0.2 m2 around' in text
    people = place.population
    assert (people.people, people.start_region, people.response_time) == (9, "corner", LogNormal(5.0, 0.5, 30.0))
    assert place.behavior(Outline) == OUTLINES["torso"]


def test_exits_and_units_of_the_command_are_saved(tmp_path):
    text = saved(tmp_path, "--exit 0,3,0,4.2 --unit m")
    place = make_scenario(tmp_path / "p.toml")
    assert place.exits == ("exit-0",) and place.geometry.exit_widths["exit-0"] == pytest.approx(1.2)
    assert "exit-0 = [[0.0, 3.0], [0.0, 4.2]]" in text and 'unit = "m"' in text


def test_a_drawing_without_exits_is_saved_to_be_given_some(tmp_path):
    path = tmp_path / "room.wkt"
    path.write_text("POLYGON ((0 0, 6 0, 6 5, 0 5, 0 0))")
    text = saved(tmp_path, "", path)
    assert "# no exits yet" in text
    exits = "[geometry.exits]\nout = [[6, 2], [6, 3]]\n[population]"
    (tmp_path / "p.toml").write_text(text.replace("[population]", exits))
    assert make_scenario(tmp_path / "p.toml").exits == ("out",)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("room-v0 --save p.toml", "room-v0 is no floor plan in a file"),
        ("examples/foyer.wkt --save p.json", "p.json"),
        ("examples/foyer.wkt --layers A --save p.toml", "--layers A: this must be NAME=VALUE, such as exits=NAME,NAME"),
        (
            "examples/foyer.wkt examples/office.dxf --save p.toml",
            "--save is for one floor plan, but 2 places are given",
        ),
        ("room-v0 --layers walkable=A", "--layers is for floor plans in files"),
    ],
)
def test_what_cannot_be_saved_is_refused(tmp_path, monkeypatch, line, words):
    done = call(f"plan {line} --out {tmp_path / 'plan.png'}")
    assert done.exit_code == 2 and words in " ".join(done.stderr.split())


def test_python_says_the_same_of_a_drawing_as_a_project_does(tmp_path):
    place = make_scenario(
        drawing(tmp_path),
        exits={"main": "east", "side": [[0, 3], [0, 5]]},
        regions={"stage": "corner", "stairs": [[6, 2], [8, 2], [8, 6], [6, 6]]},
        obstacles=[box(4, 4, 5, 5)],
        doors={"gate": "side"},
        population={"people": 5, "start_region": "stage"},
        zones=[SpeedZone("stairs", speed=0.6)],
        closed_doors=["gate"],
        sections=[Section("middle", ((6, 0), (6, 8)))],
    )
    assert place.exits == ("main", "side") and set(place.geometry.regions) == {"stage", "stairs"}
    assert place.geometry.area == pytest.approx(12 * 8 - 1) and place.geometry.doors == ("gate",)
    assert place.zones[0].speed == 0.6 and place.closed_doors == ("gate",) and place.sections[0].name == "middle"
    with pytest.raises(ValueError, match=r"hall\.geojson has no option 'zone'; did you mean 'zones'"):
        make_scenario(drawing(tmp_path), zone=[])
    with pytest.raises(ValueError, match=r"exits\.main is 'west', which hall\.geojson does not have"):
        make_scenario(drawing(tmp_path), exits={"main": "west"})


def test_an_origin_brings_a_plan_near(tmp_path):
    far = drawing(tmp_path, hall=("walkable", box(500_000, 5_000_000, 500_012, 5_000_008)))
    content = json.loads(far.read_text())
    content["features"] = content["features"][:1]
    far.write_text(json.dumps(content))
    (tmp_path / "near.toml").write_text(
        '[geometry]\nfile = "drawings/hall.geojson"\norigin = [500000, 5000000]\n'
        "[geometry.exits]\neast = [[12, 3], [12, 4]]\n[population]\npeople = 3\n"
    )
    assert make_scenario(tmp_path / "near.toml").geometry.bounds == (0.0, 0.0, 12.0, 8.0)
    (tmp_path / "near.toml").write_text('[geometry]\nfile = "drawings/hall.geojson"\norigin = [1, 2, 3]\n')
    for key, said in (
        ("origin = 1", "origin is 1; it must be"),
        ("layers = 1", "layers is 1"),
        ("exits = 1", "exits is 1"),
    ):
        (tmp_path / "wrong.toml").write_text(f'[geometry]\nfile = "drawings/hall.geojson"\n{key}\n')
        with pytest.raises(ValueError, match=said):
            make_scenario(tmp_path / "wrong.toml")
    with pytest.raises(ValueError, match="origin"):
        make_scenario(tmp_path / "near.toml")


def test_python_takes_cohorts_of_a_drawing_as_a_project_does(tmp_path):
    place = make_scenario(
        drawing(tmp_path),
        exits={"main": "east"},
        regions={"stairs": [[6, 2], [8, 2], [8, 6], [6, 6]]},
        cohorts=[{"density": 0.5, "start_region": "corner"}, {"people": 7, "start_region": "stairs", "name": "late"}],
        population={"response_time": 5},
        time_limit=90,
    )
    assert [(one.people, one.start_region) for one in place.population.parts] == [(2, "corner"), (7, "stairs")]
    assert place.exits == ("main",) and place.time_limit == 90


@pytest.mark.parametrize("in_a_file", [True, False])
def test_what_lies_off_the_floor_is_told(tmp_path, in_a_file):
    floor = "walkable = { box = [0, 0, 12, 8] }\nexits = { east = [[12, 3], [12, 5]] }"
    if in_a_file:
        drawing(tmp_path)
        floor = 'file = "drawings/hall.geojson"'
    path = tmp_path / "hall.toml"
    text = f"[geometry]\n{floor}\n[geometry.regions]\nhalf = {{ box = [-2, 2, 2, 4] }}\n"
    path.write_text(text + '[population]\ndensity = 1\nstart_region = "half"\n')
    with pytest.warns(UserWarning, match="start area 'half': 4 m2 of its 8 m2 are floor"):
        assert make_scenario(path).population.people == 4
    path.write_text(text + "off = { box = [20, 2, 22, 4] }\n[population]\npeople = 3\n")
    if in_a_file:
        with pytest.warns(UserWarning, match="left out: 1 region off the floor, off"):
            assert set(make_scenario(path).geometry.regions) == {"half", "corner"}
    else:
        with pytest.raises(ValueError, match=r"region 'off' around .* lies outside of the walkable area"):
            make_scenario(path)
