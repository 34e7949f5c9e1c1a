"""Every command of the pages is tried, those of one block one after the other; what is shown below one is what it prints."""

import json

import pytest
from outputs import compare
from shown import blocks, commands_of, named, tried
from tried_commands import attempt, evaluate_nothing, workplace

# Pages whose evaluations take long, even of few people, and end where their runs would begin.  The two commands of a task are
# the same on all pages but for its name: those of room.md are run.
LONG = {"docs/routing.md"} | {
    named(block.page) for block in blocks("console") if block.page.match("tasks/[!R]*.md") and block.page.stem != "room"
}


def run_block(block, monkeypatch, folder):
    workplace(folder, monkeypatch)
    for command in commands_of(block):
        printed = attempt(command, monkeypatch)
        if command.words[0] == "crowd-env" and "--json" in command.words:
            json.loads(printed)
        if command.output:
            compare(command, printed)


@pytest.mark.parametrize("block", tried("console"))
def test_commands_do_what_they_are_shown_for(block, monkeypatch, tmp_path):
    ended = evaluate_nothing(monkeypatch) if named(block.page) in LONG else None
    run_block(block, monkeypatch, tmp_path)
    assert ended is None or ended, "nothing was to be evaluated: the commands were run in full"


@pytest.mark.nightly
def test_strategies_are_compared_under_all_schemes(monkeypatch, tmp_path):
    (block,) = [block for block in blocks("console") if named(block.page) == "docs/routing.md"]
    run_block(block, monkeypatch, tmp_path)
    assert (tmp_path / "comparison" / "rows.json").exists()


@pytest.mark.more
def test_pages_that_are_shortened_are_there():
    assert "docs/tasks/competitive-door.md" in LONG and "docs/tasks/README.md" not in LONG
