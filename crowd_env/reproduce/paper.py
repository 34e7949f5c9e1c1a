"""What a paper is here: its settings, and for each table or figure the evacuations it needs and what it makes of them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Generic, TypeVar

from crowd_env.reproduce.evacuations import Case
from crowd_env.reproduce.result import Result
from crowd_env.reproduce.settings import Settings

AnySettings = TypeVar("AnySettings", bound=Settings)

DRAWS = frozenset({"runs", "seed"})  # options of a figure that depends on nothing else
OF_KEPT_RUNS = frozenset(
    {"workers", "fresh", "ray"}
)  # options of the computing, for figures that are made of evacuations


@dataclass(frozen=True)
class Figure(Generic[AnySettings]):
    """How one table or figure is redone."""

    title: str
    # Makes the figure of its settings and of the runs of every case, by the names of the cases.
    reproduce: Callable[[AnySettings, Any], Result]
    cases: Callable[[AnySettings], Mapping[Any, Case]] | None = None  # None = it simulates something small by itself
    options: frozenset[str] = DRAWS  # names of the settings that matter to it
    defaults: Mapping[str, object] = field(default_factory=dict)  # settings that are other by default than the paper's
    cpu_time: float = 1.0  # s, with the defaults, once the kernels are compiled; as if no other figure shared its runs

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

    def settings_of(self, name: str, given: Mapping[str, Any]) -> AnySettings:
        """Return the settings of a figure, made of those ``given`` that matter to it.

        Raises
        ------
        ValueError
            In one sentence, if one is out of range.
        """
        figure, known = self.figures[name], {one.name for one in fields(self.settings)}
        mine = {option: value for option, value in given.items() if option in figure.options and option in known}
        return self.settings(**{**figure.defaults, **mine})
