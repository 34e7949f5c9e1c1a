"""People put into a frame as discs, one or several each; pixels are covered as far as discs cover them: no stairs."""

import numpy as np
from numpy.typing import NDArray

from crowd_env.core.arrays.outline import Outline
from crowd_env.core.arrays.state import Floats
from crowd_env.rendering.palette import darker
from crowd_env.rendering.plan import Layout
from crowd_env.rendering.text import Image

_DOT = 3.0  # px, discs smaller than this are dots without rim and heading
_RIM, _RIM_WIDTH = 0.075, (0.8, 3.0)  # of the radius, and px
_WIDE = 2.0  # times as wide are rims that have a color of their own
_CHUNK = 2_000_000  # pixels of patches worked on at once


def put_discs(
    image: Image,
    center: Floats,
    radius: Floats,
    color: NDArray[np.uint8],
    heading: Floats | None = None,
    *,
    rim: NDArray[np.uint8] | bool | None = None,
) -> None:
    """Draw discs into ``image`` in place.

    Parameters
    ----------
    center, radius : (K, 2), (K,) px; a pixel's middle lies at (column + 0.5, row + 0.5).
    color : (K, 3).
    heading : (K, 2), unit vectors on the image of a tick; zero for none.
    rim : (K, 3) colors of rims, drawn wide; None draws them in a darker tone, False draws none.  Small discs have none.
    """
    height, width = image.shape[:2]
    half = np.ceil(radius) + 1
    seen = (np.abs(center - (0.5 * width, 0.5 * height)) < (0.5 * width, 0.5 * height) + half[:, None]).all(axis=1)
    if not seen.any():
        return
    size = 2 * int(half[seen].max()) + 1
    rows = np.flatnonzero(seen)
    per_chunk = max(_CHUNK // size**2, 1)
    for start in range(0, len(rows), per_chunk):
        some = rows[start : start + per_chunk]
        ticks = None if heading is None else heading[some]
        edges = rim[some] if isinstance(rim, np.ndarray) else rim
        _put_some(image, center[some], radius[some], color[some], ticks, size, edges)


def put_bodies(
    image: Image,
    layout: Layout,
    outline: Outline,
    position: Floats,
    radius: Floats,
    angle: Floats,
    color: NDArray[np.uint8],
    rim: NDArray[np.uint8] | None = None,
) -> None:
    """Draw bodies of several discs into ``image`` in place, with a dot where they face.

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
    paint = np.repeat(color, count, axis=0)
    large = np.repeat(layout.scale * radius >= _DOT, count)
    put_discs(image, at[large], width[large], around[large], rim=False)  # all rims lie below all bodies
    put_discs(image, at, width - np.where(large, edge, 0.0), paint, rim=False)
    ahead = position + (0.35 * radius)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    seen = large[::count]
    put_discs(image, layout.pixels(ahead[seen]), 0.22 * layout.scale * radius[seen], darker(color[seen]), rim=False)


def _put_some(
    image: Image,
    center: Floats,
    radius: Floats,
    color: NDArray[np.uint8],
    heading: Floats | None,
    size: int,
    rim: NDArray[np.uint8] | bool | None,
) -> None:
    corner = np.floor(center).astype(np.int64) - size // 2  # (K, 2) px, of the patch around each
    middle = np.arange(size) + 0.5
    dx = (corner[:, :1] + middle - center[:, :1]).astype(np.float32)[:, None, :]  # (K, 1, size)
    dy = (corner[:, 1:] + middle - center[:, 1:]).astype(np.float32)[:, :, None]  # (K, size, 1)
    r = np.maximum(radius, 1.0).astype(np.float32)[:, None, None]
    distance = np.sqrt(dx * dx + dy * dy)
    cover = np.clip(r - distance + 0.5, 0.0, 1.0)
    fill = color.astype(np.float32)[:, None, None, :]
    paint = np.broadcast_to(fill, (*cover.shape, 3))
    if rim is not False and float(r.max()) >= _DOT:
        own = isinstance(rim, np.ndarray)
        dark = (rim if isinstance(rim, np.ndarray) else darker(color)).astype(np.float32)[:, None, None, :]
        edge = (_WIDE if own else 1.0) * np.clip(_RIM * r, *_RIM_WIDTH) * (r >= _DOT)
        ink = np.clip(distance - (r - edge) + 0.5, 0.0, 1.0) * (r >= _DOT)
        if heading is not None:
            ink = np.maximum(ink, _tick(dx, dy, r, edge, heading.astype(np.float32)) * (r >= _DOT))
        paint = fill + (dark - fill) * ink[..., None]
    height, width = image.shape[:2]
    for k, (x, y) in enumerate(corner):
        left, top, right, bottom = max(x, 0), max(y, 0), min(x + size, width), min(y + size, height)
        if right <= left or bottom <= top:
            continue
        part = np.s_[top - y : bottom - y, left - x : right - x]
        patch = image[top:bottom, left:right]
        blend = patch + (paint[k][part] - patch) * cover[k][part][..., None]
        patch[:] = np.rint(blend).astype(np.uint8)


def _tick(
    dx: NDArray[np.float32],
    dy: NDArray[np.float32],
    r: NDArray[np.float32],
    edge: NDArray[np.float32],
    heading: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Return the coverage of a stroke from near the center of each disc to its rim."""
    hx, hy = heading[:, 0, None, None], heading[:, 1, None, None]
    along = np.clip(dx * hx + dy * hy, 0.38 * r, r - edge)
    away = np.sqrt((dx - along * hx) ** 2 + (dy - along * hy) ** 2)
    shown = (hx != 0) | (hy != 0)
    return np.asarray(np.clip(0.75 * edge - away + 0.5, 0.0, 1.0) * shown, dtype=np.float32)
