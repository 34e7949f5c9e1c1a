"""The command line as tests call it."""

import json

from typer.testing import CliRunner

from crowd_env.cli.main import app


def call(line):
    """Return what came of a command, given as one line."""
    return CliRunner().invoke(app, line.split())


def figures(line):
    """Return the one JSON object that a command prints."""
    result = call(f"{line} --json")
    assert result.exit_code == 0, result.stderr
    assert result.stdout.count("\n") == 1
    return json.loads(result.stdout)
