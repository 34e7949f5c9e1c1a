"""The colors of a page, from the palette of all pictures: ramps in steps, so that people of one color are drawn in one go."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowd_env.rendering import palette
from crowd_env.rendering.canvas import hex_of
from crowd_env.rendering.palette import Color, blend, darker, pressure_color

STEPS = 32
# From standing to walking fast, and from out in a moment to a long way to go; neither looks like a pressure, and both can be
# seen on a white floor and on a dark one.
_SPEED: tuple[Color, ...] = ((112, 76, 148), (76, 118, 184), (66, 172, 176), (176, 216, 140))
_TIME: tuple[Color, ...] = ((188, 222, 196), (104, 180, 168), (46, 126, 152), (58, 74, 128))
_UNKNOWN: Color = (158, 165, 172)


def _with_rims(colors: NDArray[np.uint8]) -> dict[str, list[str]]:
    return {"fill": [hex_of(color) for color in colors], "rim": [hex_of(color) for color in darker(colors)]}


def plain_colors() -> dict[str, Any]:
    """Return the ramps of bodies, each with darker rims, and the colors of groups."""
    level = np.linspace(0.0, 1.0, STEPS)
    return {
        "pressure": _with_rims(pressure_color(level)),
        "speed": _with_rims(blend(_SPEED, level)),
        "time": _with_rims(blend(_TIME, level)),
        "group": _with_rims(darker(palette.SERIES, by=-0.1)),  # lighter: they are seen on a dark floor too
        "unknown": _with_rims(np.array([_UNKNOWN], dtype=np.uint8)),
    }


def style_variables() -> str:
    """Return the colors of a page as properties of its style sheet; other dark ones stand in the style sheet itself."""
    named = {
        "background": palette.BACKGROUND,
        "floor": palette.FLOOR,
        "wall": palette.WALL,
        "obstacle": palette.OBSTACLE,
        "exit": palette.EXIT,
        "mat": palette.EXIT_MAT,
        "ink": palette.INK,
        "quiet": tuple(darker(palette.QUIET, by=0.06)),  # small letters need more contrast than those of a film
        "faint": palette.FAINT,
    }
    curves = (palette.SERIES, darker(palette.SERIES, by=-0.2))  # on a dark page lighter
    light, dark = (_properties({f"series-{k}": color for k, color in enumerate(colors)}) for colors in curves)
    return f":root {{ {_properties(named)} {light} }}\n@media (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}\n"


def _properties(colors: Mapping[str, Any]) -> str:
    return " ".join(f"--{name}: {hex_of(color)};" for name, color in colors.items())
