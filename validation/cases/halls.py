"""Crowded halls emptied by one door: is anyone ever through a wall, or faster than a person can be?

Positions are looked at after every decision step with shapely, which knows nothing of contacts or of the simulation's own
test; the largest speed is that after any physics step.  The crowds are denser and larger than those of ordinary scenarios:
what holds here by some way holds there.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import shapely

from crowd_env import FULL_SPEED, TABLE_4, CrowdEnv, Population, Scenario, make_scenario
from crowd_env.core.arrays.state import MAX_SPEED
from crowd_env.core.checks import Plain
from crowd_env.envs.crowd import Step
from crowd_env.envs.rollout import rollout
from validation.cases.case import Row, Setting, row

_TIME_LIMIT = 3600.0  # s


class Hall(NamedTuple):
    """A square hall with a door in the middle of its eastern wall."""

    people: int
    density: float  # 1/m2
    door: float  # m

    def scenario(self, time_limit: float = _TIME_LIMIT) -> Scenario:
        """Return the hall, in which everyone is of the default kind."""
        side = float(np.sqrt(self.people / self.density))
        people = Population(self.people, **TABLE_4)
        options: dict[str, Any] = {"population": people, "time_limit": time_limit, "blocked_after": 30.0}
        return replace(make_scenario("room-v0", side=side, door_width=self.door, **options), **FULL_SPEED)


HALLS = (Hall(500, 2.0, 0.8), Hall(500, 4.0, 4.0), Hall(1000, 3.0, 1.2), Hall(1000, 4.0, 2.0))
GREAT_HALLS = (
    Hall(2000, 2.5, 1.2),
    Hall(2000, 4.0, 0.8),
    Hall(5000, 2.0, 4.0),
    Hall(5000, 2.5, 1.2),
    Hall(5000, 4.0, 0.8),
    Hall(5000, 4.0, 4.0),
)


class _Outside:
    """A recorder of the most people outside of the plan at once, by shapely; keeps the crowd when a step is refused."""

    env: CrowdEnv

    def __init__(self) -> None:
        self.most = 0

    def begin(self, env: CrowdEnv, runs: Sequence[int]) -> None:
        self.env, self.floor = env, env.scenarios[0].geometry.walkable
        shapely.prepare(self.floor)

    def add(self, env: CrowdEnv, step: Step) -> None:
        inside = shapely.intersects_xy(self.floor, *env.simulation.state.position[env.active].T)
        self.most = max(self.most, int(np.count_nonzero(~inside)))

    def record(self, env: CrowdEnv, e: int) -> None:
        return None


def empty(hall: Hall, setting: Setting, draw: int = 0, time_limit: float = _TIME_LIMIT) -> Plain:
    """Let everyone walk out, until all are out, the door has been blocked for 30 s, or the time is over.

    The result holds the most people outside of the plan at once, by shapely and by the simulation, the largest speed, the
    deepest overlaps, how many are left; or the sentence with which the run ended early.
    """
    outside, stopped = _Outside(), None
    try:
        for _ in rollout(
            hall.scenario(time_limit), 1, seed=draw, recorder=outside, scheme=setting.scheme, manner=setting.manner
        ):
            pass
    except FloatingPointError as error:
        stopped = str(error)
    episode = outside.env.metrics(0)
    return {
        "people": hall.people,
        "density, 1/m2": hall.density,
        "door, m": hall.door,
        "outside": max(outside.most, episode.escaped),
        "fastest, m/s": episode.max_speed,
        "overlap, mm": 1e3 * episode.max_overlap,
        "beyond a wall, mm": 1e3 * episode.max_outside,
        "left": episode.unfinished,
        "until, s": float(outside.env.simulation.state.time[0]),
        "stopped": stopped,
    }


def holds(found: Plain) -> bool:
    """Whether all stayed inside, and below the largest speed."""
    unstopped = found["outside"] == 0 and found["stopped"] is None
    return bool(unstopped and found["fastest, m/s"] <= MAX_SPEED * (1.0 + 1e-12))


def told(found: Plain) -> str:
    """Return what came of a run, as a sentence."""
    hall = f"{found['people']} people at {found['density, 1/m2']:g} /m2, door of {found['door, m']:g} m: "
    if found["stopped"]:
        return hall + str(found["stopped"])
    outside = f"{found['outside'] or 'nobody'} outside, fastest {found['fastest, m/s']:.1f} m/s"
    return hall + f"{outside}, {found['left']} left after {found['until, s']:.0f} s"


def run_in(halls: tuple[Hall, ...], name: str) -> Callable[[Setting], Iterator[Row]]:
    """Return what runs the case of some halls, a row for each of them and each draw."""

    def run(setting: Setting) -> Iterator[Row]:
        for hall in halls:
            for draw in range(setting.draws):
                setting.notify(f"{hall.people} people, {hall.density:g} /m2, door {hall.door:g} m")
                found = empty(hall, setting, draw)
                yield row(name, setting, holds(found), told(found), **found)

    return run
