"""One storey or stair of a recorded building as a recording of its own, for programs that know one plane."""

from dataclasses import replace

import numpy as np

from crowd_env.core.arrays.state import row_starts
from crowd_env.core.checks import known
from crowd_env.recording.recording import Recording


def of_storey(recording: Recording, name: str) -> Recording:
    """Return the people on one storey or stair of a building, in true coordinates.

    Its seams are exits, such as "to west stair".  People have rows from the frame before they come to the second after they
    have left, when they are beyond the seam.  ``memory["height"]`` (R,) is the height [m].
    Contacts are left out.

    Raises
    ------
    ValueError
        If the place has no storey or stair of this name.
    """
    building = recording.geometry.building
    names = [] if building is None else [sheet.name for sheet in building.sheets]
    s = names.index(known("storey or stair", name, names))
    assert building is not None
    true, height, sheet = recording.places()
    frame, person, here = recording.frame, recording.person, (sheet == s) & ~recording.beyond
    last = np.full(len(recording.radius), -1)
    np.maximum.at(last, person[here], frame[here])
    left = np.flatnonzero((last[person] >= 0) & (frame == last[person] + 1))
    key = (len(recording.times) + 4) * person + frame
    rows = np.flatnonzero(np.isin(key, key[here][:, None] + [-1, 0, 1, 2]))
    exits = [one for one in recording.exits if recording.geometry.on_sheets(one[1].mean(axis=0))[1] == s]
    seams = np.flatnonzero(building.from_sheet == s)
    exits += [(f"to {building.sheets[building.to_sheet[k]].name}", building.lines[k]) for k in seams.tolist()]
    lines = np.array([line for _, line in exits]).reshape(-1, 2, 2) - building.offsets[s]
    # The first row after the last one here is beyond an exit or a seam: the nearest.
    exit_time, exit_index = np.full(len(last), np.nan), np.full(len(last), -1)
    exit_time[person[left]] = np.fmin(recording.times[frame[left]], recording.exit_time[person[left]])
    exit_index[person[left]] = np.linalg.norm(true[left, None] - lines.mean(axis=1), axis=2).argmin(axis=1)
    alone, kept = recording.geometry.sheet_alone(s), ("person", "velocity", "pressure")
    return replace(
        recording,
        facts={**{key: one for key, one in recording.facts.items() if key != "building"}, "storey": name},
        walkable=alone.walkable.wkt,
        thin_walls=alone.walls[alone.two_sided],
        doors=(),  # they are walls
        exits=tuple((way, line) for (way, _), line in zip(exits, lines, strict=True)),
        frame_start=row_starts(np.bincount(recording.frame[rows], minlength=len(recording.times))),
        exit_time=exit_time,
        exit_index=exit_index,
        position=true[rows],
        angle=None if recording.angle is None else recording.angle[rows],
        memory={**{key: one[rows] for key, one in recording.memory.items()}, "height": height[rows]},
        contacts=None,
        **{key: getattr(recording, key)[rows] for key in kept},
    )
