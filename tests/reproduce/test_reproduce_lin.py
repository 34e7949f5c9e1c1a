"""The figures of Lin, Ma, Lo: runs computed once and kept, what blocked, and what the paper shows."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from evacuations import evacuated
from lin_runs import invented
from reproductions import nothing

from crowd_env import make_scenario
from crowd_env.core.executors import Processes
from crowd_env.physics import SCHEMES
from crowd_env.reproduce import store as store_of_runs
from crowd_env.reproduce.lin2016.run import Run, Stopped, until_blocked
from crowd_env.reproduce.lin2016.sample import sample
from crowd_env.reproduce.lin2016.settings import LinSettings
from crowd_env.reproduce.pool import Interrupted, complete
from crowd_env.reproduce.store import Store, identity

# Six people are out within seconds; nothing else is smaller than in the figures.
SMALL = [
    Run(6, speed, seed, rotation=rotation) for speed in (1.0, 2.0) for seed in (0, 1) for rotation in (True, False)
]


# ---------------------------------------------------------------------------------------------------------- one run


def test_a_run_is_the_evacuation_of_the_run_command():
    run = Run(12, 1.5, seed=3)
    env = evacuated(make_scenario("lin-room-v0", desired_speed=1.5), physics="hertz", people=12, seed=[3])
    assert run.simulate().exit_times == tuple(np.sort(env.simulation.state.exit_time).tolist())
    assert run.simulate().left == 0 and run.simulate().blocked_since is None


def test_presets_are_those_of_the_schemes():
    (run,) = LinSettings(runs=1).draws(10, 1.0)
    assert run.scheme() == SCHEMES["hertz"] and run == Run(10, 1.0)
    (run,) = LinSettings(runs=1, preset="literal").draws(10, 1.0)
    assert run.scheme() == SCHEMES["hertz-literal"]


def test_every_reading_reaches_the_run():
    settings = LinSettings(
        runs=2, seed=5, dt=2e-3, wall_friction=0.3, wall_social=100.0, anisotropy=0.1, no_rotation=True,
        damping="critical", target="nearest", exit_depth=0.2, cutoff=0.3,
    )  # fmt: skip
    first, second = settings.draws(20, 1.4, strength=250.0)
    assert replace(second, seed=5) == first and second.seed == 6
    scheme = first.scheme()
    assert (scheme.wall_friction, scheme.damping_unit, scheme.rotation) == (0.3, "critical", False)
    social = scheme.social
    assert (social.strength, social.wall_strength, social.anisotropy, social.cutoff) == (250.0, 100.0, 0.1, 0.3)
    scenario = first.scenario()
    assert (scenario.population.people, scenario.target, scenario.geometry.bounds[2]) == (20, "nearest", 15.2)
    assert first.dt == 2e-3
    assert set(settings.changed()) == {
        "dt", "wall_friction", "wall_social", "anisotropy", "no_rotation", "damping", "target", "exit_depth", "cutoff",
    }  # fmt: skip


@pytest.mark.parametrize("change", [{"wall_social": 0.0}, {"target": "nearest"}, {"exit_depth": 0.3}, {"dt": 2e-3}])
def test_readings_change_the_outcome(change):
    run = Run(6, 1.0)
    assert replace(run, **change).simulate().exit_times != run.simulate().exit_times


def test_keeping_moments_changes_nothing():
    run = Run(6, 1.0)
    kept = replace(run, moments=(0.0, 1.2345, 4.0, 60.0)).simulate()
    assert replace(kept, snapshots=()) == run.simulate()
    assert [snapshot.time for snapshot in kept.snapshots] == pytest.approx([0.0, 1.234, 4.0, 60.0], abs=5e-4)
    inside = [len(snapshot.x) for snapshot in kept.snapshots]
    assert inside[0] == 6 and inside[-1] == 0 and sorted(inside, reverse=True) == inside
    assert {len(column) for column in kept.snapshots[0][1:]} == {6}


def test_a_blocked_run_has_no_clearance_time():
    # Nobody can be out within half a second: blocked from the start, by the rule.
    record = Run(6, 1.0, blocked_after=0.5).simulate()
    assert (record.blocked_since, record.left, record.clearance_time) == (0.0, 6, None)
    whole = Run(6, 1.0).simulate()
    pauses = np.diff([0.0, *whole.exit_times])
    record = Run(6, 1.0, blocked_after=float(pauses.max()) - 1e-6).simulate()
    k = int(np.argmax(pauses))
    assert record.exit_times == whole.exit_times[:k] and record.left == 6 - k and record.clearance_time is None
    assert Run(6, 1.0, blocked_after=float(pauses.max()) + 1e-6).simulate() == whole


def test_a_run_at_the_end_of_its_time_is_neither_cleared_nor_blocked():
    record = Run(6, 1.0, time_limit=1.0).simulate()
    assert (record.blocked_since, record.clearance_time, record.left) == (None, None, 6)
    found = sample({Run(6, 1.0): record}, [Run(6, 1.0)])
    assert (found.blocked, found.unfinished, found.median) == (0, 1, None)
    assert found.count_blocked() == "none of 1 blocked, 1 unfinished"


@pytest.mark.parametrize(
    ("exits", "now", "out", "since"),
    [
        ([], 119.0, 0, None),
        ([], 121.0, 0, 0.0),
        ([5.0, 6.0], 126.0, 2, None),
        ([5.0, 6.0], 126.5, 2, 6.0),
        ([5.0, 125.0, 126.0], 127.0, 3, None),
        ([5.0, 125.5, 126.0], 127.0, 1, 5.0),  # moved again too late
        ([5.0, 6.0, 7.0, 8.0], 500.0, 4, None),  # all out: nobody is missed
    ],
)
def test_blocked_means_nobody_out_for_two_minutes(exits, now, out, since):
    kept, blocked_since = until_blocked(np.array(exits), now, 4, 120.0)
    assert (len(kept), blocked_since) == (out, since)


def test_a_run_can_be_given_up():
    with pytest.raises(Stopped):
        Run(6, 1.0).simulate(lambda: True)


# -------------------------------------------------------------------------------------------- many runs, kept in files


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    return complete(SMALL, Store(tmp_path_factory.mktemp("runs")), progress=nothing)


def test_the_same_run_is_computed_once(computed, tmp_path):
    counts = []
    records = complete([*SMALL, *SMALL, replace(SMALL[0], moments=(0.0, 3.0))], Store(tmp_path), progress=counts.append)
    assert sorted(map(repr, {replace(run, moments=()) for run in computed})) == sorted(map(repr, SMALL))
    assert len(computed) == len(records) == sum(counts) == len(SMALL)
    assert [run.moments for run in computed if run == SMALL[0]] == [(0.0, 3.0)]
    complete(SMALL, Store(tmp_path), progress=nothing)
    assert len(computed) == len(SMALL)
    complete(SMALL, Store(tmp_path), fresh=True, progress=nothing)
    assert len(computed) == 2 * len(SMALL)


def test_the_longest_runs_come_first(computed, tmp_path):
    runs = [Run(100, 2.0), Run(300, 0.6), Run(200, 1.0), Run(300, 1.4), Run(100, 1.0, dt=1e-4)]
    complete(runs, Store(tmp_path), progress=nothing)
    assert computed == [Run(300, 0.6), Run(100, 1.0, dt=1e-4), Run(300, 1.4), Run(200, 1.0), Run(100, 2.0)]


def test_interrupted_and_resumed_is_uninterrupted(uninterrupted, tmp_path, monkeypatch):
    done, simulate = [], Run.simulate

    def interrupted(run, stopped=None):
        if len(done) == 3:
            raise KeyboardInterrupt
        done.append(run)
        return simulate(run)

    monkeypatch.setattr(Run, "simulate", interrupted)
    with pytest.raises(Interrupted, match=r"^3 of 8 runs are kept in .*runs.*goes on from there$"):
        complete(SMALL, Store(tmp_path / "runs"), progress=nothing)
    assert len(list((tmp_path / "runs").iterdir())) == 3
    again = []
    monkeypatch.setattr(Run, "simulate", lambda run, stopped=None: again.append(run) or simulate(run))
    assert complete(SMALL, Store(tmp_path / "runs"), progress=nothing) == uninterrupted
    assert len(again) == 5 and not set(again) & set(done)


def test_the_number_of_processes_changes_nothing(uninterrupted, tmp_path):
    store, counts = Store(tmp_path), []
    assert complete(SMALL, store, executor=Processes(2), progress=counts.append) == uninterrupted
    assert sum(counts) == len(SMALL)
    assert {run: store.load(run) for run in SMALL} == uninterrupted
    assert len(list(tmp_path.iterdir())) == len(SMALL)


def test_an_error_in_another_process_arrives_and_the_rest_is_kept(tmp_path):
    wild = replace(SMALL[0], dt=0.5)
    with pytest.raises(ValueError, match="stable step"):
        complete([*SMALL[:2], wild], Store(tmp_path), executor=Processes(2), progress=nothing)


def test_what_is_kept_is_what_was_computed(tmp_path):
    store, run = Store(tmp_path), Run(6, 1.0, moments=(0.0, 2.0))
    record = run.simulate()
    store.keep(run, record)
    assert store.load(run) == record  # every bit of every number
    assert store.load(replace(run, moments=())) == record
    assert store.load(replace(run, moments=(0.0, 3.0))) is None
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


@pytest.mark.parametrize(
    "spoil",
    [
        lambda text: "",
        lambda text: text[: len(text) // 2],
        lambda text: "[]",
        lambda text: "null",
        lambda text: '{"identity": 1}',
        lambda text: text.replace('"left": 0', '"left": 1'),
        lambda text: text.replace('"desired_speed": 1.0', '"desired_speed": 1.1'),
        lambda text: text.replace('"exit_times": [', '"exit_times": ["x", '),
        lambda text: text.replace('"exit_times": [', '"exit_times": [NaN, ').replace('"left": 0', '"left": -1'),
        lambda text: text.replace('"blocked_since": null', '"blocked_since": 3.0'),
        lambda text: "\udcff",
    ],
)
def test_a_broken_file_is_computed_again(spoil, tmp_path, computed):
    store, run = Store(tmp_path), Run(6, 1.0)
    complete([run], store, progress=nothing)
    text = store.path(run).read_text()
    spoiled = spoil(text)
    assert spoiled != text
    store.path(run).write_bytes(spoiled.encode("utf-8", "surrogateescape"))
    assert store.load(run) is None
    assert complete([run], store, progress=nothing) == {run: invented(run)}
    assert len(computed) == 2 and store.path(run).read_text() == text


@pytest.mark.parametrize(
    "change",
    [
        {"count": 7}, {"desired_speed": 1.1}, {"seed": 1}, {"strength": 200.0}, {"rotation": False}, {"dt": 2e-3},
        {"friction": 0.25},
        {"wall_friction": 0.2}, {"wall_social": 0.0}, {"anisotropy": 0.2}, {"damping": "rate"}, {"cutoff": 0.3},
        {"target": "nearest"}, {"exit_depth": 0.1}, {"time_limit": 900.0}, {"blocked_after": 60.0},
    ],
    ids=str,
)  # fmt: skip
def test_another_run_is_another_file(change, tmp_path):
    run = Run(6, 1.0)
    assert Store(tmp_path).path(replace(run, **change)) != Store(tmp_path).path(run)


def test_a_change_of_the_physics_never_serves_old_runs(tmp_path, computed, monkeypatch):
    store, run = Store(tmp_path), Run(6, 1.0)
    complete([run], store, progress=nothing)
    monkeypatch.setattr(store_of_runs.jit, "STAMP", "0123456789abcdef")
    assert store.load(run) is None
    complete([run], store, progress=nothing)
    assert len(computed) == 2
    assert identity(run)["kernels"] == "0123456789abcdef"


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "runs").write_text("a file")
    with pytest.raises(ValueError, match="cannot keep the runs in"):
        complete(SMALL[:1], Store(tmp_path / "runs"), progress=nothing)


@pytest.mark.nightly
@pytest.mark.skipif(sys.platform == "win32", reason="sends a signal to a group of processes")
def test_ctrl_c_ends_with_a_sentence_and_the_work_goes_on(tmp_path):
    words = ["-m", "crowd_env", "reproduce", "lin-fig5", "--runs", "6", "--workers", "2", "--json", "--out"]
    command = [sys.executable, *words, str(tmp_path)]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # in case we run in the background ourselves
    )
    while process.poll() is None and not list(tmp_path.glob("runs/[!.]*.json")):
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all processes
    out, said = process.communicate(timeout=60)
    assert (process.returncode, out) == (130, "")
    assert said.count("\n") == 1 and "of 24 runs are kept" in said
    kept = int(said.split()[1])
    files = {path: path.read_bytes() for path in (tmp_path / "runs").iterdir()}
    assert 1 <= kept < 24 and len(files) == kept
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    assert {path: path.read_bytes() for path in files} == files
    fresh = tmp_path / "fresh"
    other = subprocess.run([*command[:-1], str(fresh)], capture_output=True, text=True, check=True)
    assert json.loads(result.stdout) == json.loads(other.stdout)


# ------------------------------------------------------------------------------------------- what the paper shows


@pytest.mark.nightly
def test_the_numbers_of_the_paper(tmp_path):
    """Medians and blocked draws of the preset "calibrated", 5 draws; bounds from samples of other draws."""
    settings, finer, plain = LinSettings(runs=5), LinSettings(runs=8), {"rotation": False}
    draws = {
        "100 at 1": finer.draws(100, 1.0),
        "100 at 1, dt 2e-3": replace(finer, dt=2e-3).draws(100, 1.0),
        "200 at 0.6": settings.draws(200, 0.6),
        "200 at 1": settings.draws(200, 1.0),
        "200 at 2": settings.draws(200, 2.0),
        "100 at 2": settings.draws(100, 2.0),
        "100 at 2, no rotation": settings.draws(100, 2.0, **plain),
    }
    runs = [run for some in draws.values() for run in some]
    records = complete(runs, Store(tmp_path), executor=Processes(), progress=nothing)
    found = {name: sample(records, some) for name, some in draws.items()}
    assert 110 <= sample(records, settings.draws(100, 1.0)).median <= 140
    assert 320 <= found["200 at 0.6"].median <= 385 and found["200 at 0.6"].blocked == 0
    assert 200 <= found["200 at 1"].median <= 260 and found["200 at 1"].blocked <= 1
    assert found["200 at 2"].blocked >= 4
    assert found["100 at 2, no rotation"].blocked >= 4
    assert found["100 at 2, no rotation"].blocked > found["100 at 2"].blocked + 1
    assert found["100 at 1, dt 2e-3"].median == pytest.approx(found["100 at 1"].median, rel=0.10)
    for some in found.values():
        for record in some.records:
            assert (record.clearance_time is None) == (record.left > 0)
            assert all(b - a <= 120.0 for a, b in pairwise([0.0, *record.exit_times]))
