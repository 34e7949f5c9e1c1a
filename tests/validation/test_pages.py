"""Tables of the documentation that a command makes: their places, their cells, and what a mistake leaves behind."""

import json
import re

import pytest
from repository import ROOT
from typer.testing import CliRunner

from validation.cases.case import Row, Setting
from validation.cli import app
from validation.finished import Finished
from validation.pages import TABLES, fill, run

RUN = {
    "overlap_mm": {"mean": 0.01863, "max": 12.345}, "evacuation_time": {"mean": 4.444, "sd": 0.55}, "runs": 50,
    "outside_mm": 2.5, "flow": {"mean": 2.0, "sd": 0.25}, "unfinished": 34, "unfinished_runs": 3, "max_speed": 2.96,
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
def test_every_table_has_one_place_of_its_own_with_its_head(name):
    page = (ROOT / TABLES[name].page).read_text(encoding="utf-8")
    (found,) = re.findall(rf"<!-- table: {name} -->\n(.*?)<!-- end -->", page, re.DOTALL)
    if TABLES[name].head:
        assert found.splitlines()[0] == f"| {' | '.join(TABLES[name].head)} |"


def test_every_place_has_a_table():
    marked = [
        name
        for page in (ROOT / "docs").rglob("*.md")
        for name in re.findall(r"<!-- table: ([\w-]+) -->", page.read_text())
    ]
    assert sorted(marked) == sorted(TABLES)


def test_a_table_replaces_what_stands_between_its_marks_and_nothing_else(tmp_path):
    page = tmp_path / "docs" / "physics.md"
    page.parent.mkdir()
    page.write_text("before\n<!-- table: schemes -->\n| old |\n<!-- end -->\nafter\n", encoding="utf-8")
    asked = []

    def command(line):
        asked.append(line)
        return RUN

    assert fill("schemes", command, root=tmp_path) == page
    lines = page.read_text(encoding="utf-8").splitlines()
    assert (lines[0], lines[-1]) == ("before", "after") and "| old |" not in lines
    assert (
        "| `dem` | 0.01 | 0.0186 / 12.3 | 2.5 | 4.44 ± 0.55 | 2.00 ± 0.25 | 34 people in 3 of 50 runs | 3.0 |" in lines
    )
    assert "3.04 for `dem` (here 2.00, −34 %)" in lines[-3]
    assert asked[:2] == [f"crowd_env run room-v0 --physics dem --runs 50{step}" for step in ("", " --set dt=0.001")]
    assert len(asked) == len(set(asked))  # the sentences run nothing anew


def test_a_command_that_fails_leaves_the_page_as_it_was(tmp_path):
    page = tmp_path / "docs" / "physics.md"
    page.parent.mkdir()
    page.write_text("<!-- table: schemes -->\n| old |\n<!-- end -->\n", encoding="utf-8")

    def command(line):
        raise ValueError("it failed")

    with pytest.raises(ValueError, match="it failed"):
        fill("schemes", command, root=tmp_path)
    assert "| old |" in page.read_text(encoding="utf-8")
    page.write_text("no place\n")
    with pytest.raises(
        ValueError, match=r"docs/physics\.md has no place for schemes; mark one with <!-- table: schemes -->"
    ):
        fill("schemes", command, root=tmp_path)


def test_commands_are_run_as_anyone_would_run_them():
    assert set(run("crowd_env list")) >= {"scenarios", "schemes"}
    with pytest.raises(ValueError, match=r"python -m crowd_env run nowhere --json failed: .*nowhere"):
        run("crowd_env run nowhere")


def test_an_unknown_table_is_one_line():
    found = CliRunner().invoke(app, ["pages", "speeds"])
    assert found.exit_code == 2 and "unknown table 'speeds'; known: schemes, halls" in found.stderr


def test_the_names_of_pages_can_be_had_as_json(monkeypatch, tmp_path):
    monkeypatch.setattr("validation.cli.fill", lambda name, command, *, folder: tmp_path / f"{name}.md")
    found = CliRunner().invoke(app, ["pages", "clogging", "--json"])
    assert json.loads(found.stdout) == {"clogging": "clogging.md"}


def test_strategies_are_told_beside_the_first(tmp_path):
    def row(policy, scheme, last, unfinished=0):
        beside = {"mean": last - 30.0, "ci95": [last - 31.0, last - 29.0], "faster": 0.9}
        return {
            "policy": policy, "scheme": scheme, "runs": 20, "unfinished": unfinished, "unfinished_runs": min(unfinished, 2),
            "unfinished_at_limit": {"last": last}, "minus_first": {"policy": "shortest", "evacuation_time": beside},
            "exits": {"west": {"people": {"mean": 81.0}}, "east": {"people": {"mean": 69.0}}},
            "replanning_per_simulated_second": 0.0018, "physics_per_simulated_second": 0.0008,
        }  # fmt: skip

    def command(line):
        _, _, schemes = line.partition("--schemes ")
        names = schemes.partition(" --runs")[0].split()
        return {"rows": [row(*one) for name in names for one in (("shortest", name, 30.0), ("fastest", name, 25.0, 4))]}

    page = tmp_path / "docs" / "routing.md"
    page.parent.mkdir()
    page.write_text("<!-- table: strategies -->\n<!-- end -->\n", encoding="utf-8")
    fill("strategies", command, root=tmp_path)
    text = page.read_text(encoding="utf-8")
    assert "| shortest | 30.0 |" in text
    assert "| fastest | ≥ 25.0 (−6.0 to −4.0); left inside: 4 people in 2 of 20 runs |" in text
    assert "54/46 under `dem`" in text and "90 % (`hertz`) of the draws" in text and "takes 1.8 ms" in text


# -------------------------------------------------------------------------------------------- tables of finished runs


def finished(tmp_path, name, **files):
    """Return what `fill` writes into the page of a table from a folder with these JSON files."""
    folder = tmp_path / "run"
    folder.mkdir(exist_ok=True)
    for file, content in files.items():
        (folder / f"{file}.json").write_text(json.dumps(content))
    return finished_page(tmp_path, name)


def finished_page(tmp_path, name):
    page = tmp_path / TABLES[name].page
    page.parent.mkdir(exist_ok=True)
    page.write_text(f"<!-- table: {name} -->\n<!-- end -->\n", encoding="utf-8")
    fill(name, run, folder=tmp_path / "run", root=tmp_path)
    return page.read_text(encoding="utf-8")


def of_cases(tmp_path, name, rows):
    """Return what `fill` writes from a run of the map with these rows."""
    finished = Finished(tmp_path / "run")
    for case, some in rows.items():
        for scheme, manner in {(one["scheme"], one["manner"]) for one in some}:
            mine = [Row(**one) for one in some if (one["scheme"], one["manner"]) == (scheme, manner)]
            finished.keep_rows(case, Setting(scheme, manner), mine, True, 1.0)
    return finished_page(tmp_path, name)


def hall(scheme, people, speed, outside=0):
    figures = {"people": people, "fastest, m/s": speed, "outside": outside, "overlap, mm": 20.25}
    return row_of("halls", scheme, outside == 0, manner="competitive") | {"more": figures}


def test_halls_are_told_by_scheme_and_size(tmp_path):
    small = [hall("dem", 500, 3.0), hall("dem", 500, 4.04), hall("dem", 1000, 5.0), hall("nsm2", 500, 2.0, 3)]
    large = [hall("dem", 2000, 6.0), hall("dem", 5000, 12.5)]
    text = of_cases(tmp_path, "halls", {"halls": small, "great-halls": large})
    assert "| `dem` | nobody | 4.0 | 5.0 | 6.0 | 12.5 | 20.2 |" in text
    assert "| `nsm2` | 3 |" in text


def row_of(case, scheme, passed, figure="1.13 /s", manner="calm", source="a paper"):
    return {
        "case": case, "scheme": scheme, "manner": manner, "passed": passed, "figure": figure, "criterion": "as recorded",
        "source": source, "more": {},
    }  # fmt: skip


def map_rows():
    """Return a row each case under two schemes; of the tests of standards two, and one that is not supported."""
    names = ("gate", "doors", "corridor", "ring", "counterflow", "crossing", "corner", "faster", "clogging", "row")
    rows = {name: [row_of(name, "dem", True), row_of(name, "hertz", False)] for name in names}
    tests = [row_of("rimea-1", "dem", True), row_of("rimea-1", "dem", None, manner="hurried")]
    return rows | {"standards": [*tests, row_of("not supported", "dem", None, "no lifts", source="NIST 2.7")]}


def test_the_map_says_what_passes_and_what_was_asked(tmp_path):
    text = of_cases(tmp_path, "map", map_rows())
    assert "| `gate` | calm | yes |  |  |  | **no** |  |" in text
    assert "| `rimea-1` | hurried | – |  |  |  |  |  |" in text
    assert "* `doors`, 5 draws: as recorded (a paper)." in text
    assert "* Not supported, NIST 2.7: no lifts." in text and "| `not supported`" not in text


def test_reports_have_the_map_as_data(tmp_path):
    """What is written by hand beside it stays, and a map that cannot be written leaves the data as they were."""
    data = tmp_path / TABLES["map"].data[0]
    data.parent.mkdir(parents=True)
    data.write_text(json.dumps({"not_modeled": ["fire"], "cases": []}))
    of_cases(tmp_path, "map", map_rows())
    content = json.loads(data.read_text(encoding="utf-8"))
    assert content["not_modeled"] == ["fire"] and content["not_supported"] == ["NIST 2.7: no lifts."]
    assert [one["case"] for one in content["cases"]][::10] == ["gate", "rimea-1"]
    gate, *_, test = content["cases"]
    assert gate == {
        "case": "gate",
        "criterion": "as recorded (a paper).",
        "results": {"calm": {"dem": "yes", "hertz": "no"}},
    }
    assert test["results"] == {"calm": {"dem": "yes"}, "hurried": {"dem": "reported"}}
    before = data.read_bytes()
    (tmp_path / "docs" / "validation.md").write_text("no place")
    with pytest.raises(ValueError, match="no place for map"):
        fill("map", run, folder=tmp_path / "run", root=tmp_path)
    assert data.read_bytes() == before


def test_full_speed_is_told_beside_what_is_known(tmp_path):
    """A mean over the runs that were not stuck stands for them; where all were, there is none."""

    def gate(scheme, flow, stuck):
        more = {"flow": flow, "stuck": stuck, "passages": [[]] * 4}
        return {**row_of("gate", scheme, False, f"{flow} /s", manner="competitive"), "more": more}

    def doors(scheme, *flows):
        widths = {width: {"flow": flow, "stuck": 0} for width, flow in zip(("0.5", "0.8", "2.4"), flows, strict=True)}
        return {**row_of("doors", scheme, False, "wide", manner="competitive"), "more": {"widths": widths}}

    rows = {
        "gate": [gate("hertz", None, 4), gate("dem", 2.5, 1), row_of("gate", "dem", True)],
        "doors": [doors("dem", 99.0, 6.36, 8.48), doors("hertz", None, 4.24, None)],
    }
    text = of_cases(tmp_path, "full-speed", rows)
    lines = [line for line in text.splitlines() if line.startswith("| `")]
    assert lines == ["| `gate` | `dem` | 2.5 /s |", "| `gate` | `hertz` | None /s |", *(
        f"| `doors` | `{scheme}` | wide |" for scheme in ("dem", "hertz")
    )]  # fmt: skip
    assert "Through doors of 0.8 to 2.4 m 4.2 to 8.5 people" in text and "2.12: 2.0 to 4.0 times as many" in text
    assert "The gate blocks in 5 of 8 runs; 2.50 /s pass in the others, where 1.13 /s" in text


def test_the_map_has_the_figures_of_every_row(tmp_path):
    text = of_cases(tmp_path, "measured", map_rows())
    assert "| `ring` | calm | `hertz` | **no** | 1.13 /s |" in text
    assert text.count("| 1.13 /s |") == 22


def controller(name, last, unfinished=0, **beside):
    return {
        "controller": name, "runs": 200, "unfinished": unfinished, "unfinished_runs": min(unfinished, 1),
        "last": {"mean": last}, "mean": {"mean": last / 2}, **beside,
    }  # fmt: skip


def test_controllers_are_told_beside_the_learned_one(tmp_path):
    beside = {"learned_minus_this": {"last": {"mean": -10.0, "ci95": [-11.0, -9.0]}}}
    content = {
        "config": {"scenario": "two-exit-hall-v0", "scheme": "nsm2", "steps": 1000},
        "best": {"steps": 512.0, "runs": 500.0, "unfinished": 22.0},
        "rows": [controller("nearest exit", 40.0, 7, **beside), controller("learned", 30.0)],
    }
    text = finished(tmp_path, "controller", results=content)
    assert "| nearest exit | ≥ 40.0 | −10.0 (−11.0 to −9.0) | ≥ 20.0 | 7 people in 1 of 200 runs |" in text
    assert "| learned | 30.0 |  | 15.0 | nobody |" in text
    assert "−25 % beside nearest exit" in text


def test_a_table_of_a_long_run_names_the_run(tmp_path):
    found = CliRunner().invoke(app, ["pages", "training"])
    assert found.exit_code == 2 and "python train.py; name it by --from" in found.stderr
    missing = CliRunner().invoke(app, ["pages", "map", "--from", str(tmp_path)])
    assert missing.exit_code == 2 and f"{tmp_path}/gate holds no finished rows" in missing.stderr.replace("\n", "")
    unnamed = CliRunner().invoke(app, ["pages", "--from", str(tmp_path)])
    assert unnamed.exit_code == 2 and "name the tables" in unnamed.stderr
