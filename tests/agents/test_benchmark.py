"""The comparison of algorithms over seeds: its statistics against those of another library, and the command."""

import json
from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest
from cases import looped
from evaluations import random_policy
from typer.testing import CliRunner

from crowd_env.agents import benchmark as jobs
from crowd_env.agents.benchmark import (
    ALGORITHMS,
    Algorithm,
    Job,
    Plan,
    bootstrap_interval,
    checkpoint,
    do,
    interquartile_mean,
    summarize,
    table,
)
from crowd_env.agents.rules import ShortestPath
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
    monkeypatch.setattr(jobs, "_RESAMPLES", 1000)
    rng = np.random.default_rng(0)

    def draw(count):
        return rng.normal(np.where(rng.random(count) < 0.6, 50.0, hump), 1.5)

    true = interquartile_mean(draw(400_000))
    held = [low <= true <= high for low, high in (bootstrap_interval(draw(10)) for _ in range(400))]
    assert 0.88 < np.mean(held) < 0.98


def test_a_table_of_few_seeds_shows_the_mean_alone():
    final = {"clearing_time": {"mean": 1.0, "ci95": [0.5, 1.5]}, "mean_exit": {"mean": 1.0}, "flow": 1.0}
    found = [{"seed": k, "of_runs": {"clearing_times": [50.0 + k]}, "final": final} for k in range(5)]
    assert "| 52.0 |" in table(summarize({"few": found})) and "52.0 [" in table(summarize({"many": 2 * found}))


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

    row = {"clearing_time": {"mean": 50.0, "ci95": [49.0, 51.0]}, "mean_exit": {"mean": 30.0, "ci95": [29.0, 31.0]}}
    row |= {"flow": 1.7, "unfinished": 0, "runs": 4}
    monkeypatch.setattr(jobs, "evaluate", evaluated)
    monkeypatch.setattr(jobs, "compare", compared)
    monkeypatch.setattr(jobs, "task_rows", lambda *_: [row | {"minus_first": None, "credible": None}])
    known = {"quick": Algorithm("for tests", quick), "ppo": ALGORITHMS["ppo"]}
    for module in (command, jobs):
        monkeypatch.setattr(module, "ALGORITHMS", known)
    return calls


def call(*args):
    result = CliRunner().invoke(command.app, [str(arg) for arg in args])
    return result.exit_code, result.stdout, result.stderr


def arguments(folder, *more):
    plan = ("--algorithms", "quick", "--baselines", "follow", "rule", "--runs", 4)
    return (*plan, "--out", folder, *more)


@pytest.mark.more
def test_the_command_trains_every_seed_once_and_goes_on_where_it_was(small, tmp_path):
    code, out, err = call(*arguments(tmp_path, "--seeds", 2))
    assert code == 0, err
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "follow.json",
        "quick-seed0.json",
        "quick-seed1.json",
        "rule.json",
        "summary.json",
        "table.md",
    ]
    rows = json.loads((tmp_path / "summary.json").read_text())["rows"]
    assert rows["quick"]["seeds"] == 2 and rows["quick"]["clearing_time"]["iqm"] == 51.5
    assert rows["rule"]["unfinished"]["runs"] == 1 and "| `quick` | nothing | 2 | 0 of 8" in out
    made = len(small)
    code, again, _ = call(*arguments(tmp_path, "--seeds", 2))
    assert code == 0 and again == out and len(small) == made
    assert call(*arguments(tmp_path, "--seeds", 3))[0] == 0 and len(small) == made + 4


def test_the_best_checkpoint_is_judged_and_no_held_out_draw_is_seen_before(small, tmp_path):
    assert call(*arguments(tmp_path, "--seeds", 1))[0] == 0
    found = json.loads((tmp_path / "quick-seed0.json").read_text())
    assert found["best"] == 1 and len(found["curve"]) == 3 and found["constants"]["crowd"] == Evolved().crowd
    assert found["of_runs"]["clearing_times"] == [50.0, 51.0, 52.0, 53.0]
    assert [seed for _, runs, seed in small if runs == 12] == [2_000_000] * 3  # validation
    assert [seed for _, runs, seed in small if runs == 4] == [1_000_000] * 3  # held out


def test_what_another_process_is_about_is_left_alone(small, tmp_path):
    import fcntl

    plan, job = Plan("competitive-door", 1.0, runs=4), Job("quick", 0)
    with (tmp_path / ".quick-seed0.claim").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert do(job, plan, tmp_path) is None and not small
    assert do(job, plan, tmp_path)["seed"] == 0 and small


def test_results_of_another_plan_are_not_mixed(small, tmp_path):
    assert call(*arguments(tmp_path, "--seeds", 1))[0] == 0
    code, _, err = call(*arguments(tmp_path, "--seeds", 1, "--minutes", 3))
    assert code != 0 and "minutes is 2.0 there and 3.0 here; name another folder" in " ".join(err.split())


def test_results_of_other_parameters_or_other_code_are_not_taken_for_todays(small, tmp_path, monkeypatch):
    assert call(*arguments(tmp_path, "--seeds", 1))[0] == 0
    name, made = tmp_path / "quick-seed0.json", len(small)
    kept = name.read_text()
    for change, words in (
        (lambda by: by["config"]["ppo"].update(learning_rate=123.0), "config.ppo.learning_rate is 123.0 there and"),
        (lambda by: by["config"].update(scheme="other"), "config.scheme is other there and hertz here"),
        (lambda by: by["config"]["versions"].update(torch="0.1"), "config.versions.torch is 0.1 there and"),
        (lambda by: by.update(code="0"), "code is 0 there and"),
    ):
        content = json.loads(kept)
        change(content["made_by"])
        name.write_text(json.dumps(content))
        code, _, err = call(*arguments(tmp_path, "--seeds", 1))
        assert (
            code != 0
            and words in " ".join(err.split())
            and "name another folder, or remove it" in " ".join(err.split())
        )
    name.write_text(kept)
    monkeypatch.setattr(jobs, "source_stamp", lambda: "other")
    for job in (Job("quick", 0), Job("rule", None)):
        with pytest.raises(
            ValueError, match=f"{job.title}.json was made by another command: code is .* and other here"
        ):
            do(job, Plan("competitive-door", 2.0, runs=4), tmp_path)
    assert len(small) == made


def test_a_network_of_the_same_name_with_other_numbers_is_judged_anew(small, tmp_path):
    plan, path = Plan("competitive-door", 2.0, runs=4), tmp_path / "mine.safetensors"
    random_policy(0).save(path)
    job = Job(str(path), None)
    told = jobs._of_plan(job, plan)
    random_policy(1).save(path)
    assert jobs._of_plan(job, plan) | {"network": told["network"]} == told != jobs._of_plan(job, plan)


@looped(
    "args, words",
    [
        (("--algorithms", "sarsa"), "unknown algorithm 'sarsa'; known: quick, ppo"),
        (("--task", "nowhere"), "unknown task 'nowhere'"),
        (("--task", "large-hall"), "large-hall"),
        (("--seeds", "0"), "--seeds is 0"),
        (("--minutes", "0"), "--minutes is 0"),
        (("--baselines", "wind"), "unknown policy 'wind'"),
        (("--report-only",), "nothing is finished in"),
    ],
)
def test_bad_input_is_refused_before_anything_is_trained(small, tmp_path, args, words):
    given = args if "--task" in args or "--algorithms" in args else ("--algorithms", "quick", *args)
    code, _, err = call("--out", tmp_path / "new", *given)
    assert code != 0 and words in " ".join(err.split()) and "Traceback" not in err
    assert not small and not (tmp_path / "new").exists()


def test_a_checkpoint_with_fewer_left_is_the_better_one():
    def of(unfinished, times):
        return SimpleNamespace(
            column={"unfinished": np.array(unfinished)}.__getitem__, times_of_all=lambda: np.array(times)
        )

    slow = checkpoint(of([0, 0], [[90.0, 95.0], [80.0, 99.0]]))
    stuck = checkpoint(of([0, 2], [[40.0, 45.0], [40.0, 1000.0]]))
    assert slow["order"] < stuck["order"] and slow["clearing_time"] == 97.0 and stuck["clearing_time"] == 45.0


def test_tables_have_the_soonest_that_always_clears_first():
    def result(times):
        final = {"clearing_time": {"mean": 1.0, "ci95": [0.5, 1.5]}, "mean_exit": {"mean": 1.0}, "flow": 1.0}
        return {"of_runs": {"clearing_times": times}, "final": final}

    rows = summarize({"stuck": [result([40.0, None])], "slow": [result([90.0, 92.0])], "fast": [result([50.0, 52.0])]})
    assert [line.split("`")[1] for line in table(rows).splitlines()[2:]] == ["fast", "slow", "stuck"]


@pytest.mark.nightly
def test_every_algorithm_trains_for_a_moment(tmp_path):
    args = ("--task", "room", "--seeds", 1, "--minutes", 0.02, "--runs", 2, "--baselines", "rule", "--out", tmp_path)
    code, out, err = call(*args)
    assert code == 0, err
    assert all(f"`{name}`" in out for name in ALGORITHMS)
