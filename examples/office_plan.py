"""Draw the plan of an office as a CAD program would, on the layers that JuPedSim reads: python examples/office_plan.py."""

from pathlib import Path

import ezdxf

OFFICE = Path(__file__).with_name("office.dxf")
WALL = 0.12  # m
ROOM, DEPTH, CORRIDOR, DOOR = 4.0, 5.0, 2.0, 0.9  # m
ROOMS = 5
LENGTH = ROOMS * ROOM
DESK = (1.6, 0.8)  # m


def main(path: Path = OFFICE) -> None:
    """Draw ten rooms along a corridor with a door at each end."""
    drawing = ezdxf.new(units=ezdxf.units.M)
    for name in ("jps-walkablearea", "jps-obstacles", "jps-exits-west", "jps-exits-east", "jps-distributions-offices"):
        drawing.layers.add(name)
    space = drawing.modelspace()
    south, north = -DEPTH - WALL, CORRIDOR + WALL
    outline = [(0, south), (LENGTH, south), (LENGTH, north + DEPTH), (0, north + DEPTH)]
    space.add_lwpolyline(outline, close=True, dxfattribs={"layer": "jps-walkablearea"})

    def box(x0: float, y0: float, x1: float, y1: float, layer: str) -> None:
        space.add_lwpolyline([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], close=True, dxfattribs={"layer": layer})

    for low, high in ((-WALL, 0.0), (CORRIDOR, CORRIDOR + WALL)):
        ends = [0.0, *(x for k in range(ROOMS) for x in (k * ROOM + 0.5, k * ROOM + 0.5 + DOOR)), LENGTH]
        for x0, x1 in zip(ends[::2], ends[1::2], strict=True):
            box(x0, low, x1, high, "jps-obstacles")
    for k in range(1, ROOMS):
        x0, x1 = k * ROOM - 0.5 * WALL, k * ROOM + 0.5 * WALL
        box(x0, south, x1, -WALL, "jps-obstacles")
        box(x0, CORRIDOR + WALL, x1, north + DEPTH, "jps-obstacles")
    space.add_circle((0.5 * LENGTH, 0.5 * CORRIDOR), 0.15, dxfattribs={"layer": "jps-obstacles"})

    desk = drawing.blocks.new("DESK")
    width, depth = DESK
    desk.add_lwpolyline([(0, 0), (width, 0), (width, depth), (0, depth)], close=True, dxfattribs={"layer": "0"})
    for k in range(ROOMS):
        for y in (-3.5, CORRIDOR + 2.7):
            space.add_blockref("DESK", (k * ROOM + 1.8, y), dxfattribs={"layer": "jps-obstacles"})
    for y0, y1 in ((south, -WALL), (CORRIDOR + WALL, north + DEPTH)):
        for k in range(ROOMS):
            box(k * ROOM + 0.1, y0 + 0.1, (k + 1) * ROOM - 0.1, y1 - 0.1, "jps-distributions-offices")
    # The doors are drawn in the middle of outer walls of 20 cm, as they are in most drawings.
    space.add_line((-0.1, 0.4), (-0.1, 1.6), dxfattribs={"layer": "jps-exits-west"})
    space.add_line((LENGTH + 0.1, 0.4), (LENGTH + 0.1, 1.6), dxfattribs={"layer": "jps-exits-east"})
    drawing.saveas(path)


if __name__ == "__main__":
    main()
