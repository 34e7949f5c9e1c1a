"""Ways out as data: routes with a strategy each, control rules and speed zones.

Strategies (Pécol et al. 2011, section 3): the shortest path; the fastest, by the time it takes through the crowd as it is now;
the most comfortable, with a cost on stairs and turns.  Each is a travel-time field by fast marching with its own speed map.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

Strategy = Literal["shortest", "fastest", "comfortable"]

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
        if not self.name:
            raise ValueError("a route needs a name")
        exits: object = self.exits  # what is annotated is not always what is given
        if isinstance(exits, str):
            raise ValueError(
                f"route {self.name!r}: exits is {self.exits!r}; it must be a tuple of names: ({self.exits!r},)"
            )
        if self.strategy not in get_args(Strategy):
            raise ValueError(
                f"route {self.name!r}: unknown strategy {self.strategy!r}; known: {', '.join(get_args(Strategy))}"
            )


@dataclass(frozen=True)
class SpeedZone:
    """A region where people walk at another speed, such as stairs.

    Parameters
    ----------
    region : its name.
    speed : m/s, everyone's desired speed there; None = one's own.
    factor : multiple of it, > 0.
    """

    region: str
    speed: float | None = None
    factor: float = 1.0

    def __post_init__(self) -> None:
        if self.speed is not None and not 0 < self.speed < np.inf:
            raise ValueError(f"speed zone {self.region!r}: speed is {self.speed!r} m/s; it must be > 0 and finite")
        if not 0 < self.factor < np.inf:
            raise ValueError(f"speed zone {self.region!r}: factor is {self.factor!r}; it must be > 0 and finite")
        if self.speed is None and self.factor == 1.0:
            raise ValueError(f"speed zone {self.region!r} changes nothing; give it a speed or a factor other than 1")


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
        if self.at_least != int(self.at_least) or self.at_least < 1:
            raise ValueError(f"control rule on {self.region!r}: at_least is {self.at_least}; it must be at least 1")
        if self.below is not None and not 0 <= self.below <= self.at_least:
            raise ValueError(
                f"control rule on {self.region!r}: below is {self.below}; it must be from 0 to at_least, {self.at_least}"
            )
        if not 0 <= self.hold < np.inf:
            raise ValueError(f"control rule on {self.region!r}: hold is {self.hold!r} s; it must be >= 0 and finite")


@dataclass(frozen=True)
class Comfort:
    """What the most comfortable way costs, in metres of plain floor.

    Parameters
    ----------
    stairs : a metre in a slow zone counts as so many more.
    turn : passing a corner that juts into the way counts as so many more metres.
    reach : m, how near to a corner that cost is spread; it also keeps the way off corners.
    """

    stairs: float = 3.0
    turn: float = 1.0
    reach: float = 0.6

    def __post_init__(self) -> None:
        for name in ("stairs", "turn", "reach"):
            value = getattr(self, name)
            if not (0 <= value < np.inf and (value > 0 or name != "reach")):
                raise ValueError(
                    f"comfort: {name} is {value!r}; it must be {'> 0' if name == 'reach' else '>= 0'} and finite"
                )


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
        counted = (self.region is not None) + (self.exit is not None)
        by_time = self.at is not None and self.at_least is None and counted == 0
        by_count = self.at is None and self.at_least is not None and counted == 1
        if not (by_time or by_count):
            raise ValueError(
                f"event of door {self.door!r}: give either a time `at`, or `at_least` with one of `region` and `exit`"
            )
        if self.at is not None and not 0 <= self.at < np.inf:
            raise ValueError(f"event of door {self.door!r}: at is {self.at!r} s; it must be >= 0 and finite")
        if self.at_least is not None and self.at_least < 1:
            raise ValueError(f"event of door {self.door!r}: at_least is {self.at_least}; it must be at least 1")
