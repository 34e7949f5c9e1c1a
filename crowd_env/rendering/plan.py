"""The still part of a frame: where metres lie on the image, and the floor, walls, obstacles and exits on it."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowd_env.geometry import Geometry
from crowd_env.rendering.libraries import drawing_library
from crowd_env.rendering.palette import BACKGROUND, EXIT, EXIT_MAT, FLOOR, OBSTACLE, WALL, Colour
from crowd_env.rendering.text import Image
from crowd_env.state import Floats

_WALL_THICKNESS = 0.11  # m, as drawn; walls of the model have none
_THIN_WALL = 0.04  # m, walls that are touched from both sides
_STEP = 0.3  # of the margin, how far the mat of an exit reaches beyond the wall


class Layout(NamedTuple):
    """Where things are on an image; y of metres points up, y of pixels down."""

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
    """Return the layout of a frame ``width`` px wide; the height follows, but is at most about the width."""
    width = max(2 * round(width / 2), 160)
    text = text or float(np.clip(width / 42.0, 10.0, 20.0))
    header, footer = round(2.6 * text), round(2.4 * text)
    min_x, min_y, max_x, max_y = geometry.bounds
    span_x, span_y = max(max_x - min_x, 1e-6), max(max_y - min_y, 1e-6)
    margin = round(0.03 * width)
    room = width - 2 * margin
    thick = _WALL_THICKNESS * room / max(span_x + 2 * _WALL_THICKNESS, span_y + 2 * _WALL_THICKNESS)
    wall = float(np.clip(thick, 2.5, 0.02 * width + 2.0))
    scale = min((room - 2 * wall) / span_x, (room - 2 * wall) / span_y)
    plan_height = scale * span_y + 2 * wall
    height = 2 * round(0.5 * (header + plan_height + footer))
    origin_x = 0.5 * width - 0.5 * scale * (min_x + max_x)
    origin_y = header + wall + scale * max_y
    return Layout(width, height, scale, (origin_x, origin_y), wall, text, margin, header, footer)


def draw_plan(geometry: Geometry, layout: Layout, supersample: int) -> Image:
    """Return the image (H, W, 3) of an empty place, drawn ``supersample`` times larger and averaged."""
    with drawing_library():
        import pygame
    surface = pygame.Surface((layout.width * supersample, layout.height * supersample), depth=32)
    surface.fill(BACKGROUND)

    def fill(points: ArrayLike, colour: Colour) -> None:
        corners = layout.pixels(points) * supersample - 0.5
        pygame.draw.polygon(surface, colour, [tuple(corner) for corner in corners])

    for ring, colour in _rings(geometry, layout.wall / layout.scale):
        fill(ring, colour)
    for hole in _exit_areas(geometry):
        fill(hole, EXIT_MAT)
    for a, b in geometry.exits:
        fill(_strip(a, b, 0.0, (layout.wall + _STEP * layout.margin) / layout.scale), EXIT_MAT)
    for a, b in geometry.exits:
        fill(_strip(a, b, 0.0, float(np.clip(0.35 * layout.wall, 2.0, 4.0)) / layout.scale), EXIT)
    half = 0.5 * max(_THIN_WALL, 2.0 / layout.scale)
    for a, b in geometry.walls[geometry.two_sided]:
        along = half * (b - a) / np.linalg.norm(b - a)
        fill(_strip(a - along, b + along, -half, half), WALL)
    small = pygame.transform.smoothscale(surface, (layout.width, layout.height))
    return np.ascontiguousarray(pygame.surfarray.array3d(small).swapaxes(0, 1))


def _rings(geometry: Geometry, thickness: float) -> Iterator[tuple[Floats, Colour]]:
    """Yield closed lines (K, 2) [m] and what fills them, from the outermost to the innermost."""
    rings: list[tuple[float, Floats, Colour]] = []

    def add(area: Any, shell: Colour, hole: Colour) -> None:
        for polygon in getattr(area, "geoms", [area]):
            for ring, colour in [(polygon.exterior, shell), *((ring, hole) for ring in polygon.interiors)]:
                points = np.asarray(ring.coords)[:, :2]
                rings.append((_enclosed(points), points, colour))

    add(geometry.walkable.buffer(thickness, join_style="mitre"), WALL, OBSTACLE)
    add(geometry.walkable, FLOOR, WALL)
    for _, points, colour in sorted(rings, key=lambda ring: -ring[0]):
        yield points, colour


def _exit_areas(geometry: Geometry) -> Iterator[Floats]:
    """Yield the holes (K, 2) [m] of the walkable area that are exits all around: people walk into them."""
    exits = {tuple(point) for point in geometry.exits.reshape(-1, 2)}
    area: Any = geometry.walkable
    for polygon in getattr(area, "geoms", [area]):
        for ring in polygon.interiors:
            if all(point[:2] in exits for point in ring.coords):
                yield np.asarray(ring.coords)[:, :2]


def _strip(a: NDArray[np.float64], b: NDArray[np.float64], near: float, far: float) -> Floats:
    """Return the corners (4, 2) of the strip ``near`` to ``far`` outside of the segment; its inside is to the left."""
    along = (b - a) / np.linalg.norm(b - a)
    outward = np.array([along[1], -along[0]])
    return np.array([a + near * outward, b + near * outward, b + far * outward, a + far * outward])


def _enclosed(ring: NDArray[np.float64]) -> float:
    """Return the area [m^2] within a closed line (K, 2), after Gauss."""
    x, y = (ring - ring[0]).T
    return float(abs(0.5 * np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])))
