"""Crowded halls emptied by one door: is anyone ever through a wall, or faster than a person can be?

Positions are looked at after every decision step with shapely, which knows nothing of contacts or of the simulation's own
test; the largest speed is that after any physics step.  The crowds are denser and larger than those of ordinary scenarios:
what holds here by some way holds there.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import shapely
from shapely.geometry import box

from crowd_env import CrowdEnv, Geometry, Population, Scenario
from crowd_env.state import MAX_SPEED


class Hall(NamedTuple):
    """A square hall with a door in the middle of its eastern wall."""

    people: int
    density: float  # 1/m2
    door: float  # m

    def scenario(self, time_limit: float) -> Scenario:
        """Return the hall, in which everyone is of the default kind."""
        side = float(np.sqrt(self.people / self.density))
        door = [(side, 0.5 * (side - self.door)), (side, 0.5 * (side + self.door))]
        place = Geometry.from_polygon(box(0.0, 0.0, side, side), exits={"door": door})
        return Scenario("hall", place, Population(self.people), time_limit, blocked_after=30.0)


# 500 to 5000 people at 2 to 4 /m2, doors of 0.8 to 4 m.
HALLS = (
    Hall(500, 2.0, 0.8),
    Hall(500, 4.0, 4.0),
    Hall(1000, 3.0, 1.2),
    Hall(1000, 4.0, 2.0),
    Hall(2000, 2.5, 1.2),
    Hall(2000, 4.0, 0.8),
    Hall(5000, 2.0, 4.0),
    Hall(5000, 2.5, 1.2),
    Hall(5000, 4.0, 0.8),
    Hall(5000, 4.0, 4.0),
)


def empty(hall: Hall, scheme: str, time_limit: float, progress: Callable[[float], None]) -> dict[str, Any]:
    """Let everyone walk out, until all are out, the door has been blocked for 30 s, or the time is over.

    Returns
    -------
    A row ready for JSON: who was outside of the plan at most at once (by shapely) and at any decision (by the simulation), the
    largest speed [m/s], the deepest overlaps [mm], how many are left; or the sentence with which the run ended early.
    """
    env = CrowdEnv(hall.scenario(time_limit), scheme=scheme)
    env.reset([0])
    floor, lost = env.scenarios[0].geometry.walkable, 0
    shapely.prepare(floor)
    row: dict[str, Any] = {"scheme": scheme, **hall._asdict(), "stopped": None}
    try:
        while not env.finished.all():
            env.step(None)
            here = env.simulation.state.position[env.active]
            lost = max(lost, int(np.count_nonzero(~shapely.intersects_xy(floor, *here.T))))
            progress(float(env.simulation.state.time[0]))
    except FloatingPointError as error:
        row["stopped"] = str(error)
    episode = env.metrics(0)
    return row | {
        "outside_at_once": lost,
        "escaped": episode.escaped,
        "max_speed": episode.max_speed,
        "bound": MAX_SPEED,
        "overlap_mm": 1e3 * episode.max_overlap,
        "wall_mm": 1e3 * episode.max_outside,
        "left": episode.unfinished,
        "until": float(env.simulation.state.time[0]),
    }


def holds(row: dict[str, Any]) -> bool:
    """Whether nobody was outside, and nobody faster than the bound."""
    inside = row["outside_at_once"] == 0 and row["escaped"] == 0 and row["stopped"] is None
    return bool(inside and row["max_speed"] <= row["bound"] * (1.0 + 1e-12))


def told(row: dict[str, Any]) -> str:
    """Return what came of a run, in words."""
    if row["stopped"]:
        return str(row["stopped"])
    lost = max(row["outside_at_once"], row["escaped"])
    outside = "nobody" if lost == 0 else f"{lost} of them"
    return f"{outside} outside of the plan, fastest {row['max_speed']:.2f} m/s, {row['left']} left after {row['until']:.0f} s"
