"""What luck chose is not kept: the best network of a training against the one it began with, on fresh draws."""

import json
from dataclasses import replace

import numpy as np
import pytest
from cases import looped
from late import late
from training_runs import QUICK, curve, with_ppo

from crowd_env.agents.evaluation.evaluation import FINAL_SEED, OWN_SEED
from crowd_env.agents.training_config import task_config
from crowd_env.cli.agents import learn

significance, curves = late("crowd_env.agents.learned.significance_test"), late("crowd_env.agents.learned.curve")
compare_with_start, kept_row = late("crowd_env.agents.learned.significance_test", "compare_with_start", "kept_row")

ROOM = task_config("room")


@pytest.fixture
def run(tmp_path):
    """Return a folder of a training whose second row did best, with files in the place of networks."""
    rows = [
        dict.fromkeys(curves.CURVE_COLUMNS, 0.0) | {"steps": k, "evacuation_time": t} for k, t in ((0, 9.0), (5, 8.0))
    ]
    curves.write_curve(tmp_path / "learning_curve.csv", rows)
    (tmp_path / "start.safetensors").write_bytes(b"start")
    (tmp_path / "best.safetensors").write_bytes(b"trained")
    return tmp_path


def answer(monkeypatch, mean, sd, asked=None, impulse=0.0):
    """Let the times [s] and impulses of every look differ by normal numbers of such means, in place of simulations."""
    rng = np.random.default_rng(1)

    def differ(folder, config, look, threads):
        if asked is not None:
            asked.append(((folder / "start.safetensors").read_bytes(), (folder / "best.safetensors").read_bytes()))
        return rng.normal(mean, sd, significance.DRAWS), rng.normal(impulse, 1.0, significance.DRAWS)

    monkeypatch.setattr(significance, "_minus_start", differ)


def held(folder):
    return {path.name: path.read_bytes() for path in folder.glob("*.safetensors")}


@looped(("mean", "looks"), [(-5.0, 1), (-0.5, None), (5.0, 1)])
def test_what_is_plain_is_decided_at_once_and_only_what_is_sooner_is_kept(run, monkeypatch, mean, looks):
    asked = []
    answer(monkeypatch, mean, 1.0, asked)
    compare_with_start(run, ROOM)
    told = json.loads((run / "confirmation.json").read_text())
    assert told["kept"] == ("trained" if mean < 0 else "start")
    assert held(run)["best.safetensors"] == (b"trained" if mean < 0 else b"start")
    assert ("unconfirmed.safetensors" in held(run)) == (mean > 0)
    assert told["draws"] == 25 * len(asked) and len(asked) == (looks or len(asked))
    assert kept_row(run, curve(run))["steps"] == (5 if mean < 0 else 0)


def test_what_is_not_beyond_doubt_is_refused_after_all_looks(run, monkeypatch):
    asked = []
    answer(monkeypatch, -0.05, 1.0, asked)
    compare_with_start(run, ROOM)
    told = json.loads((run / "confirmation.json").read_text())
    assert (told["kept"], told["draws"], len(asked)) == ("start", 100, 4)
    assert held(run) == {
        "best.safetensors": b"start",
        "start.safetensors": b"start",
        "unconfirmed.safetensors": b"trained",
    }


@looped(
    ("mean", "sd", "impulse", "kept", "draws"),
    [
        (-0.05, 1.0, -1.0, "trained", 50),
        (-0.05, 1.0, -0.1, "start", 100),
        (0.12, 1.0, -1.0, "trained", 50),
        (0.12, 0.1, -1.0, "trained", 25),
        (0.36, 0.6, -1.0, "trained", 100),  # later beyond doubt, by less than half a second
        (-0.1, 4.0, -1.0, "trained", 100),
        (0.5, 4.0, -1.0, "start", 100),
        (5.0, 1.0, -9.0, "start", 25),
    ],
)
def test_of_two_that_are_out_as_soon_the_one_that_plainly_touches_less_is_kept(
    run, monkeypatch, mean, sd, impulse, kept, draws
):
    """-0.1 is one standard error of 100 draws; with an sd of 4 these do not tell 0 s from 0.5 s."""
    (run / "best.safetensors").write_bytes(b"trained")
    answer(monkeypatch, mean, sd, impulse=impulse)
    compare_with_start(run, ROOM)
    told = json.loads((run / "confirmation.json").read_text())
    assert (told["kept"], told["draws"]) == (kept, draws) and told["impulse_more"] == pytest.approx(impulse, abs=0.4)


@pytest.mark.more
@looped(("later", "impulse"), [(0.0, 0.0), (0.5, -9.0)])
def test_a_network_that_is_no_better_is_kept_in_few_of_many_trainings(run, monkeypatch, later, impulse):
    """The size of the test: 2.5 % on the side of "better"; 21 of 400 has a probability below 0.1 % then.

    That goes for who is no sooner and touches no less, and for who touches much less, but is half a second later.
    """
    rng = np.random.default_rng(3)
    means = np.array([[later], [impulse]])
    monkeypatch.setattr(significance, "_minus_start", lambda *args: rng.normal(means, 2.0, (2, significance.DRAWS)))
    kept = 0
    for _ in range(400):
        (run / "best.safetensors").write_bytes(b"trained")
        (run / "unconfirmed.safetensors").unlink(missing_ok=True)
        compare_with_start(run, ROOM)
        kept += held(run)["best.safetensors"] == b"trained"
    assert kept <= 20


def test_a_network_that_acts_as_the_start_is_no_better(run, monkeypatch):
    monkeypatch.setattr(significance, "_minus_start", lambda *args: np.zeros((2, significance.DRAWS)))
    compare_with_start(run, ROOM)
    assert held(run)["best.safetensors"] == b"start"


def test_a_refused_network_is_asked_about_again_unless_a_better_one_came(run, monkeypatch):
    answer(monkeypatch, 0.0, 1.0)
    compare_with_start(run, ROOM)
    asked = []
    answer(monkeypatch, -5.0, 1.0, asked)
    compare_with_start(run, ROOM)  # nothing was trained in between
    assert asked == [(b"start", b"trained")] and held(run)["best.safetensors"] == b"trained"
    assert "unconfirmed.safetensors" not in held(run)
    answer(monkeypatch, 0.0, 1.0)
    compare_with_start(run, ROOM)
    rows = [*curve(run), dict.fromkeys(curves.CURVE_COLUMNS, 0.0) | {"steps": 9.0, "evacuation_time": 7.0}]
    curves.write_curve(run / "learning_curve.csv", rows)
    (run / "best.safetensors").write_bytes(b"newer")  # as a training that went on leaves it
    asked.clear()
    answer(monkeypatch, -5.0, 1.0, asked)
    compare_with_start(run, ROOM)
    assert asked == [(b"start", b"newer")] and kept_row(run, curve(run))["steps"] == 9


def test_a_run_whose_start_did_best_is_asked_nothing(run, monkeypatch):
    monkeypatch.setattr(significance, "_minus_start", None)
    curves.write_curve(run / "learning_curve.csv", curve(run)[:1])
    compare_with_start(run, ROOM)
    assert held(run)["best.safetensors"] == b"trained" and not (run / "confirmation.json").exists()


def test_the_draws_follow_from_what_is_learned_and_its_seed_and_overlap_with_no_others():
    kinds = [replace(ROOM, task=task, scenario="room-v0") for task in ("room", "pillar", None)]
    asked = [replace(kind, seed=seed) for kind in kinds for seed in range(9)]
    asked.append(replace(ROOM, task=None, scenario="pillar-v0"))
    first = [significance.first_draw(config) for config in asked]
    most = significance.LOOKS * significance.DRAWS
    assert first == [significance.first_draw(replace(config)) for config in asked]
    assert min(first) >= FINAL_SEED and max(first) + most <= OWN_SEED
    assert (np.diff(sorted(first)) >= most).all()


@pytest.mark.more
def test_both_lead_the_crowd_of_the_task_on_draws_that_nobody_has_seen(tmp_path, monkeypatch):
    """A start that stands still loses against walking; the draws are neither those of validation nor of another curves."""
    from crowd_env.agents.evaluation import evaluation
    from crowd_env.agents.networks import network_digest

    monkeypatch.setattr(significance, "DRAWS", 2)
    seeds, run_crowds = [], evaluation.evaluate_crowds
    monkeypatch.setattr(
        "crowd_env.agents.evaluation.same_draws.evaluate_crowds",
        lambda crowds, **options: (
            seeds.append((options["first_seed"], options["runs"])),
            run_crowds(crowds, **options),
        ),
    )
    config = replace(task_config("room", 3, envs=2, steps=700), eval_every=10**6, eval_runs=2)
    config = with_ppo(config, **QUICK)
    assert learn.train(tmp_path, config)
    rows = curve(tmp_path)
    curves.write_curve(tmp_path / "learning_curve.csv", [rows[0] | {"evacuation_time": 99.0}, rows[-1]])
    compare_with_start(tmp_path, config)
    told = json.loads((tmp_path / "confirmation.json").read_text())
    first = seeds[0][0]
    assert seeds == [(first + 2 * look, 2) for look in range(told["draws"] // 2)]
    assert first == significance.first_draw(config) >= FINAL_SEED
    same = network_digest(tmp_path / "best.safetensors") == network_digest(tmp_path / "start.safetensors")
    assert same == (told["kept"] == "start")


def test_of_networks_as_soon_the_softest_does_best_and_none_later_than_the_margin():
    rows = [(51.3, 311.0), (51.5, 250.0), (51.9, 120.0), (51.2, 400.0), (51.6, 90.0), (51.4, 95.0)]
    looks = [{"unfinished": 0.0, "evacuation_time": time, "contact_impulse": impulse} for time, impulse in rows]
    best = [curves.best_row(looks[: k + 1]) for k in range(len(looks))]
    assert [looks.index(one) for one in best] == [0, 1, 1, 1, 4, 4]
    looks[2]["unfinished"] = 1.0
    assert curves.best_row(looks[2:4]) is looks[3]
    rng = np.random.default_rng(0)
    for _ in range(200):
        drawn = [
            {"unfinished": float(rng.integers(2)), "evacuation_time": rng.normal(), "contact_impulse": rng.random()}
            for _ in range(12)
        ]
        found, soonest = curves.best_row(drawn), min(map(curves.score, drawn))
        assert found["unfinished"] == soonest[0] and found["evacuation_time"] <= soonest[1] + curves.MARGIN
