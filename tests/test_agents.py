"""Policies by name, judged on the same draws, saved and read again."""

import io
import json
import zipfile

import numpy as np
import pytest
from rich.console import Console

from agents import POLICIES, ShortestPath, make_policy
from agents.evaluation import HELD_OUT_SEED, evaluate
from agents.report import comparison_table
from agents.runs import new_folder, read_json, versions, write_json
from crowd_env import SCHEMES, CrowdEnv, ObservationLayout, make_scenario
from crowd_env.experiment import report, run_rule

SMALL = make_scenario("room-v0", count=6, time_limit=8.0)


def judge(policy, **options):
    return evaluate(make_policy(policy), SMALL, **{"runs": 4, **options})


@pytest.mark.parametrize("policy", POLICIES)
def test_the_same_draws_give_the_same_results_and_others_do_not(policy):
    first, again, other = judge(policy), judge(policy), judge(policy, first_seed=HELD_OUT_SEED + 100)
    assert repr(first.episodes) == repr(again.episodes)
    np.testing.assert_array_equal(first.exit_times, again.exit_times)
    if policy != "stand-still":
        assert repr(first.episodes) != repr(other.episodes)
    assert first.policy == policy and first.runs == 4


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
    evaluate(Watching(), SMALL, runs=3, scheme="dem")
    np.testing.assert_array_equal(first, met[0])


@pytest.mark.parametrize("scheme", SCHEMES)
def test_the_shortest_path_is_the_rule_of_the_command_line(scheme):
    rule = run_rule(SMALL, scheme, 5, seed=HELD_OUT_SEED)
    assert repr(evaluate(make_policy("shortest"), SMALL, scheme=scheme, runs=5).episodes) == repr(rule)


def test_runs_are_the_same_whatever_is_simulated_beside_them():
    many = run_rule(SMALL, "nsm2", 5, seed=3)
    assert [repr(run_rule(SMALL, "nsm2", 1, seed=3 + k)[0]) for k in range(5)] == [repr(episode) for episode in many]


def test_more_runs_than_fit_beside_each_other_are_run_one_after_the_other():
    place = make_scenario("room-v0", count=1)
    told = []
    episodes = run_rule(place, "dem", 60, progress=told.append)
    assert len(episodes) == sum(told) == 60
    assert len({episode.evacuation_time for episode in episodes}) == 60
    assert repr(episodes[55]) == repr(run_rule(place, "dem", 1, seed=55)[0])
    evaluated = evaluate(make_policy("shortest"), place, scheme="dem", runs=60, first_seed=0)
    assert repr(evaluated.episodes) == repr(episodes)


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
    episodes = run_rule(make_scenario("room-v0", time_limit=5.0), "dem", 4)
    told = report(make_scenario("room-v0"), "dem", episodes)
    assert told["unfinished"] == sum(episode.unfinished for episode in episodes) > 0
    assert told["unfinished_runs"] == sum(episode.unfinished > 0 for episode in episodes)
    assert told["flow"]["mean"] == pytest.approx(np.mean([episode.flow for episode in episodes]))
    assert told["overlap_mm"]["max"] == pytest.approx(1e3 * max(episode.max_overlap for episode in episodes))
    assert told["outside_mm"] == pytest.approx(1e3 * max(episode.max_outside for episode in episodes))
    json.dumps(told, allow_nan=False)


def test_a_table_shows_every_policy():
    text = io.StringIO()
    results = [judge(name, time_limit=3.0) for name in POLICIES]
    Console(file=text, width=200).print(comparison_table(results, "title"))
    rows = {name: line for line in text.getvalue().splitlines() for name in POLICIES if name in line}
    assert set(rows) == set(POLICIES) and "24" in rows["stand-still"]
    assert "nan" not in text.getvalue()


def test_an_unknown_policy_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match=r"dance.*random, stand-still, shortest"):
        make_policy("dance")


@pytest.mark.parametrize(("runs", "seed"), [(0, 0), (-1, 0), (1, -1)])
def test_impossible_numbers_of_runs_are_refused(runs, seed):
    with pytest.raises(ValueError, match="it must be"):
        run_rule(SMALL, "nsm2", runs, seed=seed)
    with pytest.raises(ValueError):
        evaluate(make_policy("shortest"), SMALL, runs=runs, first_seed=seed)


# ----------------------------------------------------------------------------------------------------------- learned


@pytest.fixture(scope="module")
def untrained():
    pytest.importorskip("stable_baselines3")
    from agents.learned import LearnedPolicy, PPOSettings, make_ppo
    from agents.learned.policy import env_options_of

    layout = ObservationLayout(terms=("direction", "neighbours"), neighbours=2)
    env = CrowdEnv(SMALL, autoreset=True, frame="world", observation=layout)
    return LearnedPolicy(make_ppo(env, PPOSettings(), seed=0), env_options_of(env))


def test_a_saved_policy_is_the_same_policy(untrained, tmp_path):
    untrained.save(tmp_path / "model.zip")
    assert [path.name for path in tmp_path.iterdir()] == ["model.zip"]
    read = make_policy(str(tmp_path / "model.zip"))
    assert read.env_options == untrained.env_options
    assert repr(evaluate(read, SMALL, runs=2).episodes) == repr(evaluate(untrained, SMALL, runs=2).episodes)


def test_a_policy_is_asked_only_about_observations_it_knows(untrained):
    env = CrowdEnv(SMALL)
    observation, _ = env.reset(seed=0)
    with pytest.raises(ValueError, match="other observations"):
        untrained.act(observation, env.layout, np.random.default_rng(0))


def _repacked(path, **members):
    """Return the bytes of the zip file with members replaced, or left out if None."""
    out = io.BytesIO()
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(out, "w") as new:
        for name in old.namelist():
            content = members.get(name.split(".")[0], old.read(name))
            if content is not None:
                new.writestr(name, content)
    return out.getvalue()


@pytest.mark.parametrize(
    "harm",
    [
        lambda path: b"",
        lambda path: b"no zip",
        lambda path: path.read_bytes()[:1000],
        lambda path: _repacked(path, crowd_env=None),
        lambda path: _repacked(path, crowd_env=b"{"),
        lambda path: _repacked(path, crowd_env=b"[1]"),
        lambda path: _repacked(path, crowd_env=b'{"observation": {"smell": 1}}'),
        lambda path: _repacked(path, policy=b"xx"),
        lambda path: _repacked(path, policy=None),
    ],
)
def test_a_broken_file_is_refused_by_name(untrained, tmp_path, harm):
    good, bad = tmp_path / "good.zip", tmp_path / "bad.zip"
    untrained.save(good)
    bad.write_bytes(harm(good))
    with pytest.raises(ValueError, match=r"bad\.zip"):
        make_policy(str(bad))


def test_a_missing_file_is_refused_by_name(tmp_path):
    pytest.importorskip("stable_baselines3")
    with pytest.raises(ValueError, match=r"none\.zip"):
        make_policy(str(tmp_path / "none.zip"))


# ------------------------------------------------------------------------------------------------------ run folders


def test_no_run_overwrites_another(tmp_path):
    assert [new_folder(tmp_path, "x").name for _ in range(3)] == ["x", "x-2", "x-3"]


def test_json_is_written_whole_or_not_at_all(tmp_path):
    path = tmp_path / "a.json"
    write_json(path, {"a": 1})
    with pytest.raises(ValueError):
        write_json(path, {"a": float("nan")})
    assert read_json(path) == {"a": 1} and [p.name for p in tmp_path.iterdir()] == ["a.json"]
    path.write_text("{")
    with pytest.raises(ValueError, match=r"a\.json"):
        read_json(path)


def test_versions_name_what_can_change_a_result():
    assert {"python", "numpy", "numba"} <= set(versions())
