"""The strip below a film: how many people are inside, growing with the film's clock."""

from collections.abc import Sequence

import numpy as np

from crowd_env.recording import Recording
from crowd_env.rendering.libraries import Image
from crowd_env.rendering.palette import BACKGROUND, FAINT, INK, QUIET, SERIES, cohort_color
from crowd_env.rendering.text import put_text, shortened, text_width


class EgressStrip:
    """Draws N(t) of several recordings up to a time.

    Parameters
    ----------
    recordings, titles : one curve each.
    width, margin : px.
    text : px, size of letters.
    end : s, right end of the time axis.
    speed : seconds of the evacuations in one of the film; shown unless it is 1.
    """

    def __init__(
        self,
        recordings: Sequence[Recording],
        titles: Sequence[str],
        *,
        width: int,
        margin: int,
        text: float,
        end: float,
        speed: float = 1.0,
    ) -> None:
        self.recordings, self.titles, self.end = recordings, titles, max(end, 1e-6)
        self.size = 0.78 * text
        self.height = 2 * round(0.5 * float(np.clip(0.16 * width, 110.0, 150.0)) + 0.7 * text)
        self.most = max(max(int(one.inside(one.times).max()) for one in recordings), 1)
        self.top, self.bottom = round(2.2 * text), self.height - round(1.9 * text)
        self.left = margin + text_width(str(self.most), self.size) + round(0.6 * text)
        self.right = width - margin - round(1.2 * text)
        self._axes = self._draw_axes(width, margin, speed)

    def draw(self, time: float) -> Image:
        """Return the image of the curves from 0 to ``time`` [s]."""
        import PIL.ImageDraw

        image = self._axes.copy()
        draw = PIL.ImageDraw.Draw(image)
        for k, (recording, title) in enumerate(zip(self.recordings, self.titles, strict=True)):
            color, until = SERIES[k % len(SERIES)], min(time, recording.end, self.end)
            moved = np.sort(np.concatenate([recording.exit_time, recording.first_seen]))
            moved = moved[(moved > 0.0) & (moved <= until)]
            times = np.concatenate([[0.0], np.repeat(moved, 2), [until]])
            count = np.repeat(recording.inside(np.concatenate([[0.0], moved])), 2)
            draw.line(
                [self._at(*corner) for corner in zip(times.tolist(), count.tolist(), strict=True)], color, width=2
            )
            self._dot(image, self._at(until, int(count[-1])), color)
            label = f"{count[-1]}" if time < recording.end or count[-1] else f"{recording.end:.1f} s"
            x, y = self._at(until, int(count[-1]))
            if len(self.recordings) > 1:
                self._put_label(image, k, title, label)
            elif count[-1]:
                put_text(image, label, (x + 0.9 * self.size, y - 0.4 * self.size), self.size, color, bold=True)
        return image

    def _put_label(self, image: Image, k: int, title: str, label: str) -> None:
        """Name the curve ``k`` above all curves, where none can strike a name out."""
        room = (self.right - self._free) / len(self.recordings)
        end, row, color = self.right - (len(self.recordings) - 1 - k) * room, 0.32 * self.top, SERIES[k % len(SERIES)]
        put_text(image, label, (end, row), self.size, color, side="right", bold=True)
        end -= text_width("000.0 s", self.size, bold=True) + 0.3 * self.size
        name = shortened(title, end - self.right + (len(self.recordings) - k) * room - self.size, self.size)
        put_text(image, name, (end, row), self.size, color, side="right", bold=True)

    def _at(self, time: float, count: float) -> tuple[float, float]:
        """Return where a number of people at a time lies on the image [px]."""
        x = self.left + (self.right - self.left) * time / self.end
        return x, self.bottom - (self.bottom - self.top) * count / self.most

    def _dot(self, image: Image, at: tuple[float, float], color: tuple[int, int, int]) -> None:
        from crowd_env.rendering.discs import put_discs

        radius = np.array([max(0.24 * self.size, 2.0)])
        put_discs(image, np.array([at]) + 0.5, radius, np.array([color], dtype=np.uint8), rim=False)

    def _draw_axes(self, width: int, margin: int, speed: float) -> Image:
        import PIL.Image

        image = PIL.Image.new("RGB", (width, self.height), BACKGROUND)
        base, row = round(self._at(0.0, 0)[1]), 0.32 * self.top
        for count in (0, self.most):
            y = round(self._at(0.0, count)[1])
            image.paste(FAINT, (self.left, y, self.right + 1, y + 1))
            put_text(image, str(count), (self.left - 0.6 * self.size, y), self.size, QUIET, side="right")
        self._free = margin
        about = (("people inside", INK), (f"film: {speed:.3g}× real time", QUIET))
        for text, color in about[: 1 if speed == 1.0 else 2]:
            self._free += put_text(image, text, (self._free, row), self.size, color) + round(self.size)
        names = cohort_names(self.recordings[0]) if len(self.recordings) == 1 else ()
        for name, paint in zip(names, cohort_color(range(len(names))).tolist(), strict=True):
            wide = text_width(name, self.size) + round(2.2 * self.size)
            if self._free + wide > self.right:
                break
            self._dot(image, (self._free + 0.5 * self.size, row), paint)
            put_text(image, name, (self._free + 1.2 * self.size, row), self.size, QUIET)
            self._free += wide
        ticks = _ticks(self.end)
        for tick in ticks:
            column = round(self._at(tick, 0)[0])
            image.paste(FAINT, (column, base, column + 1, base + 4))
            text = f"{tick:g} s" if tick == ticks[-1] else f"{tick:g}"
            put_text(image, text, (column, base + 1.0 * self.size + 4), self.size, QUIET, side="center")
        return image


def cohort_names(recording: Recording) -> tuple[str, ...]:
    """Return the names of the cohorts of people; none if there is one cohort."""
    names = tuple(name or f"cohort {k + 1}" for k, name in enumerate(recording.cohorts))
    return names if len(names) > 1 else ()


def _ticks(end: float, most: int = 8) -> list[float]:
    """Return multiples of 1, 2 or 5 times a power of ten from 0 to ``end``, at most about ``most``."""
    power = 10.0 ** np.floor(np.log10(end / most))
    step = next(step * power for step in (1, 2, 5, 10) if end / (step * power) <= most)
    return [round(float(step * k), 10) for k in range(int(end / step + 1e-9) + 1)]
