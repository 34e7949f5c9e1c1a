"""What is collected of evacuations while they run: where it is crowded and people press, how they stand in zones and queues."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from crowd_env.analysis.results.measurements import SAMPLE, Density, Grid, felt_around, grid_over
from crowd_env.core.arrays.state import Bools, Floats, Ints, segment_lengths
from crowd_env.core.checks import Plain
from crowd_env.envs.crowd import CrowdEnv, Step
from crowd_env.geometry.geometry import Geometry, nearest_among
from crowd_env.physics.pressure import INJURY, contact_pressure

LOAD_SPAN = 1.0  # s  over which what presses on bodies and walls is a mean: loads that last, not impacts
HELD_UP = 0.5  # of the desired speed: slower since the sample before, after the response time, counts as held up
# Level of service of walkways by the floor a person (Fruin 1971), as densities [1/m2] above which the next one begins.
SERVICE = {"A, B": 0.0, "C": 1 / 2.32, "D": 1 / 1.39, "E": 1 / 0.93, "F": 1 / 0.46}


_KINDS: dict[str, Any] = {
    **dict.fromkeys(("density", "pressure"), np.float32),
    "zone_most": np.int64,
    "left_out": np.int64,
}


class Crowding(NamedTuple):
    """What was collected of one evacuation; forces of decisions with a step that the solver did not finish are left out.

    A file with other fields is of an older version, which took walls for floor.
    """

    density: Floats  # (rows, columns)  1/m2  largest of any sample
    pressure: Floats  # (rows, columns)  N/m  largest mean of `LOAD_SPAN`
    impact: float  # N/m  largest mean of a decision, of anyone
    service: Floats  # (L,)  s  that people spent at each of the `SERVICE` levels, added up
    squeezed: float  # s  that people spent beyond `INJURY`, means of `LOAD_SPAN`, added up
    zone_most: Ints  # (Z,)  most people at once in each region of the plan
    zone_empty: Floats  # (Z,)  s  when it was empty for good; nan if it was not
    queue: Ints  # (X,)  most people held up at once on the way to the exit that they took, by its name
    wait: Floats  # (X,)  s  mean time held up; nan of an unused exit
    wall_load: Floats  # (K,)  N/m  largest mean of `LOAD_SPAN` on each of `wall_pieces`, by contact and by social force
    left_out: int  # decisions whose forces are left out


class CrowdingRecorder:
    """Collects the `Crowding` of every evacuation of a place: a `crowd_env.envs.rollout.Recorder`."""

    def __init__(self, geometry: Geometry) -> None:
        self.grid = grid_over(geometry)
        self._measure, self._felt = Density(geometry, self.grid), felt_around(self.grid)
        self._zones = zones_of(geometry, self.grid)
        self._pieces = wall_pieces(geometry)
        names = list(dict.fromkeys(geometry.exit_names))
        self._exit_of_row = np.array([names.index(name) for name in geometry.exit_names], dtype=np.int64)

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the shape of each array of a `Crowding` here."""
        exits, zones = (int(self._exit_of_row.max(initial=-1)) + 1,), (len(self._zones),)
        cells, levels, pieces = self.grid.shape, (len(SERVICE),), (len(self._pieces),)
        found = {"density": cells, "pressure": cells, "service": levels, "wall_load": pieces}
        return {**found, "zone_most": zones, "zone_empty": zones, "queue": exits, "wait": exits}

    def begin(self, env: CrowdEnv, runs: Sequence[int]) -> None:
        """Forget the batch before, and look at the first moment of this one."""
        count, shapes = env.num_envs, self.shapes() | dict.fromkeys(("impact", "squeezed", "left_out"), ())
        self._of = {name: np.zeros((count, *shape), dtype=_KINDS.get(name)) for name, shape in shapes.items()}
        self._impulse, self._whole = np.zeros(env.num_people), np.zeros(count, dtype=np.int64)
        self._load, self._nearest_piece = np.zeros((count, len(self._pieces), 2)), nearest_among(self._pieces)
        self._unconverged = np.zeros(count, dtype=np.int64)
        self._held: list[Bools] = []
        self._span = max(round(LOAD_SPAN / env.decision_dt), 1)
        self._every, self._decisions = max(round(SAMPLE / env.decision_dt), 1), 0
        self._position = env.simulation.state.position.copy()
        self._look(env, env.active)

    def add(self, env: CrowdEnv, step: Step) -> None:
        """Sample the forces of a decision and, where one is due, positions."""
        self._decisions += 1
        simulation, inside = env.simulation, env.active | step.truncated
        pressure = contact_pressure(simulation.results.impulse_magnitude, env.decision_dt, simulation.bodies.radius)
        broken = simulation.diagnostics.unconverged - self._unconverged > 0
        self._unconverged[:] = simulation.diagnostics.unconverged
        self._of["left_out"] += broken
        counts = (inside | step.terminated) & ~broken[env.env_of_person]
        pressure[~counts] = 0.0
        np.maximum.at(self._of["impact"], env.env_of_person, pressure)
        self._whole += np.bincount(env.env_of_person[counts], minlength=env.num_envs) > 0
        # Means are over the decisions that count, but over half of the span at least.
        duration, ends = (
            env.decision_dt * np.maximum(self._whole, -(-self._span // 2)),
            self._decisions % self._span == 0,
        )
        self._press_on_bodies(env, counts, duration, ends | step.terminated | step.truncated)
        self._press_on_walls(env, counts, duration, ends)
        if ends:
            self._whole[:] = 0
        if self._decisions % self._every == 0:
            self._look(env, inside)

    def _press_on_bodies(self, env: CrowdEnv, counts: Bools, duration: Floats, ends: Bools) -> None:
        """Add impulses to the span; add its mean to the map for pedestrians (P,) whose span ends."""
        results = env.simulation.results
        self._impulse += np.where(counts, results.impulse_magnitude, 0.0)
        who = np.flatnonzero((self._impulse > 0.0) & ends)
        pressure = contact_pressure(self._impulse, 1.0, env.simulation.bodies.radius)[who]
        crowd = env.env_of_person[who]
        pressure /= duration[crowd]
        place = self.grid.cell_of(env.simulation.laid_out[who])[:, None] + self._felt
        np.maximum.at(_rows(self._of["pressure"]), (crowd[:, None], place), pressure[:, None].astype(np.float32))
        np.add.at(self._of["squeezed"], crowd, duration[crowd] * (pressure > INJURY))
        self._impulse[who] = 0.0

    def _press_on_walls(self, env: CrowdEnv, counts: Bools, duration: Floats, ends: bool) -> None:
        """Add impulses of walls on pedestrians that count to the load of the nearest piece of a wall, until the span ends."""
        simulation = env.simulation
        given = simulation.results.wall_impulse + env.decision_dt * simulation.social_forces_of_walls()
        who = np.flatnonzero(counts & given.any(axis=1))
        if len(who):
            piece = self._nearest_piece(simulation.laid_out[who])
            np.add.at(self._load, (env.env_of_person[who], piece), given[who])
        if ends:
            length = np.maximum(segment_lengths(self._pieces), 1.0)
            load = np.hypot(*np.moveaxis(self._load, -1, 0)) / (duration[:, None] * length)
            np.maximum(self._of["wall_load"], load, out=self._of["wall_load"])
            self._load[:] = 0.0

    def _look(self, env: CrowdEnv, inside: Bools) -> None:
        """Sample positions."""
        state, bodies = env.simulation.state, env.simulation.bodies
        duration = self._every * env.decision_dt
        walked = np.hypot(*(state.position - self._position).T)
        time = state.time[env.env_of_person]
        starting = time - duration < bodies.response_time + 1e-9
        self._held.append(inside & ~starting & (walked < HELD_UP * duration * env.simulation.history.local_speed))
        self._position[:] = state.position
        density = 1.0 / self._measure(env, inside, _rows(self._of["density"]))[inside]
        level = np.searchsorted(list(SERVICE.values()), density, side="right") - 1
        np.add.at(self._of["service"], (env.env_of_person[inside], level), duration)
        for e in np.unique(env.env_of_person[inside]).tolist():
            people = env.people(e)
            at = self.grid.cell_of(env.simulation.laid_out[people][inside[people]])
            count = self._zones[:, at].sum(axis=1)
            self._of["zone_most"][e] = np.maximum(self._of["zone_most"][e], count)
            self._of["zone_empty"][e][count > 0] = state.time[e] + duration

    def record(self, env: CrowdEnv, e: int) -> Crowding:
        """Return what was collected of the evacuation in environment ``e``, which has just ended."""
        people, state = env.people(e), env.simulation.state
        row, held = state.exit_index[people], np.array(self._held)[:, people]
        taken = np.append(self._exit_of_row, -1)[row]
        exits = range(int(self._exit_of_row.max(initial=-1)) + 1)
        ways = [held[:, taken == k] for k in exits]
        waits = [
            self._every * env.decision_dt * float(way.sum(axis=0).mean()) if way.shape[1] else np.nan for way in ways
        ]
        kept = {name: values[e].copy() for name, values in self._of.items()}
        kept["zone_empty"][np.isnan(state.exit_time[people]).any() & (kept["zone_empty"] >= state.time[e])] = np.nan
        queue = np.array([int(way.sum(axis=1).max(initial=0)) for way in ways], dtype=np.int64)
        return Crowding(**{**kept, "queue": queue, "wait": np.array(waits), "left_out": int(kept["left_out"])})

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy has, here or in another process: it begins with no evacuation under way."""
        return {name: vars(self)[name] for name in ("grid", "_measure", "_felt", "_zones", "_pieces", "_exit_of_row")}


def _rows(maps: np.ndarray) -> np.ndarray:
    """Return maps (E, rows, columns) with the cells of each in a row."""
    return maps.reshape(len(maps), -1)


def crowding_of(content: Plain | None, shapes: dict[str, tuple[int, ...]]) -> Crowding | None:
    """Return what was kept of an evacuation as a `Crowding`; None if it is none of a place with arrays of these shapes."""
    if content is None or set(content) != set(Crowding._fields):
        return None
    is_whole = all(
        np.issubdtype(np.asarray(value).dtype, np.number) and np.shape(value) == shapes.get(name, ())
        for name, value in content.items()
    )
    return Crowding(**content) if is_whole else None


def wall_pieces(geometry: Geometry) -> Floats:
    """Return the walls of a plan (K, 2, 2) [m], cut into pieces of one to two meters; a shorter wall is a piece.

    The load of a shorter one is that of a meter.
    """
    count = np.maximum(segment_lengths(geometry.walls).astype(np.int64), 1)
    wall = np.repeat(np.arange(len(count)), count)
    first = (np.arange(len(wall)) - np.repeat(np.cumsum(count) - count, count)) / count[wall]
    a, along = geometry.walls[wall, 0], geometry.walls[wall, 1] - geometry.walls[wall, 0]
    ends = (a + share[:, None] * along for share in (first, first + 1.0 / count[wall]))
    return np.stack(list(ends), axis=1)


def zones_of(geometry: Geometry, grid: Grid) -> Bools:
    """Return which cells (Z, cells) have their middle in each region of a plan."""
    middles = grid.middles()
    return np.array([geometry.contains(middles, name) for name in geometry.regions], dtype=bool).reshape(
        len(geometry.regions), len(middles)
    )
