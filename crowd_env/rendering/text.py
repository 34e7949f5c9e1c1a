"""Lines of text put into frames, at sizes in pixels."""

from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Literal, cast

from crowd_env.rendering.libraries import FreeTypeFont, Image, drawing_library
from crowd_env.rendering.palette import Color

_ANCHORS = {"left": "lm", "center": "mm", "right": "rm"}


def text_width(text: str, size: float, *, bold: bool = False) -> int:
    """Return the width [px] of ``text``."""
    return round(_font(size, bold).getlength(text) + 0.5)


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
    side: Literal["left", "center", "right"] = "left",
    bold: bool = False,
    upward: bool = False,
) -> int:
    """Write ``text`` into ``image``, centered vertically on ``at`` = (x, y) [px] and horizontally by ``side``.

    ``upward`` turns it by a right angle, so that it is read from below.  Returns the width [px] of the text.
    """
    import PIL.Image
    import PIL.ImageDraw

    font, width = _font(size, bold), text_width(text, size, bold=bold)
    if not upward:
        PIL.ImageDraw.Draw(image).text(at, text, fill=color, font=font, anchor=_ANCHORS[side])
        return width
    mask = PIL.Image.new("L", (width, sum(font.getmetrics())))
    PIL.ImageDraw.Draw(mask).text((0.5 * mask.width, 0.5 * mask.height), text, fill=255, font=font, anchor="mm")
    mask = mask.transpose(PIL.Image.Transpose.ROTATE_90)
    image.paste(color, (round(at[0] - 0.5 * mask.width), round(at[1] - 0.5 * mask.height)), mask)
    return width


@lru_cache(maxsize=32)
def _font(size: float, bold: bool) -> FreeTypeFont:
    """Return the font that the figures use too; Pillow's own where matplotlib is not installed."""
    with drawing_library():
        import PIL.ImageFont
    spec = find_spec("matplotlib")
    if spec is not None and spec.origin is not None:
        name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
        file = Path(spec.origin).parent / "mpl-data" / "fonts" / "ttf" / name
        if file.exists():
            return PIL.ImageFont.truetype(file, size, layout_engine=PIL.ImageFont.Layout.BASIC)
    return cast(FreeTypeFont, PIL.ImageFont.load_default(size))
