"""Images into PNG, GIF and MP4 files."""

from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from crowd_env.files.atomic import written
from crowd_env.rendering.libraries import drawing_library
from crowd_env.rendering.palette import RAMP
from crowd_env.rendering.text import Image

_BITS = 5  # of each of red, green and blue, that decide the place in the palette


def write_png(path: Path, image: Image) -> Path:
    """Write ``image`` and return the path."""
    with drawing_library():
        import PIL.Image
    with written(path) as part:
        PIL.Image.fromarray(image).save(part, format="PNG", optimize=True)
    return path


def write_mp4(path: Path, frames: Iterable[Image], fps: float) -> Path:
    """Write ``frames`` of even width and height as H.264 and return the path."""
    with drawing_library():
        import imageio_ffmpeg
    frames = iter(frames)
    first = next(frames)
    size = (first.shape[1], first.shape[0])
    with written(path) as part:
        video = imageio_ffmpeg.write_frames(
            str(part), size, fps=fps, codec="libx264", pix_fmt_out="yuv420p", macro_block_size=2, quality=7
        )
        video.send(None)
        try:
            for frame in chain([first], frames):
                video.send(np.ascontiguousarray(frame))
        finally:
            video.close()
    return path


def write_gif(path: Path, frames: Iterable[Image], step: float, sample: Sequence[Image]) -> Path:
    """Write ``frames``, each shown for ``step`` [s], with one palette made of ``sample``; return the path.

    No dithering: flat areas stay flat, so that nothing flickers and little has to be stored.
    """
    with drawing_library():
        import PIL.Image
    palette, nearest = _palette(sample)
    colors = palette.tobytes()

    def indexed(frame: Image) -> PIL.Image.Image:
        image = PIL.Image.fromarray(nearest[_reduced(frame)])
        image.putpalette(colors)
        return image

    frames = iter(frames)
    first = indexed(next(frames))
    with written(path) as part:
        first.save(
            part,
            format="GIF",
            save_all=True,
            append_images=map(indexed, frames),
            duration=round(1000 * step),
            loop=0,
            optimize=False,
            disposal=1,
        )
    return path


def _palette(
    sample: Sequence[Image], *, flat: int = 32, size: int = 192
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Return colors (size, 3) for the images and, for every reduced color, which of them is nearest.

    The ``flat`` commonest colors and the ramp of pressures are kept as they are; the others, of edges and letters, are
    merged by median cut.
    """
    with drawing_library():
        import PIL.Image
    packed = np.concatenate([image.reshape(-1, 3).astype(np.int32) @ (65536, 256, 1) for image in sample])
    value, count = np.unique(packed, return_counts=True)
    color = np.stack([value >> 16, value >> 8 & 255, value & 255], axis=1).astype(np.uint8)
    order = np.argsort(-count, kind="stable")
    kept, rest = np.concatenate([color[order[:flat]], RAMP[::8]]), order[flat:]
    if len(rest):
        weight = np.ceil(np.sqrt(count[rest])).astype(int)  # rare colors count too
        line = PIL.Image.fromarray(np.repeat(color[rest], weight, axis=0)[None])
        merged = line.quantize(size - len(kept), method=PIL.Image.Quantize.MEDIANCUT).getpalette() or []
        kept = np.concatenate([kept, np.array(merged, dtype=np.uint8).reshape(-1, 3)[: size - len(kept)]])
    steps = np.arange(2**_BITS) * 2.0 ** (8 - _BITS) + 2.0 ** (7 - _BITS) - 0.5
    middle = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    middle[_reduced(color[order[::-1]])] = color[order[::-1]]  # the commonest color stands for its neighbors
    apart = (
        (middle**2).sum(axis=1)[:, None] - 2.0 * middle @ kept.T.astype(float) + (kept.astype(float) ** 2).sum(axis=1)
    )
    return kept, np.argmin(apart, axis=1).astype(np.uint8)


def _reduced(colors: NDArray[np.uint8]) -> NDArray[np.int32]:
    """Return the number (...) that the upper bits of ``colors`` (..., 3) make."""
    high = (colors >> (8 - _BITS)).astype(np.int32)
    return np.asarray(high[..., 0] << 2 * _BITS | high[..., 1] << _BITS | high[..., 2])
