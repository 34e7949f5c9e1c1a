"""A policy as it acted in training: every action is drawn from its distribution."""

import numpy as np
import pytest
from evaluations import call, random_network, random_policy
from typer.testing import CliRunner

from crowd_env import ObservationLayout
from crowd_env.agents.trained import LearnedController, LearnedPolicy, load_trained
from crowd_env.cli.agents import submit

LAYOUT = ObservationLayout()
MANY = np.tile(np.random.default_rng(1).uniform(-1.0, 1.0, LAYOUT.size).astype(np.float32), (20_000, 1))


def test_choices_are_drawn_as_often_as_the_softmax_says():
    policy = random_policy(action="discrete")
    policy.network.weights[-1][:] *= 4.0  # choices of very different likelihood
    logits = policy.network(MANY[:1])[0]
    share = np.exp(logits - logits.max())
    share /= share.sum()
    drawn = policy.sampled().act(MANY, LAYOUT, np.random.default_rng(0))
    found = np.bincount(drawn, minlength=9) / len(MANY)
    assert share.max() > 3 * share.min()
    assert (np.abs(found - share) < 4.0 * np.sqrt(share * (1.0 - share) / len(MANY))).all()
    assert (policy.act(MANY, LAYOUT, np.random.default_rng(0)) == logits.argmax()).all()


def test_continuous_actions_scatter_by_the_spread_of_training_and_stay_within_their_bounds(tmp_path):
    made = random_policy()
    policy = LearnedPolicy(made.network, made.env_options, spread=[0.05, 0.5])
    policy.save(tmp_path / "one.safetensors")
    read = load_trained(tmp_path / "one.safetensors")
    assert read.spread == (0.05, 0.5)
    drawn = read.sampled().act(MANY, LAYOUT, np.random.default_rng(0))
    mean = read.network(MANY[:1])[0]
    assert np.abs(mean).max() < 0.8  # or the bounds would cut the first component
    np.testing.assert_allclose(drawn[:, 0].mean(), mean[0], atol=0.002)
    np.testing.assert_allclose(drawn[:, 0].std(), 0.05, rtol=0.03)
    assert np.abs(drawn).max() == 1.0 and drawn[:, 1].std() > 0.3


def test_the_same_generator_draws_the_same_actions_and_the_policy_itself_is_as_before():
    policy = random_policy(action="discrete")
    one, other = (policy.sampled().act(MANY, LAYOUT, np.random.default_rng(7)) for _ in range(2))
    assert (one == other).all() and len(np.unique(one)) > 1
    assert len(np.unique(policy.act(MANY, LAYOUT, np.random.default_rng(7)))) == 1


def test_both_ways_stand_in_one_table():
    names = ("competitive-door/ppo", "competitive-door/ppo:sampled")
    code, out, err = call("--task", "competitive-door", "--people", 6, "--runs", 1, "--policies", *names)
    assert code == 0, err
    assert "competitive-door/ppo:sampled" in out.replace("\n", "") or "ppo:sampled" in out


def test_what_cannot_be_drawn_is_refused_in_one_sentence(tmp_path):
    random_policy().save(tmp_path / "one.safetensors")
    code, _, err = call("--policies", f"{tmp_path}/one.safetensors:sampled", "--runs", 1)
    assert code == 2 and "how far its continuous actions scatter" in err.replace("\n", " ") and "Traceback" not in err
    LearnedController(random_network(5, 7), np.array([3, 2, 2]), {}).save(tmp_path / "two.safetensors")
    code, _, err = call("--policies", f"{tmp_path}/two.safetensors:sampled", "--runs", 1)
    assert code == 2 and "a controller takes the most likely choices alone" in err.replace("\n", " ")
    with pytest.raises(ValueError, match="3 standard deviations of 2 components"):
        LearnedPolicy(random_policy().network, random_policy().env_options, spread=[1.0, 1.0, 1.0])
    words = ["--task", "room", "--policy", "competitive-door/ppo:sampled", "--out", str(tmp_path / "out")]
    told = CliRunner().invoke(submit.app, words)
    assert told.exit_code == 2 and "most likely actions" in told.stderr and not (tmp_path / "out").exists()
