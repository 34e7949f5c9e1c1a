"""Lines of text put into frames, at sizes in pixels."""

import math
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Literal, cast

import numpy as np
from numpy.typing import NDArray

from crowd_env.rendering.libraries import drawing_library
from crowd_env.rendering.palette import Color

if TYPE_CHECKING:
    from PIL.ImageFont import FreeTypeFont

Image = NDArray[np.uint8]  # (H, W, 3)
Side = Literal["left", "center", "right"]


def text_width(text: str, size: float, *, bold: bool = False) -> int:
    """Return the width [px] of ``text``."""
    return text_mask(text, size, bold).shape[1]


def shortened(text: str, room: float, size: float) -> str:
    """Return ``text``, or as much of its beginning as fits into ``room`` [px] in bold letters."""
    if text_width(text, size, bold=True) <= room:
        return text
    while text and text_width(text + "…", size, bold=True) > room:
        text = text[:-1]
    return text.rstrip() + "…" if text else ""


def put_text(
    image: Image,
    text: str,
    at: tuple[float, float],
    size: float,
    color: Color,
    *,
    side: Side = "left",
    bold: bool = False,
    upward: bool = False,
) -> None:
    """Write ``text`` into ``image`` in place, centered vertically on ``at`` = (x, y) [px] and horizontally by ``side``.

    ``upward`` turns it by a right angle, so that it is read from below.
    """
    if not text:
        return
    mask = text_mask(text, size, bold)
    mask = np.rot90(mask) if upward else mask
    height, width = mask.shape
    x = round(at[0] - {"left": 0.0, "center": 0.5 * width, "right": width}[side])
    y = round(at[1] - 0.5 * height)
    left, top = max(x, 0), max(y, 0)
    right, bottom = min(x + width, image.shape[1]), min(y + height, image.shape[0])
    if right <= left or bottom <= top:
        return
    cover = mask[top - y : bottom - y, left - x : right - x, None]
    patch = image[top:bottom, left:right]
    patch[:] = np.rint(patch + (np.asarray(color, dtype=np.float32) - patch) * cover).astype(np.uint8)


@lru_cache(maxsize=1024)
def text_mask(text: str, size: float, bold: bool) -> NDArray[np.float32]:
    """Return the coverage (h, w) in 0..1 of the pixels of ``text``; all texts of one size are equally high."""
    with drawing_library():
        import PIL.Image
        import PIL.ImageDraw
    font = _font(size, bold)
    mask = PIL.Image.new("L", (math.ceil(font.getlength(text)), sum(font.getmetrics())))
    PIL.ImageDraw.Draw(mask).text((0, 0), text, fill=255, font=font)
    return np.asarray(mask, dtype=np.float32) / 255.0


@lru_cache(maxsize=32)
def _font(size: float, bold: bool) -> "FreeTypeFont":
    """Return the font that the figures use too; Pillow's own where matplotlib is not installed."""
    with drawing_library():
        import PIL.ImageFont
    spec = find_spec("matplotlib")
    if spec is not None and spec.origin is not None:
        name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
        file = Path(spec.origin).parent / "mpl-data" / "fonts" / "ttf" / name
        if file.exists():
            return PIL.ImageFont.truetype(file, size, layout_engine=PIL.ImageFont.Layout.BASIC)
    return cast("FreeTypeFont", PIL.ImageFont.load_default(size))
