"""The command ``crowd-env``: a group whose commands are loaded when they are named."""

import sys
from collections.abc import Mapping
from importlib import import_module
from io import TextIOWrapper
from types import MappingProxyType
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

import crowd_env

# Command -> module of this package that has it in its ``app``, in the order of the help.
COMMANDS: Mapping[str, str] = MappingProxyType(
    {
        "run": "run",
        "list": "about",
        "sweep": "sweep",
        "plan": "plan",
        "film": "recorded",
        "replay": "recorded",
        "forces": "recorded",
        "report": "report",
        "warmup": "about",
        "reproduce": "reproduce",
        "clogging": "clogging",
        "schema": "about",
        "train": "agents.learn",
        "evaluate": "agents.evaluate",
        "show": "agents.show",
        "submit": "agents.submit",
        "export": "agents.export",
        "ship": "agents.ship",
        "benchmark": "agents.benchmark",
        "tiers": "agents.upkeep",
        "dilemma": "agents.upkeep",
        "rules": "agents.upkeep",
        "freeze": "agents.upkeep",
    }
)


class LazyGroup(TyperGroup):
    """A group that imports the module of a command when the command is named, since some libraries load slowly."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__(**arguments)
        names: Any = dict.fromkeys(COMMANDS)
        self.commands = names  # what a misspelt name is compared with

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all commands, in the order of the help."""
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command; None if there is none of this name."""
        if cmd_name not in COMMANDS:
            return None
        found = typer.main.get_command(import_module(f"crowd_env.cli.{COMMANDS[cmd_name]}").app)
        command = found.commands[cmd_name] if isinstance(found, TyperGroup) else found
        command.name = cmd_name
        return command


app = typer.Typer(cls=LazyGroup, no_args_is_help=True, pretty_exceptions_enable=False)


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(f"crowd-env {crowd_env.__version__}")
        raise typer.Exit


@app.callback()
def about(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", is_eager=True, callback=_print_version)
    ] = False,
) -> None:
    """Crowds that really touch each other: run evacuations from the command line."""


def main() -> None:
    """Run the command line; a letter that the output cannot hold, as in the files of Windows, becomes a question mark."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")
    app()
