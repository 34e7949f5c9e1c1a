"""Commands of those who decide, loaded when one is typed, since learning libraries load slowly."""

from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType
from typing import Any

import typer
from typer.core import TyperGroup

from crowd_env.cli.reproduce import SETTINGS

# Command -> module of this folder with its application.
COMMANDS: Mapping[str, str] = MappingProxyType(
    {"train": "learn", **{name: name for name in ("evaluate", "show", "submit", "export", "ship", "benchmark")}}
)


# Options of version 0.1.0 that have another name now, or another place.
RENAMED: Mapping[str, str] = MappingProxyType(
    {
        "--n": "--people N",
        "--scheme": "--physics NAME",
        "--manner": "--crowd NAME",
        "--strategy": "--routing NAME",
        "--no-rules": "--set signs=no",
        **{f"--{name}": f"--set {name}=VALUE" for name in ("speed", "radius", "outline", "social", "dt")},
        **dict.fromkeys(("--film", "--film-width", "--film-fps", "--film-speed"), "--out DIR, then crowd-env film DIR"),
        "--html": "--out DIR, then crowd-env replay DIR",
        **dict.fromkeys(("--force-network", "--at", "--around"), "--out DIR, then crowd-env forces DIR"),
        "--record-runs": "--record N, or --record all",
        "--record-contacts": "--out DIR, which records contacts unless --no-contacts is given",
        "--every": "--out DIR, which records every decision",
    }
)


class WithLearning(TyperGroup):
    """The commands of an application, and those of this folder after them."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that is typed; an option that it has no more is answered with the one it has now."""
        name, command, rest = super().resolve_command(ctx, args)
        parameters = command.params if command is not None else ()
        known = {option for parameter in parameters for option in (*parameter.opts, *parameter.secondary_opts)}
        renamed = {**RENAMED, **(SETTINGS if name == "reproduce" else {})}
        for word in rest:
            option = word.partition("=")[0]
            if option in renamed and option not in known:
                ctx.fail(f"{option} is no option of {name} any more; give {renamed[option]}")
        return name, command, rest

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
