"""Who walks if nobody says it: adults who keep a distance, but for the places of the papers."""

from dataclasses import make_dataclass, replace

import numpy as np
import pytest
from cases import looped
from shapely.geometry import box

from crowd_env import (
    FULL_SPEED,
    MANNERS,
    SCENARIOS,
    TABLE_4,
    CrowdEnv,
    Geometry,
    Physics,
    Population,
    Scenario,
    make_scenario,
)
from crowd_env.cli.place import CrowdOptions, read_place
from crowd_env.core.files.fingerprint import fingerprint
from crowd_env.envs.rollout import run_episodes

OF_SCENARIO = "crowd_env.scenarios.scenario"
HALL = Geometry.from_polygon(box(0, 0, 8, 8), exits={"door": [(8, 3.5), (8, 4.5)]})
TWO = Geometry.from_polygon(box(0, 0, 8, 8), exits={"east": [(8, 3), (8, 5)], "west": [(0, 3), (0, 5)]})


def test_adults_by_weidmann_or_table_4_when_asked():
    for fields, radius, mean, sd in (({}, (0.15, 0.19), 1.34, 0.23), (TABLE_4, (0.2, 0.25), 1.6, 0.8 / 12**0.5)):
        bodies = Population(4000, **fields).draw_bodies(np.random.default_rng(0))
        assert radius[0] <= bodies.radius.min() < bodies.radius.max() <= radius[1]
        assert bodies.desired_speed.mean() == pytest.approx(mean, abs=0.02)
        assert bodies.desired_speed.std() == pytest.approx(sd, rel=0.05)  # 0.26, cut at two of them
        assert 60 <= bodies.mass.min() < bodies.mass.max() <= 100


def test_own_places_keep_a_distance_and_shipped_ones_are_as_in_the_papers(tmp_path):
    (tmp_path / "hall.toml").write_text(
        "[geometry]\nwalkable = { box = [0, 0, 8, 8] }\n[geometry.exits]\ndoor = [[8, 3], [8, 5]]\n[population]\npeople = 5\n"
    )
    (tmp_path / "hall.wkt").write_text("POLYGON ((0 0, 8 0, 8 8, 0 8, 0 0))")
    own = [
        Scenario("own", HALL, Population(5), 60.0),
        make_scenario(tmp_path / "hall.toml"),
        make_scenario(tmp_path / "hall.wkt", exits=["8,3,8,5"], people=5),
    ]
    for place in own:
        env = CrowdEnv(place)
        assert (
            env.simulation.behaviors["manner"] == MANNERS["hurried"]
            and env.simulation.behaviors["max_drive"].force == 300.0
        )
        assert place.population.radius.high == 0.19
        assert env.simulation.world.boundary.apron.tolist() == [2.0]  # m, on which people go on being bodies
    assert make_scenario("building-v0").manner == "hurried"  # no paper has one
    for name in SCENARIOS.keys() - {"building-v0"}:
        place = make_scenario(name)
        walked = dict(FULL_SPEED) | ({"strategy": None} if name == "generated-v0" else {})  # it has several exits
        assert {word: getattr(place, word) for word in FULL_SPEED} == walked, name
    env = CrowdEnv("room-v0")
    assert (
        env.simulation.behaviors["manner"] is None
        and env.simulation.behaviors["max_drive"] is None
        and env.strategies == ["shortest"]
    )


def test_of_several_exits_people_take_the_fastest_unless_somebody_says_which():
    assert Scenario("two", TWO, Population(5), 60.0).strategy_of_run() == "fastest"
    assert Scenario("one", HALL, Population(5), 60.0).strategy_of_run() == "shortest"
    assert Scenario("near", TWO, Population(5), 60.0, target="nearest").strategy_of_run() == "shortest"
    wide = Geometry.from_polygon(box(0, 0, 250, 200), exits={"east": [(250, 3), (250, 5)], "west": [(0, 3), (0, 5)]})
    assert Scenario("wide", wide, Population(5), 60.0).strategy_of_run() == "shortest"
    west = Scenario("west", TWO, Population(5), 60.0, strategy="west")
    assert west.strategy_of_run() == "west" and west.strategy_of_run("nearest") == "nearest"
    assert CrowdEnv(west).strategies == ["west"]
    with pytest.raises(ValueError, match="unknown strategy 'north'; known: shortest"):
        Scenario("north", TWO, Population(5), 60.0, strategy="north")


def test_the_drive_is_that_of_the_place_unless_the_physics_says_another():
    place = Scenario("own", HALL, Population(5), 60.0)
    for scheme in ("dem", "nsm2", "hertz", "nsm1-inertial"):
        assert CrowdEnv(place, physics=scheme).simulation.behaviors["max_drive"].force == 300.0
    assert CrowdEnv(place, physics=Physics("dem", max_drive=np.inf)).simulation.behaviors["max_drive"] is None
    assert CrowdEnv(place, physics=Physics("dem", max_drive=150.0)).simulation.behaviors["max_drive"].force == 150.0
    assert CrowdEnv(place, physics="nsm1").simulation.behaviors["max_drive"] is None  # which drives nobody
    with pytest.raises(ValueError, match=r"one max_drive, not 300.0 in .*, inf in room-v0"):
        CrowdEnv([place, make_scenario("room-v0")], num_envs=2, walking="calm")


def test_a_file_says_where_people_vanish(tmp_path):
    place = '{"geometry": {"walkable": {"box": [0, 0, 8, 8]}, "exits": {"door": [[8, 3], [8, 5]]}}, "apron": %s}'
    found = []
    for apron in ("0", "0.5", "-1"):
        (tmp_path / "hall.json").write_text(place.replace('"apron"', '"population": {"people": 5}, "apron"') % apron)
        try:
            found.append(CrowdEnv(str(tmp_path / "hall.json")).simulation.world.boundary.apron.tolist())
        except ValueError as error:
            found.append(str(error))
    assert found[:2] == [[0.0], [0.5]] and "apron is -1" in found[2]


def test_the_fingerprint_of_a_place_in_which_people_vanish_is_that_of_before_there_were_aprons():
    """Folders of runs hold it."""
    place = make_scenario("room-v0")
    newer = ("apron", "sections", "gates")
    older = {name: getattr(place, name) for name in place.__dataclass_fields__ if name not in newer}
    assert fingerprint(place) == fingerprint(
        make_dataclass("Scenario", older, namespace={"__module__": OF_SCENARIO})(**older)
    )
    assert fingerprint(place) != fingerprint(replace(place, apron=2.0)) != fingerprint(replace(place, apron=1.0))


def test_competitive_people_on_a_plan_are_those_of_the_papers(tmp_path):
    (tmp_path / "hall.wkt").write_text("POLYGON ((0 0, 8 0, 8 8, 0 8, 0 0))")
    options = CrowdOptions(scenario=str(tmp_path / "hall.wkt"), exit=["8,3,8,5"], walking="competitive")
    place = read_place(options)
    assert place.population.radius.high == 0.25 and place.population.desired_speed.high == 2.0
    place = read_place(replace(options, set=["radius=0.3"]))
    assert place.population.radius.high == 0.3 and place.population.desired_speed.high == 2.0


@pytest.mark.more
@looped("width, behind", [(1.0, True), (3.0, True), (1.0, False), (3.0, False)])
def test_by_default_no_door_passes_more_people_than_were_ever_seen(width, behind):
    # With floor behind the door, and with the exit line in the wall.
    floor, exits = [box(0, 0, 12, 12)], {"out": [(12, 6 - width / 2), (12, 6 + width / 2)]}
    if behind:
        floor += [box(11.9, 6 - width / 2, 12.3, 6 + width / 2), box(12.2, 0, 15.2, 12)]
        exits = {"out": [(15.2, 0), (15.2, 12)]}
    hall = Geometry.from_polygon(floor, exits=exits, regions={"in": box(0, 0, 12, 12)})
    for run in run_episodes(Scenario("hall", hall, Population(200, start_region="in"), 200.0), 3):
        assert run.metrics.unfinished == 0
        assert 1.0 < run.metrics.flow / width < 2.8  # 1/(s m)
