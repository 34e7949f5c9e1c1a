"""The comparison of algorithms over seeds: its statistics against those of another library, and the command."""

import json
from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest
from cases import looped
from evaluations import random_policy
from repository import ROOT
from typer.testing import CliRunner

from crowd_env.agents.benchmark import jobs, report
from crowd_env.agents.benchmark.jobs import ALGORITHMS, BOUND, TASKS, Algorithm, Job, Plan, checkpoint, do, made_by_of
from crowd_env.agents.benchmark.report import bootstrap_interval, interquartile_mean, score, summarize, table
from crowd_env.agents.rules import ShortestPath
from crowd_env.agents.training_config import task_config
from crowd_env.agents.walking import Evolved
from crowd_env.cli.agents import benchmark as command

TEN = [70.38, 69.6, 71.92, 70.31, 68.39, 71.08, 73.91, 72.84, 67.89, 66.2]
FIVE = [61.38, 62.04, 59.67, 61.78, 60.75]


# ------------------------------------------------------------------------------------------------------ the statistics


def test_interquartile_means_and_intervals_are_those_of_rliable():
    """By `rliable` 1.2.0 with 50 000 resamples."""
    for values, middle in ((TEN, 70.28), (FIVE, 61.303333)):
        assert interquartile_mean(np.array(values)) == pytest.approx(middle, abs=1e-6)
    assert bootstrap_interval(TEN) == pytest.approx((68.675, 71.868333), abs=0.1)


def test_few_seeds_have_no_interval_and_an_interval_is_always_the_same():
    assert np.isnan([bootstrap_interval(TEN[:count]) for count in (1, 5, 9)]).all()
    assert bootstrap_interval(TEN) == bootstrap_interval(TEN)


@looped("hump", [50.0, 60.0])
def test_an_interval_that_is_given_holds_the_true_value_about_as_often_as_it_says(hump, monkeypatch):
    """Of the interquartile mean of normal values, and of two humps; as 400 trials of ten seeds can tell."""
    monkeypatch.setattr(report, "_RESAMPLES", 1000)
    rng = np.random.default_rng(0)

    def draw(count):
        return rng.normal(np.where(rng.random(count) < 0.6, 50.0, hump), 1.5)

    true = interquartile_mean(draw(400_000))
    held = [low <= true <= high for low, high in (bootstrap_interval(draw(10)) for _ in range(400))]
    assert 0.88 < np.mean(held) < 0.98


def training(seed, times, scores=(0.0, 0.5, 1.0), steps=(0, 10, 20), bound=10.0):
    """Return what a training of these held-out times [s] leaves: its curve has one run a checkpoint."""
    curve = [
        {"steps": at, "seconds": float(at), "clearing_times": [bound / one if one else None]}
        for at, one in zip(steps, scores, strict=True)
    ]
    held_out = {"clearing_times": times, "mean_exits": [1.0]}
    return {"seed": seed, "start": "rule", "bound": bound, "curve": curve, "best": 0, "held_out": held_out}


def test_a_score_is_the_bound_over_the_time_and_nothing_where_somebody_is_left():
    assert score([20.0, 40.0, None, np.nan], 10.0) == pytest.approx((0.5 + 0.25) / 4)


def test_a_table_of_few_seeds_shows_the_mean_alone():
    found = [training(k, [50.0 + k]) for k in range(5)]
    assert "| 52.0 |" in table(summarize({"ppo": {"a": found}}))
    assert "52.0 [" in table(summarize({"ppo": {"a": 2 * found}}))


def test_seeds_are_drawn_within_each_task():
    """Two tasks of which each is the same for all seeds: no draw of seeds changes anything."""
    assert bootstrap_interval([0.2] * 10, [0.8] * 10) == pytest.approx((0.5, 0.5))
    low, high = bootstrap_interval([0.2] * 10 + [0.8] * 10)
    assert low < 0.4 and high > 0.6
    assert np.isnan(bootstrap_interval([0.2] * 10, [0.8] * 9)).all()


def test_equal_decisions_are_those_that_every_algorithm_has_had():
    slow, fast = training(0, [20.0], steps=(0, 10, 20)), training(0, [20.0], steps=(0, 100, 200))
    rows = summarize({"ppo": {"a": [slow]}, "mappo": {"a": [fast]}})
    assert rows["ppo"]["score_at"]["iqm"] == pytest.approx(1.0) and rows["ppo"]["equal"] == {"a": 20}
    assert rows["mappo"]["score_at"]["iqm"] == pytest.approx(0.1)  # on the way from 0 to .5 within 100 decisions


def test_a_score_over_tasks_is_of_all_their_seeds():
    rows = summarize({"ppo": {"a": [training(0, [10.0])], "b": [training(0, [20.0])]}})["ppo"]
    assert rows["score"]["iqm"] == pytest.approx(0.75)
    assert rows["tasks"]["b"]["clearing_time"]["iqm"] == 20.0 and rows["tasks"]["b"]["decisions"] == 20


# --------------------------------------------------------------------------------------------------------- the command


def quick(config, callback):
    """An "algorithm" that stands in place, then knows how."""
    callback.seconds, callback.checkpoints = 1e-9, 1e9  # always due
    for steps, policy in enumerate((ShortestPath(), Evolved(), ShortestPath())):
        callback.on_update(steps, lambda policy=policy: policy)


@pytest.fixture
def small(monkeypatch):
    """Small evaluations: one draw stands for all, and one algorithm that trains nothing."""
    calls = []

    def evaluated(policy, place, *, runs, first_seed, **options):
        calls.append((policy.name, runs, first_seed))
        time = 50.0 if isinstance(policy, Evolved) else 80.0
        unfinished = np.array([0.0] * (runs - 1) + [0.0 if isinstance(policy, Evolved) else 3.0])
        columns = {"unfinished": unfinished, "blocked_since": np.where(unfinished > 0, 20.0, np.nan)}
        times = np.full((runs, 4), time) + np.arange(runs)[:, None]
        exits = np.where(unfinished[:, None] > 0, np.nan, times)
        constants = asdict(policy) if isinstance(policy, Evolved) else {}
        found = {"times_of_all": lambda: times, "exit_times": exits, "constants": constants}
        return SimpleNamespace(column=columns.__getitem__, **found)

    def compared(entries, place, physics, *, runs):
        return [evaluated(one.policy, place, runs=runs, first_seed=1_000_000) for one in entries]

    monkeypatch.setattr(jobs, "evaluate", evaluated)
    monkeypatch.setattr(jobs, "compare", compared)
    monkeypatch.setattr(jobs, "bound_time", lambda task: 25.0)
    from crowd_env.agents.learned import algorithms

    monkeypatch.setattr(algorithms, "TRAIN", {"quick": quick})
    known = {"quick": Algorithm("for tests"), "ppo": ALGORITHMS["ppo"]}
    for module in (command, jobs, report):
        monkeypatch.setattr(module, "ALGORITHMS", known)
    return calls


def call(*args):
    result = CliRunner().invoke(command.app, [str(arg) for arg in args])
    return result.exit_code, result.stdout, result.stderr


def arguments(folder, *more):
    plan = ("--tasks", "competitive-door", "--algorithms", "quick", "--baselines", "follow", "rule", "--runs", 4)
    return (*plan, "--out", folder, *more)


@pytest.mark.more
def test_the_command_trains_every_seed_once_and_goes_on_where_it_was(small, tmp_path):
    code, out, err = call(*arguments(tmp_path, "--seeds", 2))
    assert code == 0, err
    pieces = [f"{name}.json" for name in (BOUND, "follow", "quick-seed0", "quick-seed1", "rule")]
    assert sorted(path.name for path in (tmp_path / "competitive-door").iterdir()) == pieces
    pictures = [f"algorithms-{name}.png" for name in ("decisions", "profiles", "seconds")]
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        *pictures,
        "competitive-door",
        "summary.json",
        "table.md",
    ]
    rows = json.loads((tmp_path / "summary.json").read_text())["rows"]
    found = rows["quick"]["tasks"]["competitive-door"]
    assert rows["quick"]["seeds"] == 2 and found["clearing_time"]["iqm"] == 51.5 and found["runs"] == 8
    assert rows["quick"]["score"]["iqm"] == pytest.approx(np.mean([25.0 / one for one in (50, 51, 52, 53)]))
    assert rows["rule"]["tasks"]["competitive-door"]["unfinished"] == 1
    assert "| `quick` | full speed | 2 | 51.5 |" in out and "left in 1 of 4" in out
    made = len(small)
    code, again, _ = call(*arguments(tmp_path, "--seeds", 2))
    assert code == 0 and again == out and len(small) == made
    assert call(*arguments(tmp_path, "--seeds", 3))[0] == 0 and len(small) == made + 4


def test_the_best_checkpoint_is_judged_and_no_held_out_draw_is_seen_before(small, tmp_path):
    assert call(*arguments(tmp_path, "--seeds", 1))[0] == 0
    found = json.loads((tmp_path / "competitive-door" / "quick-seed0.json").read_text())
    assert found["best"] == 1 and len(found["curve"]) == 3 and found["constants"]["crowd"] == Evolved().crowd
    assert found["held_out"]["clearing_times"] == [50.0, 51.0, 52.0, 53.0]
    assert [seed for _, runs, seed in small if runs == 12] == [2_000_000] * 3  # validation
    assert [seed for _, runs, seed in small if runs == 4] == [1_000_000] * 3  # held out


def test_what_another_process_is_about_is_left_alone(small, tmp_path):
    import fcntl

    plan, job = Plan(1.0, runs=4), Job("competitive-door", "quick", 0)
    (tmp_path / job.task).mkdir()
    with (tmp_path / job.task / ".quick-seed0.claim").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert do(job, plan, tmp_path) is None and not small
    assert do(job, plan, tmp_path)["seed"] == 0 and small


def test_results_of_another_plan_are_not_mixed(small, tmp_path):
    assert call(*arguments(tmp_path, "--seeds", 1))[0] == 0
    code, _, err = call(*arguments(tmp_path, "--seeds", 1, "--minutes", 3))
    assert code != 0 and "minutes is 2.0 there and 3.0 here; name another folder" in " ".join(err.split())


def test_results_of_other_parameters_or_another_version_are_not_taken_for_todays(small, tmp_path, monkeypatch):
    assert call(*arguments(tmp_path, "--seeds", 1))[0] == 0
    name, made = tmp_path / "competitive-door" / "quick-seed0.json", len(small)
    kept = name.read_text()
    for change, words in (
        (lambda by: by["config"]["ppo"].update(learning_rate=123.0), "config.ppo.learning_rate is 123.0 there and"),
        (lambda by: by["config"].update(scheme="other"), "config.scheme is other there and hertz here"),
        (lambda by: by.update(task_digest="0"), "task_digest is 0 there and"),
        (lambda by: by.update(version=0), "version is 0 there and 1 here"),
    ):
        content = json.loads(kept)
        change(content["made_by"])
        name.write_text(json.dumps(content))
        code, _, err = call(*arguments(tmp_path, "--seeds", 1))
        told = " ".join(err.split())
        assert code != 0 and words in told and "name another folder, or remove it" in told
    name.write_text(kept)
    monkeypatch.setattr(jobs, "source_stamp", lambda: "other")
    monkeypatch.setattr(jobs, "versions", lambda: {"torch": "0.1"})
    assert call(*arguments(tmp_path, "--seeds", 1))[0] == 0  # a processor, a library or a docstring changes no result
    assert len(small) == made


def test_a_network_of_the_same_name_with_other_numbers_is_judged_anew(small, tmp_path):
    plan, path = Plan(2.0, runs=4), tmp_path / "mine.safetensors"
    random_policy(0).save(path)
    job = Job("competitive-door", str(path), None)
    told = made_by_of(job, plan)
    random_policy(1).save(path)
    assert made_by_of(job, plan) | {"network": told["network"]} == told != made_by_of(job, plan)


@looped(
    "args, words",
    [
        (("--algorithms", "sarsa"), "unknown algorithm 'sarsa'; known: quick, ppo"),
        (("--tasks", "nowhere"), "unknown task 'nowhere'"),
        (("--tasks", "large-hall"), "large-hall"),
        (("--seeds", "0"), "--seeds is 0"),
        (("--minutes", "0"), "--minutes is 0"),
        (("--baselines", "wind"), "unknown policy 'wind'"),
        (("--report-only",), "nothing is finished in"),
    ],
)
def test_bad_input_is_refused_before_anything_is_trained(small, tmp_path, args, words):
    given = args if "--tasks" in args or "--algorithms" in args else ("--algorithms", "quick", *args)
    code, _, err = call("--out", tmp_path / "new", *given)
    assert code != 0 and words in " ".join(err.split()) and "Traceback" not in err
    assert not small and not (tmp_path / "new").exists()


def test_a_checkpoint_with_fewer_left_is_the_better_one():
    def of(exits):
        times, left = np.nan_to_num(exits, nan=1000.0), np.isnan(exits).sum(axis=1)
        return SimpleNamespace(column={"unfinished": left}.__getitem__, times_of_all=lambda: times, exit_times=exits)

    slow, stuck = (checkpoint(of(np.array([[90.0, 95.0], [80.0, last]]))) for last in (99.0, np.nan))
    assert slow["clearing_times"] == [95.0, 99.0] and stuck["clearing_times"] == [95.0, None]
    assert slow["order"] == [0, 97.0] < stuck["order"]


def test_tables_have_the_highest_score_first():
    times = {"ppo": [40.0, None], "mappo": [90.0, 92.0], "ppo-random": [50.0, 52.0]}
    rows = summarize({name: {"a": [training(0, found)]} for name, found in times.items()})
    assert [line.split("`")[1] for line in table(rows).splitlines()[2:]] == ["ppo-random", "ppo", "mappo"]


@pytest.mark.more
def test_the_committed_results_are_those_of_the_page(tmp_path):
    """The raw files lie in the repository: the command prints the table of the page from them, without training."""
    import shutil

    from validation.pages import read_table

    shutil.copytree(ROOT / "benchmarks/results/learning", tmp_path / "kept")
    code, out, err = call("--report-only", "--out", tmp_path / "kept")
    assert code == 0, err
    head, *rows = read_table("algorithms")
    assert [line[2:-2].split(" | ") for line in out.splitlines()][2:] == rows and all(
        task in " ".join(head) for task in TASKS
    )


@pytest.mark.nightly
def test_every_algorithm_trains_for_a_moment(tmp_path):
    args = ("--tasks", "room", "--seeds", 1, "--minutes", 0.02, "--runs", 2, "--baselines", "rule", "--out", tmp_path)
    code, out, err = call(*args)
    assert code == 0, err
    assert all(f"`{name}`" in out for name in ALGORITHMS)


def test_every_algorithm_has_a_training_of_its_name():
    algorithms = pytest.importorskip("crowd_env.agents.learned.algorithms")
    assert algorithms.TRAIN.keys() == ALGORITHMS.keys()


def test_a_stage_ends_with_its_share_and_the_next_one_counts_on():
    """A search of half of the budget, then learning: progress runs from 0 to 1 in each, decisions go on."""
    from crowd_env.agents.learned.algorithms import Stage

    whole = SimpleNamespace(progress=0.0, told=[])
    whole.on_update = lambda steps, policy, returns: whole.told.append(steps) is None
    first = Stage(whole, 0.5)
    whole.progress = 0.25
    assert first.progress == 0.5 and first.on_update(7, ShortestPath)
    whole.progress = 0.5
    assert not first.on_update(9, ShortestPath) and first.steps == 9
    second = Stage(whole, decided=first.steps)
    assert second.progress == 0.0 and second.on_update(1, Evolved) and whole.told == [7, 9, 10]
    whole.progress = 0.75
    assert second.progress == 0.5 and isinstance(second.best, Evolved)
    whole.progress = 1.0  # all of it is spent
    assert Stage(whole).progress == 1.0


@pytest.mark.more
@looped("task", ("counter-flow", "narrow-door"))
def test_every_algorithm_fits_what_each_task_observes(task, monkeypatch):
    """A search is cloned in the observation of the task, whatever terms that has."""
    algorithms = pytest.importorskip("crowd_env.agents.learned.algorithms")
    from crowd_env.agents.learned import network_search

    monkeypatch.setattr(network_search, "POPULATION", 4)
    monkeypatch.setattr(network_search, "DRAWS", 1)
    monkeypatch.setattr("crowd_env.agents.learned.training.clone", lambda *given: cloned.append(given[1].name))
    cloned, whole = [], SimpleNamespace(progress=0.0)

    def on_update(steps, policy, returns=()):
        policy()
        whole.progress += 0.5
        return whole.progress < 1.0

    whole.on_update = on_update
    config = task_config(task, start=ALGORITHMS["search-clone-ppo"].start, people=8, envs=2)
    algorithms.TRAIN["search-clone-ppo"](config, whole)
    assert len(cloned) == 1 and whole.progress >= 1.0
