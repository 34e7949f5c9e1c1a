"""What a paper is here: settings that may be ``--set``, and for each table or figure its evacuations and what it makes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Generic, Literal, TypeVar, get_args, get_origin, get_type_hints

from pydantic import TypeAdapter, ValidationError

from crowd_env.core.checks import COUNT, FINITE, NOT_NEGATIVE, POSITIVE, Plain, Range, known, number, whole
from crowd_env.reproduce.evacuations import Case
from crowd_env.reproduce.result import Result

TARGET_HELP = (
    "What people walk to: path (shortest path of a disc), or straight to the center of the door (centre), its nearest "
    "point that keeps off the jambs (nearest), or the nearest point of its whole width (width)"
)


def option(default: Any, help: str, allowed: Range = FINITE) -> Any:
    """Return a field of `Settings`; ``help`` explains it on the command line, without its default and a full stop."""
    return field(default=default, metadata={"help": help, "allowed": allowed})


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

    runs: int = option(10, "Number of draws", COUNT)
    seed: int = option(0, "Draw k has the seed SEED + k", NOT_NEGATIVE)
    dt: float = option(0.01, "Time step, s", POSITIVE)

    def __post_init__(self) -> None:
        hints = get_type_hints(type(self))
        for one in fields(self):
            what, value, hint = flag(one.name), getattr(self, one.name), hints[one.name]
            if get_origin(hint) is Literal:
                known(what, value, get_args(hint))
            elif hint is int:
                whole(what, value, one.metadata["allowed"])
            elif isinstance(value, float):
                number(what, value, one.metadata["allowed"])

    @property
    def seeds(self) -> range:
        """The seed of each draw."""
        return range(self.seed, self.seed + self.runs)

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

    def changed(self) -> Plain:
        """Return the options that differ from the defaults, without which draws are made."""
        values = {one.name: (getattr(self, one.name), one.default) for one in fields(self)}
        return {k: here for k, (here, usual) in values.items() if here != usual and k not in ("runs", "seed")}


AnySettings = TypeVar("AnySettings", bound=Settings)


def every(settings: type[Settings], *but: str) -> frozenset[str]:
    """Return the names of all options of a paper ``but`` some."""
    return frozenset(one.name for one in fields(settings)).difference(but)


DRAWS = frozenset({"runs", "seed"})  # options of a figure that depends on nothing else
OF_KEPT_RUNS = frozenset({"workers", "fresh", "ray"})  # options of the computing, where evacuations are kept


@dataclass(frozen=True)
class Figure(Generic[AnySettings]):
    """How one table or figure is redone."""

    title: str
    # Makes the figure of its settings and, if it has cases, of the runs of every case, by the names of the cases.
    reproduce: Callable[..., Result]
    cases: Callable[[AnySettings], Mapping[Any, Case]] | None = None  # None = it simulates something small by itself
    options: frozenset[str] = DRAWS  # names of the settings that matter to it
    defaults: Mapping[str, object] = field(default_factory=dict)  # settings that are other by default than the paper's
    cpu_time: float = 1.0  # s, with the defaults, once the kernels are compiled; as if no other figure shared its runs

    def redo(self, name: str, settings: AnySettings, runs: Mapping[Any, Any]) -> Result:
        """Return the figure, by its ``name``, of its settings and of the runs of its cases."""
        found = self.reproduce(settings) if self.cases is None else self.reproduce(settings, runs)
        title = f"{self.title} ({found.of})" if found.of else self.title
        return replace(found, name=name, title=title, options=settings.changed())

    def takes(self, option: str) -> bool:
        """Return whether an option of the command line matters to the figure."""
        return option in self.options or (self.cases is not None and option in OF_KEPT_RUNS)


@dataclass(frozen=True)
class Paper(Generic[AnySettings]):
    """A paper some of whose tables and figures can be redone."""

    title: str
    settings: type[AnySettings]
    figures: Mapping[str, Figure[AnySettings]]  # by the names of the command line
    cpu_time: float  # s, of all figures together

    def settings_of(self, name: str, given: Plain) -> AnySettings:
        """Return the settings of a figure, from the ``given`` options that matter to it.

        Raises
        ------
        ValueError
            In one sentence, if one is out of range.
        """
        figure, there = self.figures[name], {one.name for one in fields(self.settings)}
        mine = {option: value for option, value in given.items() if option in figure.options & there}
        return self.settings(**{**figure.defaults, **mine})
