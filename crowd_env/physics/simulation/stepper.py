"""The stepper of a batch: several threads, spatial order, and more memory when lists are full."""

import itertools
from collections.abc import Callable, Collection
from functools import partial
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Bodies, CrowdState, slots_of
from crowd_env.core.kernels.struct_ref import StructRef, struct_ref
from crowd_env.core.kernels.threads import Workers
from crowd_env.physics.driving_force import influences
from crowd_env.physics.neighbors.update import DIVERGED, FULL, OK, TOO_FAST
from crowd_env.physics.scheme import ContactScheme
from crowd_env.physics.spatial_order import SortedCrowd
from crowd_env.physics.workspace import Batch, Command, grow, set_command


class Stepper:
    """Advances a batch of crowds under one contact scheme.

    Parameters
    ----------
    scheme : the contact scheme.
    batch : in slot order, as callers see it.
    order : working copies of it in spatial order, if any crowd is large.
    threads : number of threads.
    uses : optional arrays in use, see `crowd_env.physics.scheme.arrays_of`.
    desire : kernel that changes desired velocities, see `crowd_env.physics.driving_force.desire_of`.

    Attributes
    ----------
    batch : the argument of kernels, always the same reference.
    ranges : ranges of environments for threads side by side, first and one past the last of each.
    """

    def __init__(
        self,
        scheme: ContactScheme,
        batch: Batch,
        order: SortedCrowd | None,
        threads: int,
        uses: Collection[str],
        desire: Any,
    ) -> None:
        self._scheme, self._in_slots, self._order, self._uses, self._desire = scheme, batch, order, uses, desire
        self.batch: StructRef = struct_ref(batch if order is None else order.batch)
        reach = influences(scheme.social, self.batch, desire).reach
        self._parts, self.ranges = _share_out(scheme, batch, reach, threads)
        # With spatial order or a crowd shared by threads, results are in slot order only after all threads have ended.
        self._looks_later = order is not None or self._parts[0][3] > 1
        self._workers = Workers()
        self._asked = Command(None, None, None, None)

    def begin(self, asked: Command) -> None:
        """Begin a call: reset its results, and take its command."""
        results, workspace = self._in_slots.results, self._in_slots.workspace
        workspace.status[:] = OK
        for sums in (*results[:-1], *results.diagnostics, workspace.substep, workspace.partition.barrier):
            sums[:] = 0
        self._asked = asked
        if self._order is None:
            set_command(self._in_slots.control, asked)

    def run_until(self, n_substeps: int, dt: float, then: Callable[[int, int], object]) -> None:
        """Advance every environment to step ``n_substeps`` of this call, and call ``then`` with each of `ranges`.

        Raises
        ------
        FloatingPointError
            If a body would move further in one step than its radius, or a position is no longer finite.
        """
        status = self._in_slots.workspace.status
        while True:
            if self._order is not None:
                self._order.gather(self._asked)
            try:  # the kernels hold no lock
                self._workers.run(partial(self._advance, dt, n_substeps, then), self._parts)
            finally:  # after Ctrl-C too, so that positions are current
                if self._order is not None:
                    self._order.scatter()
            stopped = np.flatnonzero((status == DIVERGED) | (status == TOO_FAST))
            if len(stopped):
                e, who = int(stopped[0]), (self._in_slots.bodies, self._in_slots.state)
                raise FloatingPointError(why_stopped(self._scheme.info.name, e, int(status[e]), *who, dt))
            if not (status == FULL).any():
                if self._looks_later:
                    self._workers.run(then, self.ranges)
                return
            self.grow()  # full environments then continue

    def _advance(self, dt: float, n_substeps: int, then: Callable[[int, int], object], *part: int) -> None:
        self._scheme.advance(self.batch, dt, n_substeps, *part, desire=self._desire)
        if not self._looks_later and (self._in_slots.workspace.status[part[0] : part[1]] == OK).all():
            then(part[0], part[1])  # here: waking threads again may take longer than ``then``

    def grow(self) -> None:
        """Enlarge the neighbor lists; references of callers stay valid."""
        grow(self._in_slots.history, self._in_slots.workspace, self._in_slots.bodies, self._uses)


def _share_out(
    scheme: ContactScheme, batch: Batch, reach: float, threads: int
) -> tuple[list[tuple[int, int, int, int]], list[tuple[int, int]]]:
    """Return the work of each thread (its environments, its number, the threads that share them), and the ranges.

    Threads either step ranges of environments side by side, without shared memory, or, for a large crowd and a scheme that can
    share it, all environments together.
    """
    count, largest = len(batch.state.time), int(np.diff(batch.bodies.env_start).max())
    edges = np.linspace(0, count, min(threads, count) + 1).astype(int).tolist()
    ranges = list(itertools.pairwise(edges))
    if threads > 1 and scheme.slabs(largest, reach) > 1:
        return [(0, count, thread, threads) for thread in range(threads)], ranges
    return [(first, stop, 0, 1) for first, stop in ranges], ranges


def why_stopped(scheme: str, e: int, status: int, bodies: Bodies, state: CrowdState, dt: float) -> str:
    """Return a sentence that names the pedestrian of environment ``e`` that went too far in a step, where and when."""
    people = slots_of(bodies, e)
    paths = np.where(state.present[people], dt * np.hypot(*state.velocity[people].T), 0.0)
    when = f"at t = {state.time[e]:g} s with dt = {dt:g} s"
    if status == DIVERGED or not np.isfinite(paths).all():
        return f"{scheme}: positions of environment {e} are no longer finite {when}; take a smaller dt"
    radius = bodies.radius[people]
    i = int(np.argmax(paths / radius))
    x, y = state.position[people][i]
    if paths[i] <= radius[i]:  # the velocity did not cause it
        return (
            f"{scheme}: people of environment {e} would be moved apart by more than their radius in one step {when}: their "
            "overlaps are deeper than a step may take back; take a smaller position_correction or dt"
        )
    return (
        f"{scheme}: pedestrian {i} of environment {e} would move {paths[i]:.3g} m in one step near ({x:.2f}, {y:.2f}) "
        f"{when}, further than its radius of {radius[i]:.3g} m ({paths[i] / dt:.3g} m/s); take a smaller dt"
    )
