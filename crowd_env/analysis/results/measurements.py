"""Measurements of evacuations, a sample every decision step: distance walked, density, pressure, and maps of them."""

import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowd_env.core.arrays.state import Bools, Floats, Ints, as_grid
from crowd_env.envs.crowd import CrowdEnv, Step
from crowd_env.envs.observation.view import SLOWEST
from crowd_env.envs.rollout import Episode
from crowd_env.geometry.geometry import Geometry
from crowd_env.geometry.voronoi import REACH, draw_density, make_rays, measure_floor
from crowd_env.geometry.wall_grid import make_wall_grid
from crowd_env.physics.pressure import INJURY, contact_pressure

CELL = 0.25  # m  of the maps
ALONE = 1.0 / (np.pi * REACH**2)  # 1/m2  density of a pedestrian alone
SAMPLE = 0.5  # s  between two samples of positions; forces are sampled every decision


class Grid(NamedTuple):
    """Square cells over a plan and a little beyond it."""

    origin: tuple[float, float]  # m  lower left corner
    shape: tuple[int, int]  # rows (y), columns (x)

    def cell_of(self, position: Floats) -> Ints:
        """Return the number of the cell (K,) that holds each position (K, 2), row by row."""
        column, row = np.floor((position - self.origin) / CELL).astype(np.int64).T
        rows, columns = self.shape
        return np.clip(row, 0, rows - 1) * columns + np.clip(column, 0, columns - 1)

    def middles(self) -> Floats:
        """Return the middle (cells, 2) [m] of each cell, row by row."""
        rows, columns = np.indices(self.shape)
        return np.asarray(self.origin) + CELL * (np.stack([columns, rows], axis=-1).reshape(-1, 2) + 0.5).astype(
            np.float64
        )


def grid_over(geometry: Geometry) -> Grid:
    """Return the grid over a plan, with a margin."""
    x0, y0, x1, y1 = geometry.bounds
    margin = 6.0 * CELL
    shape = tuple(int(np.ceil((high - low + 2 * margin) / CELL)) for low, high in ((y0, y1), (x0, x1)))
    return Grid((x0 - margin, y0 - margin), (shape[0], shape[1]))


def felt_around(grid: Grid) -> Ints:
    """Return what to add to the number of a cell for it and its neighbors: there the pressure on a body is drawn."""
    return np.array([-grid.shape[1], -1, 0, 1, grid.shape[1]], dtype=np.int64)


class Density:
    """Measures the floor that people have, and draws how dense they stand; see `crowd_env.geometry.voronoi`."""

    def __init__(self, geometry: Geometry, grid: Grid) -> None:
        self._boundary = geometry.with_apron(0.0).of_layout.boundary
        self._walls = make_wall_grid(self._boundary, 2.0 * REACH)
        self._rays, self._grid = make_rays(), grid

    def __call__(self, env: CrowdEnv, inside: Bools, density: NDArray[np.float32]) -> Floats:
        """Return the floor (P,) [m2] of people ``inside``, nan of others; raise ``density`` (E, cells) [1/m2] to theirs."""
        start = env.simulation.bodies.env_start
        nearness, floor = np.empty((len(inside), self._rays.shape[1])), np.full(len(inside), np.nan)
        doors = env.simulation.history.door_open
        seen = start, inside, env.simulation.laid_out
        measure_floor(self._boundary, self._walls, doors, *seen, self._rays, nearness, floor)
        draw_density(*seen, nearness, floor, self._grid.origin, CELL, density.reshape(-1, *self._grid.shape))
        return floor


class Maps(NamedTuple):
    """Where it was crowded and where people pressed, over all samples with someone inside; arrays (rows, columns)."""

    density_mean: Floats  # 1/m2
    density_max: Floats  # 1/m2
    pressure_mean: Floats  # N/m  on the person there; 0 while the cell is empty
    pressure_max: Floats  # N/m


class Measured(NamedTuple):
    """R evacuations of N people."""

    exit_index: Ints  # (R, N)  row of Geometry.exits; -1 = did not get out
    walked: Floats  # (R, N)  m  until out, or until the end
    max_density: Floats  # (R,)  1/m2  one over the least floor of anyone, see `Density`
    max_pressure: Floats  # (R,)  N/m  contact force on someone over circumference, mean of one decision step
    crushed: Floats  # (R, N)  s  in decision steps whose mean of that exceeds `INJURY`
    hurry: Floats  # (R,)  largest mean speed over desired speed, of pedestrians that want to walk
    maps: Maps
    grid: Grid
    simulated: float  # s  of all evacuations together
    computing: float  # s  of processor time to simulate them
    replanning: float  # s  of that to update the fastest routes


class RunMeasurements(NamedTuple):
    """One evacuation of N people; fields as in `Measured`."""

    exit_index: Ints  # (N,)
    walked: Floats  # (N,)  m
    max_density: float  # 1/m2
    max_pressure: float  # N/m
    crushed: Floats  # (N,)  s
    hurry: float


class MeasurementRecorder:
    """Measures the evacuations of a batch of equally large crowds; the maps are over all of them."""

    def __init__(self, geometry: Geometry) -> None:
        self.grid = grid_over(geometry)
        self._density, self._felt = Density(geometry, self.grid), felt_around(self.grid)
        self._sums, self._most = (np.zeros((2, self.grid.shape[0] * self.grid.shape[1])) for _ in range(2))
        self._samples = np.zeros(2)  # of either
        self._spent = np.zeros(2)  # s  on steps, and the part of it that updates the fastest routes

    def begin(self, env: CrowdEnv, runs: Sequence[int]) -> None:
        """Forget the batch before and keep the starting positions of this one."""
        people = env.num_people
        self._position = env.simulation.state.position.copy()
        self._walked, self._crushed = np.zeros(people), np.zeros(people)
        self._max_density, self._max_pressure = np.zeros(env.num_envs), np.zeros(env.num_envs)
        self._time = env.simulation.state.time.copy()
        self._decisions, self._every = np.zeros(env.num_envs), max(round(SAMPLE / env.decision_dt), 1)
        self._look(env, env.active, np.ones(env.num_envs))
        self._feel(env, env.active, np.zeros(people), np.ones(env.num_envs))
        self._last = self._seconds(env)

    def add(self, env: CrowdEnv, step: Step) -> None:
        """Add the distance of a step, the sample at its end, and the time that it took."""
        self._spent += self._seconds(env) - self._last
        state, simulation = env.simulation.state, env.simulation
        inside = env.active | step.truncated
        was_inside = inside | step.terminated
        moved = np.hypot(*(state.position - self._position).T)
        before = self._time[env.env_of_person]
        entered = (simulation.entrances.entry_time >= before) & (
            before > 0.0
        )  # they came in elsewhere than they were kept
        self._walked += np.where(was_inside & ~entered, moved, 0.0)
        out = np.flatnonzero(step.terminated)
        # People who get out walk on to the end of the physics step: that is not part of the distance.
        late = np.ceil(state.exit_time[out] / simulation.dt - 1e-9) * simulation.dt - state.exit_time[out]
        self._walked[out] -= np.hypot(*state.velocity[out].T) * late
        self._position[:] = state.position
        pressure = contact_pressure(simulation.results.impulse_magnitude, env.decision_dt, simulation.bodies.radius)
        pressure = np.where(was_inside, pressure, 0.0)
        # A step may stand for many without motion, see `CrowdEnv.pass_rest`.
        steps = np.maximum(np.rint((state.time - self._time) / env.decision_dt), 1.0)
        self._time[:] = state.time
        self._crushed += env.decision_dt * steps[env.env_of_person] * (pressure > INJURY)
        np.maximum(self._max_pressure, as_grid(pressure, env.num_envs).max(axis=1), out=self._max_pressure)
        before = self._decisions // self._every
        self._decisions += steps
        due = self._decisions // self._every - before
        self._look(env, inside & (due[env.env_of_person] > 0.0), due)
        self._feel(env, inside, pressure, steps)
        self._last = self._seconds(env)  # what was measured here is no part of the next step

    def record(self, env: CrowdEnv, e: int) -> RunMeasurements:
        """Return what was measured of the evacuation in environment ``e``."""
        people, state = env.people(e), env.simulation.state
        exits, walked = state.exit_index[people].copy(), self._walked[people].copy()
        times = np.where(np.isfinite(state.exit_time[people]), state.exit_time[people], state.time[e])
        wanted = env.simulation.bodies.desired_speed[people]
        inside = times - np.nan_to_num(env.simulation.entrances.entry_time[people])
        speed = walked / np.maximum(wanted * inside, 1e-9)
        hurry = float(
            np.max(speed, where=wanted >= SLOWEST, initial=0.0)
        )  # a pedestrian without a desired speed is pushed along
        peaks = float(self._max_density[e]), float(self._max_pressure[e])
        return RunMeasurements(exits, walked, *peaks, self._crushed[people].copy(), hurry)

    def merge(self, later: "MeasurementRecorder") -> None:
        """Add what another recorder saw of later batches; sums are rounded by the order of merging."""
        self._sums = self._sums + later._sums
        self._most = np.maximum(self._most, later._most)
        self._samples = self._samples + later._samples
        self._spent = self._spent + later._spent

    @property
    def maps(self) -> Maps:
        """The maps over all samples so far."""
        mean, most = self._sums / np.maximum(self._samples, 1.0)[:, None], self._most
        return Maps(*(values.reshape(self.grid.shape) for values in (mean[0], most[0], mean[1], most[1])))

    def measured(self, episodes: Sequence[Episode]) -> Measured:
        """Return all that was measured of finished evacuations."""
        columns = map(np.array, zip(*(episode.record for episode in episodes), strict=True))
        of_runs: dict[str, Any] = dict(zip(RunMeasurements._fields, columns, strict=True))
        spent: dict[str, Any] = dict(zip(("computing", "replanning"), self._spent.tolist(), strict=True))
        simulated = sum(episode.end for episode in episodes)
        return Measured(**of_runs, maps=self.maps, grid=self.grid, simulated=simulated, **spent)

    @staticmethod
    def _seconds(env: CrowdEnv) -> Floats:
        """Return the processor time so far, and that of replanning [s]."""
        return np.array([time.process_time(), env.simulation.planner.seconds])

    def _look(self, env: CrowdEnv, inside: Bools, samples: Floats) -> None:
        """Sample positions, which stand for as many ``samples`` (E,)."""
        if not inside.any():
            return
        density = np.zeros((env.num_envs, self._sums.shape[1]), dtype=np.float32)
        floor = self._density(env, inside, density)
        np.maximum.at(self._max_density, env.env_of_person[inside], 1.0 / floor[inside])
        self._add(0, env, inside, density, samples)

    def _feel(self, env: CrowdEnv, inside: Bools, pressure: Floats, steps: Floats) -> None:
        """Sample the pressure (P,) of a decision that stands for ``steps`` (E,)."""
        felt, pressed = np.zeros((env.num_envs, self._sums.shape[1])), np.flatnonzero(inside & (pressure > 0.0))
        at = self.grid.cell_of(env.simulation.laid_out[pressed])[:, None] + self._felt
        np.maximum.at(felt, (env.env_of_person[pressed][:, None], at), pressure[pressed][:, None])
        self._add(1, env, inside, felt, steps)

    def _add(self, k: int, env: CrowdEnv, inside: Bools, field: NDArray[Any], steps: Floats) -> None:
        self._sums[k] += steps @ field
        np.maximum(self._most[k], field.max(axis=0), out=self._most[k])
        self._samples[k] += steps[as_grid(inside, env.num_envs).any(axis=1)].sum()
