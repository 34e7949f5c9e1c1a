"""A policy that starts as a rule: labels, what is learned from them, and what cannot be cloned."""

from dataclasses import replace

import numpy as np
import pytest
from cases import looped
from late import late
from training_runs import call

from crowd_env import CrowdEnv
from crowd_env.agents import make_policy
from crowd_env.agents.trained import LearnedPolicy
from crowd_env.agents.training_config import make_env, task_config

PPOSettings, make_ppo = late("crowd_env.agents.learned", "PPOSettings", "make_ppo")
cloning = late("crowd_env.agents.learned.cloning")
network_of = late("crowd_env.agents.learned.actor_critic", "network_of")
env_options_of = late("crowd_env.agents.learned.training", "env_options_of")

SPEEDS = {"name": "speeds", "speeds": [-1.0, -0.5, 0.0, 0.5, 1.0]}


def small_env(**changes):
    """Return a training batch of the competitive door, with few people."""
    return make_env(replace(task_config("competitive-door", people=12, start="follow", envs=4), **changes))


@looped("action", ["speeds", SPEEDS, "speeds-directions"])
def test_labels_are_shares_of_choices_whose_mean_is_what_the_rule_wants(action):
    env = CrowdEnv("room-v0", action=action, people=2)
    choices = env.action_kind.decode.commands
    wanted = np.column_stack([np.random.default_rng(0).uniform(choices[:, 0].min(), 1.0, 200), np.zeros(200)])
    labels = cloning._labels(env, wanted)
    assert (labels >= 0.0).all() and ((labels > 0.0).sum(axis=1) <= 2).all()
    np.testing.assert_allclose(labels.sum(axis=1), 1.0)
    np.testing.assert_allclose(labels @ choices, wanted, atol=1e-6)
    np.testing.assert_allclose(cloning._labels(env, choices) @ choices, choices, atol=1e-12)


def test_a_rule_that_is_cloned_into_choices_of_exits_keeps_to_the_own_way():
    env = CrowdEnv("two-exit-hall-v0", action="speeds-exits", people=2)
    choices = env.action_kind.decode.commands
    labels = cloning._labels(env, choices)
    assert labels.shape == (len(choices), env.single_action_space.n) == (5, 15)
    commands, ways = env.action_kind.decode(labels.argmax(axis=1))
    np.testing.assert_allclose(commands, choices)
    assert (ways == -1).all() and (labels[:, len(choices) :] == 0.0).all()


@pytest.mark.more
@looped("action", [SPEEDS, "continuous"])
def test_a_clone_acts_as_its_rule_where_it_was_never_trained(action, monkeypatch):
    for name, value in (("ROUNDS", 4), ("DECISIONS", 120), ("EPOCHS", 12), ("_BATCH", 256)):
        monkeypatch.setattr(cloning, name, value)
    rule, env = make_policy("evolution"), small_env(action=action)
    model = make_ppo(env, PPOSettings(n_steps=4, rule_logit=0.0), seed=0)
    before = disagreement(model, env, rule)
    cloning.clone(model, rule, seed=0)
    after = disagreement(model, env, rule)
    assert after < 0.5 * before and after < 0.25, (before, after)  # of the desired speed


def disagreement(model, env, rule):
    """Return the mean distance between what policy and rule want in evacuations that the rule leads."""
    policy = LearnedPolicy(network_of(model), env_options_of(env))
    observation, _ = env.reset(900_000)
    rng, found = np.random.default_rng(0), []
    for _ in range(80):
        wanted = rule.act(observation, env.layout, rng)
        chosen = policy.act(observation, env.layout, rng)
        decode = env.action_kind.decode
        command = chosen if decode is None else decode(chosen)
        found.append(np.abs(command - wanted).sum(axis=1)[env.active])
        actions = wanted if decode is None else cloning._labels(env, wanted).argmax(axis=1)
        observation = env.step(actions).observation
    return float(np.concatenate(found).mean())


@pytest.mark.more
def test_the_same_seed_clones_the_same_network(monkeypatch):
    monkeypatch.setattr(cloning, "ROUNDS", 1)
    monkeypatch.setattr(cloning, "DECISIONS", 20)
    networks = []
    for _ in range(2):
        env = small_env(action=SPEEDS)
        model = make_ppo(env, PPOSettings(n_steps=4), seed=3)
        cloning.clone(model, make_policy("evolution"), seed=3)
        networks.append(network_of(model))
    assert all((one == two).all() for one, two in zip(networks[0].weights, networks[1].weights, strict=True))


@pytest.mark.more
def test_nothing_is_learned_from_people_who_are_out(monkeypatch):
    """Their observations are zeros, and what a rule makes of these is no example."""
    monkeypatch.setattr(cloning, "ROUNDS", 1)
    monkeypatch.setattr(cloning, "DECISIONS", 80)
    env, learned, loss = small_env(action=SPEEDS), [], cloning._loss
    monkeypatch.setattr(cloning, "_loss", lambda *given: learned.append(given[2]) or loss(*given))
    out = []
    monkeypatch.setattr(env, "step", lambda action, step=env.step: out.append(~env.active) or step(action))
    cloning.clone(make_ppo(env, PPOSettings(n_steps=4), seed=0), make_policy("evolution"), seed=0)
    assert np.mean(out) > 0.1 and len(learned) > 1
    assert all((rows != 0.0).any(axis=1).all() for rows in learned)


def test_rules_act_in_the_frame_of_the_path():
    env = small_env(action="continuous", frame="world")
    with pytest.raises(ValueError, match="'evolution' cannot be cloned: it acts in the frame 'path', not in 'world'"):
        cloning.clone(make_ppo(env, PPOSettings(n_steps=4), seed=0), make_policy("evolution"), seed=0)


def test_a_beta_policy_is_no_clone():
    env = small_env(action="continuous")
    model = make_ppo(env, PPOSettings(n_steps=4, distribution="beta"), seed=0)
    with pytest.raises(ValueError, match="'evolution' cannot be cloned into a policy of Beta"):
        cloning.clone(model, make_policy("evolution"), seed=0)


@looped(
    ("options", "words"),
    [
        (("--start", "nobody"), "unknown start 'nobody'; known: rule, nothing, rule-best-speed"),
        (("--start", "random"), "unknown start 'random'"),
        (("--start", "zipper"), "'zipper' needs the full state"),
        (("--scenario", "room-v0", "--start", "evolution"), "'evolution' needs its own observation holds: ahead"),
    ],
)
def test_a_start_that_cannot_be_is_refused_before_anything_is_written(tmp_path, options, words):
    result = call("--out", tmp_path / "runs" / "one", *options)
    assert result.exit_code == 2 and words in result.stderr.replace("\n", " "), result.stderr
    assert not (tmp_path / "runs").exists()
