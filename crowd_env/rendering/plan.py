"""The still part of a frame: where meters lie on the image, and the floor, walls, obstacles and exits on it."""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from crowd_env.core.arrays.state import Floats
from crowd_env.geometry.geometry import Geometry
from crowd_env.geometry.sheets import GAP, Building
from crowd_env.rendering.libraries import Image, drawing_library
from crowd_env.rendering.palette import BACKGROUND, EXIT, EXIT_MAT, FLOOR, INK, OBSTACLE, QUIET, SEAM, WALL, Color
from crowd_env.rendering.text import put_text, shortened

_WALL_THICKNESS = 0.11  # m, as drawn; walls of the model have none
_THIN_WALL = 0.04  # m, walls that are touched from both sides
MAT = 0.3  # of the margin, how far the mat of an exit reaches beyond the wall


class Layout(NamedTuple):
    """Where things are on an image; y of meters points up, y of pixels down."""

    width: int  # px   even, as video encoders want it
    height: int  # px   even
    scale: float  # px/m
    origin: tuple[float, float]  # px   where (0, 0) m lies
    wall: float  # px   thickness of a wall
    text: float  # px   size of letters
    margin: int  # px
    header: int  # px   height of the line of text above the plan
    footer: int  # px   height of the line below it

    def pixels(self, points: ArrayLike) -> Floats:
        """Return where ``points`` (..., 2) [m] lie on the image [px]."""
        return np.asarray(points, dtype=np.float64) * (self.scale, -self.scale) + self.origin


def fit(geometry: Geometry, width: int, *, text: float | None = None) -> Layout:
    """Return the layout of a frame ``width`` px wide; the height follows, but is at most about the width.

    Where there are several exits, there is room for their names around the plan.
    """
    width = max(2 * round(width / 2), 160)
    text = text or float(np.clip(width / 42.0, 10.0, 20.0))
    header, footer = round(2.6 * text), round(2.4 * text)
    min_x, min_y, max_x, max_y = geometry.bounds
    span_x, span_y = max(max_x - min_x, 1e-6), max(max_y - min_y, 1e-6)
    margin = round(0.03 * width)
    band = round(0.9 * text) if len(set(geometry.exit_names)) > 1 else 0
    room = width - 2 * (margin + band)
    thick = _WALL_THICKNESS * room / max(span_x + 2 * _WALL_THICKNESS, span_y + 2 * _WALL_THICKNESS)
    wall = float(max(round(min(thick, 0.02 * width)), 3))
    scale = min((room - 2 * wall) / span_x, (room - 2 * wall) / span_y)
    scale = max(np.floor(scale * span_x), 1.0) / span_x  # a room's walls begin where pixels do
    plan_height = scale * span_y + 2 * wall
    height = 2 * round(0.5 * (header + plan_height + 2 * band + footer))
    origin_x = round(0.5 * (width - scale * span_x)) - scale * min_x
    origin_y = header + band + wall + scale * max_y
    return Layout(width, height, scale, (origin_x, origin_y), wall, text, margin, header, footer)


def draw_plan(geometry: Geometry, layout: Layout) -> Image:
    """Return the image of the empty geometry."""
    with drawing_library():
        import PIL.Image
    image = PIL.Image.new("RGB", (layout.width, layout.height), BACKGROUND)
    fill, pixel = partial(_fill, image, layout), 1.0 / layout.scale
    with_walls: Any = geometry.walkable.buffer(layout.wall * pixel, join_style="mitre")
    fill([[hole] for hole in holes_of(with_walls)], OBSTACLE)
    fill(_rings(with_walls), WALL)
    deep = (layout.wall + MAT * layout.margin) * pixel
    mats = [*exit_areas(geometry), *(_strip(a, b, 0.0, deep) for a, b in geometry.exits)]
    fill([[mat] for mat in mats], EXIT_MAT)
    fill(_rings(geometry.walkable), FLOOR)
    line = float(np.clip(0.35 * layout.wall, 2.0, 4.0)) * pixel
    if geometry.building is not None:
        fill([[_strip(a, b, 0.0, layout.wall * pixel)] for a, b in geometry.building.lines], SEAM)
        _name_sheets(image, geometry.building, layout)
    fill([[_strip(a, b, 0.0, line)] for a, b in geometry.exits], EXIT)
    half = 0.5 * max(_THIN_WALL, 2.0 * pixel)
    thin = geometry.walls[geometry.two_sided]
    along = half * (thin[:, 1] - thin[:, 0]) / np.linalg.norm(thin[:, 1] - thin[:, 0], axis=1)[:, None]
    fill([[_strip(a - d, b + d, -half, half)] for (a, b), d in zip(thin, along, strict=True)], WALL)
    return image


def label_sheets(building: Building) -> Iterator[tuple[str, Floats, float]]:
    """Yield the title of each sheet, its lower left corner (2,) in the layout [m], and how much room there is for it [m]."""
    for sheet in building.sheets:
        x0, y0, x1, _ = sheet.area.bounds
        yield sheet.title, np.add((x0, y0), sheet.offset), x1 - x0 + GAP


def label_seams(building: Building) -> Iterator[tuple[str, Floats, Floats]]:
    """Yield the letter of each seam line, the same at both ends, the middle (2,) of the line [m], and what way (2,) is out."""
    for letter, (a, b) in zip(building.letters, building.lines, strict=True):
        yield letter, 0.5 * (a + b), _outward(a, b)


def _name_sheets(image: Image, building: Building, layout: Layout) -> None:
    size = 0.65 * layout.text
    for name, corner, room in label_sheets(building):
        x, y = layout.pixels(corner).tolist()
        put_text(image, shortened(name, room * layout.scale, size), (x, y + layout.wall + 0.7 * size), size, QUIET)
    for letter, middle, outward in label_seams(building):
        x, y = layout.pixels(middle) + (layout.wall + 0.7 * size) * outward * (1.0, -1.0)
        put_text(image, letter, (x, y), size, INK, side="center", bold=True)


def _fill(image: Image, layout: Layout, shapes: Sequence[Sequence[Floats]], color: Color) -> None:
    """Fill polygons, each a border (K, 2) [m] and the borders of its holes; a pixel as far as it is covered.

    What lies in a hole comes later.
    """
    import PIL.Image
    import PIL.ImageDraw

    if not shapes:
        return
    fine = 4 if max(image.size) <= 1400 else 2
    mask = PIL.Image.new("L", (fine * image.width, fine * image.height))
    draw = PIL.ImageDraw.Draw(mask)
    for shape in shapes:
        for k, ring in enumerate(shape):
            draw.polygon((fine * layout.pixels(ring) - 0.5).ravel().tolist(), fill=0 if k else 255)
    image.paste(color, None, mask.reduce(fine))


def _rings(area: Any) -> list[list[Floats]]:
    """Return the outer border (K, 2) [m] and the borders of the holes of each polygon, the largest first."""
    parts = sorted(polygons_of(area), key=lambda part: -float(part.area))
    return [[*shells_of(part), *holes_of(part)] for part in parts]


def polygons_of(area: Any) -> list[Any]:
    """Return the polygons of a shapely shape."""
    parts = getattr(area, "geoms", [area])
    return [part for part in parts if part.geom_type == "Polygon" and not part.is_empty]


def shells_of(area: Any) -> list[Floats]:
    """Return the outer borders (K, 2) [m] of the polygons of a shapely shape."""
    return [np.asarray(part.exterior.coords)[:, :2] for part in polygons_of(area)]


def holes_of(area: Any) -> list[Floats]:
    """Return the borders (K, 2) [m] of the holes in the polygons of a shapely shape."""
    return [np.asarray(ring.coords)[:, :2] for part in polygons_of(area) for ring in part.interiors]


def round_length(most: float) -> float:
    """Return the largest length of 1, 2 or 5 times a power of ten that is no longer than ``most``: for scale bars."""
    power = float(10.0 ** np.floor(np.log10(most) + 1e-9))
    return power * max(step for step in (1, 2, 5) if step * power <= most * (1.0 + 1e-9))


def exit_places(geometry: Geometry) -> dict[str, tuple[Floats, Floats]]:
    """Return for each exit the middle (2,) [m] of its longest line, and which way (2,) is out there."""
    longest: dict[str, Floats] = {}
    for name, line in zip(geometry.exit_names, geometry.exits, strict=True):
        longest[name] = max(longest.get(name, line), line, key=lambda one: float(np.hypot(*(one[1] - one[0]))))
    return {name: (0.5 * (a + b), _outward(a, b)) for name, (a, b) in longest.items()}


def exit_areas(geometry: Geometry) -> Iterator[Floats]:
    """Yield the holes (K, 2) [m] of the walkable area that are exits all around: people walk into them."""
    exits = {tuple(point) for point in geometry.exits.reshape(-1, 2)}
    for hole in holes_of(geometry.walkable):
        if all(tuple(point) in exits for point in hole):
            yield hole


def _strip(a: Floats, b: Floats, near: float, far: float) -> Floats:
    """Return the corners (4, 2) of the strip ``near`` to ``far`` outside of the segment; its inside is to the left."""
    outward = _outward(a, b)
    return np.array([a + near * outward, b + near * outward, b + far * outward, a + far * outward])


def _outward(a: Floats, b: Floats) -> Floats:
    """Return the unit vector (2,) to the right of the way from ``a`` to ``b``: outwards, since what is inside lies left."""
    return np.array([b[1] - a[1], a[0] - b[0]]) / np.linalg.norm(b - a)
