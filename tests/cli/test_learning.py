"""The commands of `agents` stand beside the others, and are loaded when they are asked for."""

import subprocess
import sys

import pytest
import typer
from cases import looped
from commands import call
from repository import ROOT

from crowd_env.cli.main import COMMANDS, app


def test_help_lists_them():
    result = call("--help")
    assert result.exit_code == 0
    for name in COMMANDS:
        assert f" {name} " in result.stdout


@looped("name", COMMANDS)
def test_each_tells_what_it_does(name):
    result = call(f"{name} --help")
    assert result.exit_code == 0, result.stderr
    assert f"{name} [OPTIONS]" in result.stdout


def test_no_switch_that_leaves_something_out_has_a_default_that_reads_as_if_it_did_so_already():
    group = typer.main.get_command(app)
    for name in group.list_commands(context := typer.Context(group)):
        for option in group.get_command(context, name).params:
            assert not (getattr(option, "secondary_opts", ()) and option.show_default), (name, option.name)


def test_a_mistake_is_told_as_everywhere():
    result = call("evaluate --task no-such-task")
    assert result.exit_code == 2 and "'no-such-task'; known: " in result.stderr


@pytest.mark.more
def test_other_commands_do_not_load_them():
    program = "import sys; from crowd_env.cli.main import app; app(['schema'], standalone_mode=False); "
    program += "print([name for name in sys.modules if name.startswith('crowd_env.agents')], file=sys.stderr)"
    result = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert result.stderr.strip().endswith("[]")
