"""The base of optional behaviors of pedestrians: parameters, and all facts that other modules need.

A behavior declares itself in one class.  Scenarios, settings, the schema of files, checkpoints, recordings, reports and kernels
iterate over `BEHAVIORS` and `Walking.others`, and name no behavior themselves.
"""

from collections import namedtuple
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, NamedTuple, Self

from crowd_env.core.arrays.state import Bodies, Floats
from crowd_env.core.checks import from_choice, plain_choice


class Words(NamedTuple):
    """Words about a behavior in titles, tables and reports; its plain form is a name of a preset, or a table of parameters."""

    label: str  # of its row in a report
    usual: str  # preset that the title of a run leaves out
    unsaid: frozenset[str] = frozenset()  # presets that the title of a recording leaves out
    brief: Callable[[Any], str] = str  # a table of parameters in a few words
    judged: bool = False  # whether the validation map has rows for each preset
    limits: Mapping[str, str] = {}  # preset -> note on validity in a report
    limit: str = ""  # note on validity of all other forms


@dataclass(frozen=True)
class Behavior:
    """Base of all behaviors: a frozen dataclass of parameters.

    Attributes
    ----------
    NAME : of the field of a `Scenario`, `Physics` or `Walking`, and of the parameters and the memory in kernels.
    ABOUT : one line of description, for files and documentation.
    PRESETS : name -> behavior; None stands for its absence.
    NEEDS : property that a contact scheme must have: "drives" or "turns_bodies".
    LACKS : text of the error for a scheme without it.
    MEMORY : NamedTuple of the arrays that the next step depends on, each annotated with its shape (see
        `crowd_env.physics.allocation`); they begin at zero, and a checkpoint holds them.
    USES : scratch arrays that it needs, by the last word of their annotation.
    RECORDED : arrays of the memory in recordings, with one row a pedestrian; see `rows`.
    PER_PLACE : whether each place of a batch may have its own.
    WORDS : words of titles, tables and reports; None = none.
    YIELDS : whether a scenario's behavior is dropped silently under a scheme that cannot have it.
    """

    NAME: ClassVar[str]
    ABOUT: ClassVar[str] = ""
    PRESETS: ClassVar[Mapping[str, Any]] = {}
    NEEDS: ClassVar[str | None] = None
    LACKS: ClassVar[str] = ""
    MEMORY: ClassVar[type[Any] | None] = None
    USES: ClassVar[tuple[str, ...]] = ()
    RECORDED: ClassVar[tuple[str, ...]] = ()
    PER_PLACE: ClassVar[bool] = False
    WORDS: ClassVar[Words | None] = None
    YIELDS: ClassVar[bool] = False
    # Kernel that changes the desired velocity: (i, time [s], vx, vy [m/s], batch) -> (vx, vy); see `Walking.others`.
    desire: ClassVar[Any] = None

    @classmethod
    def of(cls, given: Any) -> Self | None:
        """Return a behavior, given as such, by the name of a preset, as a table of its parameters, or as None.

        Raises
        ------
        ValueError
            If the type is wrong, or a name is unknown; the message lists the known ones.
        """
        return from_choice(cls.NAME, cls, given, cls.PRESETS)

    @classmethod
    def stored(cls, given: Any) -> Any:
        """Return the form that a scenario keeps: a name as it is, a table as the behavior that it describes.

        Raises
        ------
        ValueError
            As `of` does.
        """
        chosen = cls.of(given)
        return given if isinstance(given, str) else chosen

    @classmethod
    def plain_of(cls, chosen: Any) -> Any:
        """Return the name of a behavior, or without one the table of its parameters: for JSON, and for `of`."""
        return plain_choice(chosen, cls.PRESETS)

    @classmethod
    def params_of(cls, chosen: Any) -> Any:
        """Return the parameters for kernels, default ones where it is absent; of all places if `PER_PLACE`."""
        values = vars(chosen or cls())
        return record(**{name: float(value) for name, value in values.items()})

    @classmethod
    def acts(cls, chosen: Any, bodies: Bodies) -> bool:
        """Whether the behavior acts on these people."""
        return chosen is not None

    @classmethod
    def rows(cls, simulation: Any) -> dict[str, Floats]:
        """Return the arrays (P, ...) of a recording at this moment, by name."""
        memory = getattr(simulation.history.memory, cls.NAME)
        return {name: simulation.in_slots(getattr(memory, name)) for name in cls.RECORDED}


def record(**values: Any) -> Any:
    """Return a NamedTuple of these values, which kernels can read and pickle can store."""
    return _record(tuple(values), tuple(values.values()))


def _record(names: tuple[str, ...], values: tuple[Any, ...]) -> Any:
    return _kind_of_record(names)._make(values)


@cache
def _kind_of_record(names: tuple[str, ...]) -> Any:
    made = namedtuple("Record", names)  # type: ignore[misc]  # names are known at run time alone
    return type("Record", (made,), {"__slots__": (), "__reduce__": lambda self: (_record, (names, tuple(self)))})
