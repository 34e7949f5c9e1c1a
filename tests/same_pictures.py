"""Whether two pictures or films show the same."""

from collections.abc import Iterator
from itertools import zip_longest
from pathlib import Path

import numpy as np
from PIL import Image, ImageSequence

_SEEN = 48  # of 255: a smaller difference is one of drawing, not of what is drawn
_TILE, _MOST = 32, 0.02  # pixels; share of a tile: a digit of a small font is 4 %


def difference(one: Path, other: Path) -> str:
    """Return in words how two pictures or films differ; nothing if they show the same."""
    if not (one.exists() and other.exists()):
        return "there is but one"
    worst = 0.0
    for a, b in zip_longest(_frames(one), _frames(other)):
        if a is None or b is None or a.shape != b.shape:
            return "sizes or numbers of frames differ"
        worst = max(worst, _tiles((np.abs(a - b) > _SEEN).any(axis=2)).max())
    return "" if worst <= _MOST else f"{worst:.0%} of the pixels of a square of {_TILE} x {_TILE} differ"


def _frames(path: Path) -> Iterator[np.ndarray]:
    """Yield the frames of a picture or film as numbers (height, width, 3)."""
    with Image.open(path) as image:
        for frame in ImageSequence.Iterator(image):
            yield np.asarray(frame.convert("RGB"), dtype=np.int16)


def _tiles(differs: np.ndarray) -> np.ndarray:
    """Return the share of pixels that differ in each tile (rows, columns)."""
    padded = np.pad(differs, [(0, -size % _TILE) for size in differs.shape])
    rows, columns = (size // _TILE for size in padded.shape)
    return padded.reshape(rows, _TILE, columns, _TILE).mean(axis=(1, 3))
