"""The strip below a film: how many people are inside, growing with the film's clock."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from crowd_env.rendering.discs import put_discs
from crowd_env.rendering.palette import BACKGROUND, FAINT, INK, QUIET, SERIES, Color, group_color
from crowd_env.rendering.recordings import Recording
from crowd_env.rendering.text import Image, put_text, shortened, text_width


class EgressStrip:
    """Draws N(t) of several recordings up to a time.

    Parameters
    ----------
    recordings : one curve each.
    width, margin : px.
    text : px, size of letters.
    end : s, right end of the time axis.
    speed : seconds of the evacuations in one of the film; said unless it is 1.
    """

    def __init__(
        self,
        recordings: Sequence[Recording],
        *,
        width: int,
        margin: int,
        text: float,
        end: float,
        speed: float = 1.0,
    ) -> None:
        self.recordings = recordings
        self.speed = speed
        self.end = max(end, 1e-6)
        self.size = 0.78 * text
        self.height = 2 * round(0.5 * float(np.clip(0.16 * width, 110.0, 150.0)) + 0.7 * text)
        self.most = max(max(len(recording.radius) for recording in recordings), 1)
        self.top, self.bottom = round(2.2 * text), self.height - round(1.9 * text)
        self.left = margin + text_width(str(self.most), self.size) + round(0.6 * text)
        self.right = width - margin - round(1.2 * text)
        self._axes = self._draw_axes(width, margin)
        self._curves = [self._draw_curve(recording) for recording in recordings]

    def draw(self, time: float) -> Image:
        """Return the image (height, width, 3) of the curves from 0 to ``time`` [s]."""
        image = self._axes.copy()
        several = len(self.recordings) > 1
        for k, (recording, curve) in enumerate(zip(self.recordings, self._curves, strict=True)):
            color, until = SERIES[k % len(SERIES)], min(time, recording.end, self.end)
            column = round(self._x(until)) - self.left + 1
            image[:, self.left : self.left + column][curve[:, :column]] = color
            x, y, count = self._x(until), self._y(int(recording.inside(until))), int(recording.inside(until))
            self._dot(image, x, y, color)
            label = f"{count}" if time < recording.end or count else f"{recording.end:.1f} s"
            if several:
                self._put_label(image, k, recording.title, label)
            elif count:
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

    def _x(self, time: float) -> float:
        return self.left + (self.right - self.left) * time / self.end

    def _y(self, count: float) -> float:
        return self.bottom - (self.bottom - self.top) * count / self.most

    def _dot(self, image: Image, x: float, y: float, color: Color) -> None:
        radius = max(0.24 * self.size, 2.0)
        put_discs(
            image, np.array([[x + 0.5, y + 0.5]]), np.array([radius]), np.array([color], dtype=np.uint8), rim=False
        )

    def _draw_axes(self, width: int, margin: int) -> Image:
        image = np.empty((self.height, width, 3), dtype=np.uint8)
        image[:] = BACKGROUND
        for count in (0, self.most):
            row = round(self._y(count))
            image[row, self.left : self.right + 1] = FAINT
            put_text(image, str(count), (self.left - 0.6 * self.size, row), self.size, QUIET, side="right")
        put_text(image, "people inside", (margin, 0.32 * self.top), self.size, INK)
        self._free = margin + text_width("people inside", self.size) + round(self.size)
        if self.speed != 1.0:
            said = f"film: {self.speed:.3g}× real time"
            put_text(image, said, (self._free, 0.32 * self.top), self.size, QUIET)
            self._free += text_width(said, self.size) + round(self.size)
        if len(self.recordings) == 1:
            self._put_groups(image, self.recordings[0].groups)
        base = round(self._y(0))
        ticks = _ticks(self.end)
        for tick in ticks:
            column = round(self._x(tick))
            image[base : base + 4, column] = FAINT
            text = f"{tick:g} s" if tick == ticks[-1] else f"{tick:g}"
            put_text(image, text, (column, base + 1.0 * self.size + 4), self.size, QUIET, side="center")
        return image

    def _put_groups(self, image: Image, names: Sequence[str]) -> None:
        """Say in the line above the axes which color is which group, as far as there is room."""
        for name, color in zip(names, group_color(range(len(names))).tolist(), strict=True):
            width = text_width(name, self.size) + round(2.2 * self.size)
            if self._free + width > self.right:
                return
            self._dot(image, self._free + 0.5 * self.size, 0.32 * self.top, color)
            put_text(image, name, (self._free + 1.2 * self.size, 0.32 * self.top), self.size, QUIET)
            self._free += width

    def _draw_curve(self, recording: Recording) -> NDArray[np.bool_]:
        """Return which pixels (height, columns from the left end) the whole curve covers."""
        columns = np.arange(self.right - self.left + 1)
        count = recording.inside(self.end * columns / max(columns[-1], 1))
        row = np.rint([self._y(number) for number in count]).astype(int)
        above = np.minimum(row, np.concatenate([row[:1], row[:-1]]))
        thick = 2
        rows = np.arange(self.height)[:, None]
        curve = (rows >= above) & (rows < row + thick)
        curve[:, 1:] |= curve[:, :-1] & (rows < row[:-1] + thick) & (rows >= above[:-1])  # verticals as thick
        return curve


def _ticks(end: float, most: int = 8) -> list[float]:
    """Return multiples of 1, 2 or 5 times a power of ten from 0 to ``end``, at most about ``most``."""
    power = 10.0 ** np.floor(np.log10(end / most))
    step = next(step * power for step in (1, 2, 5, 10) if end / (step * power) <= most)
    return [round(float(step * k), 10) for k in range(int(end / step + 1e-9) + 1)]
