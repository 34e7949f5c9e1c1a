"""What tests of the command that reproduces tables and figures share."""

import csv
import json

from typer.testing import CliRunner

from crowd_env.cli.reproduce import app

PNG = b"\x89PNG\r\n\x1a\n"


def call(line):
    return CliRunner().invoke(app, line.split())


def reported(line):
    result = call(line + " --json")
    assert result.exit_code == 0, (result.stderr, result.exception)
    assert result.stdout.count("\n") == 1
    return json.loads(result.stdout)


def check_files(report, folder):
    """Check the rows of a report, and that its table says the same and its figure is one."""
    assert report["rows"]
    for row in report["rows"]:
        assert row["paper"] is None or isinstance(row["paper"], float)
    quantities = [row["quantity"] for row in report["rows"]]
    assert len(set(quantities)) == len(quantities)
    assert (folder / "reproduce" / f"{report['name']}.png").read_bytes()[:8] == PNG
    with (folder / "reproduce" / f"{report['name']}.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["quantity"] for row in rows] == quantities
    assert [float(row["here"]) for row in rows if row["here"]] == [
        row["here"] for row in report["rows"] if row["here"] is not None
    ]
