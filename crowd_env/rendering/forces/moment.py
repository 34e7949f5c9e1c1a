"""The contact forces of a recorded evacuation at the moment that tells most, or at a given one."""

import numpy as np

from crowd_env.core.arrays.outline import make_outline
from crowd_env.physics.pressure import ContactForces, mean_contact_forces
from crowd_env.recording import Recording


def forces_of(recording: Recording, at: float | None = None) -> ContactForces:
    """Return the mean contact forces of a recording between two frames, the second at ``at`` [s] or next after it.

    By default that is the end if the exits blocked, else the moment when people bear the largest forces in all.

    Raises
    ------
    ValueError
        If the recording holds no contacts, or ``at`` is not positive or after its end.
    """
    contacts, times = recording.contacts, recording.times
    if contacts is None:
        raise ValueError("the recording holds no contacts; record it with contacts=True, or without --no-contacts")
    if at is not None and not (np.isfinite(at) and at > 0.0):
        raise ValueError(f"the moment of the forces is {at!r} s; it must be > 0 and finite")
    if at is not None and at > recording.end + recording.frame_interval:
        raise ValueError(f"the evacuation was over after {recording.end:.1f} s; there are no forces at {at:g} s")
    if at is not None:
        frame = min(int(np.searchsorted(times, at - 1e-9)), len(times) - 1)
    elif recording.facts.get("blocked_since") is not None:
        frame = int(recording.frame[~recording.beyond].max(initial=0))
    else:
        load = recording.pressure * recording.radius[recording.person]
        frame = int(np.argmax(np.bincount(recording.frame, load, minlength=len(times))))
    rows = np.arange(recording.frame_start[frame], recording.frame_start[frame + 1])
    person, count = recording.person[rows], len(recording.radius)
    position, active, angle = np.full((count, 2), np.nan), np.zeros(count, dtype=np.bool_), np.zeros(count)
    position[person], active[person] = recording.position[rows], ~recording.beyond[rows]
    if recording.angle is not None:
        angle[person] = recording.angle[rows]
    start, i, j, _, _, point, force = contacts
    here = slice(start[frame], start[frame + 1])
    found = ContactForces(
        geometry=recording.geometry,
        time=float(times[frame]),
        position=position,
        radius=recording.radius,
        active=active,
        i=i[here],
        j=j[here],
        at=point[here],
        force=force[here, 0],
        angle=angle,
        outline=make_outline(recording.outline),
    )
    return mean_contact_forces([found])  # of bodies that touch in several places the sum
