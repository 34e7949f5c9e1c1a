"""Commands of `agents`, found by their names when one is asked for: crowd_env itself knows nothing of those who decide.

In a checkout they are those of the folder ``agents``; a wheel carries that folder as `crowd_env.agents`, since a package of
that name beside crowd_env would collide with others.
"""

from collections.abc import Mapping
from importlib import import_module
from importlib.util import find_spec
from types import MappingProxyType
from typing import Any

import typer
from typer.core import TyperGroup

# Command -> module of `agents` with its application.
COMMANDS: Mapping[str, str] = MappingProxyType(
    {
        "train": "learn",
        "train-routing": "train_routing",
        "evaluate": "evaluate",
        "show": "show",
        "submit": "submit",
        "export": "export",
    }
)


class WithLearning(TyperGroup):
    """The commands of an application, and those of `agents` after them."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all commands, in the order of the help."""
        return [*super().list_commands(ctx), *COMMANDS]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command, loading its module if it is one of `agents`."""
        if cmd_name not in COMMANDS:
            return super().get_command(ctx, cmd_name)
        command = typer.main.get_command(_module(COMMANDS[cmd_name]).app)
        command.name = cmd_name
        return command


def _module(name: str) -> Any:
    package = "crowd_env.agents" if find_spec("crowd_env.agents") else "agents"
    return import_module(f"{package}.{name}")
