"""What tests of the command that reproduces tables and figures share."""

import json

from typer.testing import CliRunner

from crowd_env.cli.reproduce import app
from crowd_env.reproduce import Work


def nothing(count):
    """Report progress to nobody."""


ALONE = Work(nothing, {})  # what a figure is made with that simulates by itself


def call(line):
    return CliRunner().invoke(app, line.split())


def reported(line):
    result = call(line + " --json")
    assert result.exit_code == 0, result.stderr
    assert result.stdout.count("\n") == 1
    return json.loads(result.stdout)
