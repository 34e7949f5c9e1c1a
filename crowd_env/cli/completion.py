"""What a shell proposes for an argument or an option: names that are known; file names come from the shell."""

from collections.abc import Callable, Iterable


def complete_from(names: Iterable[str]) -> Callable[[str], list[str]]:
    """Return what typer asks for proposals: those of ``names`` that begin as the user has begun."""
    known = tuple(names)

    def proposed(incomplete: str) -> list[str]:
        return [name for name in known if name.startswith(incomplete)]

    return proposed
