"""The page: a template, one style sheet, our own script and the packed recordings in one file that needs nothing else."""

import html
import json
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from crowd_env.core.arrays.outline import make_outline
from crowd_env.core.files.atomic import check_suffix, write_text
from crowd_env.recording import Recording
from crowd_env.rendering.palette import FULL_PRESSURE
from crowd_env.rendering.replay.colors import STEPS, plain_colors, style_variables
from crowd_env.rendering.replay.pack import Column, pack
from crowd_env.rendering.replay.shapes import plain_plan
from crowd_env.rendering.replay.tracks import contacts_of, thinned_frames, tracks_of
from crowd_env.rendering.words import fact_rows, outcome, titles

MOST_ROWS = 5_000_000  # people in frames, and contacts, of one page: about 30 MB
MOST_RECORDINGS = 2
FORMAT = 1  # of the packed recordings
_SCRIPTS = (
    "decode.js",
    "tracks.js",
    "colors.js",
    "plan.js",
    "people.js",
    "view.js",
    "charts.js",
    "player.js",
    "start.js",
)
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
    parts = [_packed(recording, most_rows // len(recordings)) for recording in recordings]
    write_text(path, _page(recordings, list(names), title, parts))
    frames = tuple(part.about["frames"] for part in parts)
    every = tuple(len(recording.times) for recording in recordings)
    rows = sum(part.rows for part in parts)
    return Page(path, path.stat().st_size, rows, frames, tuple(np.subtract(every, frames).tolist()))


class _Packed(NamedTuple):
    about: dict[str, Any]
    text: str
    rows: int


def _packed(recording: Recording, most_rows: int) -> _Packed:
    frames = thinned_frames(recording, most_rows)
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
    return _Packed(
        {
            "plan": plan,
            "columns": about,
            "frames": len(frames),
            "note": ""
            if len(frames) == every
            else f"{len(frames)} of {every} frames are shown, to keep this page small.",
            "groups": list(recording.groups),
            "outline": None if outline is None else np.column_stack(outline.shape[:3]).tolist(),
            "outcome": outcome(recording),
            "facts": fact_rows(recording),
        },
        text,
        len(tracks.x),
    )


def _page(recordings: Sequence[Recording], names: list[str], title: str | None, parts: Sequence[_Packed]) -> str:
    from crowd_env.core.version import __version__

    found, summary, labels = titles(recordings, names)
    title = title or found
    if len(recordings) == 1:
        summary = f"{summary} · {outcome(recordings[0])}"
    about = {
        "format": FORMAT,
        "title": title,
        "steps": STEPS,
        "full_pressure": FULL_PRESSURE,
        "colors": plain_colors(),
        "recordings": [part.about | {"label": label} for part, label in zip(parts, labels, strict=True)],
    }
    blocks = "\n".join(
        f'<script type="application/octet-stream" id="recording-{k}">{part.text}</script>'
        for k, part in enumerate(parts)
    )
    return _filled(
        _read("template.html"),
        {
            "title": html.escape(title),
            "summary": html.escape(summary),
            "version": html.escape(__version__),
            "style": style_variables() + _read("style.css"),
            "about": _script_safe(about),
            "recordings": blocks,
            "script": '"use strict";\n' + "\n".join(_read(name) for name in _SCRIPTS),
        },
    )


def _filled(template: str, parts: Mapping[str, str]) -> str:
    """Return the template with its ``{{name}}``; nothing in a part is looked at again."""
    pieces = template.split("{{")
    text = [pieces[0]]
    for piece in pieces[1:]:
        name, rest = piece.split("}}", 1)
        text += [parts[name], rest]
    return "".join(text)


def _script_safe(content: Any) -> str:
    """Return JSON that ends no script element and begins no comment, whatever strings it holds."""
    return json.dumps(content, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c").replace(">", "\\u003e")


def _read(name: str) -> str:
    return (files("crowd_env.rendering.replay") / "browser" / name).read_text(encoding="utf-8")
