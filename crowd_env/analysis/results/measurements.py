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
from crowd_env.physics.pressure import contact_pressure

REACH = 1.0  # m  the density at a point: the number of people within this distance, over the area of the disc
CELL = 0.25  # m  of the maps
# People who bear more are injured (Helbing, Farkas, Vicsek 2000, Nature 407:487); friction counts here.
INJURY = 1600.0  # N/m
_FELT = 0.25  # m  the pressure on a body is drawn up to this distance from its center


class Grid(NamedTuple):
    """Square cells over a plan and as far beyond it as a body is counted."""

    origin: tuple[float, float]  # m  lower left corner
    shape: tuple[int, int]  # rows (y), columns (x)

    def cell_of(self, position: Floats) -> Ints:
        """Return the number of the cell (K,) that holds each position (K, 2), row by row."""
        column, row = np.floor((position - self.origin) / CELL).astype(np.int64).T
        rows, columns = self.shape
        return np.asarray(np.clip(row, 0, rows - 1) * columns + np.clip(column, 0, columns - 1))

    def middles(self) -> Floats:
        """Return the middle (cells, 2) [m] of each cell, row by row."""
        rows, columns = np.indices(self.shape)
        return np.asarray(self.origin) + CELL * (np.stack([columns, rows], axis=-1).reshape(-1, 2) + 0.5).astype(
            np.float64
        )


def grid_over(geometry: Geometry) -> Grid:
    """Return the grid over a plan; everything within `REACH` of someone inside lies on it."""
    x0, y0, x1, y1 = geometry.bounds
    margin = CELL * (np.ceil(REACH / CELL) + 2)
    shape = tuple(int(np.ceil((high - low + 2 * margin) / CELL)) for low, high in ((y0, y1), (x0, x1)))
    return Grid((x0 - margin, y0 - margin), (shape[0], shape[1]))


class Spread:
    """Spreads people over the cells of a grid: how dense crowds are there, and how hard they press."""

    def __init__(self, grid: Grid) -> None:
        self._grid = grid
        offset, cover = _disc(REACH, grid.shape[1])
        # Cells around that of a person, and what one adds to the density [1/m2] of each.
        self.near = offset, cover / (np.pi * REACH**2)
        offset, cover = _disc(_FELT, grid.shape[1])
        self.felt = offset[cover > 0.3]  # the cell and its four neighbors

    def __call__(self, position: Floats, pressure: Floats, crowd: Ints, crowds: int) -> tuple[Floats, Floats]:
        """Return density [1/m2] and pressure [N/m] of ``crowds`` (C, cells), of K pedestrians, each in its ``crowd`` (K,)."""
        cells, (offset, cover) = self._grid.shape[0] * self._grid.shape[1], self.near
        at = crowd * cells + self._grid.cell_of(position)
        place = at[:, None] + offset
        weights = np.broadcast_to(cover, place.shape)
        density = np.bincount(place.ravel(), weights.ravel(), minlength=crowds * cells).astype(np.float64)
        felt, pressed = np.zeros(crowds * cells), pressure > 0.0
        place = at[pressed][:, None] + self.felt
        np.maximum.at(felt, place.ravel(), np.repeat(pressure[pressed], len(self.felt)))
        return density.reshape(crowds, cells), felt.reshape(crowds, cells)


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
    max_density: Floats  # (R,)  1/m2  people within 1 m of someone, oneself included, over pi m2
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
        self._spread = Spread(self.grid)
        self._sums, self._most = (np.zeros((2, self.grid.shape[0] * self.grid.shape[1])) for _ in range(2))
        self._samples = 0
        self._spent = np.zeros(2)  # s  on steps, and the part of it that updates the fastest routes

    def begin(self, env: CrowdEnv, runs: Sequence[int]) -> None:
        """Forget the batch before and keep the starting positions of this one."""
        people = env.num_people
        self._position = env.simulation.state.position.copy()
        self._walked, self._crushed = np.zeros(people), np.zeros(people)
        self._max_density, self._max_pressure = np.zeros(env.num_envs), np.zeros(env.num_envs)
        self._time = env.simulation.state.time.copy()
        self._see(env, env.active, np.zeros(people), np.ones(env.num_envs))
        self._last = self._seconds(env)

    def add(self, env: CrowdEnv, step: Step) -> None:
        """Add the distance of a step, the sample at its end, and the time that it took."""
        self._spent += self._seconds(env) - self._last
        state, simulation = env.simulation.state, env.simulation
        inside = env.active | step.truncated
        was_inside = inside | step.terminated
        moved = np.hypot(*(state.position - self._position).T)
        self._walked += np.where(was_inside, moved, 0.0)
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
        self._see(env, inside, pressure, steps)
        self._last = self._seconds(env)  # what was measured here is no part of the next step

    def record(self, env: CrowdEnv, e: int) -> RunMeasurements:
        """Return what was measured of the evacuation in environment ``e``."""
        people, state = env.people(e), env.simulation.state
        exits, walked = state.exit_index[people].copy(), self._walked[people].copy()
        times = np.where(np.isfinite(state.exit_time[people]), state.exit_time[people], state.time[e])
        wanted = env.simulation.bodies.desired_speed[people]
        speed = walked / np.maximum(wanted * times, 1e-9)
        hurry = float(
            np.max(speed, where=wanted >= SLOWEST, initial=0.0)
        )  # a pedestrian without a desired speed is pushed along
        peaks = float(self._max_density[e]), float(self._max_pressure[e])
        return RunMeasurements(exits, walked, *peaks, self._crushed[people].copy(), hurry)

    def merge(self, later: "MeasurementRecorder") -> None:
        """Add what another recorder saw of later batches; sums are rounded by the order of merging."""
        self._sums = self._sums + later._sums
        self._most = np.maximum(self._most, later._most)
        self._samples += later._samples
        self._spent = self._spent + later._spent

    @property
    def maps(self) -> Maps:
        """The maps over all samples so far."""
        mean, most = self._sums / max(self._samples, 1), self._most
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

    def _see(self, env: CrowdEnv, inside: Bools, pressure: Floats, steps: Floats) -> None:
        position = env.simulation.state.position
        near = most_within(as_grid(position, env.num_envs), as_grid(inside, env.num_envs), REACH)
        density = near / (np.pi * REACH**2)
        np.maximum(self._max_density, density, out=self._max_density)
        people = np.flatnonzero(inside)
        fields = self._spread(position[people], pressure[people], env.env_of_person[people], env.num_envs)
        for k, field in enumerate(fields):
            self._sums[k] += (steps[:, None] * field).sum(axis=0)
            np.maximum(self._most[k], field.max(axis=0), out=self._most[k])
        self._samples += int(steps[as_grid(inside, env.num_envs).any(axis=1)].sum())


def most_within(position: Floats, inside: Bools, reach: float) -> Ints:
    """Return the largest number (E,) of people ``inside`` (E, N) less than ``reach`` from one of them, oneself included.

    ``position`` (E, N, 2) is of their centers.
    """
    most = int(inside.sum(axis=1).max(initial=0))
    if most == 0:
        return np.zeros(len(inside), dtype=np.int64)
    those = np.argsort(~inside, axis=1, kind="stable")[:, :most]  # the crowd shrinks, and the work with its square
    here = np.take_along_axis(inside, those, axis=1)[..., None]
    # Nearer numbers, fewer digits lost below; nan is near nobody.
    place = np.where(here, np.take_along_axis(position, those[..., None], axis=1) - position.mean(axis=(0, 1)), np.nan)
    square = (place**2).sum(axis=2)
    apart = square[:, :, None] + square[:, None, :] - 2.0 * place @ place.transpose(0, 2, 1)
    return np.asarray((apart < reach**2).sum(axis=2).max(axis=1))


def _disc(radius: float, columns: int) -> tuple[Ints, Floats]:
    """Return the cells that a disc around the middle of a cell covers: offsets of their numbers, and shares covered.

    The shares add up to the area of the disc in cells, so that a crowd spread by them is as many people as before.
    """
    reach, parts = int(np.ceil(radius / CELL)) + 1, 32
    fine = (np.arange((2 * reach + 1) * parts) + 0.5) / parts - reach - 0.5  # in cells
    covered = np.hypot(*np.meshgrid(fine, fine)) < radius / CELL
    share: NDArray[np.float64] = covered.reshape(2 * reach + 1, parts, 2 * reach + 1, parts).mean(axis=(1, 3))
    share *= np.pi * (radius / CELL) ** 2 / share.sum()
    row, column = np.nonzero(share)
    return (row - reach) * columns + column - reach, share[row, column]
