"""The manner in evaluations and in training: part of what was run."""

import json

import numpy as np
import pytest
from evaluations import SMALL, call, hall, run

from crowd_env import MANNERS, Walking
from crowd_env.agents.controllers import RandomController
from crowd_env.agents.evaluation.evaluation import evaluate
from crowd_env.agents.evaluation.folder import EvaluationFolder, settings_of
from crowd_env.agents.rules import StrategyPolicy
from crowd_env.core.files.json_file import write_json

CALM = hall(manner="calm")


def test_entries_walk_in_the_manner_of_the_scenario():
    usual, calm = run("shortest"), run("shortest", CALM)
    assert repr(usual.episodes) != repr(calm.episodes)
    assert repr(run("shortest", hall(manner="competitive")).episodes) == repr(usual.episodes)


def test_policies_and_controllers_are_evaluated_in_a_manner():
    shared = {"runs": 2, "first_seed": 5}
    policy = StrategyPolicy("shortest", rules=False)
    in_calm, calm = evaluate(policy, CALM, **shared), evaluate(policy, SMALL, walking="calm", **shared)
    assert repr(in_calm.episodes) == repr(calm.episodes) != repr(evaluate(policy, SMALL, **shared).episodes)
    for controller in (RandomController(),):
        place = evaluate(controller, CALM, **shared)
        option = evaluate(controller, SMALL, walking="calm", **shared)
        back = evaluate(controller, CALM, walking="competitive", **shared)
        usual = evaluate(controller, SMALL, **shared)
        assert repr(place.episodes) == repr(option.episodes) != repr(usual.episodes) == repr(back.episodes)


def test_a_folder_holds_one_manner(tmp_path):
    usual, calm = settings_of(SMALL, 3, 0), settings_of(CALM, 3, 0)
    assert (usual["manner"], calm["manner"]) == ("competitive", "calm") and usual["digest"] != calm["digest"]
    assert settings_of(hall(manner="competitive"), 3, 0) == usual
    assert settings_of(hall(manner=MANNERS["calm"]), 3, 0) == calm
    write_json(tmp_path / "evaluation.json", calm)
    EvaluationFolder(tmp_path, settings_of(hall(manner=MANNERS["calm"]), 3, 0))
    with pytest.raises(ValueError, match="manner is calm there and competitive here"):
        EvaluationFolder(tmp_path, usual)


def test_the_command_takes_a_manner_and_prints_it():
    code, out, _ = call("--policies", "shortest", "--runs", 2, "--walking", "calm", "--json")
    assert code == 0 and json.loads(out)["manner"] == "calm"
    code, _, err = call("--walking", "slow")
    assert code == 2 and f"unknown manner 'slow'; known: {', '.join(MANNERS)}" in err


def test_training_keeps_its_manner():
    pytest.importorskip("stable_baselines3")
    from crowd_env.agents.training_config import check_config, default_config, make_env, resumed

    usual = default_config("room-v0", "nsm2", 0, 2, 100, 1.0)
    calm = default_config("room-v0", "nsm2", 0, 2, 100, 1.0, manner="calm")
    assert (usual.manner, calm.manner) == ("competitive", "calm")
    check_config(calm)
    assert (
        make_env(usual).simulation.behaviors["manner"] is None
        and make_env(calm).simulation.behaviors["manner"] == MANNERS["calm"]
    )
    with pytest.raises(ValueError, match="--walking is hurried, but x was begun with calm"):
        resumed(calm, {"manner": "hurried"}, [], "x")
    with pytest.raises(ValueError, match="unknown manner 'slow'"):
        default_config("room-v0", "nsm2", 0, 2, 100, 1.0, manner="slow")


def test_a_policy_in_training_is_evaluated_in_its_manner(tmp_path, monkeypatch):
    pytest.importorskip("stable_baselines3")
    from training_runs import tiny

    from crowd_env.agents.networks import read_network
    from crowd_env.cli.agents import learn

    seen = []

    def spy(policy, scenario, **options):
        seen.append(Walking.of(options["walking"]).manner)
        return evaluate(policy, scenario, **options)

    monkeypatch.setattr("crowd_env.agents.learned.callbacks.evaluate", spy)
    folder = tmp_path / "run"
    assert learn.train(folder, tiny(folder, manner="calm", steps=1500, eval_runs=1))
    assert seen and set(seen) == {"calm"}
    assert read_network(folder / "best.safetensors")[1]["trained"]["manner"] == "calm"


def test_a_controller_is_judged_in_the_manner_of_the_evaluation(tmp_path):
    from crowd_env.agents.evaluation.entries import make_entries
    from crowd_env.agents.networks import MLP
    from crowd_env.agents.trained import LearnedController
    from crowd_env.envs.routing.batch import RoutingBatch

    batch = RoutingBatch(SMALL)
    outputs = int(batch.choices.sum())
    network = MLP((np.zeros((outputs, batch.layout.size)),), (np.zeros(outputs),))
    LearnedController(network, batch.choices, {"scenario": "hall", "manner": "hurried"}).save(
        tmp_path / "c.safetensors"
    )
    (entry,) = make_entries([str(tmp_path / "c.safetensors")], CALM)
    assert entry.driver(CALM)(1).env.simulation.behaviors["manner"] == MANNERS["calm"]
