"""The pages of the tasks: each has one, it says what the task is, and its table is made of submissions."""

import re
from functools import partial

import numpy as np
import pytest
from repository import ROOT
from typer.testing import CliRunner

from crowd_env.agents.evaluation.submission import write_content
from crowd_env.agents.tasks import TASKS, Task
from crowd_env.agents.tasks.floors import free_walk_time
from crowd_env.cli.agents import submit
from crowd_env.core.files.json_file import read_json
from validation import task_pages
from validation.cli import app
from validation.pages import GROUPS, TABLES, markdown

ROOM = {"scenario": "room-v0", "options": {"side": 4.0, "door_width": 1.2}, "people": 4, "scheme": "nsm2", "dt": 0.01}
SMALL = Task("small", "four people", **ROOM, time_limit=20.0, blocked_after=5.0, runs=3, frozen="")
PAGES = ROOT / "docs/tasks"


@pytest.mark.parametrize("name", TASKS)
def test_every_task_has_a_page_that_says_what_it_is_now(name):
    text = (PAGES / f"{name}.md").read_text(encoding="utf-8")
    assert markdown(task_pages.FACTS_HEAD, task_pages.facts(name)(None)) in text, "run python -m validation pages tasks"
    assert markdown(task_pages.PRESET_HEAD, task_pages.preset(name)(None)) in text, (
        "run python -m validation pages presets"
    )
    assert "**Floor: " in text and f"<!-- table: {name}-results -->" in text
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text):
        assert (PAGES / target).resolve().exists(), target


def test_the_list_of_tasks_names_all_of_them_and_its_links_work():
    text = (PAGES / "README.md").read_text(encoding="utf-8")
    targets = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text)
    assert {f"{name}.md" for name in TASKS} <= set(targets)
    assert all((PAGES / target).resolve().exists() for target in targets)


def test_every_submission_that_lies_there_fits_its_task():
    assert set(task_pages.submissions()) <= set(TASKS)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a folder with two submissions to a small task, of which tables are made."""
    monkeypatch.setitem(TASKS, "small", SMALL)
    asked = ("--task", "small", "--policy", "follow", "density-cap", "--robustness-runs", "2", "--out", str(tmp_path))
    assert CliRunner().invoke(submit.app, asked).exit_code == 0
    monkeypatch.setattr(task_pages, "submissions", partial(task_pages.submissions.__wrapped__, tmp_path))
    return tmp_path


def test_the_table_of_a_task_holds_the_rule_and_what_was_submitted(folder):
    rows = task_pages.results("small")(None)
    assert [row[0] for row in rows[:2]] == ["`rule`", "`rule-best-speed`, 1"]
    assert {row[0] for row in rows[2:]} == {"`follow`", "`density-cap`"}
    assert all(len(row) == len(task_pages.RESULTS_HEAD) for row in rows)
    assert all(row[1] == "0 of 3 (0 to 56 %)" and row[2] == "nobody" and row[-1] == "yes" for row in rows)
    note = task_pages.results_note("small")(None)
    assert "| twice the people |" in note and "| half of the people follow the rule |" in note
    assert "The first 2 draws of each" in note
    assert task_pages.results("room")(None) == [] and "No policy has been submitted yet" in task_pages.results_note(
        "room"
    )(None)


def test_the_leaderboard_has_the_soonest_first_and_the_doubtful_last(folder):
    rows = task_pages.leaders(None)
    times = {one["policy"]["name"]: np.mean(task_pages._runs(one, one["policy"]["name"])["last_time"])
             for one in task_pages.submissions()["small"]}  # fmt: skip
    order = sorted(times, key=times.get)
    assert [row[1] for row in rows] == [f"`{name}`" for name in order] and rows[0][0] == "[`small`](small.md)"
    assert all(len(row) == len(task_pages.LEADERS_HEAD) for row in rows)
    assert task_pages.leaders_note(None).startswith("2 submissions to 1 of ")
    path = folder / "small" / f"{order[0]}.json"
    content = read_json(path)
    content["trials"][0]["of"][order[0]]["hurry"]["max"] = 3.0
    write_content(path, content)
    rows = task_pages.leaders(None)
    assert [row[1] for row in rows] == [f"`{name}`" for name in reversed(order)] and rows[1][-1].startswith("**no**: ")


def test_two_files_of_one_policy_are_refused(folder):
    write_content(folder / "small/again.json", read_json(folder / "small/follow.json"))
    with pytest.raises(ValueError, match="follow has been submitted twice"):
        task_pages.submissions()


def test_nobody_is_sooner_than_alone():
    task = TASKS["room"]
    assert 2.0 < free_walk_time(task) < 6.0
    assert free_walk_time(Task(**{**vars(task), "people": 5})) < free_walk_time(task)


def test_tables_that_belong_together_have_a_name(monkeypatch, tmp_path):
    made = []
    monkeypatch.setattr(
        "validation.cli.fill", lambda name, command, *, folder: made.append(name) or tmp_path / "page.md"
    )
    for name, first in (("tasks", "tasks"), ("presets", "competitive-door-preset"), ("leaderboard", "leaderboard")):
        made.clear()
        assert CliRunner().invoke(app, ["pages", name]).exit_code == 0
        assert made == list(GROUPS[name]) and made[0] == first and len(made) >= len(TASKS) and set(made) <= set(TABLES)
