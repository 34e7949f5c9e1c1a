"""What a shell proposes when the tabulator is pressed."""

import os
import subprocess
import sys

import pytest
from cases import looped
from repository import ROOT
from typer.testing import CliRunner

from crowd_env import SCENARIOS, SCHEMES
from crowd_env.cli.main import app


def proposed(line):
    """Return what is proposed for the last word of a line."""
    words = f"crowd-env {line}"
    asked = {"_CROWD_ENV_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    return CliRunner().invoke(app, [], env=asked, prog_name="crowd-env").stdout.split()


@looped(
    ("line", "names"),
    [
        ("ru", ["run", "rules"]),
        ("sho", ["show"]),
        ("run two-exit", ["two-exit-hall-v0"]),
        ("run room-v0 --scheme hertz-", ["hertz-literal"]),
        ("run room-v0 --routing n", ["nearest"]),
        ("run room-v0 --walking comp", ["competitive"]),
        ("run my_plan.wk", []),  # a file: the shell's own
        ("show competitive", ["competitive-door"]),
        ("evaluate --task narrow", ["narrow-door"]),
        ("evaluate --policies narrow", ["narrow-door/ppo"]),
        ("train --task narrow", ["narrow-door"]),
    ],
)
def test_names_are_completed(line, names):
    assert proposed(line) == names


def test_all_names_are_proposed_where_nothing_is_begun():
    assert proposed("run ") == list(SCENARIOS)
    assert proposed("warmup --scheme ") == list(SCHEMES)


@pytest.mark.more
def test_the_program_answers_a_shell_and_loads_nothing_for_drawing_or_learning():
    heavy = ("matplotlib", "PIL", "pygame", "torch", "stable_baselines3", "ray", "pandas")
    program = "import sys; from crowd_env.cli.main import app\ntry: app(prog_name='crowd-env')\n"
    program += f"finally: print([name for name in {heavy} if name in sys.modules], file=sys.stderr)"
    asked = {"_CROWD_ENV_COMPLETE": "complete_bash", "COMP_WORDS": "crowd-env show comp", "COMP_CWORD": "2"}
    options = {"cwd": ROOT, "env": os.environ | asked, "capture_output": True, "text": True}
    result = subprocess.run([sys.executable, "-c", program], **options)
    assert result.stdout.split() == ["competitive-door"]
    assert result.stderr.strip().endswith("[]")
