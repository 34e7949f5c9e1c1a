"""What a paper is here: its settings, and for each table or figure the runs that it needs and what it makes of them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Generic, NamedTuple, TypeVar

from crowd_env.core.executors import Executor
from crowd_env.reproduce.result import Progress, Result
from crowd_env.reproduce.run import Run
from crowd_env.reproduce.settings import Settings

AnySettings = TypeVar("AnySettings", bound=Settings)

DRAWS = frozenset({"runs", "seed"})  # options of a figure that depends on nothing else
SPREAD = frozenset({"ray"})  # options of a figure whose draws can be spread over a cluster
OF_KEPT_RUNS = SPREAD | {"workers", "fresh"}  # options of the computing, for figures made of runs that are kept


class Work(NamedTuple):
    """What a figure is made with."""

    progress: Progress  # to be called with each count done; in all `Figure.steps`
    records: Mapping[Any, Any]  # what came of each of `Figure.runs`
    executor: Executor | None = None  # of the draws it simulates by itself; None = side by side in this process


@dataclass(frozen=True)
class Figure(Generic[AnySettings]):
    """How one table or figure is redone: it simulates by itself, or is made of runs that are kept and shared."""

    title: str
    reproduce: Callable[[AnySettings, Work], Result]
    steps: Callable[[AnySettings], int] | None = None  # length of the progress bar of what it simulates by itself
    runs: Callable[[AnySettings], Sequence[Run[Any]]] | None = None  # that it is made of
    options: frozenset[str] = DRAWS  # names of the settings that matter to it
    defaults: Mapping[str, object] = field(default_factory=dict)  # settings that are other by default than the paper's
    cpu_time: float = 1.0  # s, with the defaults, once the kernels are compiled; as if no other figure shared its runs

    def takes(self, option: str) -> bool:
        """Return whether an option of the command line matters to the figure."""
        return option in self.options or (self.runs is not None and option in OF_KEPT_RUNS)


@dataclass(frozen=True)
class Paper(Generic[AnySettings]):
    """A paper some of whose tables and figures can be redone."""

    title: str
    settings: type[AnySettings]
    figures: Mapping[str, Figure[AnySettings]]  # by the names of the command line
    cpu_time: float  # s, of all figures together
    # Raises ValueError, before anything runs, if settings (by the names of figures) cannot be used together.
    check: Callable[[Mapping[str, AnySettings]], None] = lambda chosen: None

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
