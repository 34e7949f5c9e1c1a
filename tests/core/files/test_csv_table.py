"""Tables for spreadsheets: what a text of the user's looks like is not computed, and is read back as it was."""

import csv

from crowd_env.core.files.csv_table import plain_cell, read_table, write_csv

NAMES = ["=cmd|' /C calc'!A0", "+1+cmd", "-2+3", "@SUM(A1)", "'=1", "''-x", "'quoted'", "-", "west", "a=b", "", "it's"]
NUMBERS = ["-0.5", "+1e-3", "-inf", -2, -0.25]


def test_no_text_begins_as_a_formula_and_all_is_read_back(tmp_path):
    path = write_csv(tmp_path / "a.csv", ("name", "=x"), [[name, "1"] for name in NAMES])
    with path.open(newline="") as file:
        rows = list(csv.reader(file))
    assert not [cell for row in rows for cell in row if len(cell) > 1 and cell[0] in "=+-@"]
    assert [plain_cell(cell) for cell in rows[0]] == ["name", "=x"]
    assert [row.cells["name"] for row in read_table(path, "x", ("name",), "1", "a row").rows] == NAMES


def test_numbers_stay_numbers(tmp_path):
    write_csv(tmp_path / "a.csv", ("x",), [[number] for number in NUMBERS])
    assert (tmp_path / "a.csv").read_text().splitlines()[1:] == [str(number) for number in NUMBERS]
