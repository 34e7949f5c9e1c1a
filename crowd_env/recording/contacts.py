"""Contacts between two frames, with their mean forces."""

from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Bools, Floats, Ints, slots_of
from crowd_env.physics.simulation.simulation import Simulation
from crowd_env.recording.content import FrameContacts

_MOST_ROWS = 100_000  # of single steps that wait to be summed


class _Rows(NamedTuple):
    """Contacts of some steps, in the order of time."""

    key: Ints  # (C,)    one number for two bodies and, with an outline, two of their discs; in the order of i
    i: Ints  # (C,)
    j: Ints  # (C,)
    gap: Floats  # (C,)    m
    normal: Floats  # (C, 2)
    point: Floats  # (C, 2)  m
    impulse: Floats  # (C, 2)  N s, in the axes of the world


class ContactSums:
    """Sums the impulses of the contacts of environment ``e``, physics step by physics step, until they are taken.

    Simulations list the contacts of their last step alone, and under impulse solvers these flicker.  So the simulation
    advances step by step while the sums are taken, which costs time and changes no result.
    """

    def __init__(self, simulation: Simulation, e: int) -> None:
        self._simulation, self._e = simulation, e
        self._people = slots_of(simulation.bodies, e)
        self._time = float(simulation.state.time[e])
        # Forces at the end of a step act through half of it, and through half of the next (Verlet).
        self._share = 0.5 if simulation.scheme.info.contacts_at == "end" else 1.0
        self._next = self._sum = _no_rows()
        self._waiting: list[_Rows] = []
        simulation.listeners.append(self._look)

    def take(self, duration: float, inside: Bools) -> FrameContacts:
        """Return the contacts of the last ``duration`` [s] between pedestrians inside (N,), or walls; reset the sums."""
        self._add_up()
        rows, self._sum = self._sum, _no_rows()
        kept = inside[rows.i] & ((rows.j < 0) | inside[np.maximum(rows.j, 0)])
        nx, ny = rows.normal.T
        px, py = rows.impulse.T / max(duration, self._simulation.dt)
        force = np.stack([px * nx + py * ny, py * nx - px * ny], axis=1)
        start, i, j = np.array([0, int(kept.sum())]), rows.i[kept], rows.j[kept]
        return FrameContacts(start, i, j, rows.gap[kept], rows.normal[kept], rows.point[kept], force[kept])

    def stop(self) -> None:
        """Stop the summation."""
        if self._look in self._simulation.listeners:
            self._simulation.listeners.remove(self._look)

    def _look(self) -> None:
        """Add the contacts of the step that has just been made, if this environment made one."""
        now = float(self._simulation.state.time[self._e])
        if now == self._time:
            return
        self._time = now
        rows = self._of_step()
        rows = rows._replace(impulse=self._share * rows.impulse)
        if self._share < 1.0:
            self._waiting.append(self._next)
            self._next = rows
        self._waiting.append(rows)
        if sum(len(rows.key) for rows in self._waiting) > _MOST_ROWS:
            self._add_up()

    def _of_step(self) -> _Rows:
        """Return the contacts of the last step that overlap or press."""
        simulation, people = self._simulation, self._people
        found, outline = simulation.contacts(self._e), simulation.outline
        kept = np.flatnonzero((found.gap < 0.0) | (found.impulse != 0.0).any(axis=1))
        i, j, gap, normal = found.i[kept], found.j[kept], found.gap[kept], found.normal[kept]
        position, radius = simulation.laid_out[people], simulation.bodies.radius[people]
        key = (i << 40) | ((j + (1 << 23)) << 16)
        if outline is None or found.disc_i is None or found.disc_j is None:
            center, size = position[i], radius[i]
        else:
            disc_i, disc_j = found.disc_i[kept].astype(np.int64), found.disc_j[kept].astype(np.int64)
            discs = outline.place_discs(position, radius, simulation.state.angle[people])
            center, size = (array[i, disc_i] for array in discs)
            key |= (disc_i << 8) | (disc_j + 1)
        along, across = found.impulse[kept].T
        nx, ny = normal.T
        impulse = np.stack([along * nx - across * ny, along * ny + across * nx], axis=1)
        point = center - normal * (size + 0.5 * gap)[:, None]
        return _Rows(key, i, j, gap, normal, point, impulse)

    def _add_up(self) -> None:
        """Add the waiting rows to the sums; gap, normal and point stay as in the last step with the contact."""
        rows = _Rows._make(np.concatenate(columns) for columns in zip(self._sum, *self._waiting, strict=True))
        key, last, which = np.unique(rows.key[::-1], return_index=True, return_inverse=True)
        impulse = np.zeros((len(key), 2))
        np.add.at(impulse, which[::-1], rows.impulse)
        latest = len(rows.key) - 1 - last
        self._sum = _Rows._make(column[latest] for column in rows)._replace(impulse=impulse)
        self._waiting = []


def _no_rows() -> _Rows:
    none, no_pairs = np.zeros(0, dtype=np.int64), np.zeros((0, 2))
    return _Rows(none, none, none, np.zeros(0), no_pairs, no_pairs, no_pairs)
