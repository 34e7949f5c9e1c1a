"""Terms of the user's own, in observations and rewards: beside the named ones, refused in a sentence, pickled, never global."""

import json
import pickle

import numpy as np
from refusals import refuses, table

from crowd_env import CrowdEnv, ObservationLayout, ObservationTerm, RewardTerm, RewardWeights
from crowd_env.envs.observation.layout import TERMS, make_layout
from crowd_env.envs.observation.view import Columns
from crowd_env.envs.reward import REWARDS


def waited(view, out):
    """1 below a tenth of the own desired speed, else 0."""
    out[:, 0] = np.hypot(*view.state.velocity.T) < 0.1 * view.bodies.desired_speed


def slow(transition):
    """Minus the desired speed that is not reached [m/s]."""
    return np.hypot(*transition.state.velocity.T) - transition.bodies.desired_speed


WAITED, SLOW = ObservationTerm("waited", 1, waited), RewardTerm("slow", slow)


def several(view, out):
    out[:] = 3.0, -0.5


def walked(env, steps=3):
    observation = [env.reset(seed=0)[0]]
    rewards = []
    for _ in range(steps):
        step = env.step(None)
        observation.append(step.observation)
        rewards.append(step.reward)
    return np.array(observation), np.array(rewards), step.info


def test_a_term_of_ones_own_has_its_columns_and_leaves_the_others_as_they_are():
    layout = ObservationLayout(("velocity", ObservationTerm("two", 2, several), WAITED, "walls"), rays=4)
    assert [layout[name] for name in layout.names] == [slice(0, 2), slice(2, 4), slice(4, 5), slice(5, 9)]
    assert [layout.width(name) for name in layout.names] == [2, 2, 1, 4] and layout.size == 9
    observation, _, _ = walked(CrowdEnv("room-v0", people=3, observation=layout))
    plain, _, _ = walked(CrowdEnv("room-v0", people=3, observation=ObservationLayout(("velocity", "walls"), rays=4)))
    np.testing.assert_array_equal(observation[..., [0, 1, 5, 6, 7, 8]], plain)
    assert (observation[..., 2] == 1.0).all() and (observation[..., 3] == -0.5).all()  # what is too large is clipped
    assert (observation[0, :, 4] == 1.0).all() and not observation[-1, :, 4].all()


def test_a_reward_of_ones_own_counts_by_its_weight_and_is_reported_if_it_has_none():
    _, plain, _ = walked(CrowdEnv("room-v0", people=3, reward={"time": 1.0}))
    for weight in (0.0, 0.5):
        env = CrowdEnv("room-v0", people=3, reward={"time": 1.0, SLOW: weight})
        _, rewards, info = walked(env)
        state, bodies = env.simulation.state, env.simulation.bodies
        np.testing.assert_array_equal(info["reward/slow"], np.hypot(*state.velocity.T) - bodies.desired_speed)
        np.testing.assert_array_equal(rewards[-1], plain[-1] + weight * info["reward/slow"])
        assert [name for name in info if name.startswith("reward/")] == [f"reward/{n}" for n in (*REWARDS, "slow")]
    assert "reward/slow" not in walked(CrowdEnv("room-v0", people=3))[2]


def test_every_compiled_term_has_a_column():
    assert tuple(TERMS) == Columns._fields
    assert list(REWARDS.values()) == list(range(len(REWARDS)))  # rows of what `compute_reward` writes


def test_layouts_and_weights_can_be_pickled_and_compared():
    layout, weights = ObservationLayout(("velocity", WAITED)), RewardWeights({"time": 1.0, SLOW: 0.5}, 0.2)
    again = pickle.loads(pickle.dumps((layout, weights)))
    assert again == (layout, weights)
    assert layout != ObservationLayout(("velocity", ObservationTerm("waited", 1, several)))
    observation, rewards, _ = walked(CrowdEnv("room-v0", people=3, observation=layout, reward=weights))
    same, too, _ = walked(CrowdEnv("room-v0", people=3, observation=again[0], reward=again[1]))
    np.testing.assert_array_equal(observation, same)
    np.testing.assert_array_equal(rewards, too)


def test_a_layout_goes_through_json_and_comes_back_the_same():
    for layout in (ObservationLayout(), ObservationLayout(("walls", "push"), neighbors=3, rays=5)):
        assert make_layout(json.loads(json.dumps(layout.as_table()))) == layout
    refuses(ObservationLayout(("push", WAITED)).as_table, ("'waited'", "plain data"))


def column(transition):
    return np.ones((len(transition.inside), 1))


def nan(transition):
    return np.array([0.0, np.nan, 0.0])


def inf(transition):
    return np.full(3, np.inf)


def gap(view, out):
    out[2, 1] = np.nan


def text(transition):
    return "much"


WRONG = [
    ("unknown term", lambda: ObservationLayout(("waited", WAITED)), ("'waited'", "known: velocity")),
    ("twice", lambda: ObservationLayout((WAITED, ObservationTerm("waited", 2, several))), ("'waited'", "only once")),
    ("name of a named one", lambda: ObservationLayout((ObservationTerm("push", 1, waited),)), ("'push'", "another name")),
    ("not in a tuple", lambda: ObservationLayout(WAITED), ("terms", "tuple")),
    ("a function alone", lambda: ObservationLayout((waited,)), ("observation term", "ObservationTerm", "velocity")),
    ("width", lambda: ObservationTerm("waited", 0, waited), ("width", "0", "at least 1")),
    ("width and function", lambda: ObservationTerm("waited", waited, 1), ("width", "whole number")),
    ("no function", lambda: ObservationTerm("waited", 1, None), ("'waited'", "function", "view, out")),
    ("no name", lambda: ObservationTerm("", 1, waited), ("observation term", "name")),
    ("unknown reward", lambda: RewardWeights({"slow": 1.0}), ("'slow'", "known: progress, exit, time, contact")),
    ("reward twice", lambda: RewardWeights({SLOW: 1.0, RewardTerm("slow", column): 1.0}), ("'slow'", "only once")),
    ("reward of a named one", lambda: RewardWeights({RewardTerm("time", slow): 1.0}), ("'time'", "another name")),
    ("weight", lambda: RewardWeights({SLOW: "1"}), ("'slow'", "'1'", "number")),
    ("no reward function", lambda: RewardTerm("slow", 3), ("'slow'", "function", "transition")),
    ("no reward name", lambda: RewardTerm("", slow), ("reward term", "name")),
    ("an observation term", lambda: RewardWeights({WAITED: 1.0}), ("reward term", "RewardTerm", "progress")),
    ("a reward term", lambda: ObservationLayout((SLOW,)), ("observation term", "ObservationTerm")),
    ("shape", lambda: walked(CrowdEnv(people=3, reward={RewardTerm("slow", column): 1.0})), ("'slow'", "(3,)", "(3, 1)")),
    ("no numbers", lambda: walked(CrowdEnv(people=3, reward={RewardTerm("slow", text): 1.0})), ("'slow'", "(3,)", "'much'")),
]  # fmt: skip


@table(WRONG)
def test_a_term_that_cannot_be_is_refused_in_one_sentence(call, words):
    refuses(call, words)


def test_what_is_not_finite_is_refused_in_the_first_step_by_the_name_of_the_term():
    for function, found in ((nan, ("[1]", "nan")), (inf, ("[0]", "inf"))):
        env = CrowdEnv(people=3, reward={RewardTerm("slow", function): 0.0})
        env.reset(0)
        refuses(env.step, ("reward term 'slow'", "finite", *found))
    layout = ObservationLayout(("velocity", ObservationTerm("gap", 2, gap)))
    refuses(lambda: CrowdEnv(people=3, observation=layout).reset(0), ("observation term 'gap'[2, 1]", "nan", "finite"))


def test_a_term_that_writes_past_its_columns_is_named():
    def beyond(view, out):
        out[:, 2] = 1.0

    def wide(view, out):
        out[:] = np.ones((len(out), 3))

    for function, why in ((beyond, "out of bounds"), (wide, "broadcast")):
        layout = ObservationLayout(("velocity", ObservationTerm("sideways", 2, function)))
        env = CrowdEnv(people=3, observation=layout)
        refuses(lambda env=env: env.reset(0), ("observation term 'sideways'", "its 2 columns", why))
