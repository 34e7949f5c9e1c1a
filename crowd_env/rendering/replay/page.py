"""The page: a template with a style sheet, our own script and the packed recordings, one file that needs nothing else."""

import base64
import gzip
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.core.checks import Plain
from crowd_env.core.files.atomic import check_suffix, write_text
from crowd_env.geometry.parsing import from_wkt
from crowd_env.geometry.sheets import sheets_at
from crowd_env.physics.pressure import INJURY
from crowd_env.recording import Recording
from crowd_env.rendering import palette
from crowd_env.rendering.canvas import hex_of
from crowd_env.rendering.discs import unit_discs
from crowd_env.rendering.pages import filled
from crowd_env.rendering.palette import Color, blend, darker, pressure_color
from crowd_env.rendering.plan import holes_of, shells_of
from crowd_env.rendering.replay.stack import stack_of, stacked_plan, storeys_of
from crowd_env.rendering.replay.tracks import contacts_of, thinned_frames, tracks_of
from crowd_env.rendering.words import fact_rows, outcome, titles

MOST_ROWS = 5_000_000  # people in frames, and contacts, of one page: about 30 MB
MOST_RECORDINGS = 2
FORMAT = 1  # of the packed recordings
_NEVER = -1.0  # s, exit time of a pedestrian left inside


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
        If the suffix is unknown, there is no recording or more than two, or one holds nobody.
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
        "full_pressure": INJURY,
        "colors": plain_colors(),
        "recordings": abouts,
    }
    parts = {"title": about["title"], "summary": summary, "style": style_variables(), "recordings": texts}
    write_text(path, filled("crowd_env.rendering.replay", "browser", about=about, **parts))
    rows = sum(column["length"] for one in abouts for column in one["columns"] if column["name"] == "x")
    left_out = tuple(len(recording.times) - len(frames) for recording, frames in zip(recordings, kept, strict=True))
    return Page(path, path.stat().st_size, rows, tuple(map(len, kept)), left_out)


def _packed(recording: Recording, frames: Ints) -> tuple[dict[str, Any], str]:
    """Return what a page says of a recording, and its packed numbers."""
    tracks, contacts = tracks_of(recording, frames), contacts_of(recording, frames)
    plan, origin = plain_plan(recording)
    columns: dict[str, Floats | Ints] = {
        "times": tracks.times,
        "first": tracks.first,
        "samples": tracks.samples,
        "until": tracks.until,
        "exit_time": np.nan_to_num(recording.exit_time, nan=_NEVER),
        "exit_index": recording.exit_index,
        "radius": recording.radius,
        "desired_speed": np.nan_to_num(recording.desired_speed),
        "cohort": recording.cohort,
        "x": tracks.x - origin[0],
        "y": tracks.y - origin[1],
        "speed": tracks.speed,
        "pressure": tracks.pressure,
    }
    if tracks.angle is not None:
        columns["angle"] = tracks.angle
    if (building := recording.geometry.building) is not None:
        at, projected = np.column_stack([tracks.x, tracks.y]), stack_of(recording, building)
        u, v = projected(at).T
        columns |= {"sheet": sheets_at(at, building.sheets), "stack_x": u, "stack_y": v}
        plan = {**plan, **storeys_of(building, origin), "stack": stacked_plan(recording, building, projected)}
    if contacts is not None:
        # Lines between people go from body to body; where a wall is touched must be given.
        x, y = np.where(contacts.j < 0, (contacts.point - origin).T, 0.0)
        columns |= {
            "contact_start": contacts.start,
            "contact_i": contacts.i,
            "contact_j": np.maximum(contacts.j, -1),
            "contact_x": x,
            "contact_y": y,
            "contact_force": contacts.force[:, 0],
        }
    about, text = pack(columns)
    every = len(recording.times)
    note = f"{len(frames)} of {every} frames are shown, to keep this page small."
    return {
        "plan": plan,
        "columns": about,
        "frames": len(frames),
        "note": "" if len(frames) == every else note,
        "cohorts": list(recording.cohorts),
        "outline": unit_discs(recording),
        "outcome": outcome(recording),
        "facts": fact_rows(recording),
    }, text


_LARGEST = 2**15 - 1


# Columns that go in steps, and what they are rounded to; coarser if 16 bits would not do.  Steps are differences from number to
# number in 16 bits: of a pedestrian that walks steadily they are small and much alike.
_STEPS = {
    **dict.fromkeys(("x", "y", "stack_x", "stack_y"), 1e-3),
    **dict.fromkeys(("speed", "contact_x", "contact_y"), 1e-2),
    "pressure": 5.0,
    "angle": 2.0 * np.pi / 1024,
    "contact_force": 2.0,
}


def pack(columns: Mapping[str, Floats | Ints]) -> tuple[list[dict[str, Any]], str]:
    """Return what each column (L,) is (name, length, kind, step), and the text of all.

    Whole numbers are packed as they are, others as float32 or in steps.  One array lies behind the other, gzip, base64; the
    browser unpacks both (browser/decode.js).

    Raises
    ------
    ValueError
        If a number is not finite.
    """
    about, parts = [], []
    for name, values in columns.items():
        step = _STEPS.get(name)
        if not np.isfinite(values).all():
            raise ValueError(f"{name} of a recording has a value that is not finite")
        kind = "steps" if step else "whole" if values.dtype.kind in "iu" else "real"
        if step:
            step = max(step, float(np.abs(values).max(initial=0.0)) / _LARGEST)
            values = np.diff(np.rint(values / step).astype("<i2"), prepend=np.int16(0))
        about.append({"name": name, "length": len(values), "kind": kind, "step": step})
        parts.append(values.astype({"steps": "<i2", "whole": "<i4", "real": "<f4"}[kind]).tobytes())
    packed = gzip.compress(b"".join(parts), compresslevel=9, mtime=0)
    return about, base64.b64encode(packed).decode("ascii")


_DIGITS = 4  # of a meter


def plain_plan(recording: Recording) -> tuple[Plain, Floats]:
    """Return the plan, and the point (2,) [m] from which all of the page is measured: coordinates of maps are large."""
    area = from_wkt(recording.walkable, "the walkable area of the recording")
    shells, holes = shells_of(area), holes_of(area)
    points = [*shells, *holes, recording.position, *(segment for _, segment in recording.exits)]
    every = np.concatenate([np.reshape(part, (-1, 2)) for part in points])
    border = np.concatenate(shells) if shells else every
    origin = np.floor(every.min(axis=0))

    def plain(points: Floats) -> Any:
        return np.round(np.asarray(points) - origin, _DIGITS).tolist()

    plan = {
        "origin": origin.tolist(),
        "bounds": [*plain(border.min(axis=0)), *plain(border.max(axis=0))],
        "shells": [plain(ring) for ring in shells],
        "holes": [plain(ring) for ring in holes],
        "thin_walls": [plain(wall) for wall in recording.thin_walls],
        "doors": [plain(leaf) for _, leaf in recording.doors],
        "exits": [{"name": name, "ends": plain(segment)} for name, segment in recording.exits],
        "zones": [
            {"name": name, "rings": [plain(ring) for ring in (*shells_of(zone), *holes_of(zone))]}
            for name, text in recording.facts.get("zones", {}).items()
            for zone in (from_wkt(text, f"zone {name!r} of the recording"),)
        ],
    }
    return plan, origin


STEPS = 32
# From standing to walking fast, and from out in a moment to a long way to go; neither looks like a pressure, and both can be
# seen on a white floor and on a dark one.
_SPEED: tuple[Color, ...] = ((112, 76, 148), (76, 118, 184), (66, 172, 176), (176, 216, 140))
_TIME: tuple[Color, ...] = ((188, 222, 196), (104, 180, 168), (46, 126, 152), (58, 74, 128))
_UNKNOWN: Color = (158, 165, 172)


def _with_rims(colors: NDArray[np.uint8]) -> dict[str, list[str]]:
    return {"fill": [hex_of(color) for color in colors], "rim": [hex_of(color) for color in darker(colors)]}


def plain_colors() -> Plain:
    """Return the ramps of bodies, each with darker rims, and the colors of cohorts, from the palette of all pictures.

    They go in steps, so that people of one color are drawn in one go.
    """
    level = np.linspace(0.0, 1.0, STEPS)
    return {
        "pressure": _with_rims(pressure_color(level)),
        "speed": _with_rims(blend(_SPEED, level)),
        "time": _with_rims(blend(_TIME, level)),
        "cohort": _with_rims(darker(palette.SERIES, by=-0.1)),  # lighter: they are seen on a dark floor too
        "unknown": _with_rims(np.array([_UNKNOWN], dtype=np.uint8)),
    }


def style_variables() -> str:
    """Return the colors of a page as properties of its style sheet; other dark ones stand in the style sheet itself."""
    alike = ("background", "floor", "wall", "obstacle", "exit", "seam", "ink", "faint")
    named = {name: getattr(palette, name.upper()) for name in alike} | {"mat": palette.EXIT_MAT}
    named["quiet"] = tuple(darker(palette.QUIET, by=0.06))  # small letters need more contrast than those of a film
    curves = (palette.SERIES, darker(palette.SERIES, by=-0.2))  # on a dark page lighter
    light, dark = (_properties({f"series-{k}": color for k, color in enumerate(colors)}) for colors in curves)
    return f":root {{ {_properties(named)} {light} }}\n@media (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}\n"


def _properties(colors: Plain) -> str:
    return " ".join(f"--{name}: {hex_of(color)};" for name, color in colors.items())
