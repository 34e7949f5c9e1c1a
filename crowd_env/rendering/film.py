"""Films, stills and strips of recorded evacuations, side by side under one clock."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from crowd_env.core.files.atomic import check_suffix
from crowd_env.physics.pressure import INJURY
from crowd_env.recording import Recording
from crowd_env.rendering.curves import EgressStrip, cohort_names
from crowd_env.rendering.discs import bodies_of
from crowd_env.rendering.encoding import write_gif, write_mp4, write_png
from crowd_env.rendering.frames import Renderer
from crowd_env.rendering.libraries import Image, drawing_library
from crowd_env.rendering.palette import BACKGROUND
from crowd_env.rendering.words import titles as titles_of

_PANEL, _WIDEST = 480, 1280  # px, of one evacuation (of a building twice that) and of a film, if no width is asked for
_SECONDS = 30.0  # s  that a film lasts at most, if no speed is asked for
_FPS = 20.0  # 1/s, if no rate is asked for
_REST = 1.5  # s, on the last frame
# A GIF stores each frame whole where people walk: its rate sinks to this, so that it has about this many frames.
_GIF_FPS, _GIF_FRAMES = 10.0, 300
FORMATS = (".gif", ".mp4", ".png")


def write_film(
    path: str | Path,
    recordings: Recording | Sequence[Recording],
    *,
    titles: Sequence[str] = (),
    fps: float | None = None,
    width: int | None = None,
    speed: float | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> Path:
    """Write the evacuations side by side under one clock and return the path.

    Below them grows the curve of people inside.  An evacuation that is over earlier waits for the others.  The last frame
    rests for 1.5 s.

    Parameters
    ----------
    path : ends in .gif, .mp4, or .png (then only the moment of most pressure is written).
    titles : what stands above each; default what tells them apart, or what is known of a single one.
    fps : frames per second; a GIF counts in hundredths of a second, so that 30 becomes 33.3.  Default 20; of a GIF that lasts
        longer than 15 s as many as make about 300 frames, but at least 10.
    width : px of the whole film; default 480 an evacuation, 960 of a building, at most 1280.
    speed : how many seconds of the evacuations a second of the film shows; default 1, or the whole number at which the film
        lasts 30 s at most.  Unless it is 1 the picture says it.
    progress : called with the number of frames that have just been drawn, and of all frames.

    Raises
    ------
    ValueError
        If the suffix is unknown, there is no recording, or ``width``, ``fps`` or ``speed`` is not positive.
    """
    path = check_suffix(path, FORMATS)
    suffix = path.suffix.lower()
    if suffix == ".png":
        return write_still(path, recordings, titles=titles, width=width)
    films, titles = _several(recordings, titles)
    for name, value in (("fps", fps), ("speed", speed)):
        if value is not None and not value > 0:
            raise ValueError(f"{name} is {value!r}; it must be > 0")
    end = max(film.end for film in films)
    speed = float(max(1, np.ceil(end / _SECONDS))) if speed is None else speed
    if fps is None:
        fps = _FPS
        if suffix == ".gif":
            fps = float(np.clip(_GIF_FRAMES * speed / max(end, 1e-9), _GIF_FPS, _FPS))
    stage = _Stage(films, titles, width, end, speed)
    if suffix == ".mp4":
        return write_mp4(path, stage.frames(1.0 / fps, progress), fps)
    step = max(round(100.0 / fps), 2) / 100.0
    sample = [stage.frame(part * end) for part in np.linspace(0.0, 1.0, 9)]
    return write_gif(path, stage.frames(step, progress), step, sample)


def _several(recordings: Recording | Sequence[Recording], titles: Sequence[str]) -> tuple[list[Recording], list[str]]:
    """Return the recordings, and what stands above each."""
    found = [recordings] if isinstance(recordings, Recording) else list(recordings)
    if not found:
        raise ValueError("a film needs at least one recording")
    if not titles:
        titles = titles_of(found, [f"recording {k + 1}" for k in range(len(found))])[2]
        if len(found) == 1:
            facts = found[0].facts
            titles = [" · ".join(str(facts[name]) for name in ("scenario", "scheme") if name in facts)]
    return found, list(titles)


def write_still(
    path: str | Path,
    recordings: Recording | Sequence[Recording],
    time: float | None = None,
    *,
    titles: Sequence[str] = (),
    width: int | None = None,
) -> Path:
    """Write the moment ``time`` [s] of the evacuations as a PNG; default when the first one's crowd is pressed most.

    Raises
    ------
    ValueError
        If the suffix is not .png or there is no recording.
    """
    films, titles = _several(recordings, titles)
    time = films[0].peak_time() if time is None else time
    return write_png(path, _Stage(films, titles, width, max(film.end for film in films)).frame(time))


def write_strip(path: str | Path, recording: Recording, times: Sequence[float], *, width: int = 1280) -> Path:
    """Write snapshots of one evacuation at ``times`` [s] side by side as a PNG.

    Raises
    ------
    ValueError
        If the suffix is not .png or there is no time.
    """
    if len(times) == 0:
        raise ValueError("a strip needs at least one time")
    panel = 2 * (width // (2 * len(times)))
    text = float(np.clip(panel / 22.0, 10.0, 20.0))  # large enough for a strip shown at half its size
    images = []
    for k, time in enumerate(times):
        renderer = Renderer(recording.geometry, width=panel, text=text, scale_bar=k == len(times) - 1)
        images.append(_panel(renderer, recording, time, title=f"{time:.1f} s", clock=False, legend=k == 0))
    return write_png(path, _side_by_side(images, images[0].height))


def _side_by_side(panels: Sequence[Image], height: int) -> Image:
    """Return an image ``height`` [px] tall with panels of one width beside each other."""
    with drawing_library():
        import PIL.Image
    whole = PIL.Image.new("RGB", (len(panels) * panels[0].width, height), BACKGROUND)
    for k, panel in enumerate(panels):
        whole.paste(panel, (k * panel.width, 0))
    return whole


class _Stage:
    """Places the panels and the curves of a film on one image."""

    def __init__(
        self, films: list[Recording], titles: Sequence[str], width: int | None, end: float, speed: float = 1.0
    ) -> None:
        count = len(films)
        storeys = any(recording.geometry.building is not None for recording in films)
        width = min(_PANEL * count * (1 + storeys), _WIDEST) if width is None else width
        panel = 2 * (width // (2 * count))
        text = float(np.clip(panel / 32.0, 10.0, 18.0))
        same_place = len({recording.walkable for recording in films}) == 1
        self._films, self._titles, self._end, self._speed = films, titles, end, speed
        self.renderers = [
            Renderer(recording.geometry, width=panel, text=text, scale_bar=not same_place or k == count - 1)
            for k, recording in enumerate(films)
        ]
        margin = self.renderers[0].layout.margin
        self.strip = EgressStrip(films, titles, width=panel * count, margin=margin, text=text, end=end, speed=speed)
        self._plans = max(renderer.size[1] for renderer in self.renderers)

    def frame(self, time: float) -> Image:
        """Return the image at ``time`` [s]."""
        parts = zip(self.renderers, self._films, self._titles, strict=True)
        panels = [_panel(*part[:2], time, title=part[2], clock=True, legend=k == 0) for k, part in enumerate(parts)]
        whole = _side_by_side(panels, self._plans + self.strip.height)
        whole.paste(self.strip.draw(time), (0, self._plans))
        return whole

    def frames(self, step: float, progress: Callable[[int, int], object] | None) -> Iterator[Image]:
        """Yield the images of a film, one every ``step`` [s] of it, and rest on the last one."""
        shown = step * self._speed
        count = int(np.ceil(self._end / shown - 1e-9))
        for k in range(count):
            yield self.frame(k * shown)
            if progress is not None:
                progress(1, count)
        last = self.frame(self._end)
        for _ in range(1 + round(_REST / step)):
            yield last


def _panel(renderer: Renderer, recording: Recording, time: float, *, title: str, clock: bool, legend: bool) -> Image:
    seen, inside, count = recording.at(time), int(recording.inside(time)), recording.came
    status = f"{inside} of {count} inside"
    if time >= recording.end:
        status = (
            f"{inside} still inside after {recording.end:.1f} s" if inside else f"all out after {recording.end:.1f} s"
        )
    radius = recording.radius[seen.person]
    return renderer.draw(
        seen.position,
        radius,
        color_value=seen.pressure / INJURY,
        velocity=seen.velocity,
        bodies=bodies_of(recording, seen.position, radius, angle=seen.angle, feet=seen.memory.get("feet")),
        cohort=recording.cohort[seen.person] if cohort_names(recording) else None,
        title=title,
        clock=time if clock else None,
        inside=inside,
        status=status,
        legend=legend,
    )
