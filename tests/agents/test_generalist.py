"""One policy for all places: the best expert of each, what a teacher wants, and places of one's own between generated ones."""

from types import SimpleNamespace

import numpy as np
import pytest
from late import late

from crowd_env import CrowdEnv, GeneratedCrowds, ObservationLayout, make_scenario
from crowd_env.agents import make_policy, training_config
from crowd_env.agents.evaluation.evaluation import evaluate_crowds
from crowd_env.agents.evaluation.plans import Outcomes
from crowd_env.agents.tasks import TASKS
from crowd_env.agents.walking import Evolved, RuleAtShare
from crowd_env.scenarios.generated import Conditions

generalist = late("crowd_env.agents.learned.generalist")

LAYOUT = ObservationLayout(terms=tuple(training_config.GENERALIST["terms"]))
ROOM = make_scenario("room-v0", people=12)
OURS = Conditions("nsm2", "competitive", 0.0)
BACK = Evolved(own=0.0, far=0.0, density=0.0, close=0.0, match=0.0, crowd=0.0, always=-2.0)  # at full speed


def crowds(share, num_envs=3, **more):
    beside = [(ROOM, OURS)]
    options = {"action": "speeds", "observation": LAYOUT, "routing": "shortest"}
    return GeneratedCrowds(num_envs, people=14, beside=beside, share=share, **(options | more))


def test_a_place_of_ones_own_is_what_it_is_alone(monkeypatch):
    drawn, reset = [], CrowdEnv.reset
    monkeypatch.setattr(
        CrowdEnv, "reset", lambda self, seed=None, mask=None: drawn.append(seed[0]) or reset(self, seed, mask)
    )
    env = crowds(1.0, num_envs=1)
    seen, _ = env.reset(seed=4)
    alone = CrowdEnv(
        ROOM, physics="nsm2", walking="competitive", action="speeds", observation=LAYOUT, routing="shortest"
    )
    own, _ = reset(alone, drawn[-1])
    rng = np.random.default_rng(0)
    assert env.place_of_env == [-1]
    for _ in range(30):
        np.testing.assert_array_equal(seen[:12], own)
        action = rng.integers(0, env.single_action_space.n, env.num_people)
        seen, own = env.step(action).observation, alone.step(action[:12]).observation


def test_places_take_turns_by_their_share():
    env = crowds(0.5)
    rng = np.random.default_rng(1)
    assert 3 <= [env._draw(rng).number for _ in range(16)].count(-1) <= 13
    none = crowds(0.0)
    assert min(none._draw(rng).number for _ in range(16)) >= 0
    env.reset(seed=0)
    before = list(env.place_of_env)
    env.reset(seed=0)
    assert env.place_of_env == before


@pytest.mark.parametrize("name", ["evolution", "hertz-room/ppo"])
def test_an_expert_acts_as_it_does_alone(name):
    env = crowds(0.5, num_envs=6)
    seen, _ = env.reset(seed=2)
    assert -1 in env.place_of_env and max(env.place_of_env) >= 0
    seeds = {str(place): "rule" for place in env.place_of_env if place >= 0}
    expert = generalist.ExpertOfEachPlace(env, generalist.BestExperts(seeds, [name]))
    wanted = expert.act(seen, env.layout, np.random.default_rng(0))
    policy = make_policy(name)
    own = policy.env_options["observation"]
    for e, place in enumerate(env.place_of_env):
        rows = np.arange(env.people(e).start, env.people(e).stop)
        if place >= 0:
            np.testing.assert_array_equal(wanted[rows], np.tile([1.0, 0.0], (len(rows), 1)))
            continue
        alone = CrowdEnv(ROOM, observation=own, action=policy.env_options["action"])
        columns = np.concatenate([np.arange(LAYOUT[term].start, LAYOUT[term].stop) for term in own.names])
        action = policy.act(seen[rows][:, columns], own, np.random.default_rng(0))
        np.testing.assert_allclose(wanted[rows], np.asarray(alone.action_kind.decoded(np.asarray(action))[0]))


def test_all_tasks_of_everyone_that_are_small_enough_are_trained_in():
    small = [task for task in TASKS.values() if task.people <= 150 and not task.selfish]
    found = [(place, conditions) for place, conditions in training_config.places_of_tasks(150)]
    there = {(place.name, place.population.people, place.strategy, law) for place, (law, *_) in found}
    assert there >= {(task.place().name, task.people, task.rule, task.scheme) for task in small}
    assert len(small) < len(found) <= 2 * len(small) and all(place.time_limit <= 150.0 for place, _ in found)


def test_the_best_expert_leaves_the_fewest_people_then_takes_the_least_time(monkeypatch):
    times = {"rule": (0.0, 30.0), "evolution": (0.0, 20.0), "hertz-room/ppo": (3.0, 1.0)}

    def evaluated(crowds, *, finished, **options):
        for k, crowd in enumerate(crowds):
            left, time = times.get(crowd.name, (9.0, 9.0))
            column = np.array([left, 0.0])
            finished(k, SimpleNamespace(column={"unfinished": column}.get, ended=np.full(2, time)))

    monkeypatch.setattr(generalist, "evaluate_crowds", evaluated)
    assert generalist._best_beside([(ROOM, OURS)] * 2, generalist.Serial()) == ["evolution", "evolution"]


def test_an_expert_that_lets_people_stray_is_no_better_than_one_that_leaves_them(monkeypatch):
    def judged(names, plans, **options):
        none = np.zeros(plans)
        quick = Outcomes(np.full(plans, np.inf), none, none + 2.0, none, none)  # 2 people out elsewhere, and soon
        slow, left = quick._replace(time=none + 90.0, strayed=none), quick._replace(left=none + 3.0, strayed=none)
        return {name: {"rule": quick, "evolution": slow}.get(name, left) for name in names}

    monkeypatch.setattr(generalist, "judge_plans", judged)
    monkeypatch.setattr(generalist, "places_of_tasks", lambda people: [])
    found = training_config.GeneratedPlaces(people=150, seeds=1000, taught=20, share=0.5, rounds=1)
    assert set(generalist.find_experts(found, None).of_seed.values()) == {"evolution"}
    monkeypatch.setattr(generalist, "EXPERTS", ("hertz-room/ppo", "rule"))
    assert set(generalist.find_experts(found, None).of_seed.values()) == {"rule"}


def test_in_a_task_who_steps_back_through_the_entrance_is_left(monkeypatch):
    left = {}

    def evaluated(crowds, *, runs, finished, **options):
        def noted(k, result):
            left[result.policy] = result.column("unfinished").sum()
            finished(k, result)

        evaluate_crowds(crowds, runs=2, finished=noted, **options)

    monkeypatch.setattr(generalist, "evaluate_crowds", evaluated)
    monkeypatch.setattr(generalist, "EXPERTS", ("rule", "back"))
    monkeypatch.setattr(generalist, "_policy", lambda name, way: {"rule": RuleAtShare(0.0), "back": BACK}[name])
    place = make_scenario("counter-flow-v0", people=8)
    assert generalist._best_beside([(place, OURS)], generalist.Serial()) and list(left.values()) == [16.0, 16.0]


def test_the_parameters_of_a_training_in_all_places_are_plain_and_checked():
    config = training_config.generalist_config(3, people=40, envs=2, minutes=1.0)
    assert config.task is None and config.places.people == 40 and config.seed == 3
    assert training_config.facts_of(config)["task"] == {"name": "generated", "version": 2}
    env = training_config.make_env(config)
    assert isinstance(env, GeneratedCrowds) and env.layout.names == LAYOUT.names and env.num_envs == 2
