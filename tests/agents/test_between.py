"""Acting between two speeds: by brute force, at limits that are known, from its file, and after learning from a teacher."""

import json

import numpy as np
import pytest
from cases import looped
from evaluations import random_network
from late import late

from crowd_env import GeneratedCrowds, ObservationLayout, make_scenario
from crowd_env.agents.networks import BetweenMLP, read_network, write_network
from crowd_env.agents.training_config import generalist_config
from crowd_env.envs.action import SpeedTable
from crowd_env.scenarios.generated import Conditions

PPOSettings, make_ppo = late("crowd_env.agents.learned", "PPOSettings", "make_ppo")
clone = late("crowd_env.agents.learned.cloning", "clone")
network_of = late("crowd_env.agents.learned.actor_critic", "network_of")
trained_in = late("crowd_env.agents.learned.training", "trained_in")

RNG = np.random.default_rng(0)
# Speeds in no order: which are beside each other is not where they stand.
TABLE = SpeedTable((0.5, -0.5, 1.0, 0.0), (0.0, 0.4, -0.4))


def direct(table=TABLE):
    """Return a network that takes the logits themselves."""
    choices = len(table.commands)
    return BetweenMLP((np.eye(choices),), (np.zeros(choices),), table=table)


def by_hand(logits, table):
    """Return the command of one row of logits (S, H)."""
    speeds = sorted(table.speeds)
    score = {(table.speeds[s], table.headings[h]): logits[s, h] for s, h in np.ndindex(logits.shape)}
    speed, heading = max(score, key=score.get)
    at = speeds.index(speed)
    beside = [speeds[k] for k in (at - 1, at + 1) if 0 <= k < len(speeds)]
    other = max(beside, key=lambda one: score[one, heading])
    odds = [np.exp(score[one, heading]) for one in (speed, other)]
    mean = (odds[0] * speed + odds[1] * other) / sum(odds)
    return mean * np.cos(heading), mean * np.sin(heading)


@looped("table", [TABLE, SpeedTable(), SpeedTable((1.0, 0.3), (0.0, 0.2))])
def test_the_speed_is_the_mean_of_the_likeliest_and_the_likelier_beside_it(table):
    logits = RNG.normal(0.0, 2.0, (300, len(table.speeds), len(table.headings)))
    found = direct(table)(logits.reshape(300, -1))
    np.testing.assert_allclose(found, [by_hand(one, table) for one in logits], atol=1e-6)


def test_what_is_known_of_limits():
    table = SpeedTable((0.0, 0.35, 0.7, 1.0))
    logits = [
        [0.0, 9.0, 9.0, -9.0],  # a teacher of 0.525, in equal shares
        [0.0, 900.0, 0.0, 0.0],  # certain
        [8.0, -900.0, -900.0, 8.0],  # at both ends: whatever lies between is nobody's wish
        [0.0, -900.0, 0.1, 5.0],
    ]
    expected = [0.525, 0.35, 0.0, 1.0 - 0.3 / (1.0 + np.exp(4.9))]
    found = direct(table)(np.array(logits))
    np.testing.assert_allclose(found[:, 0], expected, atol=1e-6)
    assert (found[:, 1] == 0.0).all()
    np.testing.assert_array_equal(direct(SpeedTable((1.0,)))(np.array([[3.0]])), [[1.0, 0.0]])


def test_a_row_is_the_same_in_a_batch_of_any_size_and_from_its_file(tmp_path):
    layers = random_network(11, len(TABLE.commands), seed=2, hidden=16)
    network, rows = BetweenMLP(layers.weights, layers.biases, table=TABLE), RNG.normal(0.0, 3.0, (70, 11))
    together = network(rows)
    assert network.outputs == 2 and together.shape == (70, 2)
    np.testing.assert_array_equal(together, np.vstack([network(one[None]) for one in rows]))
    write_network(tmp_path / "a.safetensors", network, {})
    again, facts = read_network(tmp_path / "a.safetensors")
    assert facts["network"]["kind"] == "between-mlp" and again.table == TABLE
    np.testing.assert_allclose(again(rows), together, atol=1e-5)  # files hold single precision


@looped(
    ("settings", "words"),
    [
        ({"activation": "tanh", "speeds": [0.0, 1.0], "headings": [0.0]}, "end in 12 numbers; its table has 2 choices"),
        ({"activation": "tanh", "speeds": [0.0, 0.5], "headings": [0.0]}, "one of them 1: the rule has to be among"),
        ({"activation": "tanh", "speeds": "fast", "headings": [0.0]}, "action: speeds"),
        ({"activation": "tanh", "rates": [1.0]}, "has an activation and no other"),
    ],
)
def test_a_file_that_does_not_fit_is_refused(settings, words):
    tensors = direct().tensors()
    with pytest.raises(ValueError, match=words):
        BetweenMLP.of(tensors, json.loads(json.dumps(settings)))


class HalfSpeed:
    """Wants a speed that is not among the choices."""

    name = "half speed"

    def act(self, observation, layout, rng):
        return np.tile([0.5, 0.0], (len(observation), 1))


@pytest.mark.more
def test_an_expert_between_two_speeds_is_followed_between_them():
    room = make_scenario("room-v0", people=12)
    layout = ObservationLayout(terms=("velocity", "desired_speed", "travel_time"))
    action = {"name": "speeds-directions", "speeds": [0.0, 0.35, 0.7, 1.0]}
    own = {"beside": [(room, Conditions("nsm2", "competitive", 0.0))], "share": 1.0}
    env = GeneratedCrowds(2, people=14, action=action, observation=layout, routing="shortest", **own)
    model = make_ppo(env, PPOSettings(n_steps=4, rule_logit=0.0), seed=0)
    clone(model, HalfSpeed(), 0, rounds=8, decisions=60, kept=1.0)
    who = trained_in(env, network_of(model), generalist_config())
    assert isinstance(who.network, BetweenMLP) and who.network.table == env.action_kind.decode
    seen, _ = env.reset(seed=3)
    np.testing.assert_allclose(who.act(seen, layout, RNG)[env.active], np.tile([0.5, 0.0], (24, 1)), atol=0.05)
