"""The command that reproduces the figures of Lin, Ma, Lo."""

import numpy as np
import pytest
from lin_runs import episode, stuck
from reproductions import call, check_files, reported

from crowd_env.cli import reproduce as command
from crowd_env.reproduce import PAPERS
from crowd_env.reproduce.lin2016 import flow
from crowd_env.reproduce.lin2016.sample import Sample, clearance_rows
from crowd_env.reproduce.lin2016.settings import LinSettings

LIN = PAPERS["lin"].figures
KEYS = {"quantity", "paper", "here", "unit", "n", "reading", "closed_form", "sd", "ci95"}


@pytest.mark.more
def test_json_files_and_figure(folder, computed):
    for name in LIN:
        computed.clear()
        draws = "" if name == "lin-fig6" else "--runs 4 "
        object = reported(f"{name} {draws}--seed 2 --workers 1")
        assert object["name"] == name and object["options"] == {}
        for row in object["rows"]:
            assert set(row) == KEYS and (row["here"] is None or np.isfinite(row["here"])), name
        check_files(object, folder)
        assert name == "lin-fig6" or "FITTED to Figure 7" in " ".join(object["remarks"]), name
        assert computed and {seed for _, seed in computed} == ({2} if name == "lin-fig6" else {2, 3, 4, 5}), name


@pytest.mark.more
def test_all_figures_are_made_and_fresh_runs_are_made_once(folder, monkeypatch, computed, undrawn):
    object = reported("lin --runs 2 --workers 1")
    assert list(dict.fromkeys(row["of"] for row in object["rows"])) == list(LIN)
    again, instead = [], command.evacuate

    def noted(cases, *_, fresh=False, **__):
        if fresh:
            again.extend(case.name(seed) for case in cases.values() for seed in case.seeds)
        return instead(cases)

    monkeypatch.setattr(command, "evacuate", noted)
    assert reported("lin --runs 2 --workers 1 --fresh") == object
    assert len(again) == len(set(again)) > 50  # what figures share is computed once


@pytest.mark.more
def test_table_is_readable_and_fits(folder, computed, undrawn):
    result = call("lin --runs 4 --workers 1 --set no_rotation=true --set preset=literal")
    assert result.exit_code == 0, result.output
    assert max(len(line) for line in result.stdout.splitlines()) <= 100
    for words in ("quantity", "difference", "A = 200 N", "2 of 4 blocked", "no_rotation True", "preset literal"):
        assert words in result.stdout, words
    assert "nan" not in result.stdout and "the text as printed" in result.stdout
    assert "files: reproduce/lin-fig10.csv" in result.stderr


def test_blocked_draws_are_counted_and_left_out_of_medians():
    case = LinSettings(5).case(4, 1.8)
    ends = [(10.0, 20.0, 30.0, 40.0), (10.0, 20.0), (10.0, 20.0, 30.0, 50.0), (), (1.0, 2.0, 3.0, 90.0)]
    since = [None, 20.0, None, 0.0, None]
    found = Sample(case, [episode(case, k, *one) for k, one in enumerate(zip(ends, since, strict=True))])
    clearance, blocked = clearance_rows("1.8 m/s", found, "45")
    assert (clearance.here, clearance.n, clearance.difference()) == (50.0, 3, "+11.1 %")
    assert "40 to 90" in clearance.reading and "2 of 5 blocked" in clearance.reading
    assert (blocked.here, blocked.n, blocked.unit) == (2, 5, "runs")
    assert blocked.reading == "since 0 to 20 s, 2 to 4 left"
    # Wilson's interval of 2 of 5, as scipy.stats.binomtest has it.
    np.testing.assert_allclose(blocked.ci95, (0.11762, 0.76927), atol=1e-5)


@pytest.mark.more
def test_nobody_out_is_drawn_too(folder, monkeypatch):
    def instead(cases, *_, **__):
        return {key: [stuck(case, seed) for seed in case.seeds] for key, case in cases.items()}

    monkeypatch.setattr(command, "evacuate", instead)
    object = reported("lin --runs 2")
    times = [row for row in object["rows"] if row["quantity"].startswith("clearance")]
    assert times and all(row["here"] is None for row in times)


@pytest.mark.more
def test_settings_that_differ_are_reported(folder, computed, undrawn):
    changed = {
        "preset": "literal", "dt": 0.002, "wall_friction": 0.2, "wall_social": 50.0, "anisotropy": 0.2, "no_rotation": True,
        "damping": "rate", "target": "nearest", "exit_depth": 0.1, "cutoff": 0.3,
    }  # fmt: skip
    line = " ".join(f"--set {name}={value}" for name, value in changed.items())
    assert reported(f"lin-fig4 --runs 1 --workers 1 {line}")["options"] == changed


def test_windows_hold_every_exit():
    exits = np.array([3.0, 9.99, 10.0, 25.0, 31.0, 47.0])
    assert (flow.window_flow(exits, 47.0) * 10).tolist() == [2, 1, 1, 1, 1]
    assert flow.inner_flow(exits).tolist() == [0.1, 0.1, 0.1]  # 10 to 40 s
    assert len(flow.inner_flow(np.empty(0))) == len(flow.inner_flow(np.array([3.0, 4.0]))) == 0


@pytest.mark.more
def test_list_names_both_papers():
    listed = reported("list")
    assert (
        listed["groups"]["all"]
        == [name for paper in PAPERS for name in listed["groups"][paper]]
        == list(listed["names"])
    )
    assert listed["groups"]["lin"] == list(LIN)
    shown = call("list").stdout
    assert all(name in shown for name in (*listed["names"], *listed["groups"], "door_width", "preset"))
