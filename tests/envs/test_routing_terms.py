"""Terms of routing-v0: chosen by name, or a user's own beside them; refused in a sentence; never global."""

import copy
import json
import pickle

import numpy as np
import pytest
from cases import looped
from routing_places import corridor, hall

from crowd_env import RewardTerm
from crowd_env.envs.routing.batch import RoutingBatch
from crowd_env.envs.routing.env import RoutingEnv, RoutingVectorEnv
from crowd_env.envs.routing.terms import REWARDS, TERMS, RoutingTerm

FIVE = [(1.0, 2.0), (2.0, 3.0), (3.5, 0.5), (5.0, 1.0), (7.0, 2.5)]
SMALL = hall(count=12, time_limit=10.0)


def nearest(view):
    """Distance from the person nearest to each exit, of 20 m."""
    return view.exit_distance.min(axis=2, initial=20.0, where=view.inside).T / 20.0


def out(view):
    """People who left since the last decision."""
    return view.left.sum(axis=1)


def twice(view):
    return 2.0 * np.ones((len(view.time), 1))


NEAREST, OUT = RoutingTerm("nearest", "exit", nearest), RewardTerm("out", out)


def test_the_tables_name_their_terms():
    assert list(TERMS) == [term.name for term in TERMS.values()]
    assert list(REWARDS) == [term.name for term in REWARDS.values()]


def test_terms_are_chosen_by_name_and_keep_their_values():
    doors = {"gate": "east"}
    every = RoutingEnv(corridor(FIVE, doors=doors), grid=(2, 1), doors=["gate"])
    for names in (["time", "queue"], ["door"], list(reversed(TERMS))):
        data = json.loads(json.dumps({"terms": names}))
        env = RoutingEnv(corridor(FIVE, doors=doors), grid=(2, 1), doors=["gate"], observation=data)
        assert env.layout.names == tuple(names) and env.observation_space.shape == (env.layout.size,)
        chosen, all_terms = ([one.reset(seed=0)[0], one.step([0, 1, 1])[0]] for one in (env, every))
        for row, whole in zip(chosen, all_terms, strict=True):
            np.testing.assert_array_equal(row, np.concatenate([whole[every.layout[name]] for name in names]))


def test_a_term_of_ones_own_stands_among_the_others():
    env = RoutingEnv(
        corridor(FIVE), grid=(2, 1), observation={"terms": ["inside", NEAREST, RoutingTerm("2", "", twice)]}
    )
    assert [env.layout[name] for name in env.layout.names] == [slice(0, 1), slice(1, 3), slice(3, 4)]
    row, _ = env.reset(seed=0)
    # 1 m from the exit in the west and 1 m from that in the east; what is too large is clipped.
    np.testing.assert_allclose(row, [1.0, 0.05, 0.05, 1.0], atol=0.003)
    assert "nearest" not in TERMS and RoutingEnv(SMALL).layout.names == tuple(TERMS)


@pytest.mark.parametrize("weight", [0.0, 0.5])
def test_a_reward_of_ones_own_counts_by_its_weight_and_is_reported(weight):
    env = RoutingEnv(corridor(FIVE), grid=(1, 1), reward={"mean": 0.1, OUT: weight})
    env.reset(seed=0)
    sums, done = np.zeros(3), False
    while not done:
        _, reward, done, _, info = env.step([0])
        sums += reward, info["reward/mean"], info["reward/out"]
        assert info["reward/last"] < 0.0
    assert sums[2] == 5 and sums[0] == pytest.approx(0.1 * sums[1] + weight * sums[2])


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_environments_with_own_terms_are_copied_and_restart_in_batches(copied):
    options = {"interval": 1.0, "observation": {"terms": [NEAREST, "time"]}, "reward": {OUT: 1.0}}
    env = RoutingVectorEnv(SMALL, num_envs=2, **options)
    env.reset(seed=0)
    other, total, ends = copied(env), 0.0, 0
    while ends < 3:
        rows, reward, terminated, truncated, _ = env.step(np.zeros((2, 8), dtype=int))
        np.testing.assert_array_equal(rows, other.step(np.zeros((2, 8), dtype=int))[0])
        total, ends = total + reward.sum(), ends + (terminated | truncated).sum()
        assert (rows[terminated | truncated, 2] == 0.0).all()
    assert total > 12


@looped(
    "options,words",
    [
        ({"observation": ["count"]}, r"observation is \['count'\]; it must be a table of terms such as {'terms': \["),
        ({"observation": {"columns": 3}}, "observation: unknown key 'columns'; known: terms"),
        ({"observation": {"terms": ["count"], "rays": 3}}, "observation: unknown key 'rays'; known: terms"),
        ({"observation": {"terms": "count"}}, "observation: terms is 'count'; it must be a tuple of names"),
        ({"observation": {"terms": []}}, "an observation needs at least one term"),
        ({"observation": {"terms": ["walls"]}}, "unknown observation term 'walls'; known: count, density, speed, flow"),
        ({"observation": {"terms": ["count", "count"]}}, "observation term 'count' is named twice"),
        ({"observation": {"terms": [RoutingTerm("count", "", twice)]}}, "'count' comes with crowd_env; give your own"),
        ({"observation": {"terms": ["door"]}}, "observation: door has no column without a door to control"),
        ({"reward": {RewardTerm("last", out): 1.0}}, "reward term 'last' comes with crowd_env"),
        ({"reward": {OUT: float("inf")}}, "weight of reward term 'out' is inf; it must be finite"),
    ],
)
def test_what_makes_no_sense_is_refused_in_a_sentence(options, words):
    with pytest.raises(ValueError, match=words) as caught:
        RoutingEnv(SMALL, **options)
    assert "\n" not in str(caught.value)


def test_functions_that_return_something_else_are_refused_by_name():
    wrong = RoutingTerm("wrong", "region", twice)
    with pytest.raises(ValueError, match=r"observation term 'wrong' has the shape \(1, 1\); it must be \(1, 8\)"):
        RoutingEnv(SMALL, observation={"terms": [wrong]}).reset(seed=0)
    env = RoutingEnv(SMALL, reward={RewardTerm("wrong", twice): 1.0})
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"reward term 'wrong' has the shape \(1, 1\); it must be \(1,\)"):
        env.step(np.zeros(8, dtype=int))
    env = RoutingEnv(SMALL, reward={RewardTerm("wrong", lambda view: np.full(1, np.nan)): 1.0})
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"reward term 'wrong'\[0\] is nan; it must be finite"):
        env.step(np.zeros(8, dtype=int))
    wrong = RoutingTerm("wrong", "", lambda view: np.full((1, 1), np.inf))
    with pytest.raises(ValueError, match=r"observation term 'wrong'\[0, 0\] is inf; it must be finite"):
        RoutingEnv(SMALL, observation={"terms": [wrong]}).reset(seed=0)
    for make, words in (
        (lambda: RoutingTerm("", "exit", out), "observation term needs a name"),
        (lambda: RoutingTerm("mine", "wall", out), "unknown of_each 'wall'; known: region, exit, route, door"),
        (lambda: RoutingTerm("mine", "exit", 3), "observation term 'mine': function is 3; it must be a function"),
        (lambda: RewardTerm("mine", None), "reward term 'mine': function is None; it must be a function"),
    ):
        with pytest.raises(ValueError, match=words):
            make()


def test_samples_within_an_interval_add_up_to_it():
    whole, sampled = (RoutingBatch(SMALL, num_envs=2, grid=(4, 1), interval=1.0, sample_dt=dt) for dt in (None, 0.1))
    assert (whole.samples, sampled.samples) == (1, 10)
    np.testing.assert_array_equal(whole.reset(0), sampled.reset(0))
    left = 0
    while not whole.env.finished.all():
        one, other = (batch.step(np.tile([0, 0, 1, 1], (2, 1))) for batch in (whole, sampled))
        for name in ("observation", "terminated", "truncated"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
        np.testing.assert_array_equal(one.info["inside"], other.info["inside"])
        assert other.reward == pytest.approx(one.reward, rel=1e-12) and list(one.metrics) == list(other.metrics)
        left += len(one.metrics)
    assert left == 2 and sampled.env.finished.all()
    with pytest.raises(ValueError, match=r"interval = 1 s is not a whole number of samples of sample_dt = 0\.3 s"):
        RoutingBatch(SMALL, interval=1.0, sample_dt=0.3)
