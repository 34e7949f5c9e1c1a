"""The dilemma of a door: who is moved by whom, what a deviator gains, and what all lose where all push."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from cases import looped
from evaluations import made_up, random_policy

from crowd_env import CrowdEnv
from crowd_env.agents import make_policy
from crowd_env.agents.drivers import DrivenCrowd
from crowd_env.agents.evaluation import trained_run
from crowd_env.agents.evaluation.dilemma import (
    RandomSpeed,
    among,
    deterrent,
    exploitability,
    follow,
    free_walks,
    gain,
    payoffs,
    price_of_anarchy,
)
from crowd_env.agents.evaluation.entries import make_entries
from crowd_env.agents.evaluation.evaluation import evaluate_crowd
from crowd_env.agents.mixed import MixedEnv, learned_people
from crowd_env.agents.rules import StandStill, StrategyPolicy
from crowd_env.agents.tasks import TASKS, Task
from crowd_env.agents.training_config import make_env, task_config
from crowd_env.agents.walking import LEADER, Overtaking, RuleAtShare
from crowd_env.core.files.json_file import read_json
from crowd_env.envs.tasks.task import HELD_OUT_SEED

PUSH, QUEUE = StrategyPolicy("shortest", name="rule"), make_policy("evolution")
DOOR = Task(
    "door",
    "ten people",
    scenario="room-v0",
    options={"side": 6.0, "door_width": 1.0},
    people=10,
    scheme="nsm2",
    dt=0.01,
    time_limit=40.0,
    blocked_after=20.0,
    frozen="",
)


def mixed(share=0.7, **options):
    return MixedEnv(DOOR.place(), share=share, **options)


# ----------------------------------------------------------------------------------------------------- who is moved by whom


def test_as_many_push_in_every_episode_and_others_each_time():
    env = mixed(num_envs=4)
    drawn = []
    for _ in range(5):
        env.reset(0 if not drawn else None)
        drawn += list(env.learned.reshape(4, 10).copy())
    assert {int(one.sum()) for one in drawn} == {7} and len({one.tobytes() for one in drawn}) > 10
    again = mixed(num_envs=4)
    again.reset(0)
    np.testing.assert_array_equal(again.learned.reshape(4, 10), drawn[:4])
    again.reset([8, 8, 8, 8], mask=[False, True, False, False])
    drawn[1] = learned_people([8], 10, 0.7)[0]
    np.testing.assert_array_equal(again.learned.reshape(4, 10), drawn[:4])


def test_an_episode_that_begins_by_itself_draws_them_anew():
    env = mixed(share=0.5, time_limit=0.3, autoreset=True)
    env.reset(3)
    drawn = set()
    for _ in range(12):
        drawn.add(env.learned.tobytes())
        assert env.learned.sum() == 5
        env.step(np.zeros((10, 2)))
    assert len(drawn) == 4 or len(drawn) == 5


def test_pushers_walk_whatever_their_action_and_nobody_is_told_who_they_are():
    env, plain = mixed(), CrowdEnv(DOOR.place())
    np.testing.assert_array_equal(env.reset([5])[0], plain.reset([5])[0])
    np.testing.assert_array_equal(env.learned, learned_people([5], 10, 0.7)[0])
    for _ in range(5):
        env.step(np.zeros((10, 2)))
        plain.step(np.zeros((10, 2)), ~env.learned)
    np.testing.assert_array_equal(env.simulation.state.position, plain.simulation.state.position)
    assert np.hypot(*env.simulation.state.velocity[~env.learned].T).min() > 0.3


def test_others_walk_as_their_policy_says():
    env = mixed(others=StandStill())
    env.reset([5])
    for _ in range(5):
        env.step(None)  # those whom actions move walk at full speed
    speed = np.hypot(*env.simulation.state.velocity.T)
    assert speed[env.learned].min() > 0.3 and np.median(speed[~env.learned]) < 0.05


@looped("policy", [PUSH, random_policy(2, action="discrete"), QUEUE, random_policy(1)], lambda one: one.name, quick=2)
def test_a_crowd_whose_others_follow_the_same_policy_is_that_crowd(policy):
    one, both = follow(policy, DOOR, runs=4), follow(policy, DOOR, runs=4, deviator=policy, share=0.4)
    np.testing.assert_array_equal(one.exit_times, both.exit_times)
    assert both.learned.sum(axis=1).tolist() == [4] * 4
    out = np.isfinite(np.where(both.learned, one.exit_times, 0.0)).all(axis=1)
    assert gain(one, both)["mean"] == (0.0 if out.any() else None)
    assert out.all() or policy not in (PUSH, QUEUE)


def test_what_cannot_move_others_is_refused():
    with pytest.raises(ValueError, match="cannot move the others"):
        mixed(others=random_policy(0, frame="world"))
    with pytest.raises(ValueError, match="a policy moves everyone: there is no background"):
        among(QUEUE, PUSH, DOOR, runs=1)


def test_a_network_finds_its_terms_among_more():
    own, policy = random_policy(3).env_options["observation"], random_policy(3)
    more = replace(own, terms=("push", LEADER, *reversed([one for one in own.terms if one != "push"])))
    seen = np.random.default_rng(0).uniform(-1.0, 1.0, (5, more.size)).astype(np.float32)
    alone = np.hstack([seen[:, more[name]] for name in own.names])
    acts = policy.act(seen, more, None)
    np.testing.assert_array_equal(acts, policy.act(alone, own, None))
    assert len(np.unique(acts)) > 1
    for other in (replace(more, neighbors=own.neighbors + 1), replace(own, terms=own.terms[:-1])):
        with pytest.raises(ValueError, match="was trained on other observations"):
            policy.act(np.zeros((5, other.size), dtype=np.float32), other, None)


def test_policies_that_observe_different_things_walk_side_by_side():
    rule, network = make_policy("follow"), random_policy(1)
    found = follow(rule, DOOR, runs=2, deviator=network, share=0.3)
    np.testing.assert_array_equal(found.learned, learned_people(range(HELD_OUT_SEED, HELD_OUT_SEED + 2), 10, 0.3))
    assert np.nanmax(np.abs(np.array(found.exit_times) - follow(rule, DOOR, runs=2).exit_times)) > 0.1


def test_a_task_says_whom_policies_move():
    task, place = replace(DOOR, learned_share=0.8), DOOR.place()
    (entry,) = make_entries(["stand-still"], place, task)
    found = evaluate_crowd(entry.driver(place), runs=2)
    np.testing.assert_array_equal(found.learned, learned_people(range(HELD_OUT_SEED, HELD_OUT_SEED + 2), 10, 0.8))
    assert task.digest() != DOOR.digest()


def test_what_stands_beside_a_training_in_a_mixed_task_can_be_mixed():
    beside = {name: trained_run.named_beside(task_config(name)) for name in ("dilemma-door", "dilemma-mixed")}
    assert set(beside["dilemma-door"]) - set(beside["dilemma-mixed"]) == {"headway"}
    for name, policies in beside.items():
        assert [one.name for one in make_entries(policies, TASKS[name].place(), TASKS[name])] == list(policies)


def test_those_who_push_are_no_part_of_what_is_learned():
    pytest.importorskip("stable_baselines3")
    from crowd_env.envs.adapters.sb3 import CrowdVecEnv

    venv = CrowdVecEnv(make_env(task_config("dilemma-mixed"), envs=2))
    venv.seed(0)
    venv.reset()
    learned = venv.env.learned.copy()
    venv.step(np.zeros(venv.num_envs))
    assert learned.sum() == 2 * 48
    np.testing.assert_array_equal(venv.acted, learned)


def test_both_dilemmas_are_the_competitive_door():
    door, mix = TASKS["dilemma-door"], TASKS["dilemma-mixed"]
    assert door.digest() == TASKS["competitive-door"].digest() != mix.digest()
    assert (door.learned_share, mix.learned_share) == (None, 0.8) and door.selfish and mix.selfish


# ----------------------------------------------------------------------------------------------------------- what it costs


def test_one_who_pushes_among_people_who_dawdle_gains_the_difference():
    dawdle = RuleAtShare(0.3)
    crowd, mix = follow(dawdle, DOOR, runs=6), follow(dawdle, DOOR, runs=6, deviator=PUSH)
    found, who = gain(crowd, mix), mix.learned
    assert who.sum(axis=1).tolist() == [1] * 6
    before, after = np.array(crowd.exit_times)[who], np.array(mix.exit_times)[who]
    assert found["mean"] == pytest.approx((before - after).mean()) and found["mean"] > 1.0
    assert found["share"] == pytest.approx(1.0 - after.mean() / before.mean()) and found["draws"] == 6
    for one in (crowd, mix):
        with pytest.raises(ValueError, match="no more pedestrians deviate"):
            gain(one, one)
    still = follow(StandStill(), DOOR, runs=2)
    assert gain(still, follow(StandStill(), DOOR, runs=2, deviator=PUSH))["share"] is None


def test_who_switches_as_the_first_gains_what_a_single_deviator_gains():
    none, one, four, five = (
        follow(QUEUE, DOOR, runs=6, deviator=PUSH if k else None, share=k / 10) for k in (0, 1, 4, 5)
    )
    alone, later = gain(none, one), gain(four, five)
    assert alone == gain(none, follow(QUEUE, DOOR, runs=6, deviator=PUSH)) and alone["mean"] > 0.0
    who = five.learned & ~four.learned
    assert who.sum(axis=1).tolist() == [1] * 6
    sooner = np.array(four.exit_times)[who] - np.array(five.exit_times)[who]
    assert later["mean"] == pytest.approx(sooner.mean()) and later["mean"] != gain(none, five)["mean"]


def test_people_left_inside_count_to_the_limit_in_what_is_counted():
    still, free = follow(StandStill(), DOOR, runs=3), follow(StandStill(), DOOR, runs=3, deviator=PUSH)
    found, out = gain(still, free), np.array(free.exit_times)[free.learned]
    assert found["mean"] is None and found["draws"] == 0
    assert found["counted"]["mean"] == pytest.approx((DOOR.time_limit - out).mean()) and np.isfinite(out).all()


@looped("crowd", [QUEUE, PUSH, RuleAtShare(0.3), StandStill()], lambda one: one.name, quick=2)
def test_nobody_gains_more_than_to_be_out_after_the_free_walk(crowd):
    alike = {"side": 10.0, "door_width": 1.0, "desired_speed": 2.0}  # slow people are pushed beyond their speed
    task = replace(DOOR, scenario="lin-room-v0", options=alike, scheme="hertz", dt=0.005)
    free, all_follow = free_walks(task, runs=6), follow(crowd, task, runs=6)
    tried = {one.name: follow(crowd, task, runs=6, deviator=one) for one in (PUSH, QUEUE, Overtaking())}
    for one in (all_follow, *tried.values()):  # others push a body forward for some hundredths of a second
        assert (np.nan_to_num(one.exit_times, nan=np.inf) > free - 0.05).all()
    found = exploitability(all_follow, tried, free)
    assert found["gain"]["overtaking"] == found["gain"]["rule"]
    gains = [one["mean"] or 0.0 for one in found["gain"].values()]
    assert found["below"]["mean"] == max(0.0, *gains) <= (found["above"]["mean"] or 0.0)
    assert (found["tried"] is None) == (max(gains) <= 0.0)


def test_a_free_walk_is_that_of_one_alone():
    alone = replace(DOOR, people=1)
    (out,), (free,) = np.array(follow(PUSH, alone, runs=8).exit_times).T, free_walks(alone, runs=8).T
    assert (out > free - alone.dt).all() and out - free == pytest.approx(0.2, abs=0.25)
    place = alone.place()
    env = CrowdEnv(place, num_envs=8, **alone.arguments())
    env.reset(list(range(HELD_OUT_SEED, HELD_OUT_SEED + 8)))
    (start, end), position = place.geometry.exits[0], env.simulation.state.position
    straight = np.min([np.hypot(*(position - (start + k * (end - start))).T) for k in np.linspace(0, 1, 999)], axis=0)
    speed, tau = env.simulation.bodies.desired_speed, env.simulation.bodies.relaxation_time
    assert speed * (free - tau * (1.0 - np.exp(-free / tau))) == pytest.approx(straight, abs=1e-4)


def test_a_policy_that_deviates_to_itself_is_not_exploited():
    crowd, same = follow(QUEUE, DOOR, runs=4), follow(QUEUE, DOOR, runs=4, deviator=QUEUE)
    found = exploitability(crowd, {"same": same}, free_walks(DOOR, runs=4))
    assert found["tried"] is None and found["below"] == {"mean": 0.0, "share": 0.0} and found["above"]["mean"] > 0.0


def test_the_price_of_anarchy_counts_blocked_runs_where_there_are_any():
    crowd, slow = payoffs(follow(QUEUE, DOOR, runs=4)), payoffs(follow(RuleAtShare(0.3), DOOR, runs=4))
    price = price_of_anarchy(slow, crowd)
    assert price["counted"] == price["mean_exit"] > 1.0  # nothing blocks
    assert set(price_of_anarchy(crowd, crowd).values()) == {1.0}
    still = payoffs(follow(StandStill(), DOOR, runs=2))
    price = price_of_anarchy(still, crowd)
    assert price["mean_exit"] is price["last_exit"] is None and still["blocked"] == 2
    assert price["counted"] == pytest.approx(DOOR.time_limit / crowd["mean_exit"]["mean"])


def test_people_are_judged_among_others_of_any_kind():
    task = replace(DOOR, learned_share=0.6)
    same = among(QUEUE, QUEUE, task, runs=3)
    np.testing.assert_array_equal(same.exit_times, follow(QUEUE, DOOR, runs=3).exit_times)
    np.testing.assert_array_equal(same.learned, learned_people(range(HELD_OUT_SEED, HELD_OUT_SEED + 3), 10, 0.6))
    found = {one.name: among(QUEUE, one, task, runs=3) for one in (PUSH, RandomSpeed(), make_policy("headway"))}
    (pushed,) = (
        evaluate_crowd(one.driver(DOOR.place()), runs=3) for one in make_entries(["evolution"], DOOR.place(), task)
    )
    np.testing.assert_array_equal(found["rule"].exit_times, pushed.exit_times)
    part = DrivenCrowd(QUEUE, task.place(), {**task.arguments(), "walking": "hurried"}, learned_share=0.6)
    np.testing.assert_array_equal(found["headway"].exit_times, evaluate_crowd(part, runs=3).exit_times)
    assert len({one.exit_times[0].tobytes() for one in found.values()}) == 3


def test_payoffs_of_both_kinds_make_up_those_of_all():
    found = payoffs(follow(QUEUE, DOOR, runs=5, deviator=PUSH, share=0.3))
    means = [found[f"mean_exit{name}"]["mean"] for name in ("", "_deviators", "_others")]
    assert means[0] == pytest.approx(0.3 * means[1] + 0.7 * means[2])
    assert means[0] < found["last_exit"]["mean"] and found["blocked"] == 0


def test_at_the_price_that_deters_who_pushes_earns_what_the_others_earn():
    task = replace(DOOR, scheme="hertz", dt=0.005, people=20)
    price = deterrent(QUEUE, task, runs=6, deviator=PUSH, share=0.3)
    assert 0.0 < price < 100.0
    part = DrivenCrowd(PUSH, task.place(), task.arguments("hertz"), learned_share=0.3, others=QUEUE)
    driver = replace(part, arguments={**part.arguments, "reward": {"time": 1.0, "contact": price}})(6)
    driver.reset([HELD_OUT_SEED + k for k in range(6)])
    earned, env = np.zeros(driver.env.num_people), driver.env
    while not env.finished.all():
        earned += driver.step().reward
    assert np.isfinite(env.simulation.state.exit_time).all()
    assert earned[env.learned].mean() == pytest.approx(earned[~env.learned].mean())
    assert np.isnan(deterrent(StandStill(), DOOR, runs=1, deviator=PUSH, share=0.3))


# --------------------------------------------------------------------------------------------------------------- learning


@looped(
    ("task", "share", "kept"), [("dilemma-mixed", 0.8, 2), ("dilemma-door", None, 2), ("competitive-door", None, 1)]
)
def test_a_selfish_training_keeps_its_last_network(task, share, kept, tmp_path, monkeypatch):
    pytest.importorskip("stable_baselines3")
    from crowd_env.agents.learned import callbacks, significance_test

    asked, saved, times = [], [], [32.0, 31.0, 33.0]

    def evaluated(who, place, **options):
        asked.append(options["learned_share"])
        return made_up("learned", "hertz", 3 * [times[len(asked) - 1]])

    monkeypatch.setattr(callbacks, "evaluate", evaluated)
    folder, config = tmp_path / task, task_config(task)
    folder.mkdir()
    callback = callbacks.RunCallback(folder, config, lambda row: None)
    for k in range(3):
        callback.evaluate(SimpleNamespace(save=lambda path, k=k: saved.append((path.name, k))))
    looks = {"0.safetensors": 2}
    assert asked == 3 * [share] and dict(saved) == {"start.safetensors": 0, "best.safetensors": kept, **looks}
    (folder / "start.safetensors").unlink(missing_ok=True)
    significance_test.compare_with_start(folder, config)
    assert significance_test.kept_row(folder, callback.curve) is callback.curve[kept]


@pytest.mark.more
def test_a_measurement_goes_on_after_a_stop(tmp_path, monkeypatch):
    pytest.importorskip("stable_baselines3")
    from crowd_env.agents.learned import dilemma

    made = []

    def trained(*of):
        made.append(of)
        return random_policy(0, action="discrete")

    def stopped(*of):
        raise KeyboardInterrupt

    short = replace(DOOR, time_limit=8.0)
    tasks = {"dilemma-door": short, "dilemma-mixed": replace(short, learned_share=0.8)}
    monkeypatch.setattr(dilemma, "_TRAINED", {name: dilemma._TRAINED[name] for name in dilemma._FOCAL[2:]})
    small = {"_RUNS": 2, "_FEW": 2, "SHARES": (0.1, 0.5), "make_task": tasks.get, "train_crowd": trained}
    small |= {"best_response": trained, "searched_response": lambda *of: Overtaking((0.1,) * 22)}
    for name, value in small.items():
        monkeypatch.setattr(dilemma, name, value)
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(dilemma, "_at_share", stopped)
        dilemma.measure(tmp_path)
    assert len(made) == 2 + 5 and not (tmp_path / "results.json").exists()
    for name in ("train_crowd", "best_response", "searched_response", "_gains"):
        monkeypatch.setattr(dilemma, name, stopped)
    dilemma.measure(tmp_path)
    found = read_json(tmp_path / "results.json")
    assert [len(found[name]) for name in ("rows", "shares", "backgrounds")] == [5, 2, 6]
    assert found["shares"][0]["switch"] == found["rows"][1]["gain"]["push"]  # the first who switches deviates alone
    monkeypatch.setattr(dilemma, "_RUNS", 3)
    with pytest.raises(ValueError, match="results of another command: runs is 2 there and 3 here"):
        dilemma.measure(tmp_path)


def test_a_search_begins_at_full_speed():
    pytest.importorskip("stable_baselines3")
    pytest.importorskip("cma")
    from crowd_env.agents.learned import dilemma

    config = replace(task_config("dilemma-door"), people=20)
    env = dilemma._among(QUEUE, config, "continuous", 3)
    sideways = np.zeros(22)
    sideways[17] = 1.0
    times = dilemma._times(env, np.array([np.zeros(22), np.full(22, -1.0), sideways]), [5, 5, 5])
    env.reset([5, 5, 5])
    who = env.learned & (env.env_of_person == 0)
    while (who & env.active).any():
        env.step(None)  # pedestrians that actions move walk at full speed
    assert times[0] == pytest.approx(env.simulation.state.exit_time[who].mean())
    assert times[0] < times[2] < times[1] <= dilemma._LIMIT


@pytest.mark.more
def test_who_learns_among_people_in_the_way_does_not_stand_still():
    pytest.importorskip("stable_baselines3")
    from crowd_env.agents.learned.dilemma import best_response

    found = best_response(QUEUE, "dilemma-door", steps=1_000_000)
    gains = gain(follow(QUEUE, DOOR, runs=4), follow(QUEUE, DOOR, runs=4, deviator=found, share=0.1))
    assert gains["mean"] > -2.0  # processors differ in the last digit, and so by 0.2 s here; standing still costs 36 s
