"""Plans that cannot be used: one sentence that says what is wrong and where, exit code 2, no result, nothing written."""

import json
import sqlite3
import sys

import numpy as np
import pytest
import shapely
from cases import looped
from plan_files import EAST, ROOM, box_of, drawing, outline, room_drawing
from typer.testing import CliRunner

from crowd_env.cli.main import app

pytestmark = pytest.mark.more

DOOR = ["--exit", EAST]
SHELL = [[[0, 0], [8, 0], [8, 6], [0, 6], [0, 0]]]
VADERE = {"attributes": {"bounds": {"x": 0, "y": 0, "width": 9, "height": 7}}, "obstacles": [], "targets": []}


def written(text):
    return lambda path: path.write_bytes(text if isinstance(text, bytes) else text.encode())


def truncated(make, share):
    def write(path):
        make(path)
        data = path.read_bytes()
        path.write_bytes(data[: int(share * len(data))])

    return write


def drawn(*draw, unit=0):
    def write(path):
        document, space = drawing(unit)
        for one in draw:
            one(space)
        document.saveas(path)

    return write


def box(*corners):
    return lambda space: box_of(space, *corners)


def line(points, layer, *, close=True):
    return lambda space: outline(space, points, layer, close=close)


def nested(space):
    """Draw blocks in blocks, ten of each, seven deep: ten million boxes."""
    blocks = space.doc.blocks
    box_of(blocks.new("B0"), 0, 0, 1, 1, "obstacles")
    for level in range(1, 8):
        block = blocks.new(f"B{level}")
        for k in range(10):
            block.add_blockref(f"B{level - 1}", (k, level))
    space.add_blockref("B7", (0, 0))


def base(*statements):
    def write(path):
        with sqlite3.connect(path) as connection:
            for statement in statements:
                connection.execute(statement)
        connection.close()

    return write


def topography(**changes):
    return written(json.dumps({"scenario": {"topography": {**VADERE, **changes}}}))


def noisy(path):
    """Write an outline of a million corners, each of them some centimeters off the line of its neighbors."""
    angle = np.linspace(0, 2 * np.pi, 1_000_000, endpoint=False)
    radius = 20 + 0.2 * np.random.default_rng(0).random(len(angle))
    ring = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    path.write_text(shapely.to_wkt(shapely.Polygon(ring), rounding_precision=6))


def device(path):
    path.symlink_to("/dev/zero")


def huge(path):
    with path.open("wb") as file:
        file.write(b"POLYGON ((")
        file.truncate(70_000_000)


FLOOR = box(0, 0, 8, 6, "walkablearea")
HOLE = {"type": "RECTANGLE", "x": 1, "y": 1}

# name: (what writes it, options of the command, words that must be said)
BAD = {
    "empty.dxf": (written(""), DOOR, "not a DXF file"),
    "noise.dxf": (written(bytes(range(256)) * 20), DOOR, "not a DXF file"),
    "half.dxf": (truncated(lambda path: room_drawing(path), 0.5), DOOR, "DXF not whole save"),
    "text.dxf": (written(ROOM.wkt), DOOR, "not a DXF file"),
    "image.dxf": (written(b"\x89PNG\r\n\x1a\n" + bytes(9)), DOOR, "not a DXF file"),
    "drawing.dwg": (written(b"AC1027" + bytes(99)), DOOR, "DWG WKT GeoJSON DXF"),
    "broken.dxf": (written("0\nSECTION\n2\nENTITIES\n0\nLINE\n8\nwalls\n10\nhere\n0\nENDSEC\n0\nEOF\n"), DOOR, "damaged save"),
    "nothing.dxf": (drawn(), DOOR, "where people walk jps-walkablearea"),
    "layers.dxf": (drawn(box(0, 0, 8, 6, "A-WALL")), DOOR, "jps-walkablearea layers"),
    "open.dxf": (drawn(line([(0, 0), (8, 0), (8, 6), (0, 6)], "walkablearea", close=False)), DOOR, "not closed (0, 6) 6 m"),
    "bow.dxf": (drawn(line([(0, 0), (8, 6), (8, 0), (0, 6)], "walkablearea")), DOOR, "self-intersection (4, 3)"),
    "far_exit.dxf": (drawn(FLOOR, line([(9, 2), (9, 3)], "jps-exits", close=False)), [], "'exit-0' boundary 1 m"),
    "no_exit.dxf": (drawn(FLOOR), [], "at least one exit --exit"),
    "full.dxf": (drawn(FLOOR, box(-1, -1, 9, 9, "obstacles")), DOOR, "obstacles leave no walkable area"),
    "blocks.dxf": (drawn(FLOOR, nested), DOOR, "more than 50000 things blocks"),
    "closed.dxf": (
        drawn(FLOOR, box(4, 0, 4.2, 6, "obstacles"), box(1, 1, 3, 3, "jps-distributions")), DOOR, "start-0 no exit reaches",
    ),
    "mm.dxf": (lambda path: room_drawing(path, 0, 1000.0), [], "8000 m mm --unit"),
    "empty.geojson": (written(""), DOOR, "no whole JSON"),
    "half.geojson": (written('{"type": "FeatureCollection", "features": [{"type"'), DOOR, "no whole JSON line 1"),
    "list.geojson": (written("[1, 2]"), DOOR, "FeatureCollection"),
    "none.geojson": (written('{"type": "FeatureCollection", "features": []}'), DOOR, "no features"),
    "odd.geojson": (written('{"type": "FeatureCollection", "features": 3}'), DOOR, "list of features"),
    "wrong.geojson": (written('{"type": "Polygon", "coordinates": [[0, 1]]}'), DOOR, "features[0] wrong"),
    "open.geojson": (written(json.dumps({"type": "Polygon", "coordinates": [[[0, 0], [1, 0]]]})), DOOR, "features[0]"),
    "nan.geojson": (written('{"type": "Polygon", "coordinates": [[[0, 0], [NaN, 0], [8, 6], [0, 0]]]}'), DOOR, "finite"),
    "point.geojson": (written('{"type": "Point", "coordinates": [0, 0]}'), DOOR, "no area walk"),
    "deep.geojson": (written('{"type": "Polygon", "coordinates": ' + "[" * 200000), DOOR, "deeply"),
    "empty.sqlite": (written(""), DOOR, "table 'geometry' none"),
    "noise.sqlite": (written(b"SQLite format 3\x00" + bytes(200)), DOOR, "cannot be read"),
    "text.sqlite": (written("no database"), DOOR, "cannot be read JuPedSim"),
    "other.sqlite": (base("CREATE TABLE people(id INTEGER)"), DOOR, "geometry people"),
    "bare.sqlite": (base("CREATE TABLE geometry(wkt TEXT)"), DOOR, "no well-known text"),
    "number.sqlite": (base("CREATE TABLE geometry(wkt TEXT)", "INSERT INTO geometry VALUES (x'00')"), DOOR, "well-known text"),
    "bow.sqlite": (
        base("CREATE TABLE geometry(wkt TEXT)", "INSERT INTO geometry VALUES ('POLYGON ((0 0, 8 6, 8 0, 0 6, 0 0))')"),
        DOOR, "self-intersection",
    ),
    "column.sqlite": (base("CREATE TABLE geometry(text TEXT)"), DOOR, "cannot be read wkt"),
    "empty.scenario": (written(""), DOOR, "no whole JSON"),
    "other.scenario": (written("{}"), DOOR, "Vadere topography"),
    "bare.scenario": (topography(), [], "at least one exit"),
    "small.scenario": (topography(attributes={"bounds": {"x": 0, "y": 0, "width": 1, "height": 9}}), [], "bounds frame"),
    "bounds.scenario": (topography(attributes={}), [], "topography bounds"),
    "shape.scenario": (topography(targets=[{"id": 2, "shape": {"type": "ARC"}}]), [], "target 2 ARC RECTANGLE"),
    "key.scenario": (topography(obstacles=[{"id": 7, "shape": HOLE}]), [], "topography width"),
    "word.scenario": (topography(obstacles=[{"id": 7, "shape": {**HOLE, "width": "a", "height": 1}}]), [], "obstacle 7 width"),
    "list.scenario": (written('{"scenario": {"topography": [1]}}'), [], "topography"),
    "plan.pdf": (written(b"%PDF-1.7"), DOOR, "PDF WKT GeoJSON DXF scenario"),
    "plan.svg": (written("<svg></svg>"), DOOR, "XML GeoJSON DXF"),
    "plan.ifc": (written("ISO-10303-21;"), DOOR, "IFC GeoJSON DXF"),
    "plan.txt": (written("a room"), DOOR, "not well-known text"),
    "million.wkt": (noisy, ["--exit", "POLYGON ((17 -1, 22 -1, 22 1, 17 1, 17 -1))"], "1000001 corners 20000 simplify QGIS"),
    "huge.wkt": (huge, DOOR, "70 MB 60"),
    "deep.wkt": (written("GEOMETRYCOLLECTION(" * 30_000), DOOR, "nested too deeply"),
    "deep.sqlite": (
        base("CREATE TABLE geometry(wkt TEXT)", f"INSERT INTO geometry VALUES ('{'GEOMETRYCOLLECTION(' * 30_000}')"),
        DOOR, "nested too deeply",
    ),
    "zero.wkt": (device, DOOR, "no regular file"),
    "zero": (device, DOOR, "no regular file"),
    "zero.toml": (device, [], "no regular file"),
    "texts.geojson": (
        written('{"type": "Polygon", "coordinates": [[["0", 0], [5, 0], [5, 5], ["0", 0]]]}'), DOOR, "coordinate text numbers",
    ),
}  # fmt: skip


@looped("name", BAD)
def test_it_is_refused_in_one_sentence(name, tmp_path, monkeypatch):
    write, options, words = BAD[name]
    folder = tmp_path / name.replace(".", "-")
    folder.mkdir()
    write(folder / name)
    monkeypatch.chdir(folder)
    result = CliRunner().invoke(app, ["run", name, *options, "--runs", "1"])
    assert result.exit_code == 2, f"{result.output} {result.exception!r}"
    assert result.stdout == ""
    said = result.stderr.splitlines()
    assert said[-1].startswith("error: ") and all(one.startswith("note: ") for one in said[:-1]), result.stderr
    assert len(said[-1]) < 500 and name in said[-1]
    for word in words.split():
        assert word in said[-1], f"{word!r} is not in {said[-1]!r}"
    assert [path.name for path in folder.iterdir()] == [name]


def test_a_library_that_is_missing_is_named(tmp_path, monkeypatch):
    room_drawing(tmp_path / "room.dxf")
    for name in ("ezdxf", "ezdxf.filemanagement"):
        monkeypatch.setitem(sys.modules, name, None)
    result = CliRunner().invoke(app, ["run", str(tmp_path / "room.dxf")])
    assert result.exit_code == 2 and "needs ezdxf" in result.stderr and "pip install ezdxf" in result.stderr
