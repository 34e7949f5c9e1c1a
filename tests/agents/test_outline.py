"""The outline in evaluations: part of what was run."""

import json

import pytest
from evaluations import call, hall

from crowd_env import OUTLINES, Physics
from crowd_env.agents.controllers import RandomController
from crowd_env.agents.evaluation.evaluation import evaluate
from crowd_env.agents.evaluation.folder import EvaluationFolder, settings_of
from crowd_env.agents.rules import StrategyPolicy
from crowd_env.core.files.json_file import write_json


def test_a_folder_holds_one_outline(tmp_path):
    usual, torso = settings_of(hall(), 3, 0), settings_of(hall(outline="torso"), 3, 0)
    assert (usual["outline"], torso["outline"]) == ("disc", "torso") and usual["digest"] != torso["digest"]
    assert settings_of(hall(outline="disc"), 3, 0) == usual
    assert settings_of(hall(outline=OUTLINES["torso"]), 3, 0) == torso
    write_json(tmp_path / "evaluation.json", torso)
    with pytest.raises(ValueError, match="outline is torso there and disc here"):
        EvaluationFolder(tmp_path, usual)


def test_policies_and_controllers_are_evaluated_with_an_outline():
    shared = {"runs": 1, "first_seed": 5, "physics": "hertz"}
    place, usual = hall(outline="torso"), hall()
    policy = StrategyPolicy("shortest", rules=False)
    found = repr(evaluate(policy, place, **shared).episodes)
    assert found == repr(evaluate(policy, usual, **{**shared, "physics": Physics("hertz", outline="torso")}).episodes)
    assert found != repr(evaluate(policy, usual, **shared).episodes)
    for controller in (RandomController(),):
        own = evaluate(controller, place, **shared)
        option = evaluate(controller, usual, **{**shared, "physics": Physics("hertz", outline="torso")})
        assert repr(own.episodes) == repr(option.episodes)


@pytest.mark.more
def test_training_keeps_its_outline(tmp_path, monkeypatch):
    pytest.importorskip("stable_baselines3")
    from training_runs import tiny

    from crowd_env.agents.networks import read_network
    from crowd_env.agents.training_config import check_config, default_config, make_env, resumed
    from crowd_env.cli.agents import learn

    usual = default_config("room-v0", "hertz", 0, 2, 100, 1.0)
    torso = default_config("room-v0", "hertz", 0, 2, 100, 1.0, outline="torso")
    assert (usual.outline, torso.outline) == ("disc", "torso")
    check_config(torso)
    assert make_env(usual).simulation.outline is None and make_env(torso).simulation.outline == OUTLINES["torso"]
    with pytest.raises(ValueError, match="--set outline is disc, but x was begun with torso"):
        resumed(torso, {"outline": "disc"}, [], "x")
    with pytest.raises(ValueError, match="nsm2 does not turn bodies"):
        check_config(default_config("room-v0", "nsm2", 0, 2, 100, 1.0, outline="torso"))
    folder, seen = tmp_path / "run", []

    def spy(policy, scenario, **options):
        seen.append(options["physics"].outline)
        return evaluate(policy, scenario, **options)

    monkeypatch.setattr("crowd_env.agents.learned.callbacks.evaluate", spy)
    assert learn.train(folder, tiny(folder, scheme="hertz", dt=0.001, outline="torso", steps=1500, eval_runs=1))
    assert seen and set(seen) == {"torso"}
    assert read_network(folder / "best.safetensors")[1]["trained"]["outline"] == "torso"


def test_the_command_takes_an_outline_and_refuses_it_before_anything_is_run():
    code, out, _ = call("--policies", "shortest", "--scheme", "hertz", "--runs", 1, "--set", "outline=torso", "--json")
    assert code == 0 and json.loads(out)["outline"] == "torso"
    code, _, err = call("--scheme", "hertz", "nsm2", "--set", "outline=torso")
    assert code == 2 and "nsm2 does not turn bodies, so it cannot have the outline 'torso'" in err
