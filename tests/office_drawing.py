"""A foreign drawing: two rooms in mm, a gap of 0.9 m between them, layers whose names mean nothing to us, and no exit."""

from pathlib import Path

LAYERS = {"walkable": ["A-AREA"], "obstacles": ["A-WALL", "A-FURN"]}
EXIT = [[10.3, 2.0], [10.3, 3.2]]
_WALLS = [(0, 0, 10.4, 0.2), (0, 6.2, 10.4, 6.4), (0, 0.2, 0.2, 6.2), (5, 0.2, 5.2, 2.5), (5, 3.4, 5.2, 6.2)]
_WALLS += [(10.2, 0.2, 10.4, 2.0), (10.2, 3.2, 10.4, 6.2)]
AREA = 10.1 * 6.0 - 0.2 * 5.1 - 0.1 * 4.8 - 1.0  # m2, without walls and the table


def draw_office(path: Path) -> Path:
    import ezdxf

    document = ezdxf.new()
    document.header["$INSUNITS"] = 4
    drawn = [("A-AREA", (0.2, 0.2, 10.3, 6.2)), *(("A-WALL", box) for box in _WALLS), ("A-FURN", (2, 2, 3, 3))]
    for layer, box in drawn:
        x0, y0, x1, y1 = (1000.0 * number for number in box)
        corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
        document.modelspace().add_lwpolyline(corners, close=True, dxfattribs={"layer": layer})
    document.saveas(path)
    return path
