"""Strategies: how people choose their way (Pécol et al. 2011, section 3).

Each is a travel-time field by fast marching with a speed map of its own.  A new one is a line in `STRATEGIES`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import NAMES
from crowd_env.routing.speed_map import SpeedMap


@dataclass(frozen=True)
class Strategy:
    """The speed behind the travel time, and the choice of the exit.

    Parameters
    ----------
    about : a short description.
    speed : speed (rows, cols) relative to plain floor, of a speed map at nodes (rows, cols, 2); None = plain floor everywhere.
    follows_crowd : the field is found again at the speed that the crowd allows, see `crowd_env.routing.fields.congestion`.
    per_exit : there is a route to every exit, and each pedestrian keeps to the one that is shortest from its start.
    """

    about: str
    speed: Callable[[SpeedMap, Floats], Floats] | None = None
    follows_crowd: bool = False
    per_exit: bool = False


STRATEGIES: dict[str, Strategy] = {
    "shortest": Strategy("the shortest path"),
    "nearest": Strategy("the exit that is nearest at the start, once and for all", per_exit=True),
    "fastest": Strategy("the least time through the crowd as it is", speed=SpeedMap.walking, follows_crowd=True),
    "comfortable": Strategy("off stairs and corners", speed=SpeedMap.comfortable),
}
NAMES["strategy"] = STRATEGIES
# The strategies of a route: its goal does not depend on the start.
if TYPE_CHECKING:
    OfRoutes: TypeAlias = str
else:
    OfRoutes = Literal[tuple(name for name, strategy in STRATEGIES.items() if not strategy.per_exit)]
