"""Measured figures go into docs/performance.md, and nothing else does."""

import json
from itertools import pairwise

import pytest

from benchmarks import cli, report
from benchmarks.measuring import Row
from crowd_env.core.files.atomic import write_text


def test_the_page_has_a_place_for_every_case_and_nothing_is_lost(tmp_path, monkeypatch):
    monkeypatch.setattr(report, "_SHORT", ("of other cases",))
    page = tmp_path / "docs" / "page.md"
    page.parent.mkdir()
    page.write_text(report.PAGE.read_text(encoding="utf-8"), encoding="utf-8")
    rows = [
        Row("a, 5 people: speed", 2.0, "1/s"),
        Row("a, 5 people: speed", 2.0, "1/s", "b 1.0", 4.0),
        Row("load", 1.0, "1"),
    ]
    for name in cli.CASES:
        result = {"case": name, "rows": [row._asdict() for row in rows]}
        write_text(tmp_path / "figures" / f"{name}.json", json.dumps(result))
    (tmp_path / "figures" / "scaling.png").write_bytes(b"plot")
    assert report.fill(tmp_path / "figures", page) == list(cli.CASES)
    once = page.read_text(encoding="utf-8")
    assert once.count("| a, 5 people | 2 |") == len(cli.CASES)
    assert once.count("A = b 1.0") == len(cli.CASES)
    lines = once.splitlines()
    rules = [line.startswith("| ---") for line in lines]
    assert any(rules) and not any(a and b for a, b in pairwise(rules))  # one below each head
    assert once.count("<!-- case: short -->\n| agent-steps per CPU s |") == 1  # made of four cases, see below
    assert (tmp_path / "docs" / "images" / "performance-scaling.png").read_bytes() == b"plot"
    report.fill(tmp_path / "figures", page)
    assert page.read_text(encoding="utf-8") == once


def figures(folder, case, *rows):
    write_text(folder / f"{case}.json", json.dumps({"case": case, "rows": [row._asdict() for row in rows]}))


def test_the_summary_is_made_of_four_cases(tmp_path):
    page = tmp_path / "page.md"
    cases = ("short", "batch", "train", "jam", "cold")
    page.write_text("".join(f"<!-- case: {name} -->\n<!-- end -->\n" for name in cases))
    batch = [Row(f"{scheme}, 4 x 20: agent-steps", 12_300.0, "1/CPU s") for scheme in ("dem", "nsm2")]
    figures(tmp_path, "batch", *batch, Row("other, 4 x 20: agent-steps", 9.0, "1/CPU s", "other 1.0"))
    samples = "64 x 20, nsm2: samples that count"
    share = Row("64 x 20, nsm2: environment", 0.09, "of CPU time")
    figures(tmp_path, "train", Row(samples, 50.0, "1/CPU s"), share, Row(samples, 50.0, "1/CPU s", "empty", 0.91))
    jams = [
        Row(f"dem {dt} s, {people} people: CPU time", people * dt, "s") for dt in (0.001, 0.01) for people in (10, 500)
    ]
    figures(tmp_path, "jam", *jams)
    report.fill(tmp_path, page)
    assert "<!-- case: short -->\n<!-- end -->" in page.read_text(encoding="utf-8")  # not without the first step
    cold = [
        Row(f"nsm2: whole process, {cache} cache", cpu, "CPU s") for cache, cpu in (("empty", 19.2), ("filled", 0.93))
    ]
    figures(tmp_path, "cold", *cold)
    report.fill(tmp_path, page)
    text = page.read_text(encoding="utf-8").partition("<!-- end -->")[0]
    assert "| batch of 4 x 20 | 12.3 k | 12.3 k |" in text and "other" not in text
    assert "50 samples" in text and "91 % of what" in text and "9 % of the time" in text
    assert (
        "500 people in a jam under `dem`, CPU seconds per simulated second: 0.5 with steps of 0.001 s, 5 with" in text
    )
    assert "19 CPU s with an empty kernel cache, 0.9 CPU s afterwards" in text


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ({}, "holds no figures"),
        ({"cold.json": "{"}, "cold.json does not hold the figures"),
        ({"cold.json": '{"case": "cold", "rows": [{"what": "x"}]}'}, "cold.json does not hold the figures"),
        ({"cold.json": '{"case": "cold", "rows": []}'}, "no place for cold"),
    ],
)
def test_figures_that_cannot_be_put_in_are_refused(tmp_path, files, said):
    page = tmp_path / "page.md"
    page.write_text("no marks")
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=said):
        report.fill(tmp_path, page)
