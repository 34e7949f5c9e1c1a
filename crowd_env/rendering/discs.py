"""People put into a frame as discs, one or several each, from small pictures of discs that are kept."""

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowd_env.core.arrays.state import Floats
from crowd_env.core.behaviors.outline import Outline
from crowd_env.rendering.palette import darker
from crowd_env.rendering.plan import Layout

if TYPE_CHECKING:
    from PIL.Image import Image

Colors = NDArray[np.uint8]  # (K, 3)

_DOT = 3.0  # px, discs smaller than this are dots without rim and heading
_RIM, _RIM_WIDTH = 0.075, (0.8, 3.0)  # of the radius, and px
_WIDE = 2.0  # times as wide are rims that have a color of their own
_SIZES, _PLACES, _TURNS = 8, 4, 48  # steps of a pixel, and of a full turn, in which pictures of discs are kept


def put_discs(
    image: "Image",
    center: Floats,
    radius: Floats,
    color: Colors,
    heading: Floats | None = None,
    *,
    rim: Colors | bool | None = None,
) -> None:
    """Draw discs into ``image``.

    Parameters
    ----------
    center, radius : (K, 2), (K,) px; a pixel's middle lies at (column + 0.5, row + 0.5).
    color : (K, 3).
    heading : (K,) rad, of a tick on the image; nan for none.
    rim : (K, 3) colors of rims, drawn wide; None draws them in a darker tone, False draws none.  Small discs have none.
    """
    around = rim if isinstance(rim, np.ndarray) else darker(color)
    wide = 0.0 if rim is False else _WIDE if isinstance(rim, np.ndarray) else 1.0
    edge = wide * np.clip(_RIM * radius, *_RIM_WIDTH) * (radius >= _DOT)
    turn = np.full(len(radius), -1) if heading is None else np.nan_to_num(heading * _TURNS / (2.0 * np.pi), nan=-1e9)
    turn = np.where((edge > 0.0) & (turn > -1e8), np.rint(turn) % _TURNS, -1).astype(int)
    place = np.rint(_PLACES * center).astype(int)
    size = np.rint(_SIZES * np.maximum(radius, 1.0)).astype(int)
    sharp = np.rint(_SIZES * edge).astype(int)
    inner, outer = ([tuple(one) for one in paint.tolist()] for paint in (color, around))
    columns = (column.tolist() for column in (place // _PLACES, place % _PLACES, size, sharp, turn))
    for fill, ink, (x, y), part, width, line, way in zip(inner, outer, *columns, strict=True):
        half, cover, lines = _disc(width, line, part[0], part[1], way)
        if -half <= x <= image.width + half and -half <= y <= image.height + half:
            image.paste(fill, (x - half, y - half), cover)
            if lines is not None:
                image.paste(ink, (x - half, y - half), lines)


@lru_cache(maxsize=30_000)
def _disc(size: int, line: int, x: int, y: int, turn: int) -> "tuple[int, Image, Image | None]":
    """Return half the width of the picture of a disc [px], what the disc covers, and what its rim and its tick do."""
    import PIL.Image
    import PIL.ImageDraw

    radius, edge = size / _SIZES, line / _SIZES
    half = int(radius) + 2
    fine = 8 if radius < 40.0 else 2
    center = fine * (half + np.array([x, y]) / _PLACES) - 0.5

    def covered(*rings: tuple[float, int]) -> PIL.Image.Image:
        mask = PIL.Image.new("L", (fine * 2 * half, fine * 2 * half))
        draw = PIL.ImageDraw.Draw(mask)
        for reach, value in rings:
            corners = (*(center - fine * reach), *(center + fine * reach))
            draw.ellipse(corners, fill=value)
        if turn >= 0 and len(rings) > 1:
            way = np.array([np.cos(2.0 * np.pi * turn / _TURNS), np.sin(2.0 * np.pi * turn / _TURNS)])
            ends = [tuple(center + fine * part * radius * way) for part in (0.38, 0.95)]
            draw.line(ends, fill=255, width=max(round(1.5 * fine * edge), 1))
        return mask.reduce(fine)

    return half, covered((radius, 255)), covered((radius, 255), (radius - edge, 0)) if edge else None


def put_bodies(
    image: "Image",
    layout: Layout,
    outline: Outline,
    position: Floats,
    radius: Floats,
    angle: Floats,
    color: Colors,
    rim: Colors | None = None,
) -> None:
    """Draw bodies of several discs into ``image``, with a dot where they face.

    Parameters
    ----------
    position, radius, angle : (K, 2), (K,) m, (K,) rad.
    color : (K, 3).
    rim : (K, 3), colors of rims, drawn wide; default a darker tone.
    """
    center, size = outline.place_discs(position, radius, angle)
    count = size.shape[1]
    at, width = layout.pixels(center.reshape(-1, 2)), layout.scale * size.ravel()
    wide = 1.0 if rim is None else _WIDE
    edge = np.repeat(wide * np.clip(_RIM * layout.scale * radius, *_RIM_WIDTH), count)
    around = np.repeat(darker(color) if rim is None else rim, count, axis=0)
    large = np.repeat(layout.scale * radius >= _DOT, count)
    put_discs(image, at[large], width[large], around[large], rim=False)  # all rims lie below all bodies
    put_discs(image, at, width - np.where(large, edge, 0.0), np.repeat(color, count, axis=0), rim=False)
    ahead = position + (0.35 * radius)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    seen = large[::count]
    put_discs(image, layout.pixels(ahead[seen]), 0.22 * layout.scale * radius[seen], darker(color[seen]), rim=False)
