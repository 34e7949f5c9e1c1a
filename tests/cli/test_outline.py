"""The outline at the command line and in scenario files."""

import json

import pytest
from clogging_samples import needs_powerlaw
from commands import call, figures

from crowd_env import OUTLINES, Outline
from crowd_env.scenarios import make_scenario
from crowd_env.scenarios.titles import run_title, with_manner

PLACE = """
outline = {outline}
geometry = {{ walkable = {{ box = [0, 0, 6, 6] }}, exits = {{ door = [[6, 2], [6, 4]] }} }}
population = {{ people = 5 }}
"""
TWO = "{ discs = [[0, 0.1, 0.1], [0, -0.1, 0.1]], turning_time = 0.3 }"


@pytest.fixture
def place(tmp_path):
    def write(outline):
        path = tmp_path / "place.toml"
        path.write_text(PLACE.format(outline=outline))
        return path

    return write


def test_run_has_the_outline_it_is_told_and_says_so():
    options = "run room-v0 --n 8 --runs 2 --scheme hertz"
    usual, torso = figures(options), figures(f"{options} --outline torso")
    assert (usual["outline"], torso["outline"]) == ("disc", "torso")
    assert torso["evacuation_time"]["mean"] != usual["evacuation_time"]["mean"]
    told = call(f"{options} --outline torso --manner calm")
    assert "room-v0: 8 people, hertz, calm, torso, 2 runs" in " ".join(told.output.split())


def test_a_file_says_the_outline_unless_the_command_does(place):
    path = place(TWO)
    own, named = (figures(f"run {path} --runs 1 --scheme hertz {more}") for more in ("", "--outline disc"))
    assert own["outline"]["turning_time"] == 0.3 and named["outline"] == "disc"
    assert make_scenario(path).outline == Outline(((0, 0.1, 0.1), (0, -0.1, 0.1)), turning_time=0.3)
    assert run_title(make_scenario(path), "hertz") == "place, hertz, 2 discs a body"
    assert run_title(with_manner(make_scenario(path), None, "disc"), "hertz") == "place, hertz"
    assert make_scenario(place('"torso"')).outline_of_run() == OUTLINES["torso"]


@pytest.mark.parametrize(
    ("outline", "says"),
    [
        ('"square"', "unknown name 'square'; known: disc, torso"),
        ("3", "the name of an outline (disc, torso) or a table of the parameters of one"),
        ("{ discs = [[0, 0]] }", "outline.discs"),
        ("{ discs = [[0, 0, -1]] }", "must be > 0"),
        ("{ turning_time = 0.3 }", "discs"),
    ],
)
def test_a_wrong_outline_in_a_file_is_refused_in_one_line(place, outline, says):
    result = call(f"run {place(outline)} --scheme hertz")
    assert result.exit_code == 2
    (line,) = result.stderr.splitlines()
    assert says in line


@needs_powerlaw
def test_clogging_names_the_outline():
    result = call("clogging lin-room-v0 --n 10 --runs 1 --outline torso --json")
    (found,) = json.loads(result.stdout)["sets"]
    assert found["outline"] == "torso" and found["name"].startswith("lin-room-v0, hertz, torso, 10 people")


@pytest.mark.parametrize("command", ["run room-v0", "clogging lin-room-v0"])
def test_an_outline_that_cannot_be_is_refused_in_one_line(command):
    result = call(f"{command} --outline square")
    assert result.exit_code == 2
    assert result.stderr.splitlines() == [f"error: unknown outline 'square'; known: {', '.join(OUTLINES)}"]
    result = call(f"{command} --scheme dem --outline torso")
    assert result.exit_code == 2
    (line,) = result.stderr.splitlines()
    assert line.startswith(
        "error: dem does not turn bodies, so it cannot have the outline 'torso'; schemes that can: hertz"
    )
