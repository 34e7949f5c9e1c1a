"""The rule whose weights are searched, and the search."""

from dataclasses import asdict, replace
from functools import partial

import numpy as np
import pytest
from cases import looped
from evaluations import hall
from late import late

from crowd_env import CrowdEnv
from crowd_env.agents import Evolved
from crowd_env.agents.training_config import default_config, physics_of, place_of, task_config
from crowd_env.envs.settings import arguments_of
from crowd_env.envs.tasks.task import HELD_OUT_SEED

evolution, starts = late("crowd_env.agents.learned.evolution"), late("crowd_env.agents.learned.starts")
OPTIONS = {"scheme": "nsm2", "dt": 0.01, "decision_dt": 0.1}
NOTHING = Evolved(**dict.fromkeys(asdict(Evolved()), 0.0))
SMALL = {"population": 4, "draws": 2}


def test_the_rule_of_all_is_its_law_for_each():
    policy = Evolved(own=-0.7, far=0.4, density=-0.9, close=-0.8, match=1.2, crowd=0.5, always=0.3)
    env = CrowdEnv(hall(40, speed=1.6), num_envs=2, **arguments_of(policy.env_options))
    env.reset([3, 4])
    observation = [env.step(None).observation for _ in range(25)][-1]
    state, bodies, view = env.simulation.state, env.simulation.bodies, env.observer.view
    x, v, rest, ways, wanted = state.position, state.velocity, view.distance_to_go, view.direction, bodies.desired_speed
    action = policy.act(observation, env.layout, np.random.default_rng(0))
    free = 0
    for i in np.flatnonzero(state.active):
        mine = env.people(env.env_of_person[i])
        others = [j for j in range(mine.start, mine.stop) if j != i and state.active[j]]
        around = sum(np.hypot(*(x[j] - x[i])) < 1.0 for j in others) + 1
        nearer = [j for j in others if np.hypot(*(x[j] - x[i])) < 3.0 and rest[j] < rest[i]]
        time = rest[i] / wanted[i]
        share = 1.0 - 0.7 * np.clip(v[i] @ ways[i] / wanted[i], -9.0, 2.0 / wanted[i]) + 0.4 * time / (time + 5.0)
        share += 0.3 - 0.9 * around / (np.pi * 8.0)
        if nearer:
            j = max(nearer, key=rest.__getitem__)
            share -= 0.8 * (1.0 - min(rest[i] - rest[j], 3.0) / 3.0)
            share += 1.2 * min(v[j] @ ways[j], 2.0) / wanted[i] + 0.5 * len(nearer) / (len(nearer) + 10.0)
        np.testing.assert_allclose(action[i], [np.clip(share, -1.0, 1.0), 0.0], atol=2e-4)
        free += abs(share) < 1.0
    assert free > 10


def test_nothing_is_full_speed():
    env = CrowdEnv(hall(10), **arguments_of(NOTHING.env_options))
    observation, _ = env.reset(seed=0)
    assert (NOTHING.act(observation, env.layout, np.random.default_rng(0)) == (1.0, 0.0)).all()


class Generations:
    """Lets a search go on for so many generations."""

    def __init__(self, count):
        self.left, self.policies, self.steps = count, [], []

    def on_update(self, steps, policy):
        self.policies.append(policy())
        self.steps.append(steps)
        self.left -= 1
        return self.left >= 0


@pytest.fixture
def draws(monkeypatch):
    """Record which draws a search takes."""
    taken, reset = [], CrowdEnv.reset

    def recorded(self, seed=None, mask=None):
        if seed != 0:  # of one room, to see how long its walks are
            taken.append(seed)
        return reset(self, seed, mask)

    monkeypatch.setattr(CrowdEnv, "reset", recorded)
    return taken


def test_a_search_begins_at_nothing_takes_training_draws_and_can_be_repeated(draws):
    found = []
    for seed in (5, 5, 6):
        found.append(Generations(2))
        evolution.evolve(hall(6), OPTIONS, seed, found[-1], **SMALL)
    first, again, other = found
    assert first.policies == again.policies and first.steps == again.steps and first.policies != other.policies
    assert first.policies[0] == NOTHING != first.policies[-1]
    assert all(seeds == 4 * seeds[:2] and max(seeds) < HELD_OUT_SEED for seeds in draws)  # all are judged on the same
    assert draws[0] != draws[1] and draws[0] == draws[2]  # others in every generation
    assert first.steps[0] == 0 < first.steps[1] < first.steps[2]


def test_a_search_finds_what_is_asked_for(monkeypatch):
    """With a made-up cost: the nearer to a weight of 0.9 the better."""
    index = list(asdict(NOTHING)).index("match")
    monkeypatch.setattr(evolution, "_race", lambda env, weights, seeds: ((weights[:, index] - 0.9) ** 2, 1))
    found = Generations(40)
    evolution.evolve(hall(1), OPTIONS, 0, found, endless=True)
    assert found.policies[-1].match == pytest.approx(0.9, abs=0.05)


@looped(
    ("course", "ended"),
    [
        ([9.0] * 19, False),  # too short to tell
        ([9.0] * 20, True),
        ([9.0, 8.9] * 10, True),  # the luck of draws
        ([10.0 - 0.1 * k for k in range(30)], False),
        ([9.0] * 30 + [8.0] * 10, False),
    ],
)
def test_a_search_has_stalled_where_its_last_generations_are_no_better(course, ended):
    assert evolution.stalled(course) is ended


class Begun:
    """Records where searches begin, and with which step."""

    def __init__(self, monkeypatch):
        self.means, self.steps, begun = [], [], evolution.begun

        def recorded(mean, step, *rest):
            self.means.append(mean)
            self.steps.append(step)
            return begun(mean, step, *rest)

        monkeypatch.setattr(evolution, "begun", recorded)


def test_a_search_that_stalls_begins_anew_where_it_is_and_ends_when_that_was_in_vain(monkeypatch):
    """With made-up costs: a step to be found from a plateau, and then nothing more."""
    begun, found = Begun(monkeypatch), Generations(500)

    def race(env, weights, seeds):
        return np.where(np.abs(weights).max(axis=1) > 5.0, 50.0, 100.0), 1

    monkeypatch.setattr(evolution, "_race", race)
    evolution.evolve(hall(1), OPTIONS, 0, found)
    assert found.left > 0  # it ended by itself
    assert len(begun.means) >= 3 and not begun.means[0].any() and begun.means[1].any()
    assert begun.steps == [1.0] * (len(begun.steps) - 1) + [0.3]
    endless, count = Generations(60), len(begun.means)
    evolution.evolve(hall(1), OPTIONS, 0, endless, endless=True)
    assert (
        endless.left < 0 and len(begun.means) > count + 1 and begun.steps[count:] == [1.0] * (len(begun.means) - count)
    )


def test_a_search_that_is_hardly_better_than_full_speed_begins_at_nothing_again_and_looks_further_away(monkeypatch):
    """With made-up costs that hide what pays, and flatter whoever is judged by the luck of a generation."""
    begun, found, luck = Begun(monkeypatch), Generations(500), np.random.default_rng(0)

    def race(env, weights, seeds):
        lucky = luck.uniform(0.8, 1.0, len(weights)) if len(np.unique(weights, axis=0)) > 2 else 0.97
        return np.where(np.abs(weights).max(axis=1) > 40.0, 50.0, 100.0) * lucky, 1

    monkeypatch.setattr(evolution, "_race", race)
    evolution.evolve(hall(1), OPTIONS, 0, found)
    from_nothing = [step for step, mean in zip(begun.steps, begun.means, strict=True) if not mean.any()]
    assert len(from_nothing) > 2 and from_nothing == [2.0**k for k in range(len(from_nothing))]
    assert found.left > 0 and np.abs(list(asdict(found.policies[-1]).values())).max() > 40.0 and begun.steps[-1] == 0.3


def test_a_new_beginning_in_vain_is_forgotten_and_everybody_walks_in_the_end(monkeypatch):
    begun, people = Begun(monkeypatch), []

    def race(env, weights, seeds):
        people.append(env.num_people // env.num_envs)
        later = 10.0 * len(begun.means)  # whatever comes later is worse
        return np.where(weights.any(axis=1), later, 100.0), 1

    monkeypatch.setattr(evolution, "_race", race)
    found = Generations(500)
    evolution.evolve(hall(6), OPTIONS, 0, found)
    assert len(begun.means) == 3 and (begun.means[2] == begun.means[1]).all()
    assert people == [3] * 41 + [6] * 12 and len(found.policies) == 53


def test_who_does_not_get_out_counts_more_than_any_time():
    place = replace(hall(6), time_limit=12.0, blocked_after=4.0)
    env = CrowdEnv(place, num_envs=2, **arguments_of({**OPTIONS, **NOTHING.env_options}))
    weights = np.zeros((2, 7))
    weights[1, -1] = -1.0  # stands still
    costs, decided = evolution._race(env, weights, [1, 1])
    assert costs[0] == env.simulation.state.exit_time[:6].max() < 12.0 and costs[1] == 12.0 + 6.0
    times, waited = env.simulation.state.exit_time[:6], env.simulation.state.time[1]
    assert decided == np.ceil(times / 0.1 - 1e-9).sum() + 6 * round(waited / 0.1) and 4.0 <= waited < 4.2


def test_a_long_walk_is_no_block():
    """Nobody has left this corridor after 10 s, nor all after 1.5 s each."""
    config = task_config("counter-flow")
    env = evolution.rooms(place_of(config), {**physics_of(config), **NOTHING.env_options}, 4, 2)
    costs, _ = evolution._race(env, np.zeros((2, 7)), [1, 2])
    assert (costs > 10.0).all() and (costs < env.time_limit).all()


def test_a_step_back_through_the_wrong_exit_leads_nowhere():
    config = task_config("counter-flow")
    env = evolution.rooms(place_of(config), {**physics_of(config), **NOTHING.env_options}, 4, 1)
    costs, _ = evolution._race(env, np.array([[0.0] * 6 + [-2.0]]), [1])
    assert env.finished.all() and costs == env.time_limit + 4


def test_what_was_found_is_kept_with_the_run(tmp_path, monkeypatch):
    monkeypatch.setattr(starts, "MOST", 1)
    monkeypatch.setattr(starts, "evolve", partial(evolution.evolve, **SMALL))
    config = default_config("room-v0", "nsm2", 3, 2, 5000, 5.0, people=5, start="nothing")
    seen = []
    found = starts.first_rule(config, tmp_path, on_search=lambda steps, policy: seen.append((steps, policy)))
    assert seen == [(0, NOTHING)]  # the curve of a search begins at nothing
    monkeypatch.setattr(starts, "evolve", None)  # not again
    assert starts.first_rule(config, tmp_path) == found != NOTHING
    assert starts.first_rule(replace(config, start="rule")) is None
    assert starts.first_rule(replace(config, start="follow")).name == "follow"
