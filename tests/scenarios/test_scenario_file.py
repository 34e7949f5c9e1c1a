"""Scenario files and crowds of several kinds: what a file may hold, and one sentence for every mistake in it."""

import json
import re

import numpy as np
import pytest

from crowd_env import CrowdEnv, LogNormal, Normal, Population, Uniform, make_scenario
from crowd_env.routing.fields.field import OneWay
from crowd_env.routing.spec import ControlRule, DoorEvent, Route
from crowd_env.routing.speed_map import Comfort, SpeedZone
from crowd_env.scenarios.file.expressions import evaluate, fill_in
from crowd_env.scenarios.file.reading import tomllib

FULL = """
name = "everything"
title = "hall of {length} m"
reference = "a test"
time_limit = 90
blocked_after = inf
target = "path"
closed_doors = ["gate"]

[options]
length = { default = 12.0, low = 10.0, high = 20.0, about = "m" }
actors = 6

[geometry]
walkable = [{ box = [0, 0, "{length}", 8] }, "POLYGON ((0 8, 2 8, 2 9, 0 9, 0 8))"]
obstacles = [{ circle = [6, 4, 0.5] }, [[4, 0], [4.5, 0], [4.5, 0.5]], { box = [8, 1, 8.4, 1.4], rows = 2, step = [0, 1] }]
thin_walls = [[[2, 0], [2, 3]], { line = [[9, 6], [9, 7]], columns = 2, step = [1, 0] }]

[geometry.exits]
east = [["{length}", 3], ["{length}", 5]]
west = "LINESTRING (0 3, 0 5)"

[geometry.regions]
stage = { box = [7, 5, "{length}", 8] }
corner = [[0, 0], [1.9, 0], [1.9, 2], [0, 2]]
spots = { box = [3, 6, 4, 7], columns = 2, step = [1.5, 0] }

[geometry.doors]
gate = [[2, 3], [2, 5]]

[population]
radius = [0.2, 0.22]
mass = 80

[[groups]]
name = "actors"
people = "{actors}"
start_region = "stage"
route = "behind"
desired_speed = { distribution = "normal", mean = 1.3, sd = 0.2, low = 0.8, high = 1.8 }

[[groups]]
name = "guests"
starts = [[0.5, 0.5], { first = [0.5, 1.1], columns = 2, step = [0.7, 0] }]
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


def test_a_file_runs_and_its_options_reach_it(write):
    name = write(FULL)
    env = CrowdEnv(make_scenario(name, length=11.0, actors=10))
    assert env.num_people == 13 and env.scenarios[0].geometry.bounds[2] == 11.0
    env.reset(0)
    while not env.finished.all():
        env.step(None)
    assert env.metrics(0).unfinished == 0
    assert [part.people for part in make_scenario(name, people=9).population.parts] == [6, 3]
    changed = make_scenario(name, time_limit=5.0, blocked_after=2.0, target="centre", population=Population(4))
    assert (changed.time_limit, changed.blocked_after, changed.target) == (5.0, 2.0, "centre")
    assert changed.population.people == 4


def test_starts_of_a_file_beside_it(write):
    write("x,y\n1,1\n2,2\n", "seats.csv")
    place = make_scenario(write(small(people='starts = "seats.csv"')))
    assert place.name == "my" and place.population.starts.tolist() == [[1, 1], [2, 2]]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("{width}", 2.0),
        ("{(width - 1) / 4 * 2 + -width}", -1.5),
        ("{7 // actors}", 2),
        ("to {width / 4} m", "to 0.5 m"),
        ("plain", "plain"),
    ],
)
def test_braces_hold_arithmetic(text, value):
    assert fill_in(text, {"width": 2.0, "actors": 3}) == value


@pytest.mark.parametrize("expression", [
    "__import__('os')", "width ** 9", "width.real", "[1]", "'a'", "True", "1 if width else 2", "width < 3", "", "1 +", "aaa",
])  # fmt: skip
def test_braces_hold_nothing_else(expression):
    with pytest.raises(ValueError, match=r"is not an expression|unknown option 'aaa'"):
        evaluate(expression, {"width": 2.0})


# -------------------------------------------------------------------------------------------------------------- mistakes


# Part of the room -> what stands there, and what is said of it.
MISTAKES = {
    "top": [
        ('titel = "x"', r"my\.toml: unknown key 'titel'; did you mean 'title'\?"),
        ("time_limit = -1", r"my\.toml: scenario 'my': time_limit is -1"),
        ('target = "paht"', r"my\.toml: target: is 'paht'; allowed: path, nearest, centre, width"),
        ('closed_doors = ["gate"]', r"my\.toml: unknown door 'gate'"),
        ('title = "{1 / 0}"', r"title: \{1 / 0\} has no value"),
        ('title = "{1"', r"title: '\{1' has a brace without its partner"),
    ],
    "geometry": [
        ("wals = []", r"my\.toml: unknown key 'wals' in geometry; did you mean 'walkable'\?|known: "),
        ("obstacles = [{ circle = [3, 3, -1] }]", r"geometry\.obstacles\[0\]\.circle: has the radius -1 m"),
        ('obstacles = ["POLYGON ((0 0, 1 1"]', r"geometry: obstacle 0 is not well-known text"),
        ("obstacles = [{ box = [5.5, 1, 5.9, 4] }]", r"my\.toml: the way to exit 'door' is blocked"),
        ("thin_walls = [[[3, 0], [3, 5]]]", r"my\.toml: no exit can be reached from"),
    ],
    "regions": [
        ("door = { box = [0, 0, 1, 1] }", r"geometry: region 'door' has the name of an exit"),
        ("far = { box = [9, 9, 10, 10] }", r"geometry: region 'far' around .* outside of the walkable"),
        ("far = { bxo = [9, 9, 10, 10] }", r"unknown key 'bxo' in geometry\.regions\.far; did you mean 'box'"),
        ("far = { rows = 2, step = [1, 0] }", r"geometry\.regions\.far: needs either a 'box'"),
        ("far = { box = [1, 1, 0, 2] }", r"geometry\.regions\.far\.box: is \[1, 1, 0, 2\]; it must be"),
        ("far = { box = [1, 1, 2, 2], rows = 2 }", r"also needs the 'step'"),
    ],
    "people": [
        ("", r"my\.toml: population: needs 'people', or 'starts'"),
        ("people = 5.5", r"population\.people: is 5\.5; it must be a whole number"),
        ("people = true", r"population\.people: is true or false \(True\); it must be a number"),
        ('people = "five"', r"population\.people: is a text \('five'\); it must be a number"),
        ("people = 0", r"^my\.toml: population: people is 0; it must be at least 1$"),
        ("people = 900", r"my\.toml: 900 people do not fit"),
        ("starts = [[1, 1], [1.2, 1]]", r"my\.toml: starts 0 and 1 overlap by 0\.300 m"),
        ("starts = [[1, 1], [7, 1]]", r"my\.toml: start 1 at \(7, 1\) is outside"),
        ("starts = [[1, 1, 1]]", r"population\.starts\[0\]: has 3 values; it must have 2"),
        ('starts = "none.csv"', r"population\.starts: cannot read the starting positions .*none\.csv"),
        ("people = 3\nstarts = [[1, 1]]", r"population: starts must have the shape \(3, 2\), not \(1, 2\)"),
    ],
    "more": [
        ("raduis = 0.2", r"unknown key 'raduis' in population; did you mean 'radius'\?"),
        ("xyz = 0.2", r"unknown key 'xyz' in population; known: people, radius, mass"),
        ("radius = [0.3, 0.2]", r"population\.radius: uniform distribution from 0\.3 to 0\.2"),
        ("radius = [0.3]", r"population\.radius: has 1 values; it must have 2"),
        ("radius = nan", r"population\.radius: is nan; it must be finite"),
        ("radius = -1", r"^my\.toml: population: radius must be > 0"),
        (
            'mass = { distribution = "gauss", mean = 3 }',
            r"population\.mass\.distribution: is 'gauss'; allowed: uniform, normal, lognormal",
        ),
        ('mass = { distribution = "normal", mean = 3 }', r"key 'sd' is missing in population\.mass"),
        (
            'mass = { distribution = "normal", mena = 3 }',
            r"unknown key 'mena' in population\.mass; did you mean 'mean'\?",
        ),
        ('start_region = "bakc"', r"my\.toml: unknown start region 'bakc'; known: back"),
        ('route = "left"', r"my\.toml: unknown route 'left'; known: door"),
        ('exits = ["door", "gate"]', r"my\.toml: unknown exit 'gate'; known: door"),
        ('exits = ["door"]\nroute = "door"', r"takes? the route 'door' or the best of some exits"),
    ],
    "end": [
        ("[[groups]]\npeople = 3", r"population: 'people' is a matter of each group; write it there"),
        ("[[rules]]\nregion = 'attic'\nat_least = 3\nroute = 'door'", r"unknown region 'attic'; known: back"),
        ("[[rules]]\nregion = 'back'\nat_least = 3\nroute = 'up'", r"unknown route 'up'; known: out, door"),
        ("[[rules]]\nregion = 'back'\nat_least = 0\nroute = 'door'", r"rules\[0\]: control rule on 'back': at_least"),
        ("[[rules]]\nregion = 'back'\nroute = 'door'", r"key 'at_least' is missing in rules\[0\]"),
        ("[[rules]]\nregion = 'back'\nat_least = 3\nroute = 'door'\nbelo = 2", r"did you mean 'below'"),
        ("[[routes]]\nname = 'a'\nstrategy = 'fast'", r"routes\[0\]\.strategy: is 'fast'; allowed: shortest, fastest"),
        ("[[routes]]\nname = 'a'\nexits = ['b']", r"route 'a' names an unknown exit 'b'; known: door"),
        ("[[routes]]\nname = 'out'", r"route 'out': the name is taken"),
        ("[[zones]]\nregion = 'attic'\nfactor = 0.5", r"speed zone names an unknown region 'attic'"),
        ("[[zones]]\nregion = 'back'\nfactor = 0", r"zones\[0\]: speed zone 'back': factor is 0"),
        ("[comfort]\nstars = 1", r"unknown key 'stars' in comfort; did you mean 'stairs'"),
        ("[options]\npeople = 1", r"options\.people: the name cannot be taken"),
        ('[options]\nwidth = "1"', r"options\.width: is a text \('1'\); it must be a number"),
        ("[options]\nwidth = { default = 1, low = 2 }", r"options\.width: default 1 is outside of 2 to inf"),
    ],
}
OTHERS = [
    ("name = ]", r"my\.toml: Invalid value \(at line 1, column 8\)"),
    ("time_limit = 3", r"my\.toml: key 'geometry' is missing"),
    (
        small(people="radius = 0.2", end="[[groups]]\npeople = 3\n[[groups]]\npeople = 3\nraduis = 1"),
        r"unknown key 'raduis' in groups\[1\]; did you mean 'radius'\?",
    ),
    (
        small(people="radius = 0.2", end="[[groups]]\npeople = 3\n[[groups]]\npeople = 3\nradius = '1'"),
        r"groups\[1\]\.radius: is a text \('1'\); it must be a number",
    ),
    (
        small(people="mass = 70", end="[[groups]]\npeople = 3\nname = 'a'\n[[groups]]\npeople = 3\nname = 'a'"),
        r"my\.toml: groups: two groups have the name 'a'",
    ),
    (
        small(top='title = "{widht} m"', end="[options]\nwidth = 1"),
        r"title: unknown option 'widht' in braces; known: width",
    ),
]


@pytest.mark.parametrize(
    ("text", "message"),
    [(small(**{part: text}), message) for part, rows in MISTAKES.items() for text, message in rows] + OTHERS,
)
def test_a_mistake_is_named_by_its_place(write, text, message):
    with pytest.raises(ValueError) as error:
        make_scenario(write(text))
    assert str(error.value).startswith("my.toml: "), error.value
    assert re.search(message, str(error.value)), error.value
    assert "\n" not in str(error.value)


def test_json_says_line_and_column_and_refuses_doubles(write):
    with pytest.raises(ValueError, match=r"my\.json: Expecting value: line 2 column 9"):
        make_scenario(write('{\n "name":}', "my.json"))
    with pytest.raises(ValueError, match=r"my\.json: key 'name' occurs twice"):
        make_scenario(write('{"name": "a", "name": "b"}', "my.json"))
    with pytest.raises(ValueError, match=r"my\.json: is a list; it must be a table"):
        make_scenario(write("[1]", "my.json"))
    with pytest.raises(ValueError, match=r"cannot read the scenario none\.toml"):
        make_scenario("none.toml")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"lenght": 12.0}, "my has no option 'lenght'; did you mean 'length'"),
        ({"length": 50.0}, "my: length is 50; it must be 10 to 20"),
        ({"length": "12"}, r"my: length: is a text \('12'\); it must be a number"),
        ({"actors": 2.5}, r"my: actors: is 2\.5; it must be a whole number"),
        ({"people": 1}, r"my\.toml: 1 person for 2 groups; each needs at least 1"),
        ({"time_limit": 0.0}, "time_limit is 0.0"),
    ],
)
def test_options_are_checked(write, options, message):
    with pytest.raises(ValueError, match=message):
        make_scenario(write(FULL), **options)


# ----------------------------------------------------------------------------------------------------------- log-normal


def test_log_normal_has_its_median_and_spread_and_stays_in_bounds():
    values = LogNormal(10.0, 0.5, 1e6).sample(np.random.default_rng(0), 20_000)
    assert np.median(values) == pytest.approx(10.0, rel=0.02)
    assert np.log(values).std() == pytest.approx(0.5, rel=0.02)
    cut = LogNormal(10.0, 0.8, 20.0, low=5.0).sample(np.random.default_rng(0), 5000)
    assert 5.0 <= cut.min() < 5.05 and 19.9 < cut.max() <= 20.0
    assert (LogNormal(3.0, 0.0, 5.0).sample(np.random.default_rng(0), 3) == 3.0).all()
