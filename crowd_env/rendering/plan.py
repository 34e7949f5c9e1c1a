"""The still part of a frame: where meters lie on the image, and the floor, walls, obstacles and exits on it."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowd_env.core.arrays.state import Floats
from crowd_env.geometry.geometry import Geometry
from crowd_env.rendering.palette import BACKGROUND, EXIT, EXIT_MAT, FLOOR, OBSTACLE, WALL, Color
from crowd_env.rendering.text import Image

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


def draw_plan(geometry: Geometry, layout: Layout, samples: int = 4) -> Image:
    """Return the image (H, W, 3) of the empty geometry; ``samples`` a pixel along each axis are averaged."""
    image = np.empty((layout.height, layout.width, 3), dtype=np.uint8)
    image[:] = BACKGROUND

    def fill(rings: Iterable[ArrayLike], color: Color) -> None:
        _fill(image, [layout.pixels(ring) for ring in rings], color, samples)

    pixel = 1.0 / layout.scale
    with_walls: Any = geometry.walkable.buffer(layout.wall * pixel, join_style="mitre")
    fill(holes_of(with_walls), OBSTACLE)
    fill([*shells_of(with_walls), *holes_of(with_walls)], WALL)
    for hole in exit_areas(geometry):
        fill([hole], EXIT_MAT)
    for a, b in geometry.exits:
        fill([_strip(a, b, 0.0, (layout.wall + MAT * layout.margin) * pixel)], EXIT_MAT)
    fill([*shells_of(geometry.walkable), *holes_of(geometry.walkable)], FLOOR)
    line = float(np.clip(0.35 * layout.wall, 2.0, 4.0)) * pixel
    for a, b in geometry.exits:
        fill([_strip(a, b, 0.0, line)], EXIT)
    half = 0.5 * max(_THIN_WALL, 2.0 * pixel)
    for a, b in geometry.walls[geometry.two_sided]:
        along = half * (b - a) / np.linalg.norm(b - a)
        fill([_strip(a - along, b + along, -half, half)], WALL)
    return image


def _fill(image: Image, rings: Sequence[Floats], color: Color, samples: int) -> None:
    """Fill what lies within an odd number of closed lines (K, 2) [px], each pixel as far as it is covered."""
    if not rings:
        return
    points = np.concatenate(rings)
    left, top = np.maximum(np.floor(points.min(axis=0)).astype(int), 0)
    right, bottom = np.minimum(np.ceil(points.max(axis=0)).astype(int), (image.shape[1], image.shape[0]))
    if right <= left or bottom <= top:
        return
    rows, columns = (bottom - top) * samples, (right - left) * samples
    crossings = np.zeros((rows, columns + 1), dtype=np.int32)
    for ring in rings:
        ends = (ring - (left, top)) * samples
        for (x0, y0), (x1, y1) in zip(ends, np.roll(ends, -1, axis=0), strict=True):
            upper, lower = np.clip(np.ceil(np.sort([y0, y1]) - 0.5), 0, rows).astype(int)
            row = np.arange(upper, lower)  # whose middle the edge passes
            if len(row):
                x = x0 + (row + 0.5 - y0) * (x1 - x0) / (y1 - y0)
                crossings[row, np.clip(np.ceil(x - 0.5), 0, columns).astype(int)] += 1
    inside = np.cumsum(crossings[:, :-1], axis=1) % 2
    cover = inside.reshape(bottom - top, samples, right - left, samples).mean(axis=(1, 3))[..., None]
    patch = image[top:bottom, left:right]
    patch[:] = np.rint(patch + (np.asarray(color) - patch) * cover).astype(np.uint8)


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
    power = float(10.0 ** np.floor(np.log10(most)))
    return power * max(step for step in (1, 2, 5) if step * power <= most)


def exit_areas(geometry: Geometry) -> Iterator[Floats]:
    """Yield the holes (K, 2) [m] of the walkable area that are exits all around: people walk into them."""
    exits = {tuple(point) for point in geometry.exits.reshape(-1, 2)}
    for hole in holes_of(geometry.walkable):
        if all(tuple(point) in exits for point in hole):
            yield hole


def _strip(a: NDArray[np.float64], b: NDArray[np.float64], near: float, far: float) -> Floats:
    """Return the corners (4, 2) of the strip ``near`` to ``far`` outside of the segment; its inside is to the left."""
    along = (b - a) / np.linalg.norm(b - a)
    outward = np.array([along[1], -along[0]])
    return np.array([a + near * outward, b + near * outward, b + far * outward, a + far * outward])
