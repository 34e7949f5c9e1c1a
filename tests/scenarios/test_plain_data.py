"""Plain data in Python: numbers, pairs, tables and lists stand for the objects, as they do in a scenario file."""

import json

import numpy as np
import pytest
from cases import looped

from crowd_env import FULL_SPEED, Cohorts, Geometry, LogNormal, Normal, Population, Scenario, Uniform, make_scenario
from crowd_env.geometry.geometry import box
from crowd_env.routing.fields.field import OneWay
from crowd_env.routing.spec import ControlRule, DoorEvent, Route
from crowd_env.routing.speed_map import Comfort, SpeedZone

FIELDS = ("radius", "mass", "desired_speed", "relaxation_time", "response_time")
NORMAL = {"distribution": "normal", "mean": 0.22, "sd": 0.01, "low": 0.2, "high": 0.25}
LOG_NORMAL = {"distribution": "lognormal", "median": 0.3, "sigma": 0.5, "high": 2}
SAME = [
    (0.2, Uniform(0.2, 0.2)),
    (1, Uniform(1.0, 1.0)),
    (np.float32(0.25), Uniform(0.25, 0.25)),
    ((0.2, 0.25), Uniform(0.2, 0.25)),
    ([0.2, 1], Uniform(0.2, 1.0)),
    ({"distribution": "uniform", "low": 0.2, "high": 0.25}, Uniform(0.2, 0.25)),
    (NORMAL, Normal(0.22, 0.01, 0.2, 0.25)),
    ({**LOG_NORMAL, "low": 0.1}, LogNormal(0.3, 0.5, 2.0, 0.1)),
]
HALL = Geometry.from_polygon(
    box(0, 0, 12, 6), exits={"west": [(0, 2), (0, 4)], "east": [(12, 2), (12, 4)]}, regions={"left": box(0, 0, 6, 6)}
)
WEST = {"people": 8, "radius": (0.2, 0.22), "start_region": "left", "route": "west", "name": "west"}
EAST = {"people": 5, "radius": NORMAL, "mass": 70, "response_time": LOG_NORMAL, "exits": ["east"]}


def people():
    return Cohorts(
        (
            Population(8, radius=Uniform(0.2, 0.22), start_region="left", route="west", name="west"),
            Population(
                5,
                radius=Normal(0.22, 0.01, 0.2, 0.25),
                mass=Uniform(70.0, 70.0),
                response_time=LogNormal(0.3, 0.5, 2.0),
                exits=("east",),
            ),
        )
    )


def drawn(crowd, seed=5):
    bodies, position = crowd.draw(np.random.default_rng(seed), HALL)
    return [*bodies, position]


def assert_same_draws(one, other):
    for mine, theirs in zip(drawn(one), drawn(other), strict=True):
        np.testing.assert_array_equal(mine, theirs)


@looped("name", FIELDS)
@looped(("plain", "law"), SAME, ids=str)
def test_a_distribution_of_plain_data_is_the_object_and_draws_alike(name, plain, law):
    one, other = Population(5, **{name: plain}), Population(5, **{name: law})
    assert getattr(one, name) == law
    assert_same_draws(one, other)
    assert getattr(Population(5).changed(**{name: plain}), name) == law


@looped("form", [list, tuple, json.dumps])
def test_cohorts_of_tables_are_cohorts_of_objects(form):
    parts = [WEST, EAST] if form is json.dumps else form([WEST, EAST])
    plain = json.loads(form(parts)) if form is json.dumps else parts
    for crowd in (
        Cohorts(plain),
        Scenario("hall", HALL, plain, 60.0, **FULL_SPEED).population,
        Cohorts([WEST, people().parts[1]]),
    ):
        assert [(part.route, part.exits, part.name) for part in crowd.parts] == [
            ("west", (), "west"),
            (None, ("east",), ""),
        ]
        assert_same_draws(crowd, people())


def test_a_file_and_python_take_the_same_tables(tmp_path):
    plan = {"walkable": {"box": [0, 0, 12, 6]}, "exits": {"west": [[0, 2], [0, 4]], "east": [[12, 2], [12, 4]]}}
    content = {"geometry": {**plan, "regions": {"left": {"box": [0, 0, 6, 6]}}}, "cohorts": [WEST, EAST]}
    path = tmp_path / "hall.json"
    path.write_text(json.dumps(content))
    assert_same_draws(make_scenario(path).population, Cohorts([WEST, EAST]))


def test_starts_say_how_many_people_there_are():
    table = {"starts": [[1, 1], [2, 1], [3, 1]], "radius": 0.2}
    for scenario in (
        Scenario("hall", HALL, table, 60.0, **FULL_SPEED),
        Scenario("hall", HALL, [table], 60.0, **FULL_SPEED),
    ):
        (part,) = scenario.population.parts
        assert part.people == 3 and part.starts.tolist() == table["starts"]


def test_routes_and_rules_of_a_scenario_may_be_tables():
    geometry = Geometry.from_polygon(
        box(0, 0, 12, 6),
        exits={"west": [(0, 2), (0, 4)], "east": [(12, 2), (12, 4)]},
        regions={"left": box(0, 0, 6, 6)},
        doors={"gate": [(6, 0), (6, 6)]},
    )
    plain = Scenario(
        "hall",
        geometry,
        {"people": 3},
        60.0,
        routes=[{"name": "loop", "exits": ["east"], "via": "left"}],
        zones=[{"region": "left", "factor": 0.5}],
        rules=[{"region": "left", "at_least": 4, "route": "loop"}],
        door_events=[{"door": "gate", "opens": False, "at": 3}],
        one_way=[{"door": "gate", "to": "left"}],
        comfort={"stairs": 2},
        **FULL_SPEED,
    )
    assert plain.routes == (Route("loop", ("east",), "left"),)
    assert plain.zones == (SpeedZone("left", factor=0.5),)
    assert plain.rules == (ControlRule("left", 4, "loop"),)
    assert plain.door_events == (DoorEvent("gate", False, at=3.0),)
    assert plain.one_way == (OneWay("gate", "left"),) and plain.comfort == Comfort(stairs=2.0)


@looped(
    ("options", "message"),
    [
        (
            {"radius": "0.2"},
            "radius is '0.2'; it must be a number, a pair (low, high), a distribution such as Uniform(",
        ),
        ({"radius": [0.2]}, "radius is [0.2]; it must be a number, a pair"),
        ({"radius": (0.25, 0.2)}, "radius: uniform distribution from 0.25 to 0.2: the first"),
        ({"mass": ["60", 80]}, "mass[0] is '60'; it must be a number"),
        ({"mass": {**NORMAL, "mean": "x"}}, "mass: normal distribution: mean is 'x'; it must be a number"),
        ({"mass": {**NORMAL, "maen": 1}}, "mass: unknown key 'maen'; known: mean"),
        ({"mass": {"distribution": "gauss"}}, "mass: unknown distribution 'gauss'; known: uniform, normal, lognormal"),
        ({"mass": {"mean": 3}}, "mass: unknown distribution None; known: uniform"),
        ({"mass": {**NORMAL, "sd": -1}}, "mass: normal distribution: sd is -1"),
    ],
)
def test_a_mistake_in_a_table_of_people_is_one_sentence(options, message):
    with pytest.raises(ValueError) as error:
        Population(3, **options)
    assert str(error.value).startswith(f"population: {message}") and "\n" not in str(error.value)


@looped(
    ("make", "message"),
    [
        (lambda: Cohorts([WEST, {"raduis": 1}]), "cohorts[1]: unknown key 'raduis'; known: people, radius"),
        (lambda: Cohorts([WEST, {"radius": 0.2}]), "cohorts[1]: key 'people' is missing"),
        (
            lambda: Scenario("hall", HALL, [WEST, WEST], 60.0, **FULL_SPEED),
            "population: two cohorts have the name 'west'",
        ),
        (
            lambda: Scenario("hall", HALL, {**WEST, "route": "wets"}, 60.0, **FULL_SPEED),
            "unknown route 'wets'; known: west, east",
        ),
        (
            lambda: Scenario("hall", HALL, WEST, 60.0, routes=[{"nmae": "a"}], **FULL_SPEED),
            "scenario 'hall': routes[0]: unknown key 'nmae'; known: name, exits, via, strategy",
        ),
    ],
)
def test_a_mistake_in_plain_data_is_one_sentence(make, message):
    with pytest.raises(ValueError) as error:
        make()
    assert str(error.value).startswith(message) and "\n" not in str(error.value)
