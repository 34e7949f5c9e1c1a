"""What is written of an evacuation: what is known at its start, and then frame by frame who stands where."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from crowd_env.core.arrays.headway import plain_manner
from crowd_env.core.arrays.outline import plain_outline
from crowd_env.core.arrays.state import Bools, Floats, Ints
from crowd_env.core.files.versions import versions_of
from crowd_env.envs.crowd import CrowdEnv
from crowd_env.geometry.boundary import add_aprons
from crowd_env.physics.pressure import contact_pressure
from crowd_env.recording.contacts import ContactSums
from crowd_env.recording.exits import APRON, places_beyond
from crowd_env.recording.recording import FrameContacts

_AT_REST = 1e-3  # m/s; slower people go on facing as they did


class Head(NamedTuple):
    """What is known of a recording before its first frame; the fields are those of `Recording`, where it has them."""

    facts: dict[str, Any]
    walkable: str
    with_aprons: str  # WKT of the walkable area and of the ground just outside of its exits, where rows beyond them lie
    bounds: tuple[float, float, float, float]  # m, of that
    thin_walls: Floats
    doors: tuple[tuple[str, Floats], ...]
    exits: tuple[tuple[str, Floats], ...]
    groups: tuple[str, ...]
    radius: Floats
    desired_speed: Floats
    group: Ints
    outline: Any  # plain data; None = discs, and frames have no angles
    interval: float  # s, from one frame to the next
    contacts: bool  # whether frames have contacts


class Frame(NamedTuple):
    """The K rows of one frame, in the order of people, and who got out since the frame before."""

    time: float  # s
    person: Ints  # (K,)
    position: Floats  # (K, 2)  m
    velocity: Floats  # (K, 2)  m/s
    facing: Floats  # (K, 2)  unit vector: of the body, or (discs) of the velocity
    pressure: Floats  # (K,)    N/m
    angle: Floats | None  # (K,)    rad
    contacts: FrameContacts | None  # of this frame alone, `start` (2,); in the order of i
    inside: Bools  # (K,)    false where the row lies beyond an exit line
    left: Ints  # (L,)    people who got out since the frame before
    exit_time: Floats  # (L,)    s
    exit_index: Ints  # (L,)


def read_head(
    env: CrowdEnv, e: int, *, every: int, contacts: bool, seed: int | None, run: int, facts: Mapping[str, Any]
) -> Head:
    """Return what is known of the evacuation that has just begun in environment ``e``; a frame is ``every`` decisions."""
    scenario, simulation, people = env.scenario_of_env[e], env.simulation, env.people(e)
    geometry, parts = scenario.geometry, scenario.population.parts
    fixed = geometry.door_of_wall < 0
    lines = geometry.two_sided & fixed
    area = add_aprons(geometry.walkable, geometry.exits, APRON)
    leaves = zip(geometry.door_of_wall[~fixed], geometry.walls[~fixed], strict=True)
    known = {
        "scenario": scenario.name,
        "title": scenario.title,
        "people": people.stop - people.start,
        "scheme": simulation.scheme.info.name,
        "dt": simulation.dt,
        "decision_dt": env.decision_dt,
        "every": every * env.decision_dt,
        "run": run,
        "seed": seed,
        "strategy": env.routing.strategy,
        "manner": plain_manner(simulation.manner),
        "outline": plain_outline(simulation.outline),
        "time_limit": float(env.time_limit[e]),
        "versions": versions_of(),
        **({"contact_force": "mean since the frame before"} if contacts else {}),
    }
    return Head(
        facts={**known, **facts, "finished": False},
        walkable=geometry.walkable.wkt,
        with_aprons=area.wkt,
        bounds=area.bounds,
        thin_walls=geometry.walls[lines].copy(),
        doors=tuple((geometry.doors[k], line.copy()) for k, line in leaves),
        exits=tuple(zip(geometry.exit_names, geometry.exits.copy(), strict=True)),
        groups=tuple(part.name for part in parts),
        radius=simulation.bodies.radius[people].copy(),
        desired_speed=simulation.bodies.desired_speed[people].copy(),
        group=np.repeat(np.arange(len(parts)), [part.people for part in parts]),
        outline=None if simulation.outline is None else plain_outline(simulation.outline),
        interval=every * env.decision_dt,
        contacts=contacts,
    )


class FrameSampler:
    """Makes the frames of environment ``e`` of a batch, one ``every`` so many decisions, the first and the last in any case."""

    def __init__(self, env: CrowdEnv, e: int, *, every: int, contacts: bool) -> None:
        self._e, self._people, self._every = e, env.people(e), every
        self._contacts = ContactSums(env.simulation, e) if contacts else None
        count = self._people.stop - self._people.start
        self._exits = env.scenario_of_env[e].geometry.exits
        self._decision_dt, self._decisions, self._seen_at = env.decision_dt, 0, 0.0
        self._impulse = np.zeros(count)
        self._gone = np.zeros(count, dtype=np.bool_)
        self._facing = np.tile([1.0, 0.0], (count, 1))
        self._last = env.simulation.state.position[self._people].copy()
        self._leaving = np.zeros(count, dtype=np.bool_)  # who has got out, and one more row to come
        self._onward = np.zeros((count, 2))  # where that is

    def first(self, env: CrowdEnv) -> Frame:
        """Return the frame of the start: nobody has touched anybody yet."""
        return self._frame(env, np.zeros(0, dtype=np.int64), np.zeros(len(self._gone)))

    def after_step(self, env: CrowdEnv, last: bool) -> Frame | None:
        """Return the frame after a decision step, the ``last`` of its evacuation or not; None if none is due."""
        self._decisions += 1
        self._impulse += env.simulation.results.impulse_magnitude[self._people]
        if self._decisions % self._every and not last:
            return None
        time = self._time(env)
        radius = env.simulation.bodies.radius[self._people]
        pressure = contact_pressure(self._impulse, time - self._seen_at, radius)
        left = np.flatnonzero(np.isfinite(env.simulation.state.exit_time[self._people]) & ~self._gone)
        frame = self._frame(env, left, pressure)
        self._impulse[:], self._seen_at = 0.0, time
        return frame

    def after_end(self, env: CrowdEnv) -> Frame | None:
        """Return one frame more, of the people alone who got out in the last one; None if nobody did."""
        if not self._leaving.any():
            return None
        self._gone[:] = True
        frame = self._frame(env, np.zeros(0, dtype=np.int64), np.zeros(len(self._gone)))
        return frame._replace(time=self._seen_at + self._every * self._decision_dt)

    def stop(self) -> None:
        """Leave the environment alone: no more frames will be asked for."""
        if self._contacts is not None:
            self._contacts.stop()

    def _time(self, env: CrowdEnv) -> float:
        """Return the time of the moment [s]; a clock that stopped within a decision, when all were out, is at its end."""
        time = float(env.simulation.state.time[self._e])
        inside = np.isnan(env.simulation.state.exit_time[self._people]).any()
        return time if inside else max(time, self._decisions * self._decision_dt)

    def _frame(self, env: CrowdEnv, left: Ints, pressure: Floats) -> Frame:
        state, outline = env.simulation.state, env.simulation.outline
        time = self._time(env)
        position, velocity = state.position[self._people].copy(), state.velocity[self._people].copy()
        angle = state.angle[self._people]
        exit_time, exit_index = state.exit_time[self._people][left], state.exit_index[self._people][left]
        position[self._leaving] = self._onward[self._leaving]
        ways = self._exits[exit_index], self._last[left], position[left], velocity[left], time - exit_time
        position[left], self._onward[left] = places_beyond(*ways, self._every * self._decision_dt)
        if outline is None:
            speed = np.hypot(*velocity.T)
            turned = speed > _AT_REST
            self._facing[turned] = velocity[turned] / speed[turned, None]
        else:
            self._facing = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        rows = np.flatnonzero(~self._gone | self._leaving)
        pressure = np.where(self._leaving, 0.0, pressure)
        self._gone[left] = True
        self._leaving[:] = False
        self._leaving[left] = True
        self._last = position
        return Frame(
            time=time,
            person=rows,
            position=position[rows],
            velocity=velocity[rows],
            facing=self._facing[rows],
            pressure=pressure[rows],
            angle=None if outline is None else angle[rows].copy(),
            contacts=None if self._contacts is None else self._contacts.take(time - self._seen_at, ~self._gone),
            inside=~self._gone[rows],
            left=left,
            exit_time=exit_time,
            exit_index=exit_index,
        )
