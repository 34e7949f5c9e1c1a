"""What a page plays: the way of each person, person by person, at as many moments as a page may hold."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints, row_starts
from crowd_env.recording import FrameContacts, Recording


class Tracks(NamedTuple):
    """The ways of N people through K frames; the S samples lie person by person.

    Sample k of person n belongs to ``times[first[n] + k]``, but the last one to ``until[n]``: beyond the exit line, or the end
    of the recording.
    """

    times: Floats  # (K,)  s
    first: Ints  # (N,)  frame of a person's first sample
    samples: Ints  # (N,)  number of a person's samples
    until: Floats  # (N,)  s    time of a person's last sample
    x: Floats  # (S,)  m
    y: Floats  # (S,)  m
    speed: Floats  # (S,)  m/s
    pressure: Floats  # (S,)  N/m    mean since the frame before
    angle: Floats | None  # (S,)  rad    steady: no jumps by full turns


def thinned_frames(recording: Recording, most: int) -> Ints:
    """Return the frames that a page shows: every m-th and the last, so that at most about ``most`` rows and contacts remain."""
    frames = len(recording.times)
    rows = len(recording.person) + (0 if recording.contacts is None else len(recording.contacts.i))
    kept = np.arange(0, frames, max(-(-rows // most), 1))
    return kept if kept[-1] == frames - 1 else np.append(kept, frames - 1)


def tracks_of(recording: Recording, frames: Ints) -> Tracks:
    """Return the ways of people at ``frames``; where a person was not seen in between, the way is straight.

    Pedestrians left inside stay to the end where they were seen last: the last frame of a recording may hold only the ones
    that got out just before it.  Between frames that are kept, pressures are averaged.
    """
    people = len(recording.radius)
    order = np.argsort(recording.person, kind="stable")
    person, row_time = recording.person[order], recording.times[recording.frame[order]]
    times = recording.times[frames]
    seen = np.searchsorted(person, np.arange(people + 1))
    here = np.flatnonzero(np.diff(seen) > 0)
    begin, until = np.zeros(people), np.full(people, -np.inf)
    begin[here], until[here] = row_time[seen[here]], row_time[seen[here + 1] - 1]
    seen_until = until.copy()
    until[here] = np.where(np.isnan(recording.exit_time[here]), recording.times[-1], until[here])
    first = np.searchsorted(times, begin, side="left")
    whole = np.maximum(np.searchsorted(times, until, side="right") - first, 0)
    own_last = np.isfinite(until) & ((whole == 0) | (times[np.maximum(first + whole - 1, 0)] < until))
    count = whole + own_last
    # One axis for everybody: each person has a stretch of it, so that one interpolation does for all.
    span = float(recording.times[-1] - recording.times[0]) + 1.0
    start = row_starts(count)
    who = np.repeat(np.arange(people), count)
    at = times[np.minimum(first[who] + np.arange(len(who)) - start[who], len(times) - 1)]
    at[start[1:][own_last] - 1] = until[own_last]
    along, target = span * person + row_time, span * who + np.minimum(at, seen_until[who])

    def sampled(values: Floats) -> Floats:
        return np.interp(target, along, values) if len(along) else np.zeros(0)

    position, speed = recording.position[order], np.linalg.norm(recording.velocity, axis=1)[order]
    return Tracks(
        times,
        first,
        count,
        np.where(np.isfinite(until), until, 0.0),
        sampled(position[:, 0]),
        sampled(position[:, 1]),
        sampled(speed),
        _mean_pressure(recording, order, sampled, target, start),
        None if recording.angle is None else sampled(np.unwrap(recording.angle[order])),
    )


def _mean_pressure(
    recording: Recording, order: Ints, sampled: Callable[[Floats], Floats], target: Floats, start: Ints
) -> Floats:
    """Return the pressure since the sample before (S,), also where frames in between are left out."""
    pressure = np.nan_to_num(recording.pressure[order])
    step = np.diff(recording.times, prepend=recording.times[0] - recording.frame_interval)
    borne = sampled(np.cumsum(pressure * step[recording.frame[order]]))
    mean = np.diff(borne, prepend=0.0) / np.maximum(np.diff(target, prepend=-1.0), 1e-9)
    own = np.diff(target, prepend=-1.0) <= 0.0  # an unseen pedestrian has nothing between two samples
    own[start[:-1][np.diff(start) > 0]] = True  # nor before the first one
    mean[own] = sampled(pressure)[own]
    return np.maximum(mean, 0.0)


def contacts_of(recording: Recording, frames: Ints) -> FrameContacts | None:
    """Return the contacts of ``frames`` that push; near misses are left out."""
    contacts = recording.contacts
    if contacts is None:
        return None
    kept = np.zeros(len(contacts.i), dtype=bool)
    for frame in frames:
        kept[contacts.start[frame] : contacts.start[frame + 1]] = True
    kept &= contacts.force[:, 0] > 0.0
    within = row_starts(kept)
    start = np.append(within[contacts.start[frames]], within[-1])
    i, j, gap, normal, point, force = contacts[1:]
    return FrameContacts(start, i[kept], j[kept], gap[kept], normal[kept], point[kept], force[kept])
