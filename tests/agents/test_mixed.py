"""Mixed crowds: a share of the people follows the policy, the others the rule."""

import json
import re

import numpy as np
import pytest
from cases import looped
from evaluations import SMALL, call, hall, random_network, run

from crowd_env.agents.evaluation.entries import make_entries
from crowd_env.agents.evaluation.evaluation import evaluate_crowd
from crowd_env.agents.evaluation.folder import EvaluationFolder, settings_of
from crowd_env.agents.mixed import learned_people
from crowd_env.agents.trained import LearnedController
from crowd_env.envs.routing.batch import RoutingBatch
from crowd_env.envs.tasks.task import HELD_OUT_SEED


def mixed(name, share, scenario=SMALL, runs=3, **options):
    (entry,) = make_entries([name], scenario, learned_share=share)
    return evaluate_crowd(entry.driver(scenario), runs=runs, measure=True, **options)


def test_a_run_decides_who_has_learned_and_a_larger_share_adds_people():
    seeds = range(HELD_OUT_SEED, HELD_OUT_SEED + 40)
    few, half, all_of_them = (learned_people(seeds, 50, share) for share in (0.1, 0.5, 1.0))
    assert few.sum(axis=1).tolist() == [5] * 40 and half.sum(axis=1).tolist() == [25] * 40 and all_of_them.all()
    assert not (few & ~half).any()
    np.testing.assert_array_equal(learned_people(seeds[7:9], 50, 0.5), half[7:9])
    assert half.mean(axis=0).min() > 0.2 and half.mean(axis=0).max() < 0.8  # nobody is always, or never, among them
    assert learned_people([0], 4, 0.1).sum() == 1
    # A share that does not divide the people: the nearest number of them.
    assert [learned_people([0], 9, share).sum() for share in (0.3, 0.4, 0.5, 0.6)] == [3, 4, 4, 5]


def test_the_same_people_learn_under_every_policy_and_the_others_follow_the_rule():
    still, rule = mixed("stand-still", 0.5), mixed("shortest", 0.5)
    np.testing.assert_array_equal(still.learned, rule.learned)
    out = np.isfinite(np.array(still.exit_times))
    assert (out & still.learned).mean() < 0.1 < 0.4 < (out & ~still.learned).mean()  # a few are pushed out
    assert repr(rule.episodes) == repr(run("shortest").episodes)
    row = still.row()
    assert row["learned_share"] == 0.5 and run("shortest").row()["learned_share"] == 1.0
    assert row["mean_exit_learned"]["mean"] is None  # of no run: some of them are always left inside
    assert 10.0 > row["mean_exit_others"]["mean"] > 0.0


def test_a_run_does_not_depend_on_the_size_of_the_batch(monkeypatch):
    many = mixed("follow", 0.5, runs=5)
    monkeypatch.setattr("crowd_env.envs.rollout._PEOPLE_AT_ONCE", 2 * 14)
    assert repr(mixed("follow", 0.5, runs=5).episodes) == repr(many.episodes)


def test_all_of_the_people_are_everyone():
    assert repr(mixed("follow", 1.0).episodes) == repr(run("follow").episodes)
    assert repr(mixed("follow", 0.3).episodes) != repr(run("follow").episodes)
    assert mixed("follow", 1.0).row()["mean_exit_others"]["mean"] is None


def test_the_manner_of_a_mixed_crowd_is_that_of_the_others():
    calm = hall(manner="calm")
    # With a manner in force ways spread over wide openings, and people choose their direction at other moments.
    learned = mixed("follow", 1.0, calm).column("mean_exit_time")
    assert learned.mean() == pytest.approx(run("follow").column("mean_exit_time").mean(), abs=0.25)
    assert (run("follow", calm).column("mean_exit_time") > learned + 0.15).all()  # everyone's, where nobody is mixed
    assert repr(mixed("shortest", 0.5, calm).episodes) == repr(run("shortest", calm).episodes)


def test_a_kept_result_says_who_has_learned(tmp_path):
    (entry,) = make_entries(["follow"], SMALL, learned_share=0.5)
    folder, result = EvaluationFolder(tmp_path, settings_of(SMALL, 3, 0, learned_share=0.5)), mixed("follow", 0.5)
    folder.keep_result(entry, "nsm2", result)
    assert folder.load_result(entry, "nsm2").row() == result.row()
    with pytest.raises(ValueError, match=r"learned_share is 0\.5 there"):
        EvaluationFolder(tmp_path, settings_of(SMALL, 3, 0, learned_share=0.25))


def test_rows_hold_the_share(small):
    asked = ("--scenario", "hall", "--policies", "shortest", "follow", "--set", "learned=0.5", "--runs", 2)
    code, out, _ = call(*asked, "--json")
    assert code == 0
    assert [row["learned_share"] for row in json.loads(out)["rows"]] == [0.5, 0.5]
    code, out, _ = call(*asked)
    assert code == 0 and "50 % learned" in " ".join(out.split())


@looped(
    ("arguments", "message"),
    [
        (("--set", "learned=0"), r"--set learned is 0\.0; it must be above 0 and at most 1"),
        (("--set", "learned=1.5"), r"--set learned is 1\.5; it must be above 0"),
        (("--set", "learned=0.5", "--policies", "nearest"), "'nearest' cannot move a part of the people: it chooses"),
        (("--set", "learned=0.5", "--policies", "headway"), "'headway' cannot move a part .* the walking of all"),
    ],
)
def test_what_cannot_be_mixed_is_said_in_one_line(small, arguments, message):
    code, out, err = call("--scenario", "hall", "--runs", 1, *arguments)
    assert code == 2 and out == ""
    assert re.search(message, err) and len(err.strip().splitlines()) == 1 and err.startswith("error: ")


def test_a_controller_cannot_be_mixed(tmp_path):
    batch = RoutingBatch(SMALL, grid=(2, 1), interval=1.0)
    network = random_network(batch.layout.size, int(batch.choices.sum()))
    LearnedController(network, batch.choices, {"scenario": "hall"}).save(tmp_path / "leader.safetensors")
    with pytest.raises(ValueError, match=r"leader\.safetensors sends everyone of a region to an exit"):
        make_entries([str(tmp_path / "leader.safetensors")], SMALL, learned_share=0.5)
