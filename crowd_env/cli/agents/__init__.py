"""Commands of those who decide, loaded when one is typed, since learning libraries load slowly."""

from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType
from typing import Any

import typer
from typer.core import TyperGroup

# Command -> module of this folder with its application.
COMMANDS: Mapping[str, str] = MappingProxyType(
    {
        "train": "learn",
        "evaluate": "evaluate",
        "show": "show",
        "submit": "submit",
        "export": "export",
        "ship": "ship",
        "benchmark": "benchmark",
    }
)


class WithLearning(TyperGroup):
    """The commands of an application, and those of this folder after them."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all commands, in the order of the help."""
        return [*super().list_commands(ctx), *COMMANDS]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command, loading its module if it is one of this folder."""
        if cmd_name not in COMMANDS:
            return super().get_command(ctx, cmd_name)
        command = typer.main.get_command(import_module(f"{__name__}.{COMMANDS[cmd_name]}").app)
        command.name = cmd_name
        return command
