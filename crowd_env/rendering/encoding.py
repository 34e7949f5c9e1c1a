"""Images into PNG, GIF and MP4 files."""

from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowd_env.core.files.atomic import check_suffix, written
from crowd_env.rendering.libraries import Image, drawing_library
from crowd_env.rendering.palette import RAMP

_QUALITY = 5.5  # of an MP4, 10 is the best: CRF 22, at which flat areas and letters still look as they were drawn
_FLAT = 32  # colors of a film that are kept as they are
# Pillow looks the nearest color up for cells of 4 levels a channel, by a corner of the cell: a color that is kept loses to
# none that differs by so much in one channel.
_APART = 9


def write_png(path: str | Path, image: Image | NDArray[np.uint8]) -> Path:
    """Write ``image`` to ``path``, which ends in .png, and return it."""
    with drawing_library():
        import PIL.Image
    path = check_suffix(path, (".png",))
    picture = PIL.Image.fromarray(image) if isinstance(image, np.ndarray) else image
    with written(path) as part:
        picture.save(part, format="PNG", optimize=True)
    return path


def write_mp4(path: Path, frames: Iterable[Image], fps: float) -> Path:
    """Write ``frames`` of even width and height as H.264 and return the path."""
    with drawing_library():
        import imageio_ffmpeg
    frames = iter(frames)
    first = next(frames)
    with written(path) as part:
        video = imageio_ffmpeg.write_frames(
            str(part), first.size, fps=fps, codec="libx264", pix_fmt_out="yuv420p", macro_block_size=2, quality=_QUALITY
        )
        video.send(None)
        try:
            for frame in chain([first], frames):
                video.send(frame.tobytes())
        finally:
            video.close()
    return path


def write_gif(path: Path, frames: Iterable[Image], step: float, sample: Sequence[Image]) -> Path:
    """Write ``frames``, each shown for ``step`` [s], with one palette made of ``sample``; return the path.

    No dithering: flat areas stay flat, so that nothing flickers and little has to be stored.
    """
    with drawing_library():
        import PIL.Image
    palette = _palette(sample)

    def indexed(frame: Image) -> Image:
        return frame.quantize(palette=palette, dither=PIL.Image.Dither.NONE)

    images = map(indexed, frames)
    film: dict[str, Any] = {
        "save_all": True,
        "duration": round(1000 * step),
        "loop": 0,
        "optimize": False,
        "disposal": 1,
    }
    with written(path) as part:
        next(images).save(part, format="GIF", append_images=images, **film)
    return path


def _palette(sample: Sequence[Image]) -> Image:
    """Return an image with a palette for the images.

    The commonest colors and the ramp of pressures are kept as they are; all others, of edges and letters, are merged by
    median cut.
    """
    with drawing_library():
        import PIL.Image
    line = PIL.Image.fromarray(np.concatenate([np.asarray(image).reshape(1, -1, 3) for image in sample], axis=1))
    counted: Any = line.getcolors(line.width)
    commonest = [color for _, color in sorted(counted, reverse=True)[:_FLAT]]
    merged = line.quantize(256, method=PIL.Image.Quantize.MEDIANCUT).getpalette() or []
    kept: list[NDArray[np.int64]] = []
    for color in np.concatenate([commonest, RAMP[::8], np.reshape(merged, (-1, 3))]).astype(np.int64):
        if all(np.abs(color - other).max() >= _APART for other in kept):
            kept.append(color)
    palette = PIL.Image.new("P", (1, 1))
    palette.putpalette(np.ravel(kept[:256]).tolist())
    return palette
