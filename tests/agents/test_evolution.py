"""The rule whose constants are searched, and the search."""

import numpy as np
import pytest
from evaluations import hall
from late import late

from crowd_env import CrowdEnv
from crowd_env.agents import Evolved
from crowd_env.agents.evaluation.evaluation import HELD_OUT_SEED
from crowd_env.envs.rollout import run_episodes
from crowd_env.envs.settings import arguments_of

evolution = late("crowd_env.agents.learned.evolution")
OPTIONS = {"scheme": "nsm2", "dt": 0.01, "decision_dt": 0.1}


def test_the_rule_of_all_is_its_law_for_each():
    policy = Evolved(spacing=0.4, crowd=0.3, far=-0.2, time=0.25, match=1.2, damping=0.7, side=0.3, back=0.6)
    env = CrowdEnv(hall(40, speed=1.6), num_envs=2, **arguments_of(policy.env_options))
    env.reset([3, 4])
    observation = [env.step(None).observation for _ in range(25)][-1]
    state, bodies, view = env.simulation.state, env.simulation.bodies, env._observer.view
    x, v, rest, ways, wanted = state.position, state.velocity, view.distance_to_go, view.direction, bodies.desired_speed
    action = policy.act(observation, env.layout, np.random.default_rng(0))
    free = 0
    for i in np.flatnonzero(state.active):
        mine = env.people(env.env_of_person[i])
        others = [j for j in range(mine.start, mine.stop) if j != i and state.active[j]]
        near = [j for j in others if np.hypot(*(x[j] - x[i])) < 3.0]
        nearer = [j for j in near if rest[j] < rest[i]]
        speed = wanted[i]
        if nearer:
            j = max(nearer, key=rest.__getitem__)
            gap = min(rest[i] - rest[j], 3.0) - 0.4 - 0.3 * len(nearer) / 10 + 0.2 * min(rest[i] / 5.0, 1.0)
            speed = 1.2 * min(v[j] @ ways[j], 2.0) - 0.7 * (v[i] @ ways[i]) + gap / 0.25
        along, across = np.clip(speed / wanted[i], -0.6, 1.0), 0.0
        if near:
            j = min(near, key=lambda j: np.hypot(*(x[j] - x[i])) - bodies.radius[i] - bodies.radius[j])
            left = ways[i, 0] * (x[j] - x[i])[1] - ways[i, 1] * (x[j] - x[i])[0]
            gap = max(np.hypot(*(x[j] - x[i])) - bodies.radius[i] - bodies.radius[j], 0.0)
            across = -0.3 * np.sign(left) * (1.0 - gap / 3.0) ** 4
        expected = np.array([along, across]) / max(np.hypot(along, across), 1.0)
        np.testing.assert_allclose(action[i], expected, atol=2e-4)
        free += along > 0.99
    assert 0 < free < state.active.sum()


def test_every_constant_is_searched_and_the_ones_that_ship_lie_within_the_bounds():
    shipped = {name: getattr(Evolved(), name) for name in Evolved.__dataclass_fields__}
    assert list(evolution.SEARCHED) == list(shipped)
    for name, one in evolution.SEARCHED.items():
        assert one.low <= one.start <= one.high and one.low <= shipped[name] <= one.high


class Generations:
    """A watch that lets a search go on for so many generations."""

    decision_dt = 0.1

    def __init__(self, count):
        self.left, self.policies, self.steps = count, [], []

    def goes_on(self, steps, policy):
        self.policies.append(policy())
        self.steps.append(steps)
        self.left -= 1
        return self.left >= 0


@pytest.fixture
def draws(monkeypatch):
    """Record which draws a search takes."""
    taken = []

    def recorded(place, runs, *, seed, driver):
        taken.append((seed, runs))
        return run_episodes(place, runs, seed=seed, driver=driver)

    monkeypatch.setattr(evolution, "run_episodes", recorded)
    return taken


def test_a_search_begins_at_follow_takes_training_draws_and_can_be_repeated(draws):
    found = []
    for seed in (5, 5, 6):
        watch = Generations(2)
        evolution.evolve(hall(6), OPTIONS, seed, watch, evolution.EvolutionSettings(population=4, draws=2))
        found.append(watch)
    first, again, other = found
    assert first.policies == again.policies and first.steps == again.steps and first.policies != other.policies
    assert first.policies[0] == Evolved(**{name: one.start for name, one in evolution.SEARCHED.items()})
    assert all(seed + runs <= HELD_OUT_SEED for seed, runs in draws)
    assert len({seed for seed, _ in draws[:8]}) == 2  # one set of draws a generation
    assert first.steps[0] == 0 < first.steps[1] < first.steps[2]


def test_a_search_finds_what_is_asked_for(monkeypatch):
    """With a made-up cost: the nearer to a spacing of 0.9 m the better."""

    (episode,) = run_episodes(hall(1), 1)

    def made_up(place, runs, *, seed, driver):
        last = 10.0 + (driver.policy.spacing - 0.9) ** 2
        return [episode._replace(metrics=episode.metrics._replace(evacuation_time=last))]

    monkeypatch.setattr(evolution, "run_episodes", made_up)
    watch = Generations(40)
    evolution.evolve(hall(1), OPTIONS, 0, watch)
    assert watch.policies[-1].spacing == pytest.approx(0.9, abs=0.05)


def test_who_does_not_get_out_counts_until_the_limit_and_decides_until_the_end():
    (episode,) = run_episodes(hall(3), 1)
    assert evolution.clearing_times([episode])[0] == episode.metrics.evacuation_time
    out = np.array([1.0, 2.05, np.nan])
    stuck = episode._replace(
        exit_time=out, end=5.0, time_limit=60.0, metrics=episode.metrics._replace(evacuation_time=np.nan)
    )
    assert evolution.clearing_times([stuck])[0] == 60.0
    assert evolution.decisions(stuck, 0.1) == 10 + 21 + 50
