"""Floor plans as others draw them: well-known text of every oddity, features, and drawings made by ezdxf."""

import json
from dataclasses import dataclass

import numpy as np
import shapely

ROOM = shapely.box(0, 0, 8, 6)
HALL = shapely.union_all([shapely.box(0, 0, 20, 2), *(shapely.box(4 * k + 0.1, 2.1, 4 * k + 4, 7) for k in range(5))])
DOORS = shapely.union_all([shapely.box(4 * k + 1, 2, 4 * k + 2, 2.1) for k in range(5)])
OFFICE = shapely.union_all([HALL, DOORS])
EAST = "8,2,8,3.2"


@dataclass(frozen=True)
class Odd:
    """A plan with something odd: the text, an exit, the area that is walkable [m^2] and what a note must say."""

    text: str
    exit: str
    area: float
    note: str = ""


def far(shape, x=5_652_107.0, y=4_471_223.0):
    return shapely.affinity.translate(shape, x, y)


def spiky(ring):
    """Return a ring with a spike of no width: out along a line and back."""
    points = shapely.get_coordinates(ring).tolist()
    return [points[0], points[1], [points[1][0] + 1.5, points[1][1]], points[1], *points[2:]]


def wavy(corners):
    angle = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    radius = 8.0 + 0.2 * np.sin(9 * angle)
    return shapely.Polygon(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]))


def text3d(shape):
    return shapely.to_wkt(shapely.force_3d(shape, 3.5), output_dimension=3)


ROUND = "POLYGON ((6 -1, 10 -1, 10 1, 6 1, 6 -1))"  # an exit across the edge of a round plan
WAVY = wavy(400)
FINE = wavy(40_000)
SLIVER = shapely.box(8, 4, 8.001, 5)
TWICE = shapely.get_coordinates(ROOM).repeat(2, axis=0)

ODD: dict[str, Odd] = {
    "a room": Odd(ROOM.wkt, EAST, 48.0),
    "offices": Odd(OFFICE.wkt, "20,0.4,20,1.6", OFFICE.area),
    "a collection": Odd(f"GEOMETRYCOLLECTION ({OFFICE.wkt})", "20,0.4,20,1.6", OFFICE.area),
    "UTM": Odd(far(ROOM).wkt, "5652115,4471225,5652115,4471226.2", 48.0),
    "400 corners": Odd(WAVY.wkt, ROUND, WAVY.difference(shapely.from_wkt(ROUND)).area),
    "40000 corners": Odd(FINE.wkt, ROUND, WAVY.difference(shapely.from_wkt(ROUND)).area, "simplified"),
    "a sliver": Odd(shapely.MultiPolygon([ROOM, far(SLIVER, 1, 0)]).wkt, EAST, 48.0, "left out 1 sliver"),
    "a spike": Odd(shapely.Polygon(spiky(ROOM.exterior)).wkt, EAST, 48.0, "mended 1 outline that runs along itself"),
    "a thin spike": Odd(shapely.union(ROOM, shapely.box(8, 4, 9, 4.002)).wkt, EAST, 48.002),
    "doubled points": Odd(shapely.Polygon(TWICE).wkt, EAST, 48.0),
    "3D": Odd(text3d(ROOM), EAST, 48.0),
    "touching parts": Odd(shapely.MultiPolygon([ROOM, shapely.box(8, 2, 10, 4)]).wkt, "10,2,10,3.2", 52.0),
    "1 mm apart": Odd(shapely.MultiPolygon([ROOM, shapely.box(8.001, 2, 10, 4)]).wkt, "10,2,10,3.2", 52.0, "joined 1 mm"),
    "a door 1 mm short": Odd(
        shapely.MultiPolygon([ROOM, shapely.box(8, 2, 8.199, 3), shapely.box(8.2, 0, 12, 6)]).wkt,
        "12,2,12,3.2", 48 + 0.2 + 3.8 * 6, "joined 1 mm",
    ),
    "a detached shaft": Odd(shapely.MultiPolygon([ROOM, shapely.box(10, 0, 12, 2)]).wkt, EAST, 48.0, "a part of 4 m2 left out"),
    "a locked room": Odd(
        ROOM.difference(shapely.box(2, 2, 5, 5)).union(shapely.box(2.2, 2.2, 4.8, 4.8)).wkt,
        EAST, 39.0, "a part of 6.76 m2 left out",
    ),
    "a slit too narrow": Odd(
        shapely.union_all([ROOM, shapely.box(8.2, 0, 10, 6), shapely.box(8, 4, 8.2, 4.25)]).wkt,
        EAST, 48.05, "no exit can be reached from a part left out",
    ),
    "an exit 2 cm inside": Odd(ROOM.wkt, "7.98,2,7.98,3.2", 48.0, "0.02 m off the boundary moved"),
    "an exit 10 cm outside": Odd(ROOM.wkt, "8.1,2,8.1,3.2", 48.0, "0.10 m off the boundary moved"),
    "an area to leave into": Odd(ROOM.wkt, "POLYGON ((3 2, 4 2, 4 3, 3 3, 3 2))", 47.0),
    "JuPedSim's converter": Odd(
        f"GEOMETRYCOLLECTION (GEOMETRYCOLLECTION ({ROOM.wkt}), GEOMETRYCOLLECTION (POLYGON ((7 2, 7.5 2, 7.5 3, 7 3, 7 2))), "
        "GEOMETRYCOLLECTION (POLYGON ((1 1, 4 1, 4 4, 1 4, 1 1))))",
        "", 47.5, "1 exit, 1 area to start in",
    ),
}  # fmt: skip


def drawing(unit=0):
    """Return a new DXF document and its model space; ``unit`` is what its header says ($INSUNITS)."""
    import ezdxf

    document = ezdxf.new(units=unit)
    return document, document.modelspace()


def outline(space, points, layer, *, close=True):
    space.add_lwpolyline(points, close=close, dxfattribs={"layer": layer})


def box_of(space, x0, y0, x1, y1, layer):
    outline(space, [(x0, y0), (x1, y0), (x1, y1), (x0, y1)], layer)


def room_drawing(path, unit=0, scale=1.0, exits="jps-exits"):
    """Write a room of 8 m x 6 m (times ``scale``) with an exit in its east wall."""
    document, space = drawing(unit)
    box_of(space, 0, 0, 8 * scale, 6 * scale, "walkablearea")
    space.add_line((8 * scale, 2 * scale), (8 * scale, 3.2 * scale), dxfattribs={"layer": exits})
    document.saveas(path)
    return path


def feature(shape, **properties):
    return {"type": "Feature", "properties": properties, "geometry": shapely.geometry.mapping(shape)}


def geojson(path, *features, **others):
    path.write_text(json.dumps({"type": "FeatureCollection", "features": list(features), **others}))
    return path
