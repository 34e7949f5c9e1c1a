"""A task is an environment: by its name or id everywhere, with law, step, observation, action and reward of its own."""

import warnings

import gymnasium
import numpy as np
import pettingzoo
import pytest
from cases import looped
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test

from crowd_env import SCENARIOS, TASKS, CrowdEnv, Physics, make_scenario, make_task, make_vec, parallel_env
from crowd_env.envs.tasks.task import HELD_OUT_SEED

WALKED = [name for name, task in TASKS.items() if task.people <= 150]


@looped("name", WALKED)
def test_it_is_made_by_its_name_and_is_as_the_task_says(name):
    task = make_task(name)
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)  # nothing is another than in the task
        env, alike = CrowdEnv(name), CrowdEnv(task)
    assert env.task is alike.task is task and env.id == alike.id == task.id and not env.changed
    assert env.num_people == task.people and env.decision_dt == task.decision_dt
    assert env.physics.law.info.name == task.scheme and env.simulation.dt == task.dt
    assert env.time_limit.tolist() == [task.time_limit] and list(env.layout.names) == list(task.terms)
    assert env.reward_weights.weights == task.reward["weights"]
    assert env.walking.share == task.learned_share


@looped("name", [name for name in WALKED if TASKS[name].decides == "walking"], quick=3)
def test_the_checkers_of_the_libraries_accept_it(name):
    parallel_api_test(parallel_env(name), num_cycles=3)
    check_env(gymnasium.make(f"crowd_env/{TASKS[name].id}").unwrapped, skip_render_check=True)


@looped("name", [name for name in WALKED if TASKS[name].decides == "routing"], quick=2)
def test_one_controller_has_a_task_of_routes(name):
    env = gymnasium.make(f"crowd_env/{TASKS[name].id}")
    check_env(env.unwrapped, skip_render_check=True)
    inner = env.unwrapped.batch.env
    assert inner.num_people == TASKS[name].people and inner.physics.law.info.name == TASKS[name].scheme


def test_registries_list_every_task_under_a_name_that_is_no_version_of_a_scenario():
    ids = {f"crowd_env/{task.id}" for task in TASKS.values()}
    assert ids <= set(gymnasium.registry)
    walked = {f"crowd_env/{task.id}" for task in TASKS.values() if task.decides == "walking"}
    assert walked <= set(pettingzoo.parallel_registry) and walked <= set(pettingzoo.aec_registry)
    base = [identity.rpartition("-v")[0] for identity in gymnasium.registry if identity.startswith("crowd_env/")]
    assert len(base) == len(set(base))


def test_what_is_another_than_in_the_task_is_said_and_the_id_marks_it():
    with pytest.warns(
        UserWarning, match="narrow-door-v. with another physics, reward, people: its figures do not stand"
    ):
        env = CrowdEnv("narrow-door", people=20, physics="dem", reward={"time": 1.0}, observation=None)
    assert env.id == f"{make_task('narrow-door').id} with another physics, reward, people"
    assert env.num_people == 20 and env.physics.law.info.name == "dem"
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        assert not CrowdEnv("narrow-door", physics={"threads": 2}, people=80, time_limit=60.0).changed
        slow = CrowdEnv("hertz-room", physics={"threads": 2})
    assert slow.physics.law.info.name == "hertz" and slow.simulation.dt == 0.005
    with pytest.warns(UserWarning, match="another physics"):
        assert CrowdEnv("hertz-room", physics=Physics("hertz", dt=0.01)).changed == ("physics",)


MIXED_ID = f"crowd_env/{TASKS['dilemma-mixed'].id}"


@looped(
    "make",
    [
        lambda: gymnasium.make(MIXED_ID, people=9).unwrapped,
        lambda: gymnasium.make_vec(MIXED_ID, num_envs=2, people=9, physics="dem"),
        lambda: gymnasium.make_vec(MIXED_ID, num_envs=2, max_episode_steps=9),
        lambda: gymnasium.make(f"crowd_env/{TASKS['two-exit-hall'].id}", people=50).unwrapped,
    ],
)
@pytest.mark.filterwarnings("ignore:.*with another:UserWarning")
def test_the_spec_of_what_is_another_names_no_task(make):
    env = make()
    assert env.spec.id not in gymnasium.registry and env.env.changed
    assert env.spec.id == f"crowd_env/{env.env.id}".replace(",", "").replace(" ", "-")
    again = gymnasium.make(env.spec) if isinstance(env, gymnasium.Env) else gymnasium.make_vec(env.spec)
    assert again.unwrapped.spec.id == env.spec.id and again.unwrapped.env.num_people == env.env.num_people


def test_the_spec_of_a_task_and_of_a_place_is_theirs():
    for name in (MIXED_ID, "crowd_env/room-v0"):
        for env in (gymnasium.make(name), gymnasium.make_vec(name, num_envs=2)):
            assert env.unwrapped.spec.id == env.spec.id == name


def test_other_cycles_are_another_time_limit():
    env = parallel_env("narrow-door", max_cycles=5)
    assert env.env.changed == ("time_limit",) and env.env.id.endswith("with another time_limit")
    env = parallel_env("narrow-door", max_cycles=600)
    assert not env.env.changed


def test_infos_say_whom_actions_move():
    """Where a share of the people is: at resets and steps, each in the draw of its episode."""
    env = parallel_env("dilemma-mixed")
    seen = []
    for seed in (0, 1):
        _, infos = env.reset(seed=seed)
        moved = [infos[agent]["learned"] for agent in env.possible_agents]
        assert moved == env.env.learned.tolist() and 0 < sum(moved) < len(moved)
        *_, infos = env.step({})
        assert [infos[agent]["learned"] for agent in env.possible_agents] == moved
        seen.append(moved)
    assert seen[0] != seen[1]
    env = parallel_env("room-v0")
    assert not any(env.reset(seed=0)[1].values()) and "learned" not in env.step({})[4]["pedestrian_0"]


@looped("mode", ["SameStep", "NextStep", "Disabled"])
def test_infos_of_batches_say_whom_actions_move(mode):
    env = make_vec("room-v0", 2, people=8, time_limit=0.3, walking={"share": 0.5}, autoreset_mode=mode)
    _, info = env.reset(seed=0)
    first = info["learned"].copy()
    assert (first == env.env.learned.reshape(2, 8)).all() and (first.sum(axis=1) == 4).all()
    for _ in range(3):
        *_, info = env.step(np.ones(env.action_space.shape))
    if mode == "SameStep":  # the next episode has begun
        assert (info["final_info"]["learned"] == first).all() and (info["learned"] != first).any()
    else:
        assert (info["learned"] == first).all()
        if mode == "NextStep":
            *_, info = env.step(np.ones(env.action_space.shape))
            assert (info["learned"] != first).any()
    assert (info["learned"] == env.env.learned.reshape(2, 8)).all() and info["_learned"].all()


@looped("make", [CrowdEnv, lambda name: gymnasium.make(f"crowd_env/{make_task(name).id}").unwrapped.env])
def test_no_seed_draws_what_is_held_out(make):
    """A draw that is judged is never trained on: its seed gives another here."""
    task, env = make_task("narrow-door"), make("narrow-door")
    judged = CrowdEnv(task.place(), **task.arguments())
    for seed in (task.seeds.start, task.seeds.stop - 1):
        judged.reset([seed])
        env.reset([seed])
        assert not np.array_equal(judged.simulation.state.position, env.simulation.state.position)
        env.reset([seed % HELD_OUT_SEED])
        again = env.simulation.state.position.copy()
        env.reset([seed])
        np.testing.assert_array_equal(env.simulation.state.position, again)


@looped("leave", [True, False])
def test_the_info_of_the_end_holds_the_score(leave):
    """When the last pedestrian got out; inf if one is left: at full speed this door blocks."""
    if leave:
        with pytest.warns(UserWarning, match="another people"):
            env = parallel_env("narrow-door", people=4)
    else:
        env = parallel_env("narrow-door")
    env.reset(seed=0)
    fast = env.action_space(env.possible_agents[0]).n - 1
    infos = {}
    while env.agents:
        *_, infos = env.step(dict.fromkeys(env.agents, fast))
    scores = {info["score"] for info in infos.values()}
    metrics = next(iter(infos.values()))["metrics"]
    assert scores == ({metrics["evacuation_time"]} if leave else {np.inf})
    assert (metrics["unfinished"] == 0) == leave


def test_the_score_of_a_batch_stands_in_its_row():
    env = make_vec("narrow-door", num_envs=3, autoreset_mode="Disabled")
    env.reset(seed=0)
    fast = np.full(env.action_space.shape, 4)
    ended = np.zeros(3, bool)
    while not ended.all():
        *_, terminated, truncated, info = env.step(fast)
        ended = terminated | truncated
        if ended.any():
            assert (np.isinf(info["score"]) == (info["metrics"]["unfinished"] > 0))[ended].all()
            break


@looped(
    "where, name, said",
    [
        (CrowdEnv, "hurried", "'hurried' is a manner"),
        (lambda name: CrowdEnv("room-v0", physics=name), "narrow-door", "'narrow-door' is a task"),
        (lambda name: CrowdEnv("room-v0", walking=name), "dem", "'dem' is a contact scheme"),
        (make_task, "room-v0", "'room-v0' is a scenario"),
        (CrowdEnv, "narrow-door-v1", "the task narrow-door is at version"),
    ],
)
def test_a_name_of_another_kind_is_answered_so(where, name, said):
    with pytest.raises(ValueError, match=said):
        where(name)


def test_the_place_of_a_task_is_a_place():
    place = make_scenario("narrow-door", people=10)
    assert place.name == "narrow-door" and place.population.people == 10
    assert "narrow-door" not in SCENARIOS


@looped("place", [["hertz-room"], {"name": "hertz-room"}, ["room-v0", {"name": "narrow-door", "people": 5}]])
def test_a_task_within_a_list_or_a_table_is_refused(place):
    with pytest.raises(ValueError, match="stands alone, not in a list or a table: say scenario="):
        CrowdEnv(place, num_envs=2)


def test_a_task_of_routes_says_what_is_another_too():
    with pytest.warns(UserWarning, match="two-exit-hall-task-v. with another physics, people"):
        env = gymnasium.make(f"crowd_env/{TASKS['two-exit-hall'].id}", people=50, physics="dem").unwrapped
    assert env.env.changed == ("physics", "people") and env.env.num_people == 50


def test_a_vec_env_has_the_score_too():
    from crowd_env.envs.adapters.sb3 import CrowdVecEnv

    with pytest.warns(UserWarning, match="another people"):
        env = CrowdVecEnv("narrow-door", num_envs=1, people=4)
    env.reset()
    dones = np.zeros(4, bool)
    while not dones.any():
        _, _, dones, infos = env.step(np.full(4, 4))
    assert {info["score"] for info in infos} == {env.take_finished()[0].evacuation_time}
