"""Ways out as data: routes with a strategy each, control rules and speed zones.

Strategies (Pécol et al. 2011, section 3): the shortest path; the fastest, by the time it takes through the crowd as it is now;
the most comfortable, with a cost on stairs and turns.  Each is a travel-time field by fast marching with its own speed map.
"""

from dataclasses import dataclass
from typing import Literal

from crowd_env.checks import NOT_NEGATIVE, POSITIVE, Range, check_fields, shown
from crowd_env.state import MAX_SPEED

Strategy = Literal["shortest", "fastest", "comfortable"]

_NOT_GIVEN = float("nan")
OUT = "out"  # name of the route that everyone knows: all exits


@dataclass(frozen=True)
class Route:
    """A way out that people may take or be sent on.

    Parameters
    ----------
    name : what rules, groups and controllers call it.
    exits : names of the exits that it may lead to, the best of them; () = all.
    via : region to walk to first.
    strategy : "shortest", "fastest" or "comfortable".
    """

    name: str
    exits: tuple[str, ...] = ()
    via: str | None = None
    strategy: Strategy = "shortest"

    def __post_init__(self) -> None:
        check_fields(f"route {shown(self.name)}", self)
        if not self.name:
            raise ValueError("a route needs a name")


@dataclass(frozen=True)
class SpeedZone:
    """A region where people walk at another speed, such as stairs; give ``speed``, ``factor`` or both.

    Parameters
    ----------
    region : its name.
    speed : m/s, everyone's desired speed there; None = one's own.
    factor : multiple of it, > 0; 1 if not given.
    """

    region: str
    speed: float | None = None
    factor: float = _NOT_GIVEN

    def __post_init__(self) -> None:
        if self.factor is _NOT_GIVEN:  # a factor of 1 that is given may be one of several that are tried
            if self.speed is None:
                raise ValueError(f"speed zone {shown(self.region)} changes nothing; give it a speed or a factor")
            object.__setattr__(self, "factor", 1.0)
        check_fields(f"speed zone {shown(self.region)}", self, speed=Range(0.0, MAX_SPEED, above=True), factor=POSITIVE)


@dataclass(frozen=True)
class ControlRule:
    """If a region is crowded, whoever is elsewhere and would come through it takes another route.

    Parameters
    ----------
    region : where people are counted.
    at_least : so many people switch the rule on.
    route : name of a route or exit that the others take meanwhile.
    below : fewer than so many switch it off again; by default ``at_least``.
    hold : s, it stays on for so long at least.
    commits : whoever has been sent another way keeps to it, even when the rule is off.
    """

    region: str
    at_least: int
    route: str
    below: int | None = None
    hold: float = 0.0
    commits: bool = False

    def __post_init__(self) -> None:
        check_fields(f"control rule on {shown(self.region)}", self, below=NOT_NEGATIVE, hold=NOT_NEGATIVE)
        if self.below is not None and self.below > self.at_least:
            raise ValueError(
                f"control rule on {self.region!r}: below is {self.below}; it must be from 0 to at_least, {self.at_least}"
            )


@dataclass(frozen=True)
class Comfort:
    """What the most comfortable way costs, in meters of plain floor.

    Parameters
    ----------
    stairs : a meter in a slow zone counts as so many more.
    turn : passing a corner that juts into the way counts as so many more meters.
    reach : m, how near to a corner that cost is spread; it also keeps the way off corners.
    """

    stairs: float = 3.0
    turn: float = 1.0
    reach: float = 0.6

    def __post_init__(self) -> None:
        check_fields("comfort", self, stairs=NOT_NEGATIVE, turn=NOT_NEGATIVE, reach=POSITIVE)


@dataclass(frozen=True)
class DoorEvent:
    """A door opens or closes, once an episode: at a time, or when enough people are somewhere or have left.

    Parameters
    ----------
    door : its name.
    opens : True opens it, False closes it.
    at : s, when; or
    at_least : when so many people stand in ``region``, or have left by ``exit``.
    region, exit : names; one of them goes with ``at_least``.
    """

    door: str
    opens: bool
    at: float | None = None
    at_least: int | None = None
    region: str | None = None
    exit: str | None = None

    def __post_init__(self) -> None:
        check_fields(f"event of door {shown(self.door)}", self, at=NOT_NEGATIVE)
        counted = (self.region is not None) + (self.exit is not None)
        by_time = self.at is not None and self.at_least is None and counted == 0
        by_count = self.at is None and self.at_least is not None and counted == 1
        if not (by_time or by_count):
            raise ValueError(
                f"event of door {self.door!r}: give either a time `at`, or `at_least` with one of `region` and `exit`"
            )
