"""Lines of text put into frames, at sizes in pixels."""

from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from crowd_env.rendering.libraries import drawing_library
from crowd_env.rendering.palette import Color

Image = NDArray[np.uint8]  # (H, W, 3)
Side = Literal["left", "center", "right"]

_FINER = 3  # rendered so many times larger and averaged: letters keep their shape at small sizes


def text_width(text: str, size: float, *, bold: bool = False) -> int:
    """Return the width [px] of ``text``."""
    return text_mask(text, size, bold).shape[1]


def put_text(
    image: Image,
    text: str,
    at: tuple[float, float],
    size: float,
    color: Color,
    *,
    side: Side = "left",
    bold: bool = False,
) -> None:
    """Write ``text`` into ``image`` in place, centerd vertically on ``at`` = (x, y) [px] and horizontally by ``side``."""
    if not text:
        return
    mask = text_mask(text, size, bold)
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
        import pygame
    if not pygame.font.get_init():
        pygame.font.init()
    # Not kept: a font dies when somebody else quits pygame.
    font = pygame.font.Font(_font_file(bold), round(size * _FINER))
    alpha = pygame.surfarray.array_alpha(font.render(text, True, (255, 255, 255))).T
    height, width = -(-alpha.shape[0] // _FINER), -(-alpha.shape[1] // _FINER)
    padded = np.zeros((height * _FINER, width * _FINER), dtype=np.float32)
    padded[: alpha.shape[0], : alpha.shape[1]] = alpha / 255.0
    return padded.reshape(height, _FINER, width, _FINER).mean(axis=(1, 3), dtype=np.float32)


def _font_file(bold: bool) -> Path | None:
    """Return the font that the figures use too; pygame's own (None) where matplotlib is not installed."""
    spec = find_spec("matplotlib")
    if spec is None or spec.origin is None:
        return None
    file = (
        Path(spec.origin).parent / "mpl-data" / "fonts" / "ttf" / ("DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf")
    )
    return file if file.exists() else None
