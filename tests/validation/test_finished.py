"""What a run of the map has finished is kept, scheme by scheme and manner by manner, and is not computed again."""

import json

import pytest
from cases import looped
from typer.testing import CliRunner

from crowd_env.core.behaviors.headway import MANNERS, Headway
from validation.cases import Case
from validation.cases.case import row
from validation.cli import app
from validation.finished import complete_rows


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


@pytest.fixture
def asked(monkeypatch):
    """Return what the only case, made up, is asked for."""
    settings = []

    def run_case(setting):
        settings.append((setting.scheme, setting.manner))
        yield row("made-up", setting, True, f"{setting.scheme}, {setting.manner}", "c", "s")
        if setting.scheme == "nsm2" and len(settings) < 3:
            raise KeyboardInterrupt
        yield row("made-up", setting, None, "second", "c", "s")

    case = Case("t", run_case, "none", draws=7, manners=("calm",), recordings=True)
    monkeypatch.setattr("validation.cli.CASES", {"made-up": case})
    return settings


def test_what_is_finished_is_not_run_again(asked, tmp_path):
    words = ("--schemes", "nsm1", "--schemes", "dem", "--out", tmp_path, "--json")
    first = run(*words)
    assert asked == [("nsm1", "calm"), ("dem", "calm")]
    again = run(*words, "--manner", "calm", "--manner", "hurried")
    assert asked == [("nsm1", "calm"), ("dem", "calm"), ("nsm1", "hurried"), ("dem", "hurried")]
    rows = json.loads(again.stdout)["rows"]
    assert [one for one in rows if one["manner"] == "calm"] == json.loads(first.stdout)["rows"] and len(rows) == 8


def test_an_interruption_loses_no_row_and_the_case_is_run_anew(asked, tmp_path):
    words = ("--schemes", "dem", "--schemes", "nsm2", "--out", tmp_path)
    stopped = run(*words)
    assert stopped.exit_code == 130 and "finished are in" in stopped.stderr
    assert len(json.loads((tmp_path / "made-up" / "nsm2-calm.json").read_text())["rows"]) == 1
    assert [one.scheme for one in complete_rows(tmp_path, "made-up")] == ["dem", "dem"]
    assert run(*words).exit_code == 0
    assert asked == [("dem", "calm"), ("nsm2", "calm"), ("nsm2", "calm")]
    assert [one.scheme for one in complete_rows(tmp_path, "made-up")] == ["dem", "dem", "nsm2", "nsm2"]


def test_a_second_interruption_loses_no_row_of_the_first(monkeypatch, tmp_path):
    last = iter([3, 1, 9])

    def run_case(setting):
        end = next(last)
        for k in range(5):
            if k == end:
                raise KeyboardInterrupt
            yield row("made-up", setting, True, str(k), "c", "s")

    monkeypatch.setattr("validation.cli.CASES", {"made-up": Case("t", run_case, "none", manners=("calm",))})
    path = tmp_path / "made-up" / "dem-calm.json"
    for count in (3, 3, 5):
        run("--schemes", "dem", "--out", tmp_path)
        assert len(json.loads(path.read_text())["rows"]) == count


def test_processes_that_fill_one_folder_add_up_in_the_order_of_the_schemes(asked, tmp_path):
    for scheme, manner in (("hertz", "calm"), ("dem", "hurried"), ("dem", "calm")):
        run("--schemes", scheme, "--manner", manner, "--out", tmp_path)
    figures = [one.figure for one in complete_rows(tmp_path, "made-up")][::2]
    assert figures == ["dem, hurried", "dem, calm", "hertz, calm"]


@looped(
    ("words", "said"),
    [
        (("--draws", 3), "draws is 7 there and 3 here"),
        (("--seed", 1), "seed is 0 there and 1 here"),
        (("--data", "."), "recordings is False there and True here"),
    ],
)
def test_rows_of_another_run_are_neither_taken_nor_replaced(asked, tmp_path, words, said):
    run("--schemes", "dem", "--out", tmp_path)
    before = (tmp_path / "made-up" / "dem-calm.json").read_bytes()
    other = run("--schemes", "nsm1", "--schemes", "dem", "--out", tmp_path, *words)
    assert other.exit_code == 2 and "dem-calm.json was made by another command" in other.stderr and said in other.stderr
    assert asked == [("dem", "calm")] and (tmp_path / "made-up" / "dem-calm.json").read_bytes() == before


def test_recordings_do_not_matter_to_a_case_that_reads_none(monkeypatch, tmp_path):
    seen = []

    def run_case(setting):
        seen.append(setting.data)
        yield row("made-up", setting, True, "", "c", "s")

    monkeypatch.setattr("validation.cli.CASES", {"made-up": Case("t", run_case, "none", manners=("calm",))})
    words = ("--schemes", "dem", "--out", tmp_path)
    assert run(*words).exit_code == run(*words, "--data", ".").exit_code == 0
    assert seen == [None]


def test_rows_of_other_rules_are_not_taken(asked, tmp_path, monkeypatch):
    run("--schemes", "dem", "--out", tmp_path)
    calm = MANNERS["calm"]
    monkeypatch.setitem(MANNERS, "calm", Headway(time_gap=0.9))
    assert "walking.time_gap is" in run("--schemes", "dem", "--out", tmp_path).stderr
    monkeypatch.setitem(MANNERS, "calm", calm)
    monkeypatch.setattr("validation.finished.jit.STAMP", "of another day")
    assert "kernels is" in run("--schemes", "dem", "--out", tmp_path).stderr
    assert asked == [("dem", "calm")]


def test_a_file_of_something_else_is_named(asked, tmp_path):
    path = tmp_path / "made-up" / "dem-calm.json"
    path.parent.mkdir()
    path.write_text('{"rows": []}')
    assert "was made by another command" in run("--schemes", "dem", "--out", tmp_path).stderr and asked == []
    path.write_text("{")  # damaged: as good as none
    assert run("--schemes", "dem", "--out", tmp_path).exit_code == 0 and asked == [("dem", "calm")]
