"""Options of a command line that take several names each: ``--policies shortest fastest``."""

from collections.abc import Collection, Sequence
from typing import Any

from typer.core import TyperCommand


class ListsOfNames(TyperCommand):
    """A command every option of which that can be given several times takes several names at once too."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments, with the name of its option before every name of a list."""
        lists = [name for option in self.params if getattr(option, "multiple", False) for name in option.opts]
        return super().parse_args(ctx, _one_by_one(args, lists))


def _one_by_one(arguments: Sequence[str], lists: Collection[str]) -> list[str]:
    found: list[str] = []
    option = None
    for argument in arguments:
        if argument.startswith("--"):
            option = argument if argument in lists else None
        elif option is not None and found[-1] != option:
            found.append(option)
        found.append(argument)
    return found
