"""Every command takes the same places: names, scenario files, and floor plans with --exit and --unit."""

import json

import pytest
from cases import looped
from commands import call
from plan_files import EAST, ROOM, room_drawing
from typer.testing import CliRunner

from crowd_env.agents.training_config import TrainingConfig, place_of, resumed, task_of
from crowd_env.cli.agents.evaluate import app as evaluate
from crowd_env.cli.agents.learn import _begun

pytestmark = pytest.mark.more

CM = "800,200,800,320"


@pytest.fixture
def plan(tmp_path):
    """A room in centimeters, in text: the file says neither exit nor unit nor people."""
    path = tmp_path / "room.wkt"
    path.write_text("POLYGON ((0 0, 800 0, 800 600, 0 600, 0 0))")
    return path


def test_a_plan_and_its_options_are_understood(plan):
    result = call(f"run {plan} --scheme dem --runs 1 --json --exit {CM} --unit cm --people 6")
    assert result.exit_code == 0 and result.stderr == "", result.output
    assert json.loads(result.stdout)["people"] == 6


def test_a_plan_is_drawn(plan, tmp_path):
    result = call(f"plan {plan} --exit {CM} --unit cm --out {tmp_path / 'plan.png'}")
    assert result.exit_code == 0 and (tmp_path / "plan.png").stat().st_size > 1000, result.output


def test_policies_are_compared_on_a_plan(plan):
    line = f"--scenario {plan} --exit {CM} --unit cm --people 5 --policies shortest --scheme dem --runs 1 --json"
    result = CliRunner().invoke(evaluate, line.split())
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["people"] == 5


def test_policies_are_trained_on_a_plan(plan):
    given = {"place": str(plan), "exit": [CM], "unit": "cm", "people": 9, "scheme": "dem"}
    config = _begun(given, seed=0)
    assert config.options == {"exits": [CM], "unit": "cm"} and config.people == 9
    place = place_of(TrainingConfig(**json.loads(json.dumps(config.as_table()))))
    assert place.population.people == 9 and place.geometry.area == pytest.approx(48.0)
    assert task_of(config).place(7).population.people == 7
    assert resumed(config, {"exit": [CM], "unit": "cm"}, [], "run") == config
    with pytest.raises(ValueError, match=r"--unit is mm, but run was begun with cm"):
        resumed(config, {"unit": "mm"}, [], "run")


@looped(
    ("given", "words"),
    [
        ({"exit": ["1,2,3,4"]}, "--exit is for floor plans"),
        ({"place": "room-v0", "unit": "cm"}, "--unit is for floor plans"),
        ({"place": "room-v0", "people": 5}, "a scenario says how many"),
    ],
)
def test_options_of_plans_belong_to_plans(given, words):
    with pytest.raises(ValueError, match=words):
        _begun(given, seed=0)


@looped("option", ["--exit 1,2,3,4", "--unit cm"])
def test_a_task_says_where_people_walk(option):
    result = CliRunner().invoke(evaluate, f"--task room {option}".split())
    assert result.exit_code == 2 and "--task room says where people walk" in result.stderr


def test_notes_stand_before_the_table_once(tmp_path):
    room_drawing(tmp_path / "room.dxf", 4)
    (tmp_path / "two.wkt").write_text(f"GEOMETRYCOLLECTION ({ROOM.wkt}, POLYGON ((10 0, 12 0, 12 2, 10 2, 10 0)))")
    for name, note in (("room.dxf", "the file says that it is in mm"), (f"two.wkt --exit {EAST}", "left out")):
        result = call(f"run {tmp_path}/{name} --scheme dem --people 3 --runs 1")
        assert result.exit_code == 0
        (line,) = [one for one in result.stderr.splitlines() if one]
        assert line.startswith("note: ") and note in line
