"""Settings of a paper: a frozen dataclass whose fields are what the command line may ``--set``."""

import math
from dataclasses import dataclass, field, fields
from typing import Any, Literal, get_args, get_origin, get_type_hints

from pydantic import TypeAdapter, ValidationError

TARGET_HELP = (
    "What people walk to: path (shortest path of a disc), or straight to the center of the door (centre), its nearest "
    "point that keeps off the jambs (nearest), or the nearest point of its whole width (width)"
)


def option(default: Any, help: str, *, may_be_infinite: bool = False) -> Any:
    """Return a field of `Settings`; ``help`` explains it on the command line, without its default and a full stop."""
    return field(default=default, metadata={"help": help, "may_be_infinite": may_be_infinite})


def flag(name: str) -> str:
    """Return how the command line spells an option or a setting."""
    return f"--{name}" if name in ("runs", "seed", "workers", "fresh", "ray") else f"--set {name}"


@dataclass(frozen=True)
class Settings:
    """Options that every paper has; a paper derives its own from it, with a field an option.

    Raises
    ------
    ValueError
        In one sentence, if a number is out of range or not finite, or a word is unknown.
    """

    runs: int = option(10, "Number of draws")
    seed: int = option(0, "Draw k has the seed SEED + k")
    dt: float = option(0.01, "Time step, s")

    def __post_init__(self) -> None:
        if self.runs < 1:
            raise ValueError(f"--runs is {self.runs}; it must be at least 1")
        if self.seed < 0:
            raise ValueError(f"--seed is {self.seed}; it must be >= 0")
        hints = get_type_hints(type(self))
        for one in fields(self):
            value = getattr(self, one.name)
            if get_origin(hints[one.name]) is Literal and value not in get_args(hints[one.name]):
                known = ", ".join(get_args(hints[one.name]))
                raise ValueError(f"unknown {flag(one.name)} {value!r}; known: {known}")
            if isinstance(value, float) and not math.isfinite(value) and not one.metadata["may_be_infinite"]:
                raise ValueError(f"{flag(one.name)} is {value}; it must be a finite number")
        if not self.dt > 0:
            raise ValueError(f"--set dt is {self.dt:g} s; it must be > 0")

    @property
    def draws_are(self) -> str:
        """The beginning of a sentence: "Draws 0 to 9 are"."""
        last = self.seed + self.runs - 1
        return f"Draw {last} is" if self.runs == 1 else f"Draws {self.seed} to {last} are"

    @classmethod
    def read(cls, name: str, text: str) -> Any:
        """Return the value of a setting that the command line gives as text.

        Raises
        ------
        ValueError
            If it is not of its kind.
        """
        hint = get_type_hints(cls)[name]
        try:
            return text if get_origin(hint) is Literal else TypeAdapter(hint).validate_python(text)
        except ValidationError as error:
            raise ValueError(f"--set {name}={text}: {error.errors()[0]['msg'].lower()}") from None

    def changed(self) -> dict[str, object]:
        """Return the options that differ from the defaults, without which draws are made."""
        values = {one.name: (getattr(self, one.name), one.default) for one in fields(self)}
        return {k: here for k, (here, usual) in values.items() if here != usual and k not in ("runs", "seed")}
