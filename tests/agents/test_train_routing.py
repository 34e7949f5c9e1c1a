"""A controller that sends people to exits is trained, judged and gone on with as a policy is."""

import json
from dataclasses import replace

import numpy as np
import pytest
from late import late
from training_runs import call, curve

from crowd_env.agents import training_config
from crowd_env.agents.trained import LearnedController
from crowd_env.agents.training_config import ROUTING_PPO, default_config, make_env, task_config

make_ppo = late("crowd_env.agents.learned", "make_ppo")

ROUTING = {"interval": 2.0, "grid": [4, 2]}


def test_it_begins_at_the_nearest_exits():
    config = default_config("two-exit-hall-v0", "nsm2", 0, 2, 100, 1.0, people=12, routing=ROUTING)
    env = make_env(config)
    model = make_ppo(env, config.ppo, 0)
    assert model.gamma == ROUTING_PPO.gamma
    observation = env.reset(seed=0)[0]
    chosen = model.predict(observation, deterministic=True)[0]
    batch = env.batch
    center = np.array([batch.scenario.geometry.exits[k].mean(axis=0) for k in range(2)])
    routes = [batch.layout.routes.index(name) for name in batch.scenario.geometry.exit_names]
    for region, place in enumerate(batch.regions.center):
        nearest = np.hypot(*(center - place).T).argmin()
        assert (chosen[:, region] == routes[nearest]).all()


def test_a_task_is_trained_as_it_stands():
    config = task_config("two-exit-hall", 3, routing=ROUTING, people=20)
    assert (config.people, config.scheme, config.dt, config.strategy) == (20, "nsm2", 0.01, "fastest")
    assert config.seed == 3 and config.routing == ROUTING and config.manner == "competitive"


@pytest.mark.more
def test_the_whole_job(tmp_path, monkeypatch):
    def smaller(*args, **given):
        return replace(default_config(*args, **given), people=10, eval_runs=2)

    monkeypatch.setattr(training_config, "default_config", smaller)
    options = ("--scenario", "two-exit-hall-v0", "--decides", "routing", "--set", "grid=2,1", "--envs", 2, "--runs", 2)
    result = call(*options, "--steps", 100, "--out", tmp_path / "run")
    assert result.exit_code == 0, result.output
    found = json.loads((tmp_path / "run/results.json").read_text())
    assert [row["policy"] for row in found["rows"]] == ["fastest", "nearest", "shortest", "split", "random", "learned"]
    controller = LearnedController.load(tmp_path / "run/best.safetensors")
    assert controller.options == {"interval": 2.0, "grid": [2, 1]} and controller.trained["people"] == 10
    steps = curve(tmp_path / "run")[-1]["steps"]
    more = call("--resume", tmp_path / "run", "--steps", 200, "--runs", 1)
    assert more.exit_code == 0, more.output
    assert curve(tmp_path / "run")[-1]["steps"] >= 200 > steps
