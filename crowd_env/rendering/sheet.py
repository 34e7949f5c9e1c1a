"""Plans on a sheet: walls, exits, regions, doors, and where people start, one panel a scenario."""

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crowd_env.outline import room_of
from crowd_env.rendering.canvas import draw_floor, draw_lines, fill_rings, hex_of, new_figure, save_figure, show_plan
from crowd_env.rendering.palette import BACKGROUND, EXIT, INK, QUIET, SERIES, WALL, Color
from crowd_env.rendering.plan import holes_of, round_length, shells_of
from crowd_env.scenarios.scenario import Scenario

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_PANEL = (5.2, 4.3)  # inch
_COLUMNS = 3
_DPI = 110
_MARGIN = 0.09  # of the longer side of a plan
_DOOR: Color = (196, 120, 32)
_REGION: Color = (74, 92, 160)
_GROUPS: tuple[Color, ...] = (SERIES[0], SERIES[1], SERIES[2], SERIES[4])


def draw_sheet(path: str | Path, scenarios: Sequence[Scenario], *, seed: int = 0) -> Path:
    """Draw the plans of scenarios and return the path.

    Parameters
    ----------
    path : ends in .png.
    seed : draws where people start.

    Raises
    ------
    ValueError
        If the suffix is another, there is no scenario, or the people do not fit.
    """
    if not scenarios:
        raise ValueError("a sheet needs at least one scenario")
    columns = min(_COLUMNS, len(scenarios))
    rows = -(-len(scenarios) // columns)
    zoom = 1.6 if len(scenarios) == 1 else 1.0
    size = (zoom * _PANEL[0] * columns, zoom * _PANEL[1] * rows)
    figure = new_figure(size, dpi=_DPI, background=BACKGROUND)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in panels:
        axes.set_axis_off()
    for axes, scenario in zip(panels, scenarios, strict=False):
        draw_scenario(axes, scenario, np.random.default_rng([seed, 0]))
    return save_figure(figure, path)


def draw_scenario(axes: "Axes", scenario: Scenario, rng: np.random.Generator) -> None:
    """Draw a plan and a crowd on axes."""
    geometry = scenario.geometry
    draw_floor(axes, geometry)
    for name, area in geometry.regions.items():
        _draw_region(axes, name, area.intersection(geometry.walkable))
    fixed, thin = geometry.walls_when(())
    draw_lines(axes, fixed[~thin], WALL, 1.8, 4)
    draw_lines(axes, fixed[thin], WALL, 1.0, 4)
    draw_lines(axes, geometry.walls[geometry.door_of_wall >= 0], _DOOR, 2.4, 5)
    draw_lines(axes, geometry.exits, EXIT, 4.5, 5)
    _name_exits(axes, scenario)
    _draw_people(axes, scenario, rng)
    show_plan(axes, geometry, _MARGIN)
    x0, y0, x1, y1 = geometry.bounds
    _scale_bar(axes, (x0, y0 - 0.62 * _MARGIN * max(x1 - x0, y1 - y0)), x1 - x0)
    words = textwrap.wrap(scenario.title, 60)
    axes.set_title(
        scenario.name, loc="left", color=hex_of(INK), fontsize=11, fontweight="bold", pad=6 + 11 * len(words)
    )
    above: dict[str, Any] = {
        "xytext": (0, 4),
        "textcoords": "offset points",
        "xycoords": "axes fraction",
        "va": "bottom",
    }
    axes.annotate("\n".join(words), (0.0, 1.0), color=hex_of(QUIET), fontsize=8, **above)


def _draw_region(axes: "Axes", name: str, area: Any) -> None:
    """Tint a region, and write its name into the upper left corner of its first part."""
    fill_rings(axes, [*shells_of(area), *holes_of(area)], _REGION, 2, alpha=0.16)
    first = getattr(area, "geoms", [area])[0]
    left, _, _, top = first.bounds
    near: dict[str, Any] = {
        "xytext": (3, -3),
        "textcoords": "offset points",
        "ha": "left",
        "va": "top",
        "fontsize": 7,
        "zorder": 7,
    }
    background = {"facecolor": "white", "alpha": 0.7, "edgecolor": "none", "pad": 0.6}
    axes.annotate(name, (left, top), color=hex_of(_REGION), bbox=background, **near)


def _name_exits(axes: "Axes", scenario: Scenario) -> None:
    geometry = scenario.geometry
    x0, y0, x1, y1 = geometry.bounds
    off = 0.035 * max(x1 - x0, y1 - y0)
    for name in dict.fromkeys(geometry.exit_names):
        a, b = geometry.exits[geometry.exit_names.index(name)]
        along = (b - a) / np.hypot(*(b - a))
        outward = np.array([along[1], -along[0]])
        x, y = 0.5 * (a + b) + off * outward
        upright = abs(outward[0]) > abs(outward[1])
        turn = 90 if upright else 0
        axes.text(
            x,
            y,
            name,
            color=hex_of(EXIT),
            fontsize=8,
            fontweight="bold",
            ha="center",
            va="center",
            rotation=turn,
            zorder=8,
        )


def _draw_people(axes: "Axes", scenario: Scenario, rng: np.random.Generator) -> None:
    from matplotlib.collections import EllipseCollection

    bodies, position = scenario.population.draw(rng, scenario.geometry, room_of(scenario.outline_of_run()))
    begin = 0
    for k, part in enumerate(scenario.population.parts):
        rows = slice(begin, begin + part.count)
        begin += part.count
        color = hex_of(_GROUPS[k % len(_GROUPS)])
        size = 2.0 * bodies.radius[rows]
        discs = EllipseCollection(
            size, size, np.zeros(part.count), units="xy", offsets=position[rows], offset_transform=axes.transData
        )
        discs.set(facecolor=color, edgecolor="white", linewidth=0.3, zorder=6)
        axes.add_collection(discs)


def _scale_bar(axes: "Axes", corner: tuple[float, float], width: float) -> None:
    meters = round_length(0.25 * width)
    x, y = corner
    axes.plot([x, x + meters], [y, y], color=hex_of(QUIET), linewidth=1.5, solid_capstyle="butt")
    axes.text(x + meters + 0.02 * width, y, f"{meters:g} m", color=hex_of(QUIET), fontsize=7, va="center")
