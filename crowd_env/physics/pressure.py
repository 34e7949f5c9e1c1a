"""Contact forces, contact pressure on a body, and crowd pressure."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from crowd_env.core.arrays.state import Bools, Floats, Ints, slots_of
from crowd_env.core.behaviors.outline import Outline
from crowd_env.core.checks import POSITIVE, array, number, require_all
from crowd_env.geometry.geometry import Geometry
from crowd_env.geometry.wall_grid import pairs_within
from crowd_env.physics.simulation.simulation import Simulation

# "Pedestrians are injured if the sum of the magnitudes of the radial forces on them, divided by their circumference, exceeds a
# pressure of 1600 N/m" (Helbing, Farkas, Vicsek 2000, Nature 407:487); friction counts here.
INJURY = 1600.0  # N/m


class ContactForces(NamedTuple):
    """Normal forces of the C contacts in a crowd of N."""

    geometry: Geometry
    time: float  # s
    position: Floats  # (N, 2)  m
    radius: Floats  # (N,)    m
    active: Bools  # (N,)    still inside
    i: Ints  # (C,)    body
    j: Ints  # (C,)    other body > i, or -1 - k: wall feature k
    at: Floats  # (C, 2)  m, the center of j, or where i touches the wall
    force: Floats  # (C,)    N, normal; > 0 pushes apart
    angle: Floats | None = None  # (N,)    rad
    outline: Outline | None = None  # shape of all bodies; None = discs


def contact_pressure(impulse: ArrayLike, duration: float, radius: ArrayLike) -> Floats:
    """Return the contact force on each body per circumference [N/m], ``sum |f_c| / (2 pi r)``.

    It is the two-dimensional pressure inside the disc: the trace of the virial stress ``sum (r n) f / (pi r^2)``, halved.

    Parameters
    ----------
    impulse : (..., N) N s, summed magnitudes of the contact impulses during ``duration``, as in ``Results.impulse_magnitude``.
    duration : s.
    radius : (N,) m.

    Raises
    ------
    ValueError
        If the shapes do not fit, or the duration or a radius is not positive.
    """
    circumference = 2.0 * np.pi * require_all("radius", array("radius", radius, (None,)), POSITIVE)
    impulse = array("impulse", impulse, (..., len(circumference)))
    return np.asarray(impulse, dtype=np.float64) / (number("duration", duration, POSITIVE, "s") * circumference)


def contact_forces(simulation: Simulation, e: int = 0) -> ContactForces:
    """Return the contacts of environment ``e`` with their normal forces: the normal impulses of the last step over its length.

    The forces between all discs of two bodies with an outline, or of a body and a wall, are added up.

    Forces from impulse solvers fluctuate from step to step; `mean_contact_forces` averages many steps.
    """
    people = slots_of(simulation.bodies, e)
    position, radius = simulation.laid_out[people].copy(), simulation.bodies.radius[people].copy()
    angle, outline = simulation.state.angle[people].copy(), simulation.outline
    active, contacts = simulation.state.active[people].copy(), simulation.contacts(e)
    inside = _both_inside(active, contacts.i, contacts.j)
    i, j = contacts.i[inside], contacts.j[inside]
    center, size = position[i], radius[i]
    if outline is not None and contacts.disc_i is not None:
        of_all = outline.place_discs(position, radius, angle)
        center, size = (array[i, contacts.disc_i[inside]] for array in of_all)
    touch = center - contacts.normal[inside] * (size + contacts.gap[inside])[:, None]
    forces = ContactForces(
        geometry=simulation.geometries[simulation.world.geometry_of_env[e]],
        time=float(simulation.state.time[e]),
        position=position,
        radius=radius,
        active=active,
        i=i,
        j=j,
        at=np.where((j < 0)[:, None], touch, position[np.maximum(j, 0)]),
        force=contacts.impulse[inside, 0] / simulation.dt,
        angle=angle,
        outline=outline,
    )
    return forces if outline is None else mean_contact_forces([forces])


def mean_contact_forces(samples: Sequence[ContactForces]) -> ContactForces:
    """Return the time average of the normal forces over ``samples`` of one crowd, with the positions of the last one.

    A contact counts as 0 N in samples without it; contacts of people that have left meanwhile are left out.

    Raises
    ------
    ValueError
        If there is no sample.
    """
    if not samples:
        raise ValueError("a mean of contact forces needs at least one sample")
    last = samples[-1]
    i, j, at, force = (np.concatenate([getattr(s, name) for s in samples]) for name in ("i", "j", "at", "force"))
    stays = _both_inside(last.active, i, j)
    i, j, at, force = i[stays], j[stays], at[stays], force[stays]
    pairs, which = np.unique(np.stack([i, j], axis=1), axis=0, return_inverse=True)
    which = which.reshape(-1)
    mean, place = np.zeros(len(pairs)), np.zeros((len(pairs), 2))
    np.add.at(mean, which, force / len(samples))
    place[which] = at  # of several, the last one
    i, j = pairs.T.copy()
    at = np.where((j < 0)[:, None], place, last.position[np.maximum(j, 0)])
    return last._replace(i=i, j=j, at=at, force=mean)


def _both_inside(active: Bools, i: Ints, j: Ints) -> Bools:
    """Return which contacts (C,) join active people, or an active pedestrian and a wall."""
    return active[i] & ((j < 0) | active[np.maximum(j, 0)])


def crowd_pressure(simulation: Simulation, radius: float = 1.0) -> Floats:
    """Return density times velocity variance around each pedestrian (P,) [1/s^2]; 0 after leaving.

    Both are taken over the people within ``radius`` [m], the pedestrian included.  This is the "crowd pressure" of Helbing,
    Johansson, Al-Abideen 2007, with turbulence from 0.02 /s^2 on.  They weight by a Gaussian of the distance; here all people
    within the radius have equal weight.

    Raises
    ------
    ValueError
        If the radius is not positive and finite.
    """
    radius = number("crowd_pressure: radius", radius, POSITIVE, "m")
    out, state = np.zeros(len(simulation.bodies.radius)), simulation.state
    for begin, end in pairwise(simulation.bodies.env_start):
        here = begin + np.flatnonzero(state.active[begin:end])
        i, j = pairs_within(simulation.laid_out[here], radius)
        count = np.bincount(i)  # the pedestrian included
        x, y = state.velocity[here].T
        mean_x, mean_y, mean_square = (np.bincount(i, values[j]) / count for values in (x, y, x**2 + y**2))
        variance = mean_square - mean_x**2 - mean_y**2
        out[here] = count / (np.pi * radius**2) * np.maximum(variance, 0.0)
    return out
