"""Policies by name, judged on the same draws, and the folders of runs."""

import io
import json
from pathlib import Path

import numpy as np
import pytest
from cases import looped
from rich.console import Console

from crowd_env import SCHEMES, Physics, Uniform, make_scenario
from crowd_env.agents import POLICIES, ShortestPath, make_policy
from crowd_env.agents.evaluation.evaluation import evaluate
from crowd_env.agents.evaluation.report import comparison_table
from crowd_env.agents.runs import new_folder, versions
from crowd_env.analysis.figures import report
from crowd_env.core.files.json_file import read_json, write_json
from crowd_env.envs.rollout import run_episodes
from crowd_env.envs.tasks.task import HELD_OUT_SEED

SMALL = make_scenario("room-v0", people=6, time_limit=8.0)


def judge(policy, **options):
    return evaluate(make_policy(policy), SMALL, **{"runs": 4, **options})


@looped("policy", POLICIES)
def test_the_same_draws_give_the_same_results_and_others_do_not(policy):
    first, again = judge(policy, runs=2), judge(policy, runs=2)
    other = judge(policy, runs=2, first_seed=HELD_OUT_SEED + 100)
    assert repr(first.episodes) == repr(again.episodes)
    np.testing.assert_array_equal(first.exit_times, again.exit_times)
    if policy != "stand-still":
        assert repr(first.episodes) != repr(other.episodes)
    assert first.policy == policy and first.runs == 2


def test_every_policy_meets_the_same_people_in_the_same_places():
    met = []

    class Watching(ShortestPath):
        def act(self, observation, layout, rng):
            if len(met) < 2 and not any(observation is seen for seen in met):
                met.append(observation.copy())
            return None

    evaluate(Watching(), SMALL, runs=3)
    first = met[0].copy()
    met.clear()
    evaluate(Watching(), SMALL, runs=3, physics="dem")
    np.testing.assert_array_equal(first, met[0])


@looped("scheme", SCHEMES)
def test_the_shortest_path_is_the_rule_of_the_command_line(scheme):
    rule = run_episodes(SMALL, 5, scheme=scheme, seed=HELD_OUT_SEED)
    assert repr(evaluate(make_policy("shortest"), SMALL, physics=scheme, runs=5).episodes) == repr(
        [episode.metrics for episode in rule]
    )


def test_more_runs_than_fit_beside_each_other_are_run_one_after_the_other():
    place = make_scenario("room-v0", people=1)
    told = []
    episodes = run_episodes(place, 60, scheme="dem", keep=told.extend)
    assert len(episodes) == len(told) == 60
    assert len({episode.metrics.evacuation_time for episode in episodes}) == 60
    assert repr(episodes[55].metrics) == repr(run_episodes(place, 1, scheme="dem", seed=55)[0].metrics)
    evaluated = evaluate(make_policy("shortest"), place, physics="dem", runs=60, first_seed=0)
    assert repr(evaluated.episodes) == repr([episode.metrics for episode in episodes])


def test_who_stands_still_stays():
    result = judge("stand-still", time_limit=1.0)
    assert result.row()["unfinished"] == 4 * 6
    assert result.row()["evacuation_time"]["mean"] is None
    assert np.isnan(result.exit_times).all()


def test_the_shortest_path_beats_a_random_walk():
    shortest, random = judge("shortest"), judge("random")
    assert shortest.column("unfinished").sum() == 0 < random.column("unfinished").sum()


def test_a_row_holds_the_means_and_is_json():
    result = judge("shortest")
    row = json.loads(json.dumps(result.row(), allow_nan=False))
    assert row["evacuation_time"]["mean"] == pytest.approx(result.column("evacuation_time").mean())
    assert row["evacuation_time"]["sd"] == pytest.approx(result.column("evacuation_time").std(ddof=1))
    assert row["contact_impulse"]["mean"] == pytest.approx(result.column("contact_impulse").mean())
    for episode, times in zip(result.episodes, result.exit_times, strict=True):
        assert episode.evacuation_time == times.max()
    low, high = row["evacuation_time"]["ci95"]
    assert low < row["evacuation_time"]["mean"] < high


def test_the_report_of_runs_is_made_of_their_metrics():
    finished = run_episodes(make_scenario("room-v0", time_limit=5.0), 4, scheme="dem")
    told = report(make_scenario("room-v0"), "dem", finished)
    episodes = [episode.metrics for episode in finished]
    assert told["unfinished"] == sum(episode.unfinished for episode in episodes) > 0
    assert told["unfinished_runs"] == sum(episode.unfinished > 0 for episode in episodes)
    assert told["flow"]["mean"] == pytest.approx(np.mean([episode.flow for episode in episodes]))
    assert told["overlap_mm"]["max"] == pytest.approx(1e3 * max(episode.max_overlap for episode in episodes))
    assert told["outside_mm"] == pytest.approx(1e3 * max(episode.max_outside for episode in episodes))
    json.dumps(told, allow_nan=False)


@pytest.mark.more
def test_a_table_shows_every_policy():
    text = io.StringIO()
    results = [judge(name, time_limit=3.0) for name in POLICIES]
    Console(file=text, width=100).print(comparison_table(results, "title"))
    rows = {line.split()[0]: line for line in text.getvalue().splitlines() if line.strip()}
    assert set(POLICIES) <= set(rows) and " 24 " in rows["stand-still"] and "never" in rows["stand-still"]
    assert "100 (51..100)" in rows["stand-still"]  # 4 of 4 runs: the share with its interval
    assert "nan" not in text.getvalue() and "…" not in text.getvalue()


def test_an_unknown_policy_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match=r"dance.*random, stand-still, shortest"):
        make_policy("dance")


@looped(("runs", "seed"), [(0, 0), (-1, 0), (1, -1)])
def test_impossible_numbers_of_runs_are_refused(runs, seed):
    with pytest.raises(ValueError, match="it must be"):
        run_episodes(SMALL, runs, seed=seed)
    with pytest.raises(ValueError):
        evaluate(make_policy("shortest"), SMALL, runs=runs, first_seed=seed)


# ------------------------------------------------------------------------------------------------------ run folders


def test_no_run_overwrites_another(tmp_path):
    assert [new_folder(tmp_path, "x").name for _ in range(3)] == ["x", "x-2", "x-3"]


def test_two_processes_that_want_one_folder_get_two(tmp_path, monkeypatch):
    """The other one makes its folder just after this one has looked."""
    monkeypatch.setattr(Path, "exists", lambda self: False)
    assert [new_folder(tmp_path, "x").name for _ in range(3)] == ["x", "x-2", "x-3"]


def test_two_processes_that_write_one_file_do_not_meet(tmp_path, monkeypatch):
    """Another process writes the same file, and is done with it, while this one is at its part."""
    path, write = tmp_path / "a.json", Path.write_text

    def slowly(self, *args, **options):
        write(self, *args, **options)
        monkeypatch.setattr(Path, "write_text", write)
        with monkeypatch.context() as other:
            other.setattr("os.getpid", lambda: 1)
            write_json(path, {"a": 2})

    monkeypatch.setattr(Path, "write_text", slowly)
    write_json(path, {"a": 1})
    assert read_json(path) == {"a": 1} and [p.name for p in tmp_path.iterdir()] == ["a.json"]


@looped("name", ["", ".", "..", "../x", "a/b", "/x", "a\\b"])
def test_a_run_is_named_by_one_folder_below_the_root(tmp_path, name):
    with pytest.raises(ValueError, match="cannot name a run"):
        new_folder(tmp_path / "runs", name)
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    for root in (tmp_path / "file", tmp_path / "file" / "runs"):
        with pytest.raises(ValueError, match=r"cannot make the folder .*file"):
            new_folder(root, "x")


def test_json_is_written_whole_or_not_at_all(tmp_path):
    path = tmp_path / "a.json"
    write_json(path, {"a": 1})
    with pytest.raises(ValueError):
        write_json(path, {"a": float("nan")})
    assert read_json(path) == {"a": 1} and [p.name for p in tmp_path.iterdir()] == ["a.json"]
    for content in (b"{", b"\xff\xfe{", b"[" * 100_000):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"a\.json"):
            read_json(path)


def test_versions_name_what_can_change_a_result():
    assert {"python", "numpy", "numba"} <= set(versions())


@looped(
    "physics",
    [Physics("nsm2", balance="stepping"), Physics("nsm2", max_drive=100.0), Physics("nsm2", dt=0.005), Physics("dem")],
    ids=repr,
)
def test_an_evaluation_takes_its_physics_whole(physics):
    """Nothing of it is dropped on the way: every run is that of an environment of this physics."""
    crowd = make_scenario("room-v0", people=30).population.changed(response_time=Uniform(0.0, 6.0))
    place = make_scenario("room-v0", population=crowd, time_limit=8.0)  # who walks bumps into those who still stand
    judged = evaluate(make_policy("shortest"), place, physics=physics, routing="shortest", runs=2)
    alone, usual = (
        repr([one.metrics for one in run_episodes(place, 2, seed=HELD_OUT_SEED, physics=one, routing="shortest")])
        for one in (physics, "nsm2")
    )
    assert repr(judged.episodes) == alone != usual


def test_an_evaluation_knows_physics_by_one_name_alone():
    with pytest.raises(TypeError, match="no argument 'scheme'; say physics="):
        evaluate(make_policy("shortest"), SMALL, scheme="dem", runs=1)
