"""Floor plans in well-known text (WKT), alone and as the geometry of JuPedSim's SQLite files."""

import sqlite3
from contextlib import closing
from pathlib import Path
from urllib.parse import quote

import shapely
from shapely.geometry.base import BaseGeometry

from crowd_env.core.checks import counted
from crowd_env.core.files.foreign import read_text
from crowd_env.geometry.parsing import from_wkt
from crowd_env.scenarios.plans.floor_plan import Drawing

_READ = (
    "a floor plan in this file must be well-known text (WKT), e.g. POLYGON ((0 0, 5 0, 5 5, 0 5, 0 0)); GeoJSON, DXF, "
    "SQLite and scenario files have suffixes of their own"
)
# Output of JuPedSim's converter of DXF files: a collection of one collection each.
_COLLECTIONS = ("walkable", "exit", "start")


def read_wkt(path: Path, meters: float | None) -> Drawing:
    """Read a POLYGON, MULTIPOLYGON or GEOMETRYCOLLECTION, or the collections that JuPedSim's converter of DXF files writes."""
    return _drawing(from_wkt(read_text(path, "the floor plan", _READ), "walkable area"))


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
    drawing = _drawing(from_wkt(texts[0], "walkable area"))
    if changes:
        drawing.notes.append("the geometry of the recording changes; this is the one that it begins with")
    return drawing


def _drawing(shape: BaseGeometry) -> Drawing:
    parts = list(shapely.get_parts(shape))
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
