"""cromosim: the granular model of Maury and Venel with its own solvers, a step of 0.01 s (its examples').

Velocities are projected on those that do not overlap within the step, by interior points (cvxopt) for crowds of up to 1000, and
by Uzawa's method.  Walls and ways are read off an image with pixels of 5 cm (2 cm in rooms of less than 10 m).
"""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cromosim.domain
import cromosim.micro
import numpy as np
from matplotlib.lines import Line2D

from benchmarks.measuring import Effort
from benchmarks.peers.walking import DT, PeerCrowd
from benchmarks.scenes import Floats, Scene

_OUTSIDE = 1.0  # m behind the door
_MARGIN = 0.3  # m around the walls
_CVXOPT_PEOPLE = 1000


class Granular(PeerCrowd):
    """A scene under one of its solvers."""

    def __init__(self, solver: str, scene: Scene, domain: Any) -> None:
        self._solver, self._domain = solver, domain
        # Two people who meet must be seen before they are in each other.
        self._reach = 2.0 * DT * float(scene.bodies.desired_speed.max()) + 0.005
        super().__init__(f"granular, {solver}", "cromosim", scene)

    def _build(self) -> None:
        bodies = self._scene.bodies
        self._xyrv = np.column_stack([self._scene.position, bodies.radius, bodies.desired_speed])
        self._number = np.arange(self._scene.people)

    def _step(self) -> None:
        xyrv = self._xyrv
        contacts = cromosim.micro.compute_contacts(self._domain, xyrv, self._reach)
        _, _, desired = self._domain.people_desired_velocity(xyrv, ["door"] * len(xyrv))
        _, _, velocity, _, _ = cromosim.micro.projection(
            DT, xyrv, contacts, desired, dmin_people=0.0, dmin_walls=0.0, method=self._solver
        )
        xyrv[:, :2] += DT * velocity
        stays = xyrv[:, 0] <= self._scene.side
        if not stays.all():
            self._xyrv, self._number = xyrv[stays], self._number[stays]

    @property
    def inside(self) -> int:
        """Number of people inside; one alone counts as none, since its contact search needs two."""
        return len(self._xyrv) if len(self._xyrv) > 1 else 0

    def _people(self) -> tuple[np.ndarray, Floats]:
        return self._number, self._xyrv[:, :2].copy()


def domain_of(scene: Scene) -> Any:
    """Draw the room and find the ways."""
    side, pixel = scene.side, 0.02 if scene.side < 10.0 else 0.05
    black, red = [0, 0, 0], [255, 0, 0]
    with tempfile.TemporaryDirectory() as folder:  # it leaves an image beside its name
        domain = cromosim.domain.Domain(
            name=str(Path(folder) / "room"),
            pixel_size=pixel,
            xmin=-_MARGIN,
            ymin=-_MARGIN,
            width=round((side + _MARGIN + _OUTSIDE) / pixel),
            height=round((side + 2 * _MARGIN) / pixel),
            wall_colors=[black],
        )
        shift = np.array([_MARGIN, _MARGIN])
        for a, b in scene.walls:
            (ax, ay), (bx, by) = np.array(a) + shift, np.array(b) + shift
            domain.add_shape(Line2D([ax, bx], [ay, by], linewidth=1), outline_color=black, fill_color=black)
        x, y0, y1 = side + 0.5 + _MARGIN, _MARGIN, side + _MARGIN
        domain.add_shape(Line2D([x, x], [y0, y1], linewidth=1), outline_color=red, fill_color=red)
        domain.build_domain()
    door = cromosim.domain.Destination(name="door", colors=[red], excluded_colors=[black])
    domain.add_destination(door)
    return domain


def crowds(scene: Scene, effort: Effort) -> Iterator[Granular]:
    """Yield the scene under both solvers."""
    domain = domain_of(scene)
    for solver in ("cvxopt", "uzawa"):
        if solver == "uzawa" or scene.people <= _CVXOPT_PEOPLE:
            yield Granular(solver, scene, domain)
