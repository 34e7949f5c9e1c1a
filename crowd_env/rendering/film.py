"""Films, stills and strips of recorded evacuations, side by side under one clock."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from crowd_env.core.arrays.outline import make_outline
from crowd_env.core.files.atomic import check_suffix
from crowd_env.recording import Recording
from crowd_env.rendering.curves import EgressStrip, group_names
from crowd_env.rendering.encoding import write_gif, write_mp4, write_png
from crowd_env.rendering.frames import Renderer
from crowd_env.rendering.libraries import drawing_library
from crowd_env.rendering.palette import BACKGROUND, FULL_PRESSURE
from crowd_env.rendering.words import titles as titles_of

if TYPE_CHECKING:
    from PIL.Image import Image

_PANEL, _WIDEST = 480, 1280  # px, of one evacuation and of a film, if no width is asked for
_SECONDS = 30.0  # s  that a film lasts at most, if no speed is asked for
_FPS = 20.0  # 1/s, if no rate is asked for
# A GIF stores each frame whole where people walk: beyond so many the rate sinks so far.
_GIF_FPS, _GIF_FRAMES = 10.0, 300


def write_film(
    path: str | Path,
    recordings: Recording | Sequence[Recording],
    *,
    titles: Sequence[str] = (),
    fps: float | None = None,
    width: int | None = None,
    max_seconds: float | None = None,
    hold: float = 1.5,
    speed: float | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> Path:
    """Write the evacuations side by side under one clock and return the path.

    Below them grows the curve of people inside.  An evacuation that is over earlier waits for the others.

    Parameters
    ----------
    path : ends in .gif, .mp4, or .png (then only the moment of most pressure is written).
    titles : what stands above each; default what tells them apart, or what is known of a single one.
    fps : frames per second; a GIF counts in hundredths of a second, so that 30 becomes 33.3.  Default 20; of a GIF that lasts
        longer than 15 s as many as make about 300 frames, but at least 10.
    width : px of the whole film; default 480 an evacuation, at most 1280.
    max_seconds : s of the evacuations to show; default all.
    hold : s to rest on the last frame.
    speed : how many seconds of the evacuations a second of the film shows; default 1, or the whole number at which the film
        lasts 30 s at most.  Unless it is 1 the picture says it.
    progress : called with the number of frames that have just been drawn, and of all frames.

    Raises
    ------
    ValueError
        If the suffix is another, there is no recording, or ``width``, ``fps`` or ``speed`` is not positive.
    """
    path = check_suffix(path, tuple(FORMATS))
    films = _several(recordings, titles)
    for name, value in (("fps", fps), ("speed", speed)):
        if value is not None and not value > 0:
            raise ValueError(f"{name} is {value!r}; it must be > 0")
    end = max(film.end for film in films.recordings)
    end = end if max_seconds is None else min(end, max_seconds)
    speed = default_speed(end) if speed is None else speed
    if fps is None:
        fps = _FPS
        if path.suffix.lower() == ".gif":
            fps = float(np.clip(_GIF_FRAMES * speed / max(end, 1e-9), _GIF_FPS, _FPS))
    return FORMATS[path.suffix.lower()](path, films, width, _Clock(end, fps, hold, speed, progress))


def default_speed(end: float) -> float:
    """Return how many seconds a second of a film shows of evacuations that end after ``end`` [s], if nothing is asked for."""
    return float(max(1, np.ceil(end / _SECONDS)))


class _Clock(NamedTuple):
    """What is shown of the evacuations, and how fast."""

    end: float  # s  of the evacuations
    fps: float  # 1/s  frames of the film
    hold: float  # s  of the film, on the last frame
    speed: float  # seconds of the evacuations in one of the film
    progress: Callable[[int, int], object] | None


class _Films(NamedTuple):
    recordings: list[Recording]
    titles: list[str]


def _several(recordings: Recording | Sequence[Recording], titles: Sequence[str]) -> _Films:
    found = [recordings] if isinstance(recordings, Recording) else list(recordings)
    if not found:
        raise ValueError("a film needs at least one recording")
    if not titles:
        titles = titles_of(found, [f"recording {k + 1}" for k in range(len(found))])[2]
        if len(found) == 1:
            titles = [
                " · ".join(str(found[0].facts[name]) for name in ("scenario", "scheme") if name in found[0].facts)
            ]
    return _Films(found, list(titles))


def _gif(path: Path, films: _Films, width: int | None, clock: _Clock) -> Path:
    step = max(round(100.0 / clock.fps), 2) / 100.0
    stage = _Stage(films, width, clock.end, clock.speed)
    sample = [stage.frame(part * clock.end) for part in np.linspace(0.0, 1.0, 9)]
    return write_gif(path, stage.frames(clock, step), step, sample)


def _mp4(path: Path, films: _Films, width: int | None, clock: _Clock) -> Path:
    return write_mp4(path, _Stage(films, width, clock.end, clock.speed).frames(clock, 1.0 / clock.fps), clock.fps)


def _png(path: Path, films: _Films, width: int | None, clock: _Clock) -> Path:
    return write_still(path, films.recordings, titles=films.titles, width=width)


# Suffix -> what writes a film of recordings: (path, films, width in px or None, clock) -> path.
FORMATS: dict[str, Callable[[Path, _Films, int | None, _Clock], Path]] = {".gif": _gif, ".mp4": _mp4, ".png": _png}


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
    films = _several(recordings, titles)
    end = max(film.end for film in films.recordings)
    time = films.recordings[0].peak_time() if time is None else time
    return write_png(path, _Stage(films, width, end).frame(time))


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
    with drawing_library():
        import PIL.Image
    strip: PIL.Image.Image | None = None
    for k, time in enumerate(times):
        renderer = Renderer(recording.geometry, width=panel, text=text, scale_bar=k == len(times) - 1)
        image = _panel(renderer, recording, time, title=f"{time:.1f} s", clock=False, legend=k == 0)
        strip = strip or PIL.Image.new("RGB", (panel * len(times), image.height))
        strip.paste(image, (k * panel, 0))
    assert strip is not None
    return write_png(path, strip)


class _Stage:
    """Places the panels and the curves of a film on one image."""

    def __init__(self, films: _Films, width: int | None, end: float, speed: float = 1.0) -> None:
        count = len(films.recordings)
        width = min(_PANEL * count, _WIDEST) if width is None else width
        self._panel = panel = 2 * (width // (2 * count))
        text = float(np.clip(panel / 32.0, 10.0, 18.0))
        same_place = len({recording.walkable for recording in films.recordings}) == 1
        self._films = films
        self.renderers = [
            Renderer(recording.geometry, width=panel, text=text, scale_bar=not same_place or k == count - 1)
            for k, recording in enumerate(films.recordings)
        ]
        margin = self.renderers[0].layout.margin
        self.strip = EgressStrip(*films, width=panel * count, margin=margin, text=text, end=end, speed=speed)
        self._plans = max(renderer.size[1] for renderer in self.renderers)

    def frame(self, time: float) -> "Image":
        """Return the image at ``time`` [s]."""
        import PIL.Image

        count = len(self.renderers)
        whole = PIL.Image.new("RGB", (self._panel * count, self._plans + self.strip.height), BACKGROUND)
        for k, (renderer, recording, title) in enumerate(zip(self.renderers, *self._films, strict=True)):
            panel = _panel(renderer, recording, time, title=title, clock=True, legend=k == 0)
            whole.paste(panel, (k * self._panel, 0))
        whole.paste(self.strip.draw(time), (0, self._plans))
        return whole

    def frames(self, clock: _Clock, step: float) -> "Iterator[Image]":
        """Yield the images of a film, one every ``step`` [s] of it, and then the last one as long as it is held."""
        shown = step * clock.speed
        count = int(np.ceil(clock.end / shown - 1e-9))
        for k in range(count):
            yield self.frame(k * shown)
            if clock.progress is not None:
                clock.progress(1, count)
        last = self.frame(clock.end)
        for _ in range(1 + round(clock.hold / step)):
            yield last


def _panel(renderer: Renderer, recording: Recording, time: float, *, title: str, clock: bool, legend: bool) -> "Image":
    seen, inside, count = recording.at(time), int(recording.inside(time)), len(recording.radius)
    status = f"{inside} of {count} inside"
    if time >= recording.end:
        status = (
            f"{inside} still inside after {recording.end:.1f} s" if inside else f"all out after {recording.end:.1f} s"
        )
    return renderer.draw(
        seen.position,
        recording.radius[seen.person],
        color_value=seen.pressure / FULL_PRESSURE,
        velocity=seen.velocity,
        angle=seen.angle,
        outline=make_outline(recording.outline),
        group=recording.group[seen.person] if group_names(recording) else None,
        title=title,
        clock=time if clock else None,
        inside=inside,
        status=status,
        legend=legend,
    )
