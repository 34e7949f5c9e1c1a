"""Measured figures go into docs/performance.md, and nothing else does."""

import json

import pytest

from benchmarks import cli, report
from benchmarks.measuring import Row
from crowd_env.files.atomic import write_text


def test_the_page_has_a_place_for_every_case_and_nothing_is_lost(tmp_path):
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
    assert (tmp_path / "docs" / "images" / "performance-scaling.png").read_bytes() == b"plot"
    report.fill(tmp_path / "figures", page)
    assert page.read_text(encoding="utf-8") == once


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
