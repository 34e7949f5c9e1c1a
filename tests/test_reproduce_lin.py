"""The figures of Lin, Ma, Lo from the command line: runs computed once and kept, what blocked, and how it is told."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from crowd_env.env import CrowdEnv
from crowd_env.physics import SCHEMES
from crowd_env.reproduce import LIN, LinSettings, lin_fig9, lin_pool, lin_store
from crowd_env.reproduce.command import app
from crowd_env.reproduce.lin_pool import Interrupted, complete, distinct
from crowd_env.reproduce.lin_run import Record, Run, Stopped, simulate, until_blocked
from crowd_env.reproduce.lin_sample import clearance_rows, sample
from crowd_env.reproduce.lin_store import Store, identity

PNG = b"\x89PNG\r\n\x1a\n"
KEYS = {"quantity", "paper", "here", "unit", "n", "reading", "closed_form", "sd", "ci95"}
# Six people are out within seconds; nothing else is smaller than in the figures.
SMALL = [
    Run(6, speed, seed, rotation=rotation) for speed in (1.0, 2.0) for seed in (0, 1) for rotation in (True, False)
]


def nothing(count):
    """Report progress to nobody."""


def call(line):
    return CliRunner().invoke(app, line.split())


def told(line):
    result = call(line + " --json")
    assert result.exit_code == 0, result.stderr
    assert result.stdout.count("\n") == 1
    return json.loads(result.stdout)


def all_runs(settings):
    return distinct(run for figure in LIN.values() for run in figure.runs(settings))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def invented(run):
    """Return what could have come of a run: the paper's times, and blocked above 1.6 m/s in every second draw."""
    if run.desired_speed > 1.6 and run.seed % 2 == 1:
        left = run.count // 2
        return Record(tuple(float(k) for k in range(run.count - left)), left, float(run.count - left - 1))
    pace = {200.0: 1.7}.get(run.strength, 1.2) / min(run.desired_speed, 1.0) + 0.01 * run.seed
    times = pace * np.arange(1.0, run.count + 1.0)
    moments = tuple(
        (moment, *(((5.0,) * int((times > moment).sum()),) * 2), *(((0.3,) * int((times > moment).sum()),) * 2))
        for moment in run.moments
    )
    return Record(tuple(times.tolist()), 0, None, tuple(lin_store.Snapshot(*moment) for moment in moments))


@pytest.fixture
def computed(monkeypatch):
    """Let nothing be simulated, and return the list of runs that would have been."""
    runs = []

    def instead(run, stopped=None):
        runs.append(run)
        return invented(run)

    monkeypatch.setattr(lin_pool, "simulate", instead)
    return runs


@pytest.fixture
def undrawn(monkeypatch):
    """Write no files of results: drawing takes most of the time."""
    monkeypatch.setattr("crowd_env.reproduce.command._write", lambda result, out: [out / f"{result.name}.csv"])


# ---------------------------------------------------------------------------------------------------------- one run


def test_a_run_is_the_evacuation_of_the_run_command():
    run = Run(12, 1.5, seed=3)
    env = CrowdEnv("lin-room-v0", scheme="hertz", count=12, desired_speed=1.5)
    env.reset([3])
    while not env.finished.all():
        env.step(None)
    assert simulate(run).exit_times == tuple(np.sort(env.simulation.state.exit_time).tolist())
    assert simulate(run).left == 0 and simulate(run).blocked_since is None


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
    assert (scenario.population.count, scenario.target, scenario.geometry.bounds[2]) == (20, "nearest", 15.2)
    assert first.dt == 2e-3
    assert set(settings.changed()) == {
        "dt", "wall_friction", "wall_social", "anisotropy", "no_rotation", "damping", "target", "exit_depth", "cutoff",
    }  # fmt: skip


@pytest.mark.parametrize("change", [{"wall_social": 0.0}, {"target": "nearest"}, {"exit_depth": 0.3}, {"dt": 2e-3}])
def test_readings_change_the_outcome(change):
    run = Run(6, 1.0)
    assert simulate(replace(run, **change)).exit_times != simulate(run).exit_times


def test_keeping_moments_changes_nothing():
    run = Run(6, 1.0)
    kept = simulate(replace(run, moments=(0.0, 1.2345, 4.0, 60.0)))
    assert replace(kept, snapshots=()) == simulate(run)
    assert [snapshot.time for snapshot in kept.snapshots] == pytest.approx([0.0, 1.234, 4.0, 60.0], abs=5e-4)
    inside = [len(snapshot.x) for snapshot in kept.snapshots]
    assert inside[0] == 6 and inside[-1] == 0 and sorted(inside, reverse=True) == inside
    assert {len(column) for column in kept.snapshots[0][1:]} == {6}


def test_a_blocked_run_has_no_clearance_time():
    # Nobody can be out within half a second: blocked from the start, by the rule.
    record = simulate(Run(6, 1.0, blocked_after=0.5))
    assert (record.blocked_since, record.left, record.clearance_time) == (0.0, 6, None)
    whole = simulate(Run(6, 1.0))
    pauses = np.diff([0.0, *whole.exit_times])
    record = simulate(Run(6, 1.0, blocked_after=float(pauses.max()) - 1e-6))
    k = int(np.argmax(pauses))
    assert record.exit_times == whole.exit_times[:k] and record.left == 6 - k and record.clearance_time is None
    assert simulate(Run(6, 1.0, blocked_after=float(pauses.max()) + 1e-6)) == whole


def test_a_run_at_the_end_of_its_time_is_neither_cleared_nor_blocked():
    record = simulate(Run(6, 1.0, time_limit=1.0))
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
        simulate(Run(6, 1.0), lambda: True)


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
    done = []

    def interrupted(run, stopped=None):
        if len(done) == 3:
            raise KeyboardInterrupt
        done.append(run)
        return simulate(run)

    monkeypatch.setattr(lin_pool, "simulate", interrupted)
    with pytest.raises(Interrupted, match=r"^3 of 8 runs are kept in .*runs.*goes on from there$"):
        complete(SMALL, Store(tmp_path / "runs"), progress=nothing)
    assert len(list((tmp_path / "runs").iterdir())) == 3
    again = []
    monkeypatch.setattr(lin_pool, "simulate", lambda run: again.append(run) or simulate(run))
    assert complete(SMALL, Store(tmp_path / "runs"), progress=nothing) == uninterrupted
    assert len(again) == 5 and not set(again) & set(done)


def test_the_number_of_processes_changes_nothing(uninterrupted, tmp_path):
    store, counts = Store(tmp_path), []
    assert complete(SMALL, store, workers=2, progress=counts.append) == uninterrupted
    assert sum(counts) == len(SMALL)
    assert {run: store.load(run) for run in SMALL} == uninterrupted
    assert len(list(tmp_path.iterdir())) == len(SMALL)


def test_an_error_in_another_process_arrives_and_the_rest_is_kept(tmp_path):
    wild = replace(SMALL[0], dt=0.5)
    with pytest.raises(ValueError, match="stable step"):
        complete([*SMALL[:2], wild], Store(tmp_path), workers=2, progress=nothing)


def test_what_is_kept_is_what_was_computed(tmp_path):
    store, run = Store(tmp_path), Run(6, 1.0, moments=(0.0, 2.0))
    record = simulate(run)
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
    monkeypatch.setattr(lin_store._jit, "CACHE_FOLDER", Path("kernels-0123456789abcdef"))
    assert store.load(run) is None
    complete([run], store, progress=nothing)
    assert len(computed) == 2
    assert identity(run)["kernels"] == "kernels-0123456789abcdef"


def test_a_folder_that_cannot_be_written_is_told(tmp_path):
    (tmp_path / "runs").write_text("a file")
    with pytest.raises(ValueError, match="cannot keep the runs in"):
        complete(SMALL[:1], Store(tmp_path / "runs"), progress=nothing)


@pytest.mark.slow
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


# ---------------------------------------------------------------------------------------------------- how it is told


@pytest.mark.parametrize("name", list(LIN))
def test_json_files_and_figure(name, folder, computed):
    draws = "" if name == "lin-fig6" else "--runs 4 "
    object = told(f"{name} {draws}--seed 2 --workers 1")
    assert object["name"] == name and object["rows"] and object["options"] == {}
    for row in object["rows"]:
        assert set(row) == KEYS
        assert row["paper"] is None or isinstance(row["paper"], float)
        assert row["here"] is None or np.isfinite(row["here"])
    quantities = [row["quantity"] for row in object["rows"]]
    assert len(set(quantities)) == len(quantities)
    assert "FITTED to Figure 7" in " ".join(object["remarks"])
    assert (folder / "reproduce" / f"{name}.png").read_bytes()[:8] == PNG
    with (folder / "reproduce" / f"{name}.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["quantity"] for row in rows] == quantities
    assert [float(row["here"]) for row in rows if row["here"]] == [
        row["here"] for row in object["rows"] if row["here"] is not None
    ]
    assert len(list((folder / "reproduce" / "runs").iterdir())) == len(computed)
    assert {run.seed for run in computed} <= {2, 3, 4, 5}


def test_all_figures_share_their_runs(folder, computed, undrawn):
    object = told("lin --runs 2 --workers 1")
    assert list(dict.fromkeys(row["of"] for row in object["rows"])) == list(LIN)
    needed = all_runs(LinSettings(runs=2))
    alone = sum(len(distinct(figure.runs(LinSettings(runs=2)))) for figure in LIN.values())
    assert len(computed) == len(set(computed)) == len(needed) < alone
    again = [told(f"{name}{'' if name == 'lin-fig6' else ' --runs 2'}") for name in LIN]
    assert len(computed) == len(needed)  # all there
    assert [row["here"] for each in again for row in each["rows"]] == [row["here"] for row in object["rows"]]
    told("lin-fig4 --runs 2 --workers 1 --fresh")
    assert len(computed) == len(needed) + 8


def test_table_is_readable_and_fits(folder, computed, undrawn):
    result = call("lin --runs 4 --workers 1 --no-rotation --preset literal")
    assert result.exit_code == 0, result.output
    assert max(len(line) for line in result.stdout.splitlines()) <= 100
    for words in ("quantity", "difference", "A = 200 N", "2 of 4 blocked", "--no-rotation", "--preset literal"):
        assert words in result.stdout
    assert "nan" not in result.stdout and "--no-rotation True" not in result.stdout
    assert "files: reproduce/lin-fig10.csv" in result.stderr


def test_blocked_draws_are_counted_and_left_out_of_medians():
    runs = tuple(Run(4, 1.8, seed) for seed in range(5))
    ends = [(10.0, 20.0, 30.0, 40.0), (10.0, 20.0), (10.0, 20.0, 30.0, 50.0), (), (1.0, 2.0, 3.0, 90.0)]
    since = [None, 20.0, None, 0.0, None]
    records = {run: Record(e, 4 - len(e), s) for run, e, s in zip(runs, ends, since, strict=True)}
    found = sample(records, runs)
    clearance, blocked = clearance_rows("1.8 m/s", found, "45")
    assert (clearance.here, clearance.n, clearance.difference()) == (50.0, 3, "+11.1 %")
    assert "40 to 90" in clearance.reading and "2 of 5 blocked" in clearance.reading
    assert (blocked.here, blocked.n, blocked.unit) == (2, 5, "runs")
    assert blocked.reading == "since 0 to 20 s, 2 to 4 left"
    stuck = sample(records, [runs[1], runs[3]])
    clearance, blocked = clearance_rows("1.8 m/s", stuck, "45")
    assert (clearance.here, clearance.shown(), clearance.difference(), clearance.n) == (None, "-", "-", 0)
    assert stuck.mostly_blocked and stuck.times == [None, None] and len(stuck.mean_flows) == 0


def test_everything_blocked_is_told_and_drawn(folder, monkeypatch):
    monkeypatch.setattr(lin_pool, "simulate", lambda run: Record((), run.count, 0.0, invented(run).snapshots))
    object = told("lin --runs 2 --workers 1")
    for row in object["rows"]:
        if row["unit"] == "s":
            assert row["here"] is None and row["n"] == 0
    text = " ".join(object["remarks"])
    assert "NOT reproduced: clearance, A = 200 N (- s, printed 170)" in text
    assert all((folder / "reproduce" / f"{name}.png").exists() for name in LIN)


def test_remarks_follow_the_figures(folder, computed, undrawn, monkeypatch):
    text = " ".join(told("lin --runs 4 --workers 1")["remarks"])
    assert "Within 10 %: clearance, A = 200 N (171.5 s, printed 170), clearance, A = 300 N" in text
    assert "+42 % in the paper" in text and "(as the paper says: barely)" in text
    assert "half of the draws or more block from 1.8 m/s on; the paper: from 1.8 m/s on" in text
    assert "basically the same: reproduced" in text and "more likely without: NOT reproduced" in text
    assert "100 people from 1.8 m/s on, 200 people from 1.8 m/s on, 300 people from 1.8 m/s on" in text

    def faster(run, stopped=None):
        if not run.rotation and run.desired_speed > 1.5:
            return Record((1.0,), run.count - 1, 1.0)
        record = invented(replace(run, seed=0))
        slow = (run.strength == 500.0) + 1.0
        return replace(record, exit_times=tuple(slow * t for t in record.exit_times)) if run.strength != 200 else record

    monkeypatch.setattr(lin_pool, "simulate", faster)
    text = " ".join(told("lin --runs 4 --workers 1 --fresh --preset literal")["remarks"])
    assert "NOT barely" in text and "At no speed do half of the draws block" in text
    assert "more likely without: reproduced" in text
    assert "FITTED" not in text and "the text as printed" in text
    assert "as asked for" in " ".join(told("lin-fig4 --runs 1 --workers 1 --wall-social 100")["remarks"])


def test_options_that_differ_are_told(folder, computed, undrawn):
    line = (
        "lin-fig4 --runs 1 --workers 1 --preset literal --wall-friction 0.2 --dt 0.002 --damping rate --target nearest"
    )
    object = told(line + " --exit-depth 0.1 --cutoff 0.3 --anisotropy 0.2 --no-rotation --wall-social 50")
    assert object["options"] == {
        "preset": "literal", "wall_friction": 0.2, "dt": 0.002, "damping": "rate", "target": "nearest", "exit_depth": 0.1,
        "cutoff": 0.3, "anisotropy": 0.2, "no_rotation": True, "wall_social": 50.0,
    }  # fmt: skip


def test_windows_hold_every_exit():
    exits = np.array([3.0, 9.99, 10.0, 25.0, 31.0, 47.0])
    assert (lin_fig9.window_flow(exits, 47.0) * 10).tolist() == [2, 1, 1, 1, 1]
    assert lin_fig9.inner_flow(Record(tuple(exits), 0)).tolist() == [0.1, 0.1, 0.1]  # 10 to 40 s
    assert len(lin_fig9.inner_flow(Record((), 5, 0.0))) == len(lin_fig9.inner_flow(Record((3.0, 4.0), 0))) == 0


def test_list_names_both_papers():
    listed = told("list")
    assert listed["groups"]["all"] == [*listed["groups"]["pecol"], *listed["groups"]["lin"]] == list(listed["names"])
    assert listed["groups"]["lin"] == list(LIN)
    shown = call("list").stdout
    assert all(name in shown for name in (*listed["names"], *listed["groups"]))


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("lin-fig11", "lin-fig11 lin-fig4 lin-fig10 pecol lin all"),
        ("table5 --preset literal", "--preset lin table5"),
        ("pecol --no-rotation", "--no-rotation lin pecol"),
        ("table3 --workers 2", "--workers lin table3"),
        ("fig2 --fresh", "--fresh lin fig2"),
        ("lin --door-width 1", "--door-width fig3 table5 lin"),
        ("lin-fig7 --n 50", "--n fig3 table5 lin-fig7"),
        ("lin-fig7 --scheme dem", "--scheme fig3 lin-fig7"),
        ("lin-fig5 --no-rotation", "--no-rotation all but lin-fig5"),
        ("lin-fig6 --runs 3", "--runs lin-fig6"),
        ("lin-fig4 --preset guess", "--preset guess calibrated literal"),
        ("lin-fig4 --damping much", "--damping much per-length rate critical"),
        ("lin-fig4 --target up", "--target up path nearest centre width"),
        ("lin-fig4 --runs 0", "--runs 0 at least 1"),
        ("lin-fig4 --seed -1", "--seed -1 >= 0"),
        ("lin-fig4 --workers 0", "--workers 0 at least 1"),
        ("lin-fig4 --dt 0", "--dt > 0"),
        ("lin-fig4 --dt nan", "--dt finite"),
        ("lin-fig7 --dt 0.02", "dt 0.02 stable step"),
        ("lin-fig4 --wall-friction -1", "wall_friction >= 0"),
        ("lin-fig4 --wall-social -1", "wall_strength >= 0"),
        ("lin-fig4 --anisotropy 2", "anisotropy [-1, 1]"),
        ("lin-fig4 --cutoff 0", "cutoff > 0"),
        ("lin-fig4 --cutoff inf", "--cutoff finite"),
        ("lin-fig4 --exit-depth -1", "exit_depth >= 0"),
        ("all --preset guess", "--preset guess"),
        ("lin-fig4 --out taken", "--out taken not a folder"),
    ],
)
def test_a_mistake_is_one_plain_line_before_anything_runs(line, words, folder, monkeypatch):
    (folder / "taken").write_text("a file")
    monkeypatch.setattr(lin_pool, "simulate", lambda *_: pytest.fail("ran"))
    monkeypatch.setattr("crowd_env.reproduce.command._run", lambda *_: pytest.fail("ran"))
    result = call(line)
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert result.stderr.startswith("error: ") and result.stderr.count("\n") == 1
    for word in words.split():
        assert word in result.stderr
    assert [path.name for path in folder.iterdir()] == ["taken"]


# ------------------------------------------------------------------------------------------- what the paper shows


@pytest.mark.slow
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
    records = complete(runs, Store(tmp_path), workers=lin_pool.all_cores(), progress=nothing)
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
