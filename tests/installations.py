"""What installing commands name: extras of the project, files, targets of make and what these call."""

import argparse
import importlib.util
import re
import subprocess
import tomllib
from pathlib import Path

import typer
from packaging.requirements import Requirement
from repository import ROOT

from crowd_env.cli.main import app

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
EXTRAS = PROJECT["project"]["optional-dependencies"]


def check_pip(words: list[str]) -> None:
    """Check that `pip install` would find what it is told to install: this project with extras that it has, or what they name.

    tests/docs/test_wheel.py installs.
    """
    parser = argparse.ArgumentParser(exit_on_error=False)
    parser.add_argument("command", choices=["install"])
    parser.add_argument("-e", "--editable", action="append", default=[])
    parser.add_argument("-c", "--constraint", type=Path)
    parser.add_argument("--extra-index-url", choices=["URL"])
    parser.add_argument("requirements", nargs="*")
    asked = parser.parse_args(words[1:])
    assert asked.constraint is None or asked.constraint.exists()
    named = [*asked.editable, *asked.requirements]
    assert named
    known = {Requirement(line).name for group in EXTRAS.values() for line in group}
    for one in named:
        if one.startswith("."):
            extras = Requirement(f"here{one[1:]}").extras
            assert extras <= set(EXTRAS), f"{one}: pyproject.toml has the extras {', '.join(EXTRAS)}"
        else:
            assert Requirement(one).name in known, f"{one} is in no extra of pyproject.toml"


def check_make(words: list[str]) -> None:
    """Check that make has the target, and that the programs it would call are there."""
    options = {"check": True, "capture_output": True, "text": True, "cwd": ROOT}
    called = subprocess.run(["make", "-n", *words[1:]], **options).stdout
    programs = re.findall(r"/bin/python (?:-m ([\w.]+)|([\w./]+\.py))", called)
    commands = re.findall(r"/bin/crowd-env (\w+)", called)
    assert programs or commands
    group = typer.main.get_command(app)
    assert {*commands} <= {*group.list_commands(typer.Context(group))}
    for module, script in programs:
        assert importlib.util.find_spec(module) if module else (ROOT / script).exists(), module or script
