"""Routes, control rules and events of doors, as data."""

from dataclasses import dataclass

from crowd_env.checks import NOT_NEGATIVE, check_fields, known, shown
from crowd_env.routing.strategies import OF_ROUTES

OUT = "out"  # name of the route that everyone knows: all exits


@dataclass(frozen=True)
class Route:
    """A way out that people may take or be sent on.

    Parameters
    ----------
    name : what rules, groups and controllers call it.
    exits : names of the exits that it may lead to, the best of them; () = all.
    via : region to walk to first.
    strategy : "shortest", "fastest" or "comfortable", see `crowd_env.routing.strategies.STRATEGIES`.
    """

    name: str
    exits: tuple[str, ...] = ()
    via: str | None = None
    strategy: str = "shortest"

    def __post_init__(self) -> None:
        check_fields(f"route {shown(self.name)}", self)
        if not self.name:
            raise ValueError("a route needs a name")
        known("strategy", self.strategy, OF_ROUTES, f"route {shown(self.name)}: ")


@dataclass(frozen=True)
class ControlRule:
    """While a region is crowded, people elsewhere who would come through it take another route.

    Parameters
    ----------
    region : where people are counted.
    at_least : so many people switch the rule on.
    route : name of a route or exit that the others take meanwhile.
    below : fewer than so many switch it off again; by default ``at_least``.
    hold : s, it stays on for so long at least.
    commits : people who have been sent another way keep to it, even when the rule is off.
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
