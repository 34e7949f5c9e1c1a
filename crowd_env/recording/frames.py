"""Contents of a recording: the facts known at the start, then the pedestrians frame by frame."""

from dataclasses import replace
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.core.behaviors import BEHAVIORS
from crowd_env.core.behaviors.behavior import Behavior
from crowd_env.core.behaviors.outline import Outline
from crowd_env.core.checks import Plain
from crowd_env.core.files.versions import versions_of
from crowd_env.envs.crowd import CrowdEnv
from crowd_env.geometry.geometry import Geometry
from crowd_env.geometry.sheets import as_plain
from crowd_env.physics.pressure import contact_pressure
from crowd_env.physics.settings import kinds_of
from crowd_env.physics.simulation.simulation import Simulation
from crowd_env.recording.contacts import ContactSums
from crowd_env.recording.exits import places_beyond
from crowd_env.recording.recording import Recording

_ALWAYS = ("manner", "outline")  # behaviors that every recording names
_NOBODY: Ints = np.zeros(0, dtype=np.int64)


def facts_of(env: CrowdEnv, e: int, *, every: int, contacts: bool, seed: int | None, run: int) -> Plain:
    """Return the facts of the evacuation in environment ``e`` for a recording; a frame is ``every`` decisions."""
    scenario, simulation, people = env.scenario_of_env[e], env.simulation, env.people(e)
    facts = {
        "scenario": scenario.name,
        "title": scenario.title,
        "people": people.stop - people.start,
        "scheme": simulation.scheme.info.name,
        "dt": simulation.dt,
        "decision_dt": env.decision_dt,
        "every": every * env.decision_dt,
        "run": run,
        "seed": seed,
        "strategy": env.strategies[e % len(env.strategies)],
        **{name: BEHAVIORS[name].plain_of(simulation.behaviors[name]) for name in _ALWAYS},
        "time_limit": float(env.time_limit[e]),
        "versions": versions_of(),
        **({"contact_force": "mean since the frame before"} if contacts else {}),
    }
    recorded = {name: kind.plain_of(simulation.behaviors[name]) for name, kind in _of_memory(simulation).items()}
    return recorded | facts  # a behavior called as a fact does not replace it


def _of_memory(simulation: Simulation) -> dict[str, type[Behavior]]:
    """Return the behaviors of which a recording holds rows, by name."""
    kinds = kinds_of(simulation.walking)
    return {name: kind for name, kind in kinds.items() if simulation.behaviors[name] is not None and kind.RECORDED}


def _of_building(geometry: Geometry) -> dict[str, Any]:
    return {} if geometry.building is None else {"building": as_plain(geometry.building)}


class FrameSampler:
    """Makes the frames of environment ``e`` of a batch, each a recording of one frame.

    There is one every ``every`` decisions, and the first and the last in any case.
    """

    def __init__(self, env: CrowdEnv, e: int, facts: Plain, *, every: int, contacts: bool) -> None:
        self._e, self._people, self._every = e, env.people(e), every
        self._contacts = ContactSums(env.simulation, e) if contacts else None
        count = self._people.stop - self._people.start
        self._exits = env.scenario_of_env[e].geometry.exits
        self._decision_dt, self._decisions, self._seen_at = env.decision_dt, 0, 0.0
        self._impulse = np.zeros(count)
        self._gone = np.zeros(count, dtype=bool)
        self._last = env.simulation.laid_out[self._people].copy()
        self._leaving = np.zeros(count, dtype=bool)  # pedestrians that have got out, with one more row to come
        self._onward = np.zeros((count, 2))  # the position of that row
        self._empty = self._without_frames(env, facts)

    def _without_frames(self, env: CrowdEnv, facts: Plain) -> dict[str, Any]:
        """Return the fields of a recording that are known at the start."""
        scenario, bodies = env.scenario_of_env[self._e], env.simulation.bodies
        geometry, parts = scenario.geometry, scenario.population.parts
        fixed = geometry.door_of_wall < 0
        leaves = zip(geometry.door_of_wall[~fixed], geometry.walls[~fixed], strict=True)
        outline = env.simulation.outline
        zones = {zone.region: geometry.regions[zone.region].wkt for zone in scenario.zones}
        return {
            "facts": {**facts, "finished": False, **_of_building(geometry), "zones": zones},
            "walkable": geometry.walkable.wkt,
            "thin_walls": geometry.walls[geometry.two_sided & fixed].copy(),
            "doors": tuple((geometry.doors[k], line.copy()) for k, line in leaves),
            "exits": tuple(zip(geometry.exit_names, geometry.exits.copy(), strict=True)),
            "cohorts": tuple(part.name for part in parts),
            "radius": bodies.radius[self._people].copy(),
            "desired_speed": bodies.desired_speed[self._people].copy(),
            "cohort": np.repeat(np.arange(len(parts)), [part.people for part in parts]),
            "group": bodies.group[self._people].copy(),
            "outline": None if outline is None else Outline.plain_of(outline),
        }

    def first(self, env: CrowdEnv) -> Recording:
        """Return the frame of the start, without contacts."""
        return self._frame(env, _NOBODY, np.zeros(len(self._gone)))

    def after_step(self, env: CrowdEnv, last: bool) -> Recording | None:
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

    def after_end(self, env: CrowdEnv) -> Recording | None:
        """Return one frame more, of only the pedestrians that got out in the last one; None if there are none."""
        if not self._leaving.any():
            return None
        self._gone[:] = True
        frame = self._frame(env, _NOBODY, np.zeros(len(self._gone)))
        return replace(frame, times=np.array([self._seen_at + self._every * self._decision_dt]))

    def stop(self) -> None:
        """Detach from the environment: no more frames follow."""
        if self._contacts is not None:
            self._contacts.stop()

    def _time(self, env: CrowdEnv) -> float:
        """Return the time of the moment [s]; a clock that stopped within a decision, with all out, is at its end."""
        time = float(env.simulation.state.time[self._e])
        entry = env.simulation.entrances.times_of(self._e, np.inf)
        inside = (np.isnan(env.simulation.state.exit_time[self._people]) & ~np.isinf(entry)).any()
        return time if inside else max(time, self._decisions * self._decision_dt)

    def _frame(self, env: CrowdEnv, left: Ints, pressure: Floats) -> Recording:
        simulation = env.simulation
        state, outline = simulation.state, simulation.outline
        kept = {
            name: values[self._people]
            for kind in _of_memory(simulation).values()
            for name, values in kind.rows(simulation).items()
        }
        time = self._time(env)
        position, velocity = simulation.laid_out[self._people].copy(), state.velocity[self._people].copy()
        angle, exit_time = state.angle[self._people].copy(), state.exit_time[self._people].copy()
        exit_index = state.exit_index[self._people].copy()
        position[self._leaving] = self._onward[self._leaving]
        ways = self._exits[exit_index[left]], self._last[left], position[left], velocity[left], time - exit_time[left]
        position[left], self._onward[left] = places_beyond(*ways, self._every * self._decision_dt)
        entered = np.isfinite(simulation.entrances.entry_time[self._people])
        rows = np.flatnonzero((~self._gone | self._leaving) & entered)
        pressure = np.where(self._leaving, 0.0, pressure)
        self._gone[left] = True
        self._leaving[:] = False
        self._leaving[left] = True
        self._last = position
        return Recording(
            **self._empty,
            times=np.array([time]),
            frame_start=np.array([0, len(rows)]),
            exit_time=exit_time,
            exit_index=exit_index,
            person=rows,
            position=position[rows],
            velocity=velocity[rows],
            pressure=pressure[rows],
            angle=None if outline is None else angle[rows],
            memory={name: np.asarray(values[rows], dtype=np.float64) for name, values in kept.items()},
            contacts=None if self._contacts is None else self._contacts.take(time - self._seen_at, ~self._gone),
        )
