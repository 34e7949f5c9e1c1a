"""Who touches whom at a moment, and with what forces."""

import numpy as np

from crowd_env.recording.recording import FrameContacts
from crowd_env.simulation.simulation import Simulation
from crowd_env.state import Bools


def find_contacts(simulation: Simulation, e: int, inside: Bools) -> FrameContacts:
    """Return the contacts of people who are inside (N,) that overlap or press, in the order of i."""
    people = slice(int(simulation.bodies.env_start[e]), int(simulation.bodies.env_start[e + 1]))
    position, radius = simulation.state.position[people], simulation.bodies.radius[people]
    found, outline = simulation.contacts(e), simulation.outline
    kept = inside[found.i] & ((found.j < 0) | inside[np.maximum(found.j, 0)])
    kept &= (found.gap < 0.0) | (found.impulse != 0.0).any(axis=1)
    rows = np.flatnonzero(kept)
    rows = rows[np.argsort(found.i[rows], kind="stable")]
    i, gap, normal = found.i[rows], found.gap[rows], found.normal[rows]
    center, size = position[i], radius[i]
    if outline is not None and found.disc_i is not None:
        discs = outline.place_discs(position, radius, simulation.state.angle[people])
        center, size = (array[i, found.disc_i[rows]] for array in discs)
    return FrameContacts(
        start=np.array([0, len(rows)]),
        i=i,
        j=found.j[rows],
        gap=gap,
        normal=normal,
        point=center - normal * (size + 0.5 * gap)[:, None],
        force=found.impulse[rows] / simulation.dt,
    )
