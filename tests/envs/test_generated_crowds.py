"""Places that take turns in a batch: each is what it is alone, and nobody learns more of a slot that stands empty."""

import numpy as np
import pytest
from cases import looped
from late import late

from crowd_env import CrowdEnv, GeneratedCrowds, make_scenario
from crowd_env.agents.walking import Evolved
from crowd_env.envs import generated
from crowd_env.scenarios.generated import Conditions, conditions_of

PPOSettings, make_ppo = late("crowd_env.agents.learned.ppo", "PPOSettings", "make_ppo")
CrowdVecEnv, MaskedRolloutBuffer = late("crowd_env.envs.adapters.sb3", "CrowdVecEnv", "MaskedRolloutBuffer")
clone = late("crowd_env.agents.learned.cloning", "clone")
cloning = late("crowd_env.agents.learned.cloning")

OPTIONS = {"routing": "fastest", "action": "speeds", "observation": {"terms": Evolved.terms}}


def crowds(num_envs=4, people=12, **more):
    return GeneratedCrowds(num_envs, people=people, **{**OPTIONS, **more})


def seeds_of(env):
    """Return the seed of each place, as its title says."""
    return [int(place.title.split()[1].rstrip(":")) for place in env.scenario_of_env]


def actions(env, rng):
    most = env.single_action_space.n
    return rng.integers(most // 2, most, env.num_people)  # of five speeds the higher three


class Alone:
    """A place by itself, from the draw that the batch gave it."""

    def __init__(self, seed, place, drawn):
        law, manner, self.noise, delay = conditions_of(seed)
        self.env = CrowdEnv(place, physics=law, walking=manner, **OPTIONS)
        self.first, _ = self.env.reset(drawn)
        rule = np.full(self.env.num_people, self.env.action_kind.neutral)
        self.decided = [rule] * round(10 * delay)

    def step(self, action):
        self.decided.append(action)
        return self.env.step(self.decided.pop(0))


@pytest.mark.parametrize("threads", [1, 2])
def test_places_are_what_they_are_alone_and_take_turns(monkeypatch, threads):
    drawn, reset = {}, CrowdEnv.reset

    def watched(self, seed=None, mask=None):
        drawn.update({(id(self), int(k)): seed[k] for k in np.flatnonzero(mask)})
        return reset(self, seed, mask)

    def seed_of(env, e):
        return drawn[id(env._turns[e].crowd), env._turns[e].e]

    env, rng = crowds(7, people=16, threads=threads), np.random.default_rng(0)
    with monkeypatch.context() as patched:
        patched.setattr(CrowdEnv, "reset", watched)
        seen, _ = env.reset(seed=0)
    assert len(env._parts) < 7  # some share a call
    alone = [
        Alone(*pair, seed_of(env, e)) for e, pair in enumerate(zip(seeds_of(env), env.scenario_of_env, strict=True))
    ]
    ended, noisy, late = 0, False, False
    while ended < 3 or not noisy or not late:
        for e, one in enumerate(alone):
            rows, n = seen[env.people(e)], one.env.num_people
            assert not rows[n:].any() and not env.active[env.people(e)][n:].any()
            if one.noise == 0.0:
                np.testing.assert_array_equal(rows[:n], one.first)
            else:
                noisy |= bool((rows[:n] != one.first).any())
                np.testing.assert_array_equal(rows[:n] == 0.0, one.first == 0.0)
                assert np.abs(rows).max() <= 1.0 and np.abs(rows[:n] - one.first).max() < 6.0 * one.noise
        action, before = actions(env, rng), seeds_of(env)
        with monkeypatch.context() as patched:
            patched.setattr(CrowdEnv, "reset", watched)
            step = env.step(action)
        seen = step.observation
        for e, one in enumerate(alone):
            people, n = env.people(e), one.env.num_people
            late |= len(one.decided) > 0
            own = one.step(action[people][:n])
            for ours, theirs in zip(step[1:4], own[1:4], strict=True):
                np.testing.assert_array_equal(ours[people][:n], theirs)
                assert not ours[people][n:].any()
            one.first = own.observation
            assert step.info["finished"][e] == own.info["finished"][0]
            if not own.info["finished"][0]:
                assert seeds_of(env)[e] == before[e]
                continue
            ended += 1
            assert repr(step.info["metrics"][e]) == repr(own.info["metrics"][0])
            if one.noise == 0.0:
                np.testing.assert_array_equal(step.info["final_observation"][people][:n], own.observation)
            assert seeds_of(env)[e] != before[e] and env.active[people].any()
            alone[e] = Alone(seeds_of(env)[e], env.scenario_of_env[e], seed_of(env, e))


def test_a_seed_repeats_everything_and_other_seeds_draw_other_places():
    def run(seed):
        env, rng = crowds(2), np.random.default_rng(1)
        seen, rewards = [env.reset(seed)[0]], []
        for _ in range(20):
            step = env.step(actions(env, rng))
            seen.append(step.observation)
            rewards.append(step.reward)
        return np.array(seen), np.array(rewards), seeds_of(env)

    one, same, other = run(0), run(0), run(1)
    np.testing.assert_array_equal(one[0], same[0])
    np.testing.assert_array_equal(one[1], same[1])
    assert one[2] == same[2] != other[2]


def test_no_place_beyond_the_seeds_is_drawn_and_each_stays_until_it_is_over():
    env = crowds(3, people=60, seeds=7)
    assert env.finished.all()
    env.reset(seed=0)
    known = seeds_of(env)
    assert set(known) <= set(range(7)) and not env.finished.any()
    while not (step := env.step(None)).info["finished"].any():
        assert seeds_of(env) == known
    stay = np.flatnonzero(~step.info["finished"])
    assert [seeds_of(env)[e] for e in stay] == [known[e] for e in stay]


@looped(
    ("options", "words"),
    [
        ({"people": 5}, "people is 5"),
        ({"people": 10, "seeds": 1}, "none has at most 10 people"),
        ({"seeds": 0}, "seeds is 0"),
        ({"action": "speeds-exits", "seeds": 50}, "different numbers of exits"),
    ],
)
def test_what_cannot_be_is_refused(monkeypatch, options, words):
    monkeypatch.setattr(generated, "TRIES", 20)
    with pytest.raises(ValueError, match=words):
        crowds(20, **{"people": 60, **options}).reset(seed=0)


def test_stable_baselines3_learns_from_those_who_are_inside_alone():
    room = make_scenario("room-v0", people=10)
    env = crowds(2, beside=[(room, Conditions("nsm2", "competitive", 0.0))], share=1.0)
    model = make_ppo(env, PPOSettings(n_steps=64, batch_size=64, n_epochs=1, hidden=8), 0)
    assert isinstance(model.rollout_buffer, MaskedRolloutBuffer)
    empty = np.tile(np.arange(12) >= 10, 2)
    found = []

    def look(local, _):
        found.append([len(local["infos"][row]) > 0 for row in range(env.num_people)])
        return True

    model.learn(400 * env.num_people, callback=look)
    ended = np.array(found)
    assert ended[:, ~empty].any() and not ended[:, empty].any()
    assert all(np.isfinite(value.detach().numpy()).all() for value in model.policy.parameters())
    model.rollout_buffer.reset()
    model.collect_rollouts(model.env, _silent(model), model.rollout_buffer, 64)
    assert model.rollout_buffer.mask.any() and not model.rollout_buffer.mask[:, empty].any()


def _silent(model):
    _, callback = model._setup_learn(1, None)
    return callback


@pytest.mark.more
def test_a_rule_is_cloned_in_them(monkeypatch):
    monkeypatch.setattr(cloning, "ROUNDS", 2)
    monkeypatch.setattr(cloning, "DECISIONS", 30)
    model = make_ppo(crowds(), PPOSettings(n_steps=8, batch_size=64, hidden=8), 0)
    assert np.isfinite(clone(model, Evolved(), 0))


@pytest.mark.parametrize("name", ["autoreset", "physics", "people_", "time_limit"])
def test_what_the_places_decide_is_no_argument(name):
    with pytest.raises(TypeError, match=rf"^GeneratedCrowds has no argument '{name}'; of CrowdEnv it takes routing"):
        GeneratedCrowds(1, people=12, **{name: True})


@pytest.mark.parametrize("options", [{"action": "speeds-exits"}, {"observation": {"terms": ["routes"]}}])
def test_exits_are_counted_by_no_action_and_no_term(options):
    with pytest.raises(ValueError, match=r"^generated places have different numbers of exits"):
        crowds(1, **options)


def test_a_step_needs_a_reset_before_it():
    with pytest.raises(ValueError, match=r"^call reset before the first step$"):
        crowds(1).step(None)
