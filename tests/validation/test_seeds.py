"""The table and the picture of several seeds, of runs that are made up."""

import pytest
from late import late

from crowd_env.core.files.csv_table import write_csv
from crowd_env.core.files.json_file import write_json
from validation import seeds
from validation.sources import Source
from validation.tables import MAKERS

curve = late("crowd_env.agents.learned.curve")


def write(path, *points):
    """Write a curve of CPU seconds and times of the last person [s]."""
    columns = curve.CURVE_COLUMNS
    rows = [dict.fromkeys(columns, 0.0) | {"cpu_seconds": cpu, "evacuation_time": time} for cpu, time in points]
    write_csv(path, columns, [list(row.values()) for row in rows])


def time(mean):
    return {"clearing_time": {"mean": mean, "ci95": [mean - 1.0, mean + 1.0]}, "unfinished": 0, "runs": 200}


@pytest.fixture
def folder(tmp_path):
    for seed, mean, kept in ((0, 51.0, "start"), (10, 52.0, "trained"), (9, 60.0, "start")):
        rows = {"evolution": 50.0, "learned": mean, "rule-best-speed": 94.0, "follow": 61.0}
        run = tmp_path / str(seed)
        run.mkdir()
        write_json(run / "results.json", {
            "rows": [{"policy": name, **time(value)} for name, value in rows.items()],
            "confirmation": {"kept": kept, "steps": 3000}, "spent": {"cpu_seconds": 300.0 + seed},
        })  # fmt: skip
        write(run / curve.CURVE, (0.0, 60.0), (200.0, 53.0), (300.0, mean))
    return tmp_path


def test_every_run_is_a_row_and_all_curves_are_in_one_picture(folder):
    seeds.draw(folder)
    head, *rows = MAKERS["seeds"](Source(dict, folder))
    assert [row[0] for row in rows] == ["0", "9", "10"]
    found = dict(zip(head, rows[2], strict=True))
    assert found["last person out, s"] == "52.0 [51.0, 53.0]" and found["of that of `evolution`"] == "1.040"
    assert found["network kept"] == "of step 3,000" and rows[0][head.index("network kept")] == "the start"
    assert found["runs with people left"] == "0 of 200" and found["training, CPU s"] == "310"
    assert (folder / "learning.png").read_bytes()[:4] == b"\x89PNG"
