"""The command that reproduces the figures of Lin, Ma, Lo."""

from dataclasses import replace

import numpy as np
import pytest
from lin_runs import invented
from reproductions import call, check_files, reported

from crowd_env.reproduce import PAPERS
from crowd_env.reproduce.lin2016 import fig9
from crowd_env.reproduce.lin2016.record import Record
from crowd_env.reproduce.lin2016.run import Run
from crowd_env.reproduce.lin2016.sample import clearance_rows, sample
from crowd_env.reproduce.lin2016.settings import LinSettings
from crowd_env.reproduce.pool import distinct

LIN = PAPERS["lin"].figures
KEYS = {"quantity", "paper", "here", "unit", "n", "reading", "closed_form", "sd", "ci95"}


def all_runs(settings):
    return distinct(run for figure in LIN.values() for run in figure.runs(settings))


@pytest.fixture
def undrawn(monkeypatch):
    """Write no files of results: drawing takes most of the time."""
    monkeypatch.setattr("crowd_env.cli.reproduce._write", lambda result, out: [out / f"{result.name}.csv"])


# ---------------------------------------------------------------------------------------------------- how it is said


@pytest.mark.parametrize("name", list(LIN))
def test_json_files_and_figure(name, folder, computed):
    draws = "" if name == "lin-fig6" else "--runs 4 "
    object = reported(f"{name} {draws}--seed 2 --workers 1")
    assert object["name"] == name and object["options"] == {}
    for row in object["rows"]:
        assert set(row) == KEYS and (row["here"] is None or np.isfinite(row["here"]))
    check_files(object, folder)
    assert "FITTED to Figure 7" in " ".join(object["remarks"])
    assert len(list((folder / "reproduce" / "runs").iterdir())) == len(computed)
    assert {run.seed for run in computed} <= {2, 3, 4, 5}


def test_all_figures_share_their_runs(folder, computed, undrawn):
    object = reported("lin --runs 2 --workers 1")
    assert list(dict.fromkeys(row["of"] for row in object["rows"])) == list(LIN)
    needed = all_runs(LinSettings(runs=2))
    alone = sum(len(distinct(figure.runs(LinSettings(runs=2)))) for figure in LIN.values())
    assert len(computed) == len(set(computed)) == len(needed) < alone
    again = [reported(f"{name}{'' if name == 'lin-fig6' else ' --runs 2'}") for name in LIN]
    assert len(computed) == len(needed)  # all there
    assert [row["here"] for each in again for row in each["rows"]] == [row["here"] for row in object["rows"]]
    reported("lin-fig4 --runs 2 --workers 1 --fresh")
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
    # Wilson's interval of 2 of 5, as scipy.stats.binomtest has it.
    np.testing.assert_allclose(blocked.ci95, (0.11762, 0.76927), atol=1e-5)
    assert blocked.explained() == f"{blocked.reading}; of all runs, 95 %: 12 to 77 %"
    assert found.blocked_share() == "2 of 5 blocked (95 %: 12 to 77 %)"
    stuck = sample(records, [runs[1], runs[3]])
    clearance, blocked = clearance_rows("1.8 m/s", stuck, "45")
    assert (clearance.here, clearance.shown(), clearance.difference(), clearance.n) == (None, "-", "-", 0)
    assert stuck.mostly_blocked and stuck.times == [None, None] and len(stuck.mean_flows) == 0


def test_everything_blocked_is_said_and_drawn(folder, monkeypatch):
    monkeypatch.setattr(Run, "simulate", lambda run, stopped=None: Record((), run.count, 0.0, invented(run).snapshots))
    object = reported("lin --runs 2 --workers 1")
    for row in object["rows"]:
        if row["unit"] == "s":
            assert row["here"] is None and row["n"] == 0
    text = " ".join(object["remarks"])
    assert "NOT reproduced: clearance, A = 200 N (- s, printed 170)" in text
    assert all((folder / "reproduce" / f"{name}.png").exists() for name in LIN)


def test_remarks_follow_the_figures(folder, computed, undrawn, monkeypatch):
    text = " ".join(reported("lin --runs 4 --workers 1")["remarks"])
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

    monkeypatch.setattr(Run, "simulate", faster)
    text = " ".join(reported("lin --runs 4 --workers 1 --fresh --preset literal")["remarks"])
    assert "NOT barely" in text and "At no speed do half of the draws block" in text
    assert "more likely without: reproduced" in text
    assert "FITTED" not in text and "the text as printed" in text
    assert "as asked for" in " ".join(reported("lin-fig4 --runs 1 --workers 1 --wall-social 100")["remarks"])


def test_options_that_differ_are_reported(folder, computed, undrawn):
    line = (
        "lin-fig4 --runs 1 --workers 1 --preset literal --wall-friction 0.2 --dt 0.002 --damping rate --target nearest"
    )
    object = reported(line + " --exit-depth 0.1 --cutoff 0.3 --anisotropy 0.2 --no-rotation --wall-social 50")
    assert object["options"] == {
        "preset": "literal", "wall_friction": 0.2, "dt": 0.002, "damping": "rate", "target": "nearest", "exit_depth": 0.1,
        "cutoff": 0.3, "anisotropy": 0.2, "no_rotation": True, "wall_social": 50.0,
    }  # fmt: skip


def test_windows_hold_every_exit():
    exits = np.array([3.0, 9.99, 10.0, 25.0, 31.0, 47.0])
    assert (fig9.window_flow(exits, 47.0) * 10).tolist() == [2, 1, 1, 1, 1]
    assert fig9.inner_flow(Record(tuple(exits), 0)).tolist() == [0.1, 0.1, 0.1]  # 10 to 40 s
    assert len(fig9.inner_flow(Record((), 5, 0.0))) == len(fig9.inner_flow(Record((3.0, 4.0), 0))) == 0


def test_list_names_both_papers():
    listed = reported("list")
    assert listed["groups"]["all"] == [*listed["groups"]["pecol"], *listed["groups"]["lin"]] == list(listed["names"])
    assert listed["groups"]["lin"] == list(LIN)
    shown = call("list").stdout
    assert all(name in shown for name in (*listed["names"], *listed["groups"]))
