"""The page: a template with a style sheet, our own script and the packed recordings, one file that needs nothing else."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from crowd_env.core.arrays.outline import make_outline
from crowd_env.core.arrays.state import Ints
from crowd_env.core.files.atomic import check_suffix, write_text
from crowd_env.recording import Recording
from crowd_env.rendering.pages import filled
from crowd_env.rendering.palette import FULL_PRESSURE
from crowd_env.rendering.replay.colors import STEPS, plain_colors, style_variables
from crowd_env.rendering.replay.pack import Column, pack
from crowd_env.rendering.replay.shapes import plain_plan
from crowd_env.rendering.replay.tracks import contacts_of, thinned_frames, tracks_of
from crowd_env.rendering.words import fact_rows, outcome, titles

MOST_ROWS = 5_000_000  # people in frames, and contacts, of one page: about 30 MB
MOST_RECORDINGS = 2
FORMAT = 1  # of the packed recordings
_NEVER = -1.0  # s, as a time when people left who are inside at the end


class Page(NamedTuple):
    """A page that has been written."""

    path: Path
    size: int  # bytes
    rows: int  # people in frames that it holds
    frames: tuple[int, ...]  # that it holds of each recording
    left_out: tuple[int, ...]  # frames that it does not hold, of each recording


def write_page(
    path: str | Path,
    recordings: Recording | Sequence[Recording],
    *,
    names: Sequence[str] = (),
    title: str | None = None,
    most_rows: int = MOST_ROWS,
) -> Page:
    """Write one HTML page that replays a recording, or two side by side in step, and say what it holds.

    Parameters
    ----------
    path : ends in .html.
    names : what recordings are called that nothing else tells apart, such as their files.
    title : by default what the recordings say of themselves.
    most_rows : how many people in frames, and contacts, the page may hold; every second, third ... frame is shown of longer
        recordings.

    Raises
    ------
    ValueError
        If the suffix is another, there is no recording or more than two, or one holds nobody.
    """
    path = check_suffix(path, (".html",))
    recordings = [recordings] if isinstance(recordings, Recording) else list(recordings)
    if not 1 <= len(recordings) <= MOST_RECORDINGS:
        raise ValueError(f"a page shows 1 or {MOST_RECORDINGS} recordings; {len(recordings)} were given")
    names = names or [f"recording {k + 1}" for k in range(len(recordings))]
    for recording, name in zip(recordings, names, strict=True):
        if not len(recording.person):
            raise ValueError(f"{name} holds nobody: there is nothing to replay")
    kept = [thinned_frames(recording, most_rows // len(recordings)) for recording in recordings]
    found, summary, labels = titles(recordings, names)
    if len(recordings) == 1:
        summary = f"{summary} · {outcome(recordings[0])}"
    abouts, texts = [], []
    for recording, frames, label in zip(recordings, kept, labels, strict=True):
        about, text = _packed(recording, frames)
        abouts.append({**about, "label": label})
        texts.append(text)
    about = {
        "format": FORMAT,
        "title": title or found,
        "steps": STEPS,
        "full_pressure": FULL_PRESSURE,
        "colors": plain_colors(),
        "recordings": abouts,
    }
    parts = {
        "title": title or found,
        "summary": summary,
        "style": style_variables(),
        "about": about,
        "recordings": texts,
    }
    write_text(path, filled("crowd_env.rendering.replay", "browser", **parts))
    rows = sum(column["length"] for one in abouts for column in one["columns"] if column["name"] == "x")
    left_out = tuple(len(recording.times) - len(frames) for recording, frames in zip(recordings, kept, strict=True))
    return Page(path, path.stat().st_size, rows, tuple(map(len, kept)), left_out)


def _packed(recording: Recording, frames: Ints) -> tuple[dict[str, Any], str]:
    """Return what a page says of a recording, and its packed numbers."""
    tracks, contacts = tracks_of(recording, frames), contacts_of(recording, frames)
    plan, origin = plain_plan(recording)
    columns = [
        Column("times", tracks.times),
        Column("first", tracks.first),
        Column("samples", tracks.samples),
        Column("until", tracks.until),
        Column("exit_time", np.nan_to_num(recording.exit_time, nan=_NEVER)),
        Column("exit_index", recording.exit_index),
        Column("radius", recording.radius),
        Column("desired_speed", np.nan_to_num(recording.desired_speed)),
        Column("group", recording.group),
        Column("x", tracks.x - origin[0], 1e-3),
        Column("y", tracks.y - origin[1], 1e-3),
        Column("speed", tracks.speed, 1e-2),
        Column("pressure", tracks.pressure, 5.0),
    ]
    if tracks.angle is not None:
        columns.append(Column("angle", tracks.angle, 2.0 * np.pi / 1024))
    if contacts is not None:
        columns += [
            Column("contact_start", contacts.start),
            Column("contact_i", contacts.i),
            Column("contact_j", np.maximum(contacts.j, -1)),
            # Lines between people go from body to body; where a wall is touched must be said.
            *(
                Column(f"contact_{axis}", np.where(contacts.j < 0, contacts.point[:, k] - origin[k], 0.0), 1e-2)
                for k, axis in enumerate("xy")
            ),
            Column("contact_force", contacts.force[:, 0], 2.0),
        ]
    outline = make_outline(recording.outline)
    about, text = pack(columns)
    every = len(recording.times)
    note = f"{len(frames)} of {every} frames are shown, to keep this page small."
    return {
        "plan": plan,
        "columns": about,
        "frames": len(frames),
        "note": "" if len(frames) == every else note,
        "groups": list(recording.groups),
        "outline": None if outline is None else np.column_stack(outline.shape[:3]).tolist(),
        "outcome": outcome(recording),
        "facts": fact_rows(recording),
    }, text
