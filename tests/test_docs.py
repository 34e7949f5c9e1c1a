"""What the documents say is tried: every Python block runs, every command and link works, every table of names is complete."""

import json
import os
import re
import shlex
from pathlib import Path

import pytest
from repository import ROOT
from typer.testing import CliRunner

from crowd_env.cli.main import app
from crowd_env.envs.action import DISCRETE
from crowd_env.envs.global_state import StateLayout
from crowd_env.envs.observation.layout import ObservationLayout
from crowd_env.envs.observation.terms import TERMS
from crowd_env.envs.reward import REWARDS, RewardWeights
from crowd_env.physics import SCHEMES

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def blocks(language):
    """Return (page, line, text) of every fenced block of a language."""
    found = []
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for match in re.finditer(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
            found.append((page, text.count("\n", 0, match.start()) + 1, match[1]))
    return found


def named(page):
    return page.relative_to(ROOT).as_posix()


def called(block):
    return f"{named(block[0])}:{block[1]}"


def commands():
    """Return (page, line, words) of every ``crowd-env`` command that is shown."""
    found = []
    for page, line, text in blocks("console"):
        joined = text.replace("\\\n", " ")
        found += [
            (page, line, shlex.split(row[2:])[1:]) for row in joined.splitlines() if row.startswith("$ crowd-env ")
        ]
    return found


def table(page, first_column):
    """Return the rows, as lists of cells, of the table of a page whose head begins with a cell."""
    lines = (ROOT / page).read_text(encoding="utf-8").splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith(f"| {first_column} |"))
    rows = []
    for line in lines[start + 2 :]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip().replace("`", "") for cell in line.strip("|").split("|")])
    return rows


@pytest.mark.parametrize("block", blocks("python"), ids=called)
def test_python_blocks_run(block, monkeypatch, tmp_path):
    page, line, text = block
    for library in set(re.findall(r"^import (pandas|pedpy)", text, re.MULTILINE)):
        pytest.importorskip(library, reason=f"{library} is not installed; `make test` does, for Python 3.11 and newer")
    monkeypatch.chdir(tmp_path)
    exec(compile("\n" * line + text, str(page), "exec"), {"__name__": "__main__"})


def test_the_readme_has_a_short_example_to_begin_with():
    page, line, text = blocks("python")[0]
    assert page.name == "README.md"
    assert line < 60
    assert len(text.splitlines()) <= 12


@pytest.mark.parametrize("command", commands(), ids=called)
def test_commands_run(command, monkeypatch, tmp_path):
    words = list(command[2])
    if "--ray" in words:
        words.remove("--ray")  # tests/agents/test_cluster.py has clusters
    monkeypatch.chdir(ROOT)  # paths are written as seen from the checkout
    for option, value in (("--runs", "1"), ("--n", "8")):
        if option in words:
            words[words.index(option) + 1] = value
    for option in {"--force-network", "--html", "--out", "--record"} & set(words):  # written, but not into the checkout
        where = words.index(option) + 1
        words[where] = str(tmp_path / words[where])
    if "--film" in words:  # try the suffix, but spare the time and write nothing into the checkout
        where = words.index("--film")
        assert Path(words[where + 1]).suffix in {".gif", ".mp4"}
        del words[where : where + 2]
    if words[0] == "show":
        words += ["--film", str(tmp_path / "film.gif"), "--film-width", "320", "--film-fps", "1"]
    if words[0] == "reproduce":
        words += ["--out", str(tmp_path)]
        if words[1] in ("lin", "lin-fig5"):  # minutes of computing: one of its figures will do
            words[1] = "lin-fig4"
        if words[1].startswith("lin"):
            words += ["--workers", "1"]
    if words[0] in ("warmup", "replay", "report"):  # what is shown was made by the commands above
        words = [words[0], "--help"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    if "--json" in words:
        json.loads(result.stdout)


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_links_lead_somewhere(page):
    text = page.read_text(encoding="utf-8")
    links = re.findall(r"\]\(([^)#\s]+)", text) + re.findall(r'src="([^"]+)"', text)
    local = [link for link in links if "://" not in link]
    missing = [link for link in local if not (page.parent / link).exists()]
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_files_that_are_named_exist(page):
    text = page.read_text(encoding="utf-8")
    named = re.findall(r"`((?:crowd_env|agents|benchmarks|validation|tests|docs|examples)/[\w./-]*)`", text)
    names = {name for name in named if not re.search(r"-v\d+$|/[A-Z]+(/|$)", name)}  # environments; TASK is any task
    missing = sorted(name for name in names if not (ROOT / name).exists())
    assert not missing


def test_the_table_of_observation_terms_is_complete():
    layout = ObservationLayout(tuple(TERMS), routes=3)
    rows = table("docs/environments.md", "term")
    found = {row[0]: row[1] for row in rows}
    widths = {name: layout.width(name) for name in TERMS}
    of_ways = {name: f"{term.width} W".removeprefix("1 ") for name, term in TERMS.items() if term.of_each == "routes"}
    assert found == {name: of_ways.get(name, str(width)) for name, width in widths.items()}
    assert all(widths[name] == 3 * TERMS[name].width for name in of_ways)


def test_the_table_of_the_global_state_is_complete():
    rows = table("docs/environments/pettingzoo.md", "column of a person")
    widths = {name: "X" if name == "exit" else str(width) for name, width in StateLayout(1, 7).of_person.items()}
    assert {row[0]: row[2] for row in rows} == widths
    text = (ROOT / "docs/environments/pettingzoo.md").read_text(encoding="utf-8")
    assert f"a row of {StateLayout(1, 0).width} + X numbers for each of N people" in text


def test_the_table_of_rewards_is_complete():
    lines = (ROOT / "docs/environments.md").read_text(encoding="utf-8")
    part = lines[lines.index("## Rewards") :]
    rows = dict(re.findall(r"^\| `(\w+)` \| ([\d.]+) \|", part, re.MULTILINE))
    weights = RewardWeights().weights
    assert {name: float(weight) for name, weight in rows.items()} == {name: weights.get(name, 0.0) for name in REWARDS}


def test_the_tables_of_schemes_are_complete():
    assert [row[0] for row in table("docs/physics.md", "name")] == list(SCHEMES)
    assert [row[0] for row in table("README.md", "scheme")] == list(SCHEMES)


def test_numbers_in_the_text_are_those_of_the_code():
    text = (ROOT / "docs/environments.md").read_text(encoding="utf-8")
    assert f"{ObservationLayout().size} numbers by default" in text
    assert f"Discrete({len(DISCRETE)})" in text


@pytest.mark.parametrize("name", ["own_policy", "room_picture", "shipped_policy"])
def test_examples_run(name, monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(ROOT))
    example = __import__(f"examples.{name}", fromlist=["main"])
    if name == "own_policy":
        example.main(runs=1)
    elif name == "shipped_policy":
        from agents import load
        from agents.evaluation.evaluation import evaluate
        from agents.tasks import make_task

        task = make_task("competitive-door")
        judged = evaluate(load("competitive-door/ppo"), task.place(8), scheme=task.scheme, runs=1, dt=task.dt)
        assert example.main(people=8) == judged.column("evacuation_time")[0]
    else:
        example.main(tmp_path / "room.png")
        assert os.path.getsize(tmp_path / "room.png") > 1000
