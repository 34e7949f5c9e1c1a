"""Scenarios in files: what every key becomes, mistakes by their place, TOML and JSON alike; their schema and their table."""

import json
import re
import tomllib
import warnings
from dataclasses import fields, replace
from functools import partial

import numpy as np
import pytest
from cases import looped
from late import late
from repository import ROOT
from shapely.geometry import Polygon, box
from typer.testing import CliRunner

from crowd_env import (
    Attraction,
    Balance,
    CrowdEnv,
    Geometry,
    GroupCohesion,
    Headway,
    LogNormal,
    Normal,
    Outline,
    Population,
    Uniform,
    make_scenario,
)
from crowd_env.cli.main import app
from crowd_env.core.checks import POSITIVE, number
from crowd_env.envs.rollout import run_episodes
from crowd_env.routing.fields.field import OneWay
from crowd_env.routing.spec import ControlRule, DoorEvent, Gate, Route
from crowd_env.routing.speed_map import Comfort, SpeedZone
from crowd_env.scenarios.arrivals import Arrivals
from crowd_env.scenarios.buildings import Level, Ramp, Stair
from crowd_env.scenarios.shapes import circle

json_schema = late("crowd_env.scenarios.schema", "json_schema")

FULL = """
name = "everything"
title = "hall of 12 m"
reference = "a test"
time_limit = 90
blocked_after = inf
target = "path"
closed_doors = ["gate"]

[geometry]
walkable = [{ box = [0, 0, 12, 8] }, "POLYGON ((0 8, 2 8, 2 9, 0 9, 0 8))"]
obstacles = [{ circle = [6, 4, 0.5] }, [[4, 0], [4.5, 0], [4.5, 0.5]], { box = [8, 1, 8.4, 1.4] }, { box = [8, 2, 8.4, 2.4] }]
thin_walls = [[[2, 0], [2, 3]], [[9, 6], [9, 7]], "LINESTRING (10 6, 10 7)"]

[geometry.exits]
east = [[12, 3], [12, 5]]
west = "LINESTRING (0 3, 0 5)"

[geometry.regions]
stage = { box = [7, 5, 12, 8] }
corner = [[0, 0], [1.9, 0], [1.9, 2], [0, 2]]
spots = [{ box = [3, 6, 4, 7] }, { box = [4.5, 6, 5.5, 7] }]

[geometry.doors]
gate = [[2, 3], [2, 5]]

[population]
radius = [0.2, 0.22]
mass = 80

[[cohorts]]
name = "actors"
people = 6
start_region = "stage"
route = "behind"
desired_speed = { distribution = "normal", mean = 1.3, sd = 0.2, low = 0.8, high = 1.8 }

[[cohorts]]
name = "guests"
starts = [[0.5, 0.5], [0.5, 1.1], [1.2, 1.1]]
exits = ["west"]
response_time = { distribution = "lognormal", median = 5, sigma = 0.5, high = 30 }

[[routes]]
name = "behind"
exits = ["east"]
via = "spots"
strategy = "comfortable"

[[zones]]
region = "stage"
factor = 0.5

[[rules]]
region = "stage"
at_least = 4
below = 2
hold = 3.0
route = "west"
commits = true

[[door_events]]
door = "gate"
opens = true
at = 2.5

[[one_way]]
door = "gate"
to = "left"

[comfort]
stairs = 2.0
"""

SMALL = """
[geometry]
walkable = {{ box = [0, 0, 6, 5] }}
{geometry}
[geometry.exits]
door = [[6, 2], [6, 3]]
[geometry.regions]
back = {{ box = [0, 0, 2, 5] }}
{regions}
[population]
{people}
{end}
"""


def small(*, top="", geometry="", regions="", people="people = 5", more="", end=""):
    """Return a room with a door as a file, with more in some places."""
    return top + SMALL.format(geometry=geometry, regions=regions, people=f"{people}\n{more}", end=end)


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Write a file in a folder of its own and return its name."""
    monkeypatch.chdir(tmp_path)

    def written(text, name="my.toml"):
        (tmp_path / name).write_text(text, encoding="utf-8")
        return name

    return written


# --------------------------------------------------------------------------------------------------------- what it holds


@looped(
    "area",
    [
        *(
            {"box": [10.0 - depth, 1.0, 10.0, 2.0]} for depth in (0.02, 0.05, 0.1, 0.3, 0.5)
        ),  # at the end of the corridor
        {"box": [9.95, 0.0, 10.0, 4.0]},  # across all of it
        {"box": [9.5, 1.0, 10.5, 2.0]},  # half outside
        {"box": [4.0, 1.5, 5.0, 2.5]},  # in the floor
        {"box": [4.0, 0.0, 6.0, 1.0]},  # at a wall
        {"box": [0.0, 0.0, 1.0, 1.0]},  # in a corner
        {"circle": [5.0, 2.0, 0.5]},
        {"circle": [10.0, 2.0, 0.5]},
        {"circle": [0.0, 0.0, 1.0]},
    ],
)
def test_an_exit_as_a_box_or_circle_is_the_same_area_as_its_polygon(area, write):
    """People walk into it: it is cut out of the floor, and its open sides lead out."""
    ((form, size),) = area.items()
    shape = box(*size) if form == "box" else Polygon(circle(*size))
    text = "[geometry]\nwalkable = {{ box = [0, 0, 10, 4] }}\n[geometry.exits]\nzone = {}\n[population]\npeople = 2\n"
    ours, same = (
        make_scenario(write(text.format(one))).geometry for one in (f"{{ {form} = {size} }}", json.dumps(shape.wkt))
    )
    lines, expected = ({tuple(line.ravel().round(9)) for line in one.exits} for one in (ours, same))
    assert lines == expected and ours.area == pytest.approx(box(0, 0, 10, 4).difference(shape).area)
    open_sides = shape.boundary.intersection(box(1e-6, 1e-6, 10 - 1e-6, 4 - 1e-6)).length
    assert ours.exit_lengths == pytest.approx({"zone": open_sides}, abs=0.01)


def test_everything_arrives(write):
    place = make_scenario(write(FULL))
    assert (place.name, place.title, place.reference) == ("everything", "hall of 12 m", "a test")
    assert (place.time_limit, place.blocked_after, place.target) == (90, np.inf, "path")
    assert place.closed_doors == ("gate",) and place.geometry.doors == ("gate",)
    assert place.routes == (Route("behind", ("east",), "spots", "comfortable"),)
    assert place.zones == (SpeedZone("stage", factor=0.5),)
    assert place.rules == (ControlRule("stage", 4, "west", below=2, hold=3.0, commits=True),)
    assert place.door_events == (DoorEvent("gate", True, at=2.5),)
    assert place.one_way == (OneWay("gate", "left"),)
    assert place.comfort == Comfort(stairs=2.0)
    area = 12 * 8 + 2 - 0.5**2 / 2 * 32 * np.sin(2 * np.pi / 32) - 0.125 - 2 * 0.16
    assert place.geometry.area == pytest.approx(area)
    assert place.geometry.walls[place.geometry.two_sided].shape == (4, 2, 2)  # three walls and a leaf
    assert place.geometry.regions["spots"].area == pytest.approx(2.0)
    actors, guests = place.population.parts
    assert (actors.people, actors.start_region, actors.route) == (6, "stage", "behind")
    assert actors.radius == guests.radius == Uniform(0.2, 0.22) and guests.mass == Uniform(80, 80)
    assert actors.desired_speed == Normal(1.3, 0.2, 0.8, 1.8)
    assert guests.exits == ("west",) and guests.response_time == LogNormal(5, 0.5, 30)
    np.testing.assert_allclose(guests.starts, [[0.5, 0.5], [0.5, 1.1], [1.2, 1.1]])


@pytest.mark.more
def test_toml_and_json_are_the_same(write):
    content = tomllib.loads(FULL)
    del content["blocked_after"]  # JSON knows no infinity
    one = make_scenario(write(FULL))
    other = make_scenario(write(json.dumps(content), "my.json"))
    assert one.geometry.walkable.equals(other.geometry.walkable)
    np.testing.assert_array_equal(one.geometry.walls, other.geometry.walls)
    for name in ("name", "title", "time_limit", "blocked_after", "routes", "zones", "rules", "door_events", "one_way"):
        assert getattr(one, name) == getattr(other, name)
    drawn = [place.population.draw(np.random.default_rng(3), place.geometry) for place in (one, other)]
    np.testing.assert_array_equal(drawn[0][1], drawn[1][1])


@pytest.mark.more
def test_a_file_runs_and_takes_what_is_common_to_all_places(write):
    name = write(FULL)
    env = CrowdEnv(name)
    assert env.num_people == 9
    env.reset(0)
    while not env.finished.all():
        env.step(None)
    assert env.metrics(0).unfinished == 0
    assert [part.people for part in make_scenario(name, people=6).population.parts] == [4, 2]
    changed = make_scenario(name, time_limit=5.0, blocked_after=2.0, target="centre", population=Population(4))
    assert (changed.time_limit, changed.blocked_after, changed.target) == (5.0, 2.0, "centre")
    assert changed.population.people == 4


def test_starts_of_a_file_beside_it(write):
    write("x,y\n1,1\n2,2\n", "seats.csv")
    place = make_scenario(write(small(people='starts = "seats.csv"')))
    assert place.name == "my" and place.population.starts.tolist() == [[1, 1], [2, 2]]


# -------------------------------------------------------------------------------------------------------------- mistakes


# Part of the room -> what stands there, and what is said of it.
MISTAKES = {
    "top": [
        ('titel = "x"', r"my\.toml: unknown key 'titel'; known: .*title"),
        ("time_limit = -1", r"my\.toml: scenario 'my': time_limit is -1"),
        ('target = "paht"', r"my\.toml: scenario 'my': unknown target 'paht'; known: path, nearest, centre, width"),
        ('closed_doors = ["gate"]', r"my\.toml: unknown door 'gate'"),
        ("options = { width = 1 }", r"my\.toml: unknown key 'options'; known: .*title"),
    ],
    "geometry": [
        ("wals = []", r"my\.toml: geometry: unknown key 'wals'; known: file, level, layers, unit, origin, walkable"),
        (
            "obstacles = [{ circle = [3, 3, -1] }]",
            r"geometry\.obstacles\[0\]: the radius of the circle is -1\.0 m; it must be > 0",
        ),
        ('obstacles = ["POLYGON ((0 0, 1 1"]', r"geometry: obstacle 0 is not well-known text"),
        ("obstacles = [{ box = [5.5, 1, 5.9, 4] }]", r"my\.toml: the way to exit 'door' is blocked"),
        ("thin_walls = [[[3, 0], [3, 5]]]", r"my\.toml: no exit can be reached from"),
    ],
    "regions": [
        ("door = { box = [0, 0, 1, 1] }", r"geometry: region 'door' has the name of an exit"),
        ("far = { box = [9, 9, 10, 10] }", r"geometry: region 'far' around .* outside of the walkable"),
        ("far = { bxo = [9, 9, 10, 10] }", r"geometry\.regions\.far: unknown key 'bxo'; known: box, circle"),
        ("far = { box = [1, 1, 0, 2] }", r"geometry\.regions\.far: box is \[1, 1, 0, 2\]; it must be"),
        ("far = { box = [1, 1, 2, 2], rows = 2 }", r"my\.toml: geometry\.regions\.far: unknown key 'rows'; known: box"),
        ("far = { box = [1, 1, 2] }", r"geometry\.regions\.far: it must be a box = \["),
    ],
    "people": [
        ("", r"my\.toml: population: key 'people' is missing"),
        ("people = 5.5", r"population: people is 5\.5; it must be a whole number"),
        ("people = true", r"population: people is True; it must be a whole number"),
        ('people = "five"', r"population: people is 'five'; it must be a whole number"),
        (
            "people = 0",
            r"^my\.toml: population: people is 0; it must be 1 to 500000: more people do not fit into one environment$",
        ),
        ("count = 5", r"^my\.toml: population: unknown key 'count'; known: people"),
        ("people = 900", r"my\.toml: 900 people do not fit"),
        ("starts = [[1, 1], [1.2, 1]]", r"my\.toml: starts 0 and 1 overlap by 0\.180 m"),
        ("starts = [[1, 1], [7, 1]]", r"my\.toml: start 1 at \(7, 1\) is outside"),
        ("starts = [[1, 1, 1]]", r"population: starts must have the shape \(\d, 2\), not \(1, 3\)"),
        ('starts = "none.csv"', r"population\.starts: cannot read the starting positions .*none\.csv"),
        ("people = 3\nstarts = [[1, 1]]", r"population: starts must have the shape \(3, 2\), not \(1, 2\)"),
    ],
    "more": [
        ("raduis = 0.2", r"population: unknown key 'raduis'; known: people, radius"),
        ("radius = [0.3, 0.2]", r"population: radius: uniform distribution from 0\.3 to 0\.2"),
        ("radius = [0.3]", r"population: radius is \[0\.3\]; it must be a number, a pair"),
        ("radius = nan", r"population: radius is nan; it must be finite"),
        ("radius = -1", r"^my\.toml: population: radius must be > 0"),
        (
            'mass = { distribution = "gauss", mean = 3 }',
            r"population: mass: unknown distribution 'gauss'; known: uniform, normal, lognormal",
        ),
        ('mass = { distribution = "normal", mean = 3 }', r"population: mass: key 'sd' is missing"),
        (
            'mass = { distribution = "normal", mena = 3 }',
            r"population: mass: unknown key 'mena'; known: mean",
        ),
        ('start_region = "bakc"', r"my\.toml: unknown start region 'bakc'; known: back"),
        ('route = "left"', r"my\.toml: unknown route 'left'; known: door"),
        ('exits = ["door", "gate"]', r"my\.toml: unknown exit 'gate'; known: door"),
        ('exits = ["door"]\nroute = "door"', r"takes? the route 'door' or the best of some exits"),
    ],
    "end": [
        ("[[cohorts]]\npeople = 3", r"population: 'people' is a matter of each cohort; write it there"),
        ("[[rules]]\nregion = 'attic'\nat_least = 3\nroute = 'door'", r"unknown region 'attic'; known: back"),
        ("[[rules]]\nregion = 'back'\nat_least = 3\nroute = 'up'", r"unknown route 'up'; known: out, door"),
        ("[[rules]]\nregion = 'back'\nat_least = 0\nroute = 'door'", r"control rule on 'back': at_least"),
        ("[[rules]]\nregion = 'back'\nroute = 'door'", r"rules\[0\]: key 'at_least' is missing"),
        (
            "[[rules]]\nregion = 'back'\nat_least = 3\nroute = 'door'\nbelo = 2",
            r"rules\[0\]: unknown key 'belo'; known: .*below",
        ),
        ("[[routes]]\nname = 'a'\nstrategy = 'fast'", r"route 'a': unknown strategy 'fast'; known: shortest, fastest"),
        ("[[routes]]\nname = 'a'\nexits = ['b']", r"route 'a' names an unknown exit 'b'; known: door"),
        ("[[routes]]\nname = 'out'", r"route 'out': the name is taken"),
        ("[[zones]]\nregion = 'attic'\nfactor = 0.5", r"speed zone names an unknown region 'attic'"),
        ("[[zones]]\nregion = 'back'\nfactor = 0", r"speed zone 'back': factor is 0"),
        ("[comfort]\nstars = 1", r"comfort: unknown key 'stars'; known: stairs"),
    ],
}
OTHERS = [
    ("name = ]", r"my\.toml: Invalid value \(at line 1, column 8\)"),
    ("time_limit = 3", r"my\.toml: key 'geometry' is missing"),
    (
        small(people="radius = 0.2", end="[[cohorts]]\npeople = 3\n[[cohorts]]\npeople = 3\nraduis = 1"),
        r"cohorts\[1\]: unknown key 'raduis'; known: people, radius",
    ),
    (
        small(people="radius = 0.2", end="[[cohorts]]\npeople = 3\n[[cohorts]]\npeople = 3\nradius = '1'"),
        r"cohorts\[1\]: population: radius is '1'; it must be a number",
    ),
    (
        small(people="mass = 70", end="[[cohorts]]\npeople = 3\nname = 'a'\n[[cohorts]]\npeople = 3\nname = 'a'"),
        r"my\.toml: cohorts: two cohorts have the name 'a'",
    ),
]


@looped(
    ("text", "message"),
    [(small(**{part: text}), message) for part, rows in MISTAKES.items() for text, message in rows] + OTHERS,
)
def test_a_mistake_is_named_by_its_place(write, text, message):
    with pytest.raises(ValueError) as error:
        make_scenario(write(text))
    assert str(error.value).startswith("my.toml: "), error.value
    assert re.search(message, str(error.value)), error.value
    assert "\n" not in str(error.value)


@pytest.mark.more
def test_json_says_line_and_column(write):
    with pytest.raises(ValueError, match=r"my\.json: Expecting value: line 2 column 9"):
        make_scenario(write('{\n "name":}', "my.json"))
    with pytest.raises(ValueError, match=r"my\.json: the scenario is \[1\]; it must be a table"):
        make_scenario(write("[1]", "my.json"))
    with pytest.raises(ValueError, match=r"cannot read the scenario none\.toml"):
        make_scenario("none.toml")


@pytest.mark.more
def test_options_are_checked(write, subtests):
    for options, message in (
        ({"length": 12.0}, r"my\.toml has no option 'length'; known: people, population, time_limit"),
        ({"people": 1}, r"1 person for 2 cohorts; each needs at least 1"),
        ({"time_limit": 0.0}, "time_limit is 0.0"),
    ):
        with subtests.test(options=options), pytest.raises(ValueError, match=message):
            make_scenario(write(FULL), **options)


# ----------------------------------------------------------------------------------------------------------- log-normal


def test_log_normal_has_its_median_and_spread_and_stays_in_bounds():
    values = LogNormal(10.0, 0.5, 1e6).sample(np.random.default_rng(0), 20_000)
    assert np.median(values) == pytest.approx(10.0, rel=0.02)
    assert np.log(values).std() == pytest.approx(0.5, rel=0.02)
    cut = LogNormal(10.0, 0.8, 20.0, low=5.0).sample(np.random.default_rng(0), 5000)
    assert 5.0 <= cut.min() < 5.05 and 19.9 < cut.max() <= 20.0
    assert (LogNormal(3.0, 0.0, 5.0).sample(np.random.default_rng(0), 3) == 3.0).all()


# --------------------------------------------------------------------------------------------------------------- schema


@pytest.mark.more
def test_the_command_writes_the_schema(tmp_path):
    out = tmp_path / "new.json"
    assert CliRunner().invoke(app, ["schema", "--out", str(out)]).exit_code == 0
    assert json.loads(CliRunner().invoke(app, ["schema"]).stdout) == json.loads(out.read_text()) == json_schema()
    wrong = CliRunner().invoke(app, ["schema", "--out", "schema.toml"])
    assert wrong.exit_code == 2 and "must end in .json" in wrong.stderr


def tables(schema):
    """Return name -> table of the schema, that of the whole file as ""."""
    return {"": schema, **{name: one for name, one in schema["definitions"].items() if "properties" in one}}


@pytest.mark.more
def test_every_key_has_a_note_and_no_table_takes_others():
    for name, table in tables(json_schema()).items():
        assert table["additionalProperties"] is False
        for key, one in table["properties"].items():
            inner = one.get("$ref", "").removeprefix("#/definitions/")
            told = one.get("description") or json_schema()["definitions"].get(inner, {}).get("description")
            assert told or "const" in one, f"{name}.{key} has no note"


@pytest.mark.more
def test_people_have_the_keys_of_a_population():
    properties = json_schema()["definitions"]["Population"]["properties"]
    today = [name for name, one in properties.items() if not one.get("deprecated")]
    assert today == [*(field.name for field in fields(Population)), "density", "level"]


def accepts(schema, value, whole):
    """Return whether a value is valid: as much of JSON Schema as this one uses."""
    if "$ref" in schema:
        return accepts(whole["definitions"][schema["$ref"].removeprefix("#/definitions/")], value, whole)
    if "anyOf" in schema and not any(accepts(one, value, whole) for one in schema["anyOf"]):
        return False
    if value != schema.get("const", value) or value not in schema.get("enum", [value]):
        return False
    if isinstance(value, str) and not re.search(schema.get("pattern", ""), value):
        return False
    if isinstance(value, int | float):
        low, high = schema.get("minimum", -np.inf), schema.get("maximum", np.inf)
        if not low <= value <= high or value <= schema.get("exclusiveMinimum", -np.inf):
            return False
    kinds = {"object": dict, "array": list, "string": str, "boolean": bool, "number": (int, float), "integer": int}
    wanted = schema.get("type", [])
    wanted = [wanted] if isinstance(wanted, str) else wanted
    whole_number = "integer" in wanted and isinstance(value, float) and value % 1.0 == 0.0
    if wanted and not whole_number and not any(isinstance(value, kinds[one]) for one in wanted):
        return False
    if isinstance(value, list):
        size = schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value))
        items = schema.get("items", {})
        each = items if isinstance(items, list) else [items] * len(value)  # one by one, or all alike
        return size and all(accepts(item, one, whole) for item, one in zip(each, value, strict=True))
    if isinstance(value, dict):
        properties, others = schema.get("properties", {}), schema.get("additionalProperties", True)
        if not set(schema.get("required", ())) <= set(value) or (others is False and not set(value) <= set(properties)):
            return False
        others = others if isinstance(others, dict) else {}
        return all(accepts(properties.get(key, others), one, whole) for key, one in value.items())
    return True


@pytest.mark.more
def test_the_schema_takes_what_the_reader_takes_and_refuses_what_it_refuses():
    schema, content = json_schema(), tomllib.loads(FULL)
    assert accepts(schema, content, schema)
    for right in (
        {"manner": "calm"},
        {"manner": {"time_gap": 0.7}},
        {"population": {"people": 4, "companions": 2}},
        {"pulls": {"companions": {"patience": 0.0}}},
    ):
        assert accepts(schema, {**content, **right}, schema)
    assert accepts(schema, {"geometry": content["geometry"], "groups": [{"people": 3}]}, schema)
    assert accepts(schema, {**content, "population": {"density": 0.5}}, schema)
    assert accepts(schema, {"geometry": {"file": "office.dxf", "layers": {"exits": ["A-EXIT"]}}}, schema)
    for wrong in (
        {"titel": "x"},
        {"target": "paht"},
        {"geometry": {}},
        {"comfort": {"stars": 1}},
        {"name": 3},
        {"time_limit": 0.0},
        {"blocked_after": -1.0},
        {"population": {"people": 0}},
        {"pulls": {"groups": {"patience": -1.0}}},
        {"manner": "hasty"},
        {"outline": {"discs": [[0, 0]]}},
        {"routes": [{"name": "a", "strategy": "longest"}]},
        {"population": {"people": 3, "radius": {"distribution": "gauss", "mean": 0.2}}},
    ):
        assert not accepts(schema, {**content, **wrong}, schema)


def of_plan(level=0.0, **key):
    number("level", level)
    return Geometry.from_polygon(box(0, 0, 900, 900), exits={"a": [(900, 400), (900, 500)]}, **key)


def of_population(density=1.0, **key):
    number("density", density, POSITIVE)
    return Population(**{"people": 10**4, **key})


WAY = {"name": "a", "lower": "b", "upper": "c", "foot": (0.0, 0.0), "direction": 0.0}  # a stair or ramp
# Table -> what it is made by, and the numbers of it that others bound too: these are refused by more than the schema.
TABLES = {
    "": (lambda **key: replace(make_scenario("room-v0"), **key), ()),
    "Arrivals": (partial(Arrivals, **{"rate": 1.0}), ("since", "until")),
    "Attraction": (partial(Attraction, **{"x": 1.0, "y": 1.0, "strength": 1.0}), ()),
    "Balance": (Balance, ("step", "base", "arms")),
    "Box": (None, ()),
    "Circle": (None, ()),
    "Comfort": (Comfort, ()),
    "ControlRule": (partial(ControlRule, **{"region": "a", "at_least": 10**9, "route": "b"}), ()),
    "DoorEvent": (lambda **key: DoorEvent("a", True, region="b" if "at_least" in key else None, **key), ()),
    "Gate": (partial(Gate, "a"), ()),
    "GroupCohesion": (GroupCohesion, ()),
    "Headway": (Headway, ()),
    "LogNormal": (partial(LogNormal, **{"median": 2.0, "sigma": 0.0, "high": 3.0}), ("median", "high", "low")),
    "Normal": (partial(Normal, **{"mean": 0.0, "sd": 0.0, "low": -1.0, "high": 1.0}), ("mean", "sd", "low", "high")),
    "OneWay": (None, ()),
    "Outline": (partial(Outline, ((0.0, 0.0, 1.0),)), ()),
    "Plan": (
        of_plan,
        ("jamb_radius",),
    ),
    "Population": (of_population, ("group_size",)),
    "Pulls": (None, ()),
    "Route": (partial(Route, "a", via="b"), ()),
    "Ramp": (partial(Ramp, **WAY, length=9.0), ()),
    "Section": (None, ()),
    "SpeedZone": (partial(SpeedZone, "a"), ()),
    "Stair": (partial(Stair, **WAY), ()),
    "Storey": (
        lambda level=0.0, **key: Level(**{"name": "a", "height": number("level", level), "walkable": ()} | key),
        (),
    ),
    "Uniform": (partial(Uniform, **{"low": 0.0, "high": 1.0}), ("low", "high")),
}
PROBES = (
    -2,
    -1.0,
    -0.5,
    0,
    0.0,
    1e-3,
    0.5,
    1,
    1.0,
    1.5,
    2,
    2.5,
    3,
    9.5,
    10.5,
    12,
    13.0,
    999.0,
    1001.0,
    86_401.0,
    1e6,
    1e9,
)


def taken(make):
    try:
        make()
    except ValueError:
        return False
    return True


@pytest.mark.more
@looped("name", TABLES)
def test_the_schema_bounds_each_number_as_the_code_does(name):
    schema = json_schema()
    make, together = TABLES[name]
    for key, one in tables(schema)[name]["properties"].items():
        forms = [one.get("type"), *(form.get("type") for form in one.get("anyOf", ()))]
        if one.get("deprecated") or not {"number", "integer"} & {*forms}:
            continue
        for probe in PROBES:
            given = [probe] + [[probe, probe]] * ("anyOf" in one)
            for value in given:
                said, done = accepts(one, value, schema), taken(partial(make, **{key: value}))
                assert done <= said and (key in together or done == said), (
                    f"{key} = {value}: schema {said}, code {done}"
                )


@looped(("where", "value"), [("Disc", [0.0, 0.0, 0.0]), ("Circle", {"circle": [1.0, 1.0, -1.0]})])
def test_the_schema_refuses_discs_of_no_size(where, value):
    schema = json_schema()
    assert not accepts(schema["definitions"][where], value, schema)
    whole = [1.0, 1.0, 1.0]
    assert accepts(schema["definitions"][where], whole if where == "Disc" else {"circle": whole}, schema)


def test_every_table_of_the_schema_is_compared():
    assert TABLES.keys() >= tables(json_schema()).keys()


def test_a_file_may_name_its_schema(tmp_path):
    content = {
        "$schema": "scenario.schema.json",
        "geometry": {"walkable": {"box": [0, 0, 5, 5]}, "exits": {"door": [[5, 2], [5, 3]]}},
        "population": {"people": 3},
    }
    (tmp_path / "a.json").write_text(json.dumps(content))
    assert make_scenario(tmp_path / "a.json").population.people == 3


def key_rows():
    text = (ROOT / "docs" / "scenarios.md").read_text(encoding="utf-8")
    _, _, rest = text.partition("| key | what it holds |\n|---|---|\n")
    rows = re.findall(r"^\| (.*?) \| (.*) \|$", rest.partition("\n\n")[0], re.MULTILINE)
    return [(re.findall(r"`([^`]+)`", keys), note) for keys, note in rows]


@pytest.mark.more
def test_the_table_of_keys_in_the_documents_is_complete():
    schema = json_schema()
    definitions = schema["definitions"]
    geometry = [f"geometry.{key}" for key in definitions["Plan"]["properties"]]
    levels = ["levels.name", "levels.height"]
    known = [key for key in schema["properties"] if key not in ("$schema", "geometry", "groups", "levels")]
    known += geometry + levels
    assert sorted(key for keys, _ in key_rows() for key in keys) == sorted(known)


@pytest.mark.more
@looped(
    ("key", "table"),
    [
        ("population", "Population"),
        ("routes", "Route"),
        ("zones", "SpeedZone"),
        ("rules", "ControlRule"),
        ("door_events", "DoorEvent"),
        ("one_way", "OneWay"),
        ("comfort", "Comfort"),
        ("stairs", "Stair"),
        ("ramps", "Ramp"),
    ],
)
def test_the_documents_name_every_key_of_a_table(key, table):
    (note,) = (note for keys, note in key_rows() if key in keys)
    named = set(re.findall(r"\w+", " ".join(re.findall(r"`([^`]+)`", note))))
    properties = {
        name for name, one in json_schema()["definitions"][table]["properties"].items() if "deprecated" not in one
    }
    assert properties <= named, f"{key}: the documents do not name {sorted(properties - named)}"


def test_people_wait_behind_doors_that_open_later(tmp_path):
    file = tmp_path / "gate.toml"
    file.write_text(
        'closed_doors = ["east"]\n[geometry]\nwalkable = { box = [0, 0, 10, 6] }\ndoors = { east = "east" }\n'
        "[geometry.exits]\neast = [[10, 2], [10, 3.2]]\n[population]\npeople = 3\n"
    )
    with pytest.raises(ValueError, match="all exits that the way may lead to are closed: east"):
        make_scenario(file)
    file.write_text('door_events = [{ door = "east", at = 4, opens = true }]\n' + file.read_text())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        (episode,) = run_episodes(make_scenario(file), 1)
    assert episode.metrics.mean_exit_time > 4.0 and episode.metrics.evacuation_time < 20.0
