"""The tables of the documentation: pages and CSV files agree, each file has its place, and cells are what was measured."""

import csv
import io
import re

import numpy as np
import pytest
from repository import ROOT
from typer.testing import CliRunner

from crowd_env.agents.tasks import TASKS
from crowd_env.analysis.figures import cell
from crowd_env.core.files.json_file import read_json
from validation import pages
from validation.cases import CASES
from validation.cases.case import Setting, row
from validation.cases.standards import TESTS, WHY
from validation.cli import app
from validation.finished import Finished
from validation.map import LIMITS, limits, of_all, passed, standards
from validation.pages import TABLES, facts_in, filled, grid, pivoted, read_table, write_table
from validation.pictures import commands
from validation.sources import Source, run
from validation.tables import MAKERS
from validation.task_tables import payoffs_of

PAGES = pages.pages_of()
NO_SOURCE = Source(dict)
# Tables of runs that one command begins and ends; the others are of folders that runs of hours have written.
OF_COMMANDS = (
    "schemes",
    "strategies",
    "fastest",
    "scenarios",
    "bodies",
    "theatre",
    "variants",
    "clearance",
    "flows",
    "task-floors",
)
STORED = {path.stem for path in TABLES.glob("*.csv")} - {pages.MADE_BY}


def test_pages_and_files_agree():
    stale = [
        page.name for page in PAGES if filled(page.read_text(encoding="utf-8")) != page.read_text(encoding="utf-8")
    ]
    assert not stale, "run python -m validation pages"


def test_every_file_is_used_says_what_made_it_and_is_written_as_it_lies(tmp_path):
    text = "".join(page.read_text(encoding="utf-8") for page in PAGES)
    drawn = {name for names in commands().values() for name in names}
    made_by = {name: how for name, *how in read_table(pages.MADE_BY)[1:] if name not in drawn}
    assert set(made_by) == STORED and all(command for command, _ in made_by.values()) and set(MAKERS) <= STORED
    (tmp_path / "made_by.csv").write_bytes((TABLES / "made_by.csv").read_bytes())
    for name in sorted(STORED):
        assert f"<!-- table: {name}" in text or f"tables/{name}.csv" in text or name == "facts", name
        write_table(name, read_table(name), *made_by[name], folder=tmp_path)
        assert (tmp_path / f"{name}.csv").read_bytes() == (TABLES / f"{name}.csv").read_bytes(), name
    assert (tmp_path / "made_by.csv").read_bytes() == (TABLES / "made_by.csv").read_bytes()


def test_facts_are_those_of_code_and_tables_and_each_stands_in_a_sentence():
    assert MAKERS["facts"](NO_SOURCE) == read_table("facts"), "run python -m validation pages facts"
    texts = [page.read_text(encoding="utf-8") for page in PAGES]
    assert {name for text in texts for name in facts_in(text)} == {name for name, _ in read_table("facts")[1:]}
    assert not [line for text in texts for line in re.findall(r"^ *<!--[\w-]+-->.*", text, re.MULTILINE)], "no Markdown"


def test_the_map_and_what_reports_say_of_it_follow_from_the_figures():
    assert passed(read_table("measured")) == read_table("map"), "run python -m validation pages map"
    assert standards(of_all("standard-tests", "measured")) == read_table("standards"), (
        "run python -m validation pages standards"
    )
    found = limits(of_all("measured", "standard-tests"), of_all("criteria", "standard-criteria"))
    assert {**read_json(LIMITS), **found} == read_json(LIMITS)


def test_what_fails_is_explained_and_what_passes_is_not():
    """Names in the bold head of a remark are cases, manners and schemes; it is of the rows that all of them fit."""
    head, *rows = ([cell.strip("`") for cell in line] for line in read_table("map"))
    failed = {
        (case, manner, scheme)
        for case, manner, *cells in rows
        for scheme, cell in zip(head[2:], cells, strict=True)
        if "no" in cell
    }
    text = (ROOT / "docs/validation.md").read_text(encoding="utf-8")
    section = text.partition("### What fails, and why\n")[2].partition("\n## ")[0]
    explained = set()
    for remark in re.findall(r"^\* \*\*(.*?)\*\*", section, re.MULTILINE):
        names = set(re.findall(r"`([\w-]+)`", remark))
        kinds = [names & set(column) for column in zip(*failed, strict=True)]
        fits = {row for row in failed if all(name in kind for name, kind in zip(row, kinds, strict=True) if kind)}
        assert not names or names == {name for row in fits for name in row} & names, f"nothing of this fails: {remark}"
        explained |= fits if names else set()
    assert failed == explained


def test_a_row_of_a_standard_that_is_not_met_says_why_and_no_other():
    head, *lines = read_table("standards")
    assert len(lines) == 67
    for line in lines:
        one = dict(zip(head, line, strict=True))
        met = {one[scheme] for scheme in ("`dem`", "`nsm2`", "`hertz`")}
        assert met <= {"yes", "**no**"} if one["test"] else met == {""}
        assert bool(one["why not"]) == ("yes" not in met or "**no**" in met), one
    assert {line[4].strip("`") for line in lines if "**no**" in line} == {*WHY} & {*TESTS, *CASES}, (
        "reasons of what is met"
    )


@pytest.mark.more
def test_the_tables_of_the_tasks_say_what_these_are_now():
    for name in ("tasks", "task-facts", "task-presets"):
        assert MAKERS[name](NO_SOURCE) == read_table(name), f"run python -m validation pages {name}"
    assert [line[0] for line in read_table("task-floors")[1:]] == list(TASKS)


@pytest.mark.more
def test_submissions_fit_their_tasks_and_stand_in_the_tables():
    for name in ("submissions", "variations", "cards", "tiers"):
        assert MAKERS[name](NO_SOURCE) == read_table(name), f"run python -m validation pages {name}"


def test_a_task_in_which_all_are_paid_for_their_own_time_is_ordered_by_it():
    run = {"variation": "task", "last_time": [9.0], "mean_exit": [5.0], "mean_exit_learned": [6.0]}
    for task, time in {"competitive-door": 9.0, "dilemma-door": 5.0, "dilemma-mixed": 6.0}.items():
        content = {"task": {"name": task}, "policy": {"name": "x"}, "runs": [{"policy": "x", **run}]}
        assert payoffs_of(content).tolist() == [time]


@pytest.mark.nightly
@pytest.mark.parametrize("name", OF_COMMANDS)
def test_tables_of_commands_are_what_these_print_now(name):
    """Another processor rounds otherwise, so that late times differ, and some other run may block."""
    found, stored = MAKERS[name](Source(run)), read_table(name)
    shapes = [[(line[0], len(line)) for line in table] for table in (found, stored)]
    assert shapes[0] == shapes[1] and found[0] == stored[0], f"run python -m validation pages {name}"
    cells = [pair for lines in zip(found, stored, strict=True) for pair in zip(*lines, strict=True)]
    assert not [pair for pair in cells if not near(*pair)], f"run python -m validation pages {name}"


NUMBER, RUNS_LEFT = r"[-+−]?\d+(?:\.\d+)?", r"\d+ (?:people|person) in (\d+) of \d+ runs"


def near(one, other):
    """Whether two cells differ by no more than chaotic runs do: a tenth, two units of the last digit, or a few runs."""
    cells = [re.sub(RUNS_LEFT, r"\1", re.sub("nobody|none", "0", cell)) for cell in (one, other)]
    if re.sub(NUMBER, "", cells[0]) != re.sub(NUMBER, "", cells[1]):
        return False
    for a, b in zip(*(re.findall(NUMBER, text.replace("−", "-")) for text in cells), strict=True):
        unit = max(10.0 ** -len(text.partition(".")[2]) for text in (a, b))
        few = 2.0 * unit if "." in a + b else 3.0 + 2.0 * np.sqrt(min(abs(float(a)), 25.0))
        if abs(float(a) - float(b)) > 0.1 * max(abs(float(a)), abs(float(b))) + few:
            return False
    return True


def test_cells_are_near_where_chaos_alone_tells_them_apart():
    same = [
        ("7.69 ± 0.69", "7.7 ± 0.66"),
        ("12 people in 1 of 50 runs", "nobody"),
        ("0.0993", "0.099"),
        ("0/1/0/0", "0/0/3/0"),
    ]
    other = [
        ("46.9", "55.0"),
        ("nobody", "90 people in 20 of 50 runs"),
        ("a 1.0", "b 1.0"),
        ("+2.95 (2.38)", "+4.16 (3.62)"),
    ]
    assert all(near(*pair) for pair in same) and not any(near(*pair) for pair in other)


def test_every_task_has_a_page_with_its_tables():
    for name in TASKS:
        text = (ROOT / f"docs/tasks/{name}.md").read_text(encoding="utf-8")
        for table in ("task-facts", "task-floors", "task-presets", "submissions", "variations"):
            assert f"<!-- table: {table} task={name} -->" in text, (name, table)


def test_nobody_is_sooner_than_alone():
    for line in read_table("task-floors")[1:]:
        floor, alone, queue = (float(value) for value in line[1:4])
        assert floor == pytest.approx(max(alone, queue), abs=0.51), line


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "made_by.csv").write_text("table,command,note\n")
    rows = [["who", "a, s", "b"], ["`x`", "1", ""], ["y", "2, or 3", 'say "no"'], ["y", "4", "5"]]
    write_table("t", rows, "python -m x", folder=tmp_path)
    return tmp_path


def test_a_table_replaces_what_stands_between_its_marks_and_nothing_else(folder):
    text = "before\n<!-- table: t -->\nold\n<!-- end -->\nafter\n<!-- table: t who=x --><!-- end -->"
    found = filled(text, folder)
    assert (
        found.splitlines()[0] == "before"
        and "old" not in found
        and found.endswith("<!-- table: t who=x --><!-- end -->")
    )
    assert '| y | 2, or 3 | say "no" |\n| y | 4 | 5 |\n\nMade by `python -m x`.\n<!-- end -->\nafter\n' in found
    assert filled(found, folder) == found


def test_a_fact_replaces_what_stands_between_its_marks(folder):
    write_table("facts", [["fact", "value"], ["tasks", "17"]], "python -m x", folder=folder)
    found = filled("All <!--tasks-->9<!--/--> and <!--tasks--><!--/-->, <!-- tasks -->.", folder)
    assert found == "All <!--tasks-->17<!--/--> and <!--tasks-->17<!--/-->, <!-- tasks -->."
    with pytest.raises(ValueError, match="unknown fact 'laws'; known: fact, tasks"):
        filled("<!--laws-->4<!--/-->", folder)


def test_rows_can_be_chosen_one_stands_upright_and_none_is_said(folder):
    def between(chosen):
        return filled(f"<!-- table: t {chosen} -->\n<!-- end -->", folder).splitlines()[1:-1]

    assert between("who=x") == ["|  |  |", "| --- | --- |", "| a, s | 1 |"]
    assert between("who=y") == ["| a, s | b |", "| --- | --- |", '| 2, or 3 | say "no" |', "| 4 | 5 |"]
    assert between("who=z") == ["None yet."]


def test_what_cannot_be_made_is_refused_and_changes_nothing(folder, monkeypatch):
    with pytest.raises(ValueError, match="no table 'u'; known: made_by, t"):
        read_table("u", folder)
    before = {path: path.read_bytes() for path in TABLES.glob("*.csv")}
    for words, said in ((("speeds",), "unknown table 'speeds'; known: schemes, halls"), (("training",), "name it by --from"),
                        (("measured", "--from", str(folder)), "holds no finished rows of gate")):  # fmt: skip
        found = CliRunner().invoke(app, ["pages", *words])
        assert found.exit_code == 2 and said in found.stderr.replace("\n", ""), words
    assert {path: path.read_bytes() for path in TABLES.glob("*.csv")} == before


@pytest.mark.more
def test_a_command_that_fails_is_named():
    with pytest.raises(ValueError, match=r"python -m crowd_env run nowhere --json failed: .*nowhere"):
        run("crowd_env run nowhere")


# ----------------------------------------------------------------------------------------------------------------- cells


def test_cells_are_dashed_where_nothing_is_known():
    row = {"a": {"mean": 1.25, "ci95": [-0.5, 2.0]}, "share": 0.126, "none": None}
    texts = {"{a[mean]:.1f}": "1.2", "{a[ci95][0]:+.1f} to {a[ci95][1]:+.1f}": "−0.5 to +2.0", "{share:%} %": "13 %",
             "{none:.1f}": "–", "{none[mean]:.2f} ± {none[sd]:.2f}": "–", "{b} b3": "– b3"}  # fmt: skip
    assert {text: cell(text, row) for text in texts} == texts
    assert grid([row], x="{share:g}") == [["x"], ["0.126"]]
    rows = [{"n": n, "at": at, "value": n * at} for n in (1, 2) for at in (3, 4) if (n, at) != (2, 3)]
    assert pivoted(rows, {"n": "{n}"}, "at {at}", "{value}") == [["n", "at 3", "at 4"], ["1", "3", "4"], ["2", "", "8"]]


def test_tables_of_commands_have_the_heads_that_are_stored(tmp_path):
    """Every command is asked for, and what it does not say is a dash: heads are those of the files."""
    asked = []

    def command(line):
        asked.append(line)
        found = {"unfinished": 3, "unfinished_runs": 1, "runs": 20}
        return {**found, "sets": [{}], "rows": [found]}

    for name in ("schemes", "clogging", "strategies", "scenarios", "bodies"):
        assert MAKERS[name](Source(command, tmp_path))[0] == read_table(name)[0], name
    assert asked[:2] == [f"crowd_env run room-v0 --scheme dem{step} --runs 50" for step in ("", " --set dt=0.001")]


def made_of(folder, name, *rows):
    """Return a table of a run of the map with these rows (case, scheme, manner, whether it passed, numbers)."""
    found = {}
    for case, scheme, manner, *said, more in rows:
        mine = row(case, Setting(scheme, manner), *said, "1.13 /s", "as recorded", "a paper", **more)
        found.setdefault((case, scheme, manner), []).append(mine)
    for (case, scheme, manner), some in found.items():
        Finished(folder).keep_rows(case, Setting(scheme, manner), some, True, 1.0)
    return MAKERS[name](Source(lambda line: {}, folder))


def test_halls_are_told_by_scheme_and_size(tmp_path):
    def hall(scheme, case, people, speed, outside=0):
        more = {"people": people, "fastest, m/s": speed, "outside": outside, "overlap, mm": 20.25}
        return case, scheme, "competitive", True, more

    rows = [hall("dem", "halls", 500, 3.0), hall("dem", "halls", 500, 4.04), hall("dem", "halls", 1000, 5.0)]
    rows += [hall("dem", "great-halls", 2000, 6.0), hall("dem", "great-halls", 5000, 12.5, 3)]
    head, found = made_of(tmp_path, "halls", *rows)
    assert head == read_table("halls")[0] and found == ["`dem`", "3", "4.0", "5.0", "6.0", "12.5", "20.2"]


def test_the_map_is_what_passed_case_by_case(tmp_path):
    rows = [(case, scheme, "calm", scheme == "dem", {}) for case in ("gate", "ring") for scheme in ("dem", "hertz")]
    found = made_of(tmp_path, "measured", *rows)
    assert found[2] == ["`gate`", "calm", "`hertz`", "**no**", "1.13 /s"] and found[0] == read_table("measured")[0]
    assert passed(found)[1:] == [["`gate`", "calm", "yes", "**no**"], ["`ring`", "calm", "yes", "**no**"]]
    asked = MAKERS["criteria"](Source(lambda line: {}, tmp_path))
    assert asked[1] == ["`gate`", "5", "as recorded", "a paper"]
    (gate, _) = limits(found, asked)["cases"]
    assert gate == {
        "case": "gate",
        "criterion": "as recorded (a paper).",
        "results": {"calm": {"dem": "yes", "hertz": "no"}},
    }


def test_links_of_the_task_pages_lead_somewhere():
    for page in (ROOT / "docs/tasks").glob("*.md"):
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).resolve().exists(), (page.name, target)


def test_files_are_plain_csv():
    for name in STORED:
        text = (TABLES / f"{name}.csv").read_text(encoding="utf-8")
        assert len({len(line) for line in csv.reader(io.StringIO(text))}) == 1, name
