"""Routes, control rules and events of doors, as data."""

from dataclasses import dataclass, field

from crowd_env.core.checks import Natural, NotNegative, Positive, check_fields, shown
from crowd_env.core.files.fingerprint import UNSAID
from crowd_env.routing.strategies import OfRoutes

OUT = "out"  # name of the route of all people by default: all exits


@dataclass(frozen=True)
class Route:
    """A way out that people may take or be sent on."""

    name: str
    """name by which rules, cohorts and controllers refer to the route."""
    exits: tuple[str, ...] = ()
    """names of the exits that the route may lead to, the best of which is taken; all exits by default."""
    via: str | tuple[str, ...] | None = None
    """name of the region that the route leads to first, or of several in turn; none by default."""
    strategy: OfRoutes = "shortest"
    """what counts on the route: "shortest", "fastest" or "comfortable"."""
    until: NotNegative = field(default=0.0, metadata={UNSAID: 0.0})
    """s, the time until which people wait in ``via``, its first region; a `Population.wait` may hold them for longer."""

    def __post_init__(self) -> None:
        check_fields(f"route {shown(self.name)}", self)
        if not self.name:
            raise ValueError("a route needs a name")
        if self.until and self.via is None:
            raise ValueError(f"route {self.name!r}: until is a time to wait in a region; give via too")

    @property
    def stops(self) -> tuple[str, ...]:
        """Names of the regions that the route leads to, in turn."""
        return (self.via,) if isinstance(self.via, str) else self.via or ()


@dataclass(frozen=True)
class ControlRule:
    """While a region is crowded, people elsewhere who would come through it take another route.

    People on a "fastest" route are not turned away: their route weighs the crowd already, and both together would send them
    to and fro.
    """

    region: str
    """name of the region in which people are counted."""
    at_least: int
    """number of people in the region that switches the rule on."""
    route: str
    """name of the route or exit that people elsewhere take while the rule is on."""
    below: Natural | None = None
    """the rule switches off when fewer people than this are in the region; by default ``at_least``."""
    hold: NotNegative = 0.0
    """s, the shortest time for which the rule stays on."""
    commits: bool = False
    """whether redirected people keep to their new route after the rule has switched off."""

    def __post_init__(self) -> None:
        check_fields(f"control rule on {shown(self.region)}", self)
        if self.below is not None and self.below > self.at_least:
            raise ValueError(
                f"control rule on {self.region!r}: below is {self.below}; it must be from 0 to at_least, {self.at_least}"
            )


@dataclass(frozen=True)
class DoorEvent:
    """A door opens or closes, once an episode: at a time, or when enough people are somewhere or have left."""

    door: str
    """name of the door."""
    opens: bool
    """true opens the door, false closes it."""
    at: NotNegative | None = None
    """s, the time of the event; give either this or ``at_least``."""
    at_least: int | None = None
    """number of people in ``region``, or out by ``exit``, at which the event happens."""
    region: str | None = None
    """name of the region in which people are counted, for ``at_least``."""
    exit: str | None = None
    """name of the exit at which leaving people are counted, for ``at_least``."""

    def __post_init__(self) -> None:
        check_fields(f"event of door {shown(self.door)}", self)
        counted = (self.region is not None) + (self.exit is not None)
        by_time = self.at is not None and self.at_least is None and counted == 0
        by_count = self.at is None and self.at_least is not None and counted == 1
        if not (by_time or by_count):
            raise ValueError(
                f"event of door {self.door!r}: give either a time `at`, or `at_least` with one of `region` and `exit`"
            )


@dataclass(frozen=True)
class Gate:
    """A door that lets people through one by one, such as a turnstile: it is a wall for all others."""

    door: str
    """name of the door."""
    flow: Positive
    """1/s, the largest number of people per second."""

    def __post_init__(self) -> None:
        check_fields(f"gate {shown(self.door)}", self)
