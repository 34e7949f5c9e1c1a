"""Small films that go on for ever: few frames, few colors, a rest on the last moment."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import PIL.Image

from crowd_env.physics.pressure import INJURY
from crowd_env.recording import Recording
from crowd_env.rendering import Renderer
from crowd_env.rendering.curves import cohort_names
from crowd_env.rendering.encoding import write_gif
from crowd_env.rendering.palette import (
    BACKGROUND,
    EXIT,
    EXIT_MAT,
    FLOOR,
    INK,
    OBSTACLE,
    QUIET,
    RAMP,
    SERIES,
    WALL,
)

FPS, REST = 6.0, 1.0  # 1/s; s on the last moment
_EDGES = 14  # colors beside those of plans and pressures, ...
_APART = 12  # ... which no edge comes as near as this in all channels: flat areas keep their color


def write_loop(path: Path, frames: Sequence[PIL.Image.Image], fps: float = FPS) -> None:
    """Write frames as a GIF that rests on the last one, and print its length and size."""
    palette = few_colors(frames[::8])
    frames = [one.quantize(palette=palette, dither=PIL.Image.Dither.NONE).convert("RGB") for one in frames]
    frames += round(REST * fps) * frames[-1:]
    write_gif(path, frames, 1.0 / fps, frames[::8])
    print(f"{path}: {len(frames) / fps:.1f} s, {path.stat().st_size / 1000:.0f} kB")


def few_colors(sample: Sequence[PIL.Image.Image]) -> PIL.Image.Image:
    """Return an image with a palette of the colors of plans and pressures, and a few of edges and letters."""
    picture = PIL.Image.fromarray(np.concatenate([np.asarray(one) for one in sample]))
    edges = np.reshape(picture.quantize(_EDGES, method=PIL.Image.Quantize.MEDIANCUT).getpalette(), (-1, 3))[:_EDGES]
    known = [BACKGROUND, FLOOR, WALL, OBSTACLE, EXIT, EXIT_MAT, INK, QUIET, *SERIES[:2]]
    kept = np.concatenate([known, RAMP[:: len(RAMP) // 9]]).astype(int)
    others = [one for one in edges.astype(int) if np.abs(kept - one).max(axis=1).min() >= _APART]
    palette = PIL.Image.new("P", (1, 1))
    palette.putpalette(np.concatenate([kept, *([others] if others else [])]).ravel().tolist())
    return palette


def frames_of(
    films: dict[str, Recording], width: int, seconds: float, count: int, *, below: bool = False
) -> Iterator[PIL.Image.Image]:
    """Yield ``count`` frames until ``seconds`` of evacuations, title -> evacuation, beside or below each other."""
    renderers = [Renderer(one.geometry, width=width, text=11.0, scale_bar=False) for one in films.values()]
    for time in np.linspace(0.0, seconds, count):
        parts = [_panel(*each, float(time)) for each in zip(renderers, films.values(), films, strict=True)]
        yield beside(parts, below=below)


def beside(parts: Sequence[PIL.Image.Image], *, below: bool = False, gap: int = 0) -> PIL.Image.Image:
    """Return images beside or below each other, ``gap`` [px] apart."""
    sizes = np.array([one.size for one in parts])
    along, across = (1, 0) if below else (0, 1)
    size, at = [0, 0], np.zeros(2, dtype=int)
    size[along], size[across] = int(sizes[:, along].sum()) + gap * (len(parts) - 1), int(sizes[:, across].max())
    whole = PIL.Image.new("RGB", (size[0], size[1]), BACKGROUND)
    for one in parts:
        whole.paste(one, (int(at[0]), int(at[1])))
        at[along] += one.size[along] + gap
    return whole


def _panel(renderer: Renderer, recording: Recording, title: str, time: float) -> PIL.Image.Image:
    seen = recording.at(time)
    return renderer.draw(
        seen.position,
        recording.radius[seen.person],
        color_value=seen.pressure / INJURY,
        velocity=seen.velocity if cohort_names(recording) else 0.0 * seen.velocity,
        cohort=recording.cohort[seen.person] if cohort_names(recording) else None,
        title=title,
        status=f"{int(recording.inside(time))} inside, {time:.0f} s",
        legend=False,
    )
