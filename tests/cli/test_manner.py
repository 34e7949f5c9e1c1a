"""The manner at the command line."""

import json

import pytest
from clogging_samples import needs_powerlaw
from commands import call, figures

from crowd_env import MANNERS, CrowdEnv
from crowd_env.scenarios import make_scenario
from crowd_env.scenarios.titles import run_title, with_manner

PLACE = """
manner = { time_gap = 0.7 }
geometry = { walkable = { box = [0, 0, 6, 6] }, exits = { door = [[6, 2], [6, 4]] } }
population = { people = 5 }
"""


@pytest.fixture
def place(tmp_path):
    path = tmp_path / "place.toml"
    path.write_text(PLACE)
    return path


def test_run_walks_as_it_is_told_and_says_so():
    usual, calm = figures("run room-v0 --n 8 --runs 2"), figures("run room-v0 --n 8 --runs 2 --manner calm")
    assert (usual["manner"], calm["manner"]) == ("competitive", "calm")
    assert calm["evacuation_time"]["mean"] > usual["evacuation_time"]["mean"]
    told = call("run room-v0 --n 8 --runs 2 --manner calm")
    assert "room-v0: 8 people, nsm2, calm, 2 runs" in " ".join(told.output.split())


def test_a_file_says_the_manner_unless_the_command_does(place):
    own, named = figures(f"run {place} --runs 1"), figures(f"run {place} --runs 1 --manner competitive")
    assert own["manner"]["time_gap"] == 0.7 and named["manner"] == "competitive"
    assert own["evacuation_time"]["mean"] != named["evacuation_time"]["mean"]
    assert run_title(make_scenario(place), "dem") == "place, dem, time gap 0.7 s"
    assert run_title(with_manner(make_scenario(place), "hurried")) == "place, hurried"
    assert run_title(with_manner(make_scenario(place), "competitive"), "dem") == "place, dem"


@needs_powerlaw
def test_clogging_names_the_manner():
    result = call("clogging lin-room-v0 --n 10 --scheme nsm2 --runs 1 --manner hurried --json")
    (found,) = json.loads(result.stdout)["sets"]
    assert found["manner"] == "hurried" and found["name"].startswith("lin-room-v0, nsm2, hurried, 10 people")


def test_warmup_compiles_the_manner_that_is_asked_for(monkeypatch):
    seen = []

    class Watched(CrowdEnv):
        def __init__(self, *args, **options):
            super().__init__(*args, **options)
            seen.append(self.simulation.manner)

    monkeypatch.setattr("crowd_env.envs.crowd.CrowdEnv", Watched)
    assert call("warmup --scheme dem --scheme nsm2 --manner calm").exit_code == 0
    assert call("warmup --scheme dem").exit_code == 0
    assert seen == [MANNERS["calm"], MANNERS["calm"], None]


@pytest.mark.parametrize("command", ["run room-v0", "clogging lin-room-v0", "warmup --scheme dem"])
def test_an_unknown_manner_is_refused_in_one_line(command):
    result = call(f"{command} --manner slow")
    assert result.exit_code == 2
    assert result.stderr.splitlines() == [f"error: unknown manner 'slow'; known: {', '.join(MANNERS)}"]


def test_papers_are_reproduced_as_they_are():
    result = call("reproduce table3 --manner calm")
    assert result.exit_code == 2 and "--manner" in result.stderr
