"""Floor plans in well-known text (WKT), alone and as the geometry of JuPedSim's SQLite files."""

import sqlite3
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from urllib.parse import quote

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import counted
from crowd_env.core.files.foreign import read_text
from crowd_env.geometry.parsing import flat_parts, from_wkt
from crowd_env.scenarios.plans.floor_plan import Drawing
from crowd_env.scenarios.plans.lines import GAP, enclosed, open_line

_READ = (
    "a floor plan in this file must be well-known text (WKT), e.g. POLYGON ((0 0, 5 0, 5 5, 0 5, 0 0)); GeoJSON, DXF, "
    "SQLite and scenario files have suffixes of their own"
)
# Output of JuPedSim's converter of DXF files: a collection of one collection each.
_COLLECTIONS = ("walkable", "exit", "start")


def read_wkt(path: Path, meters: float | None) -> Drawing:
    """Read a POLYGON, MULTIPOLYGON or GEOMETRYCOLLECTION, or the collections that JuPedSim's converter of DXF files writes.

    Geometries may stand one below the other, with comments after #; lines alone enclose the floor.

    Parameters
    ----------
    meters : how many meters a unit is, as the user gave it; None = 1.
    """
    texts = _geometries(read_text(path, "the floor plan", _READ))
    if len(texts) == 1:
        return _drawing(from_wkt(texts[0], "walkable area"), meters or 1.0)
    shapes = [from_wkt(text, f"geometry {number} of the walkable area") for number, text in enumerate(texts)]
    return _drawing(shapely.GeometryCollection(shapes), meters or 1.0)


def _geometries(text: str) -> list[str]:
    """Return the geometries of a text, each of which begins a line, without lines of comments; one if there is no more."""
    found, depth = [""], 0
    for line in text.splitlines(keepends=True):
        if line.lstrip().startswith("#"):
            continue
        if depth == 0 and found[-1].strip() and line.strip()[:1].isalpha():
            found.append("")
        found[-1] += line
        depth += line.count("(") - line.count(")")
    return found


def read_jupedsim_sqlite(path: Path, meters: float | None) -> Drawing:
    """Read the geometry of a recording that JuPedSim has written, of the first frame if it changes."""
    if not path.is_file():
        raise ValueError(f"cannot read the floor plan {path}: {'is no file' if path.exists() else 'No such file'}")
    address = f"file:{quote(str(path.absolute()))}?mode=ro&immutable=1"
    try:
        with closing(sqlite3.connect(address, uri=True)) as base:
            tables = {name for (name,) in base.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
            if "geometry" not in tables:
                raise ValueError(
                    f"it is an SQLite database without a table 'geometry', so not one of JuPedSim; its tables: "
                    f"{', '.join(sorted(tables)) or 'none'}"
                )
            texts = [text for (text,) in base.execute("SELECT wkt FROM geometry ORDER BY rowid")]
            changes = len(texts) > 1
            if changes and "frame_data" in tables:
                first = "SELECT geometry_hash FROM frame_data ORDER BY frame LIMIT 1"
                texts = [row[0] for row in base.execute(f"SELECT wkt FROM geometry WHERE hash = ({first})")] or texts
    except sqlite3.Error as error:
        raise ValueError(f"it cannot be read as a recording of JuPedSim: {error}") from None
    if not texts or not isinstance(texts[0], str):
        raise ValueError("its table 'geometry' holds no well-known text (WKT)")
    drawing = _drawing(from_wkt(texts[0], "walkable area"), 1.0)
    if changes:
        drawing.notes.append("the geometry of the recording changes; this is the one that it begins with")
    return drawing


def _drawing(shape: BaseGeometry, meters: float) -> Drawing:
    parts = list(shapely.get_parts(shape))
    lines = [shapely.get_coordinates(part) for part in flat_parts(shape) if part.geom_type == "LineString"]
    if len(lines) == len(flat_parts(shape)) and all(len(line) and np.isfinite(line).all() for line in lines):
        return _outlined(lines, meters)
    if len(parts) < len(_COLLECTIONS) or any(part.geom_type != "GeometryCollection" for part in parts):
        return Drawing(walkable=[shape])
    drawing = Drawing(walkable=[parts[0]])
    for role, collection in zip(_COLLECTIONS[1:], parts[1:], strict=False):
        for one in shapely.get_parts(collection):
            for part in shapely.get_parts(one) if one.geom_type.startswith("Multi") else [one]:
                drawing.add(role, "", part)
    drawing.notes.append(
        f"read as JuPedSim's converter writes plans: a walkable area, {counted(len(drawing.exits), 'exit', 'exits')}, "
        f"{counted(len(drawing.starts), 'area', 'areas')} to start in"
    )
    return drawing


def _outlined(lines: Sequence[Floats], meters: float) -> Drawing:
    """Return what lines (K, 2) each enclose.

    Raises
    ------
    ValueError
        If they enclose nothing.
    """
    found = enclosed(lines, GAP / meters)
    longest = max(found.open, key=lambda line: line.length, default=None)
    if not found.areas:
        where = "" if longest is None else f", {open_line(longest, meters)}"
        raise ValueError(f"its LineStrings enclose no area{where}; a floor is a POLYGON, or lines that close")
    drawing = Drawing(walkable=list(found.areas))
    drawing.notes.append(f"{counted(len(lines), 'line', 'lines')} taken as outlines of the floor")
    if longest is not None:
        left = counted(len(found.open), "line that encloses nothing", "lines that enclose nothing")
        drawing.notes.append(f"left out: {left}; of the longest {open_line(longest, meters)}")
    return drawing
