"""The evacuations that figures are made of, each computed once and kept; what blocked; and what Lin, Ma, Lo show."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from evacuations import evacuated
from lin_runs import episode

from crowd_env import make_scenario
from crowd_env.core.executors import Processes, Serial
from crowd_env.core.files.store import Store
from crowd_env.core.kernels import jit
from crowd_env.physics import SCHEMES
from crowd_env.reproduce import evacuations
from crowd_env.reproduce.evacuations import Interrupted, evacuate
from crowd_env.reproduce.lin2016 import room
from crowd_env.reproduce.lin2016.sample import Sample
from crowd_env.reproduce.lin2016.settings import LinSettings


def small(runs=2, **settings):
    """Return draws of six people, who are out within seconds, at two speeds; nothing else is smaller than in the figures."""
    return {speed: LinSettings(runs, **settings).case(6, speed) for speed in (1.0, 2.0)}


def run(case, folder):
    """Return what comes of a case."""
    return evacuate({"it": case}, Store(folder), Serial())["it"]


def same(found, expected):
    return repr(found) == repr(expected)


# ---------------------------------------------------------------------------------------------------------- one run


def test_a_run_is_the_evacuation_of_the_run_command(tmp_path):
    (one,) = run(LinSettings(1, seed=3).case(12, 1.5), tmp_path)
    physics = {"scheme": "hertz", "dt": 0.001}  # as the paper
    env = evacuated(make_scenario("lin-room-v0", desired_speed=1.5), physics=physics, people=12, seed=[3])
    np.testing.assert_array_equal(one.exit_time, env.simulation.state.exit_time)
    assert one.metrics.unfinished == 0 and np.isnan(one.metrics.blocked_since)


def test_every_reading_reaches_the_run():
    assert LinSettings().scheme() == SCHEMES["hertz"]
    assert LinSettings(preset="literal").scheme() == SCHEMES["hertz-literal"]
    given = {
        "dt": 2e-3, "wall_friction": 0.3, "wall_social": 100.0, "anisotropy": 0.1, "no_rotation": True,
        "damping": "critical", "target": "nearest", "exit_depth": 0.2, "cutoff": 0.3,
    }  # fmt: skip
    settings = LinSettings(2, 5, **given)
    case = settings.case(20, 1.4, 250.0)
    assert list(case.seeds) == [5, 6] and case.dt == 2e-3
    scheme, social, place = case.scheme, case.scheme.social, case.place
    assert (scheme.wall_friction, scheme.damping_unit, scheme.rotation) == (0.3, "critical", False)
    assert (social.strength, social.wall_strength, social.anisotropy, social.cutoff) == (250.0, 100.0, 0.1, 0.3)
    assert (place.population.people, place.target, place.geometry.bounds[2]) == (20, "nearest", 15.2)
    assert settings.changed() == given


@pytest.mark.more
def test_a_blocked_run_has_no_clearance_time(tmp_path):
    case = LinSettings(1).case(6, 1.0)
    (whole,) = run(case, tmp_path)
    exits = np.sort(whole.exit_time)
    pauses = np.diff([0.0, *exits])
    k = int(np.argmax(pauses))
    # Nobody can be out within half a second; then a patience just shorter, and just longer, than the longest pause.
    for patience, out in ((0.5, 0), (float(pauses.max()) - 0.2, k), (float(pauses.max()) + 1e-6, 6)):
        place = replace(case.place, blocked_after=patience)
        (one,) = run(replace(case, place=place), tmp_path)
        found = Sample(case, [one])
        assert len(found.exits[0]) == out and one.metrics.unfinished == 6 - out, patience
        np.testing.assert_array_equal(found.exits[0], exits[:out])
        assert found.blocked == (out < 6) and (found.median is None) == (out < 6), patience
        if out < 6:
            assert found.blocked_since == [0.0 if out == 0 else exits[out - 1]], patience


@pytest.mark.more
def test_a_run_at_the_end_of_its_time_is_neither_cleared_nor_blocked(tmp_path):
    case = LinSettings(1).case(6, 1.0)
    found = Sample(case, run(replace(case, place=replace(case.place, time_limit=1.0)), tmp_path))
    assert (found.blocked, found.median, found.count_blocked()) == (0, None, "none of 1 blocked, 1 unfinished")


@pytest.mark.more
def test_moments_of_figure_6_show_everybody_inside(tmp_path, monkeypatch):
    monkeypatch.setattr(room, "MOMENTS", (0.0, 1.2, 4.0, 60.0))
    case = LinSettings(1).case(6, 1.0)
    (plain,) = run(case, tmp_path)
    (kept,) = run(replace(case, recorder=room._Moments()), tmp_path)
    assert same(kept._replace(record=None), plain)  # keeping moments changes nothing
    inside = [len(rows) for rows in kept.record]
    assert inside == [int((plain.exit_time > moment).sum()) for moment in room.MOMENTS] and inside[0] == 6
    assert {len(row) for rows in kept.record for row in rows} == {4}


# -------------------------------------------------------------------------------------------- many runs, kept in files


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    return evacuate(small(), Store(tmp_path_factory.mktemp("runs")), Serial())


@pytest.fixture
def batches(monkeypatch):
    """Return the seeds of every batch that is simulated."""
    seeds, simulate = [], evacuations.simulate_batch

    def counted(batch, stopped):
        seeds.append([batch.seed + run for run in batch.runs])
        return simulate(batch, stopped)

    monkeypatch.setattr(evacuations, "simulate_batch", counted)
    return seeds


@pytest.mark.more
def test_a_run_is_computed_once_and_read_back_to_the_last_bit(uninterrupted, tmp_path, batches):
    counts = []
    assert same(evacuate(small(), Store(tmp_path), Serial(), progress=counts.append), uninterrupted)
    assert sum(map(len, batches)) == sum(counts) == 4
    assert same(evacuate(small(), Store(tmp_path), Serial()), uninterrupted) and sum(map(len, batches)) == 4
    assert [len(runs) for runs in evacuate(small(3), Store(tmp_path), Serial()).values()] == [3, 3]
    assert sum(map(len, batches)) == 6  # one draw more of each
    evacuate(small(), Store(tmp_path), Serial(), fresh=True)
    assert sum(map(len, batches)) == 10


@pytest.mark.more
def test_interrupted_and_resumed_is_uninterrupted(uninterrupted, tmp_path, monkeypatch, batches):
    with monkeypatch.context() as patch:
        patch.setattr(evacuations, "_MANY", 1)  # one run at a time
        counted = evacuations.simulate_batch

        def stops(batch, stopped):
            if len(batches) == 3:
                raise KeyboardInterrupt
            return counted(batch, stopped)

        patch.setattr(evacuations, "simulate_batch", stops)
        with pytest.raises(
            Interrupted, match=r"^3 of 4 runs are kept in .*; without --fresh, the same command goes on"
        ):
            evacuate(small(), Store(tmp_path / "runs"), Serial())
    assert same(evacuate(small(), Store(tmp_path / "runs"), Serial()), uninterrupted)
    assert sum(map(len, batches)) == 4


@pytest.mark.more
def test_the_number_of_processes_changes_nothing(uninterrupted, tmp_path):
    assert same(evacuate(small(), Store(tmp_path), Processes(2)), uninterrupted)


def test_another_case_is_another_file():
    names = {LinSettings(1).case(6, 1.0).name(0)}
    cases = [
        *(LinSettings(1).case(*other) for other in ((7, 1.0), (6, 1.1), (6, 1.0, 200.0), (6, 1.0, 300.0, False))),
        *(
            LinSettings(1, **{name: value}).case(6, 1.0)
            for name, value in {
                "dt": 2e-3, "friction": 0.25, "wall_friction": 0.2, "wall_social": 0.0, "anisotropy": 0.2,
                "damping": "rate", "cutoff": 0.3, "target": "nearest", "exit_depth": 0.1,
            }.items()
        ),
        replace(LinSettings(1).case(6, 1.0), recorder=room._Moments()),
    ]  # fmt: skip
    for case in cases:
        assert case.name(0) not in names, case
        names.add(case.name(0))


@pytest.mark.more
def test_a_change_of_the_physics_never_serves_old_runs(tmp_path, monkeypatch, batches):
    run(LinSettings(1).case(6, 1.0), tmp_path)
    monkeypatch.setattr(jit, "STAMP", "0123456789abcdef")
    run(LinSettings(1).case(6, 1.0), tmp_path)
    assert len(batches) == 2


@pytest.mark.more
def test_what_cannot_go_on_is_said(tmp_path, monkeypatch):
    (tmp_path / "runs").write_text("a file")
    with pytest.raises(ValueError, match="cannot keep the runs in"):
        evacuate(small(1), Store(tmp_path / "runs"), Serial())
    monkeypatch.setattr(evacuations, "decode", lambda *_: episode(LinSettings(1).case(6, 1.0), 0, np.ones(6)))
    escaped = LinSettings(1).case(6, 1.0)
    (one,) = run(escaped, tmp_path / "kept")
    one = one._replace(metrics=one.metrics._replace(escaped=1))
    with pytest.raises(FloatingPointError, match="hertz: 1 people were outside of the plan"):
        evacuations._sound(escaped, [one])


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
    while process.poll() is None and not list(tmp_path.glob("runs/*/*.json")):
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all processes
    out, said = process.communicate(timeout=600)
    assert (process.returncode, out) == (130, "")
    assert said.count("\n") == 1 and "of 24 runs are kept" in said
    kept = int(said.split()[1])
    files = {path: path.read_bytes() for path in (tmp_path / "runs").rglob("*.json")}
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
    settings, finer = LinSettings(5), LinSettings(8)
    cases = {
        "100 at 1": finer.case(100, 1.0),
        "100 at 1, dt 2e-3": replace(finer, dt=2e-3).case(100, 1.0),
        "200 at 0.6": settings.case(200, 0.6),
        "200 at 1": settings.case(200, 1.0),
        "200 at 2": settings.case(200, 2.0),
        "100 at 2": settings.case(100, 2.0),
        "100 at 2, no rotation": settings.case(100, 2.0, rotation=False),
    }
    runs = evacuate(cases, Store(tmp_path), Processes())
    found = {name: Sample(case, runs[name]) for name, case in cases.items()}
    assert 110 <= found["100 at 1"].median <= 140
    assert 320 <= found["200 at 0.6"].median <= 385 and found["200 at 0.6"].blocked == 0
    assert 200 <= found["200 at 1"].median <= 260 and found["200 at 1"].blocked <= 1
    assert found["200 at 2"].blocked >= 4
    assert found["100 at 2, no rotation"].blocked >= 4
    assert found["100 at 2, no rotation"].blocked > found["100 at 2"].blocked + 1
    assert found["100 at 1, dt 2e-3"].median == pytest.approx(found["100 at 1"].median, rel=0.10)
    for some in found.values():
        assert all(np.diff([0.0, *exits]).max(initial=0.0) <= 120.0 for exits in some.exits)
