"""People who leave by the way that they came from have not got out: positions and exits, not what the judge says of them."""

import numpy as np
import pytest

from crowd_env import make_scenario
from crowd_env.agents.drivers import drive
from crowd_env.agents.evaluation.evaluation import evaluate
from crowd_env.agents.evaluation.goals import strayed
from crowd_env.agents.evaluation.plans import judge_plan
from crowd_env.agents.walking import Evolved, RuleAtShare
from crowd_env.envs.rollout import run_episodes
from crowd_env.scenarios.generated import draw_place, kind_of

BACK = Evolved(own=0.0, far=0.0, density=0.0, close=0.0, match=0.0, crowd=0.0, always=-2.0)  # at full speed


@pytest.mark.parametrize("place", ["counter-flow-v0", "crossing-v0"])
def test_people_of_a_route_are_out_by_its_exit_alone(place):
    place = make_scenario(place, people=8)
    forth, back = (evaluate(who, place, runs=3, first_seed=0, measure=True) for who in (RuleAtShare(1.0), BACK))
    assert not forth.column("unfinished").any() and np.isfinite(forth.column("evacuation_time")).all()
    # In the corridor they leave by the exit behind them, where streams cross they stand at a wall.
    assert (back.column("unfinished") == 8).all() and np.isnan(back.column("evacuation_time")).all()
    assert np.isnan(back.exit_times).all() and (back.row()["unfinished"], back.row()["unfinished_runs"]) == (24, 3)


def test_it_is_the_physics_that_lets_them_out():
    place = make_scenario("counter-flow-v0", people=8)
    for episode in run_episodes(place, 3, driver=drive(BACK, place)):
        assert episode.metrics.unfinished == 0
        assert strayed(episode.exit_index, place).all()


def test_those_without_a_route_may_leave_anywhere():
    place = make_scenario("two-exit-hall-v0", people=6)
    for index in range(len(place.exits)):
        assert not strayed(np.full(6, index), place).any()
    assert not strayed(np.full(6, -1), make_scenario("counter-flow-v0", people=6)).any()  # inside


def test_each_run_is_a_row():
    place = make_scenario("counter-flow-v0", people=2)
    west, east = (place.geometry.exit_names.index(name) for name in ("west", "east"))
    assert strayed(np.array([[east, west], [west, east], [east, -1]]), place).tolist() == [
        [False, False],
        [True, True],
        [False, False],
    ]


def test_no_generated_place_is_cleared_by_walking_back():
    seed = next(s for s in range(1000) if kind_of(s) == "counter-flow" and draw_place(seed=s).population.people <= 14)
    people = draw_place(seed=seed).population.people
    back, forth = judge_plan(BACK, seed), judge_plan("rule", seed)
    assert (back.left, back.strayed, back.time) == (0, people, np.inf) and forth.left == forth.strayed == 0 < forth.time
