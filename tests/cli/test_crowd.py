"""Who walks and how at the command line: ``--walking``, ``--scheme``, ``--routing`` and ``--set``."""

import pytest
from cases import looped
from commands import call, figures

from crowd_env import MANNERS, OUTLINES, CrowdEnv, LogNormal, Normal, Outline, Routing
from crowd_env.cli.place import CrowdOptions, setting_of
from crowd_env.scenarios import make_scenario
from crowd_env.scenarios.titles import run_title, with_manner

PLACE = """
manner = {{ time_gap = 0.7 }}
outline = {outline}
geometry = {{ walkable = {{ box = [0, 0, 6, 6] }}, exits = {{ door = [[6, 2], [6, 4]] }} }}
population = {{ people = 5 }}
"""
TWO = "{ discs = [[0, 0.1, 0.1], [0, -0.1, 0.1]], turning_time = 0.3 }"
LAW = """
from dataclasses import dataclass
from crowd_env.physics import Hertz

class MyLaw(Hertz):
    pass

gentle = Hertz(damping=0.5) if "damping" in Hertz.__dataclass_fields__ else Hertz()
"""


@pytest.fixture
def place(tmp_path):
    def write(outline='"disc"'):
        path = tmp_path / "place.toml"
        path.write_text(PLACE.format(outline=outline))
        return path

    return write


def test_run_walks_as_it_is_told_and_says_so():
    usual, calm = figures("run room-v0 --people 8 --runs 2"), figures("run room-v0 --people 8 --runs 2 --walking calm")
    assert (usual["manner"], calm["manner"]) == ("competitive", "calm")
    assert calm["evacuation_time"]["mean"] > usual["evacuation_time"]["mean"]
    told = call("run room-v0 --people 8 --runs 2 --walking calm --scheme hertz --set outline=torso")
    assert "room-v0: 8 people, hertz, calm, torso, 2 runs" in " ".join(told.output.split())


def test_walking_may_be_a_table_of_parameters():
    found = figures('run room-v0 --people 4 --runs 1 --walking {"time_gap":0.7}')
    assert found["manner"]["time_gap"] == 0.7


def test_a_file_says_how_people_walk_unless_the_command_does(place):
    path = place(TWO)
    line = f"run {path} --runs 1 --scheme hertz"
    own, named = figures(line), figures(f"{line} --walking competitive --set outline=disc")
    assert own["manner"]["time_gap"] == 0.7 and own["outline"]["turning_time"] == 0.3
    assert (named["manner"], named["outline"]) == ("competitive", "disc")
    assert make_scenario(path).outline == Outline(((0, 0.1, 0.1), (0, -0.1, 0.1)), turning_time=0.3)
    assert run_title(make_scenario(path), "hertz") == "place, hertz, time gap 0.7 s, 2 discs a body"
    assert run_title(with_manner(make_scenario(path), "hurried", "disc"), "dem") == "place, dem, hurried"
    assert make_scenario(place('"torso"')).behavior(Outline) == OUTLINES["torso"]


def test_what_is_set_reaches_the_people_the_physics_and_the_routing():
    changes = ["speed=0.5", "radius=0.2,0.22", "dt=0.005", "max_drive=300", "max_iterations=40", "signs=no"]
    place, physics, routing, _ = setting_of(CrowdOptions(scenario="floor-v0", set=changes, routing="nearest"))
    assert setting_of(CrowdOptions(set=["balance=stepping"])).place.balance == "stepping"
    people = place.population
    assert (people.desired_speed.low, people.desired_speed.high) == (0.5, 0.5)
    assert (people.radius.low, people.radius.high) == (0.2, 0.22)
    late = setting_of(CrowdOptions(set=["response_time=lognormal,5,0.5,60", "mass=normal,70,5,60,80"])).place.population
    assert (late.response_time, late.mass) == (LogNormal(5.0, 0.5, 60.0), Normal(70.0, 5.0, 60.0, 80.0))
    assert physics.law.max_iterations == 40 and physics.law.info.name == "nsm2"
    assert (physics.dt, physics.max_drive) == (0.005, 300) and routing == Routing("nearest", signs=False)


def test_a_law_of_ones_own_is_named_by_its_file(tmp_path):
    (tmp_path / "my_law_of_a_test.py").write_text(LAW)
    for name in ("MyLaw", "gentle"):
        law = setting_of(CrowdOptions(scheme=f"{tmp_path}/my_law_of_a_test.py:{name}", set=["social=lin"])).physics.law
        assert law.info.name.startswith("hertz") and law.social is not None
    for wrong, words in (("none.py:MyLaw", "there is no file"), ("my_law_of_a_test.py:Glue", "has no Glue")):
        with pytest.raises(ValueError, match=words):
            setting_of(CrowdOptions(scheme=f"{tmp_path}/{wrong}"))


@pytest.mark.more
def test_warmup_compiles_the_crowd_that_is_asked_for(monkeypatch):
    seen = []

    class Watched(CrowdEnv):
        def __init__(self, *args, **options):
            super().__init__(*args, **options)
            seen.append(self.simulation.behaviors["manner"])

    monkeypatch.setattr("crowd_env.envs.crowd.CrowdEnv", Watched)
    assert call("warmup --scheme dem --scheme nsm2 --walking calm").exit_code == 0
    assert seen == [MANNERS["calm"], MANNERS["calm"]]


@looped(
    ("options", "says"),
    [
        ('--walking {"time_gap":', "this must be a name or a table"),
        ("--walking slow", f"unknown manner 'slow'; known: {', '.join(MANNERS)}"),
        ("--set outline=square", f"unknown outline 'square'; known: {', '.join(OUTLINES)}"),
        ("--scheme dem --set outline=torso", "dem does not turn bodies, so it cannot have the outline 'torso'"),
        ("--set spede=2", "--set spede: nothing has this name; the crowd has outline, balance, speed, "),
        ("--set speed", "--set speed: this must be NAME=VALUE, such as speed=1.5"),
        ("--set speed=1 --set speed=2", "--set speed=2: speed is set twice"),
        ("--scheme nsm2 --set tolerance=much", "tolerance is 'much'"),
        ("--set signs=maybe", "--set signs is 'maybe'"),
    ],
)
def test_what_is_unknown_is_answered_by_whom_it_concerns(options, says):
    result = call(f"run room-v0 {options}")
    assert result.exit_code == 2
    (line,) = result.stderr.splitlines()
    assert says in line


@looped(
    ("misspelt", "meant"),
    [("--peple", "--people"), ("--walkin", "--walking"), ("--schme", "--scheme"), ("--seeds", "--seed")],
)
def test_a_misspelt_option_is_answered_with_the_nearest_one(misspelt, meant):
    result = call(f"run room-v0 {misspelt} 1")
    assert result.exit_code == 2
    told = " ".join(result.stderr.replace("│", " ").split())
    assert f"No such option: {misspelt}" in told and meant in told.partition("Possible options")[2], told


def test_a_misspelt_command_is_answered_with_the_nearest_one():
    told = call("repot room").stderr
    assert "No such command 'repot'" in told and "report" in told


def test_papers_are_reproduced_as_they_are():
    result = call("reproduce table3 --walking calm")
    assert result.exit_code == 2 and "--walking" in result.stderr
