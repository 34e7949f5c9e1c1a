"""Plans as they were understood: one large, with axes to read coordinates off; several on a sheet, a panel each."""

import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from crowd_env.analysis.plan_check import PlanCheck
from crowd_env.rendering.canvas import hex_of, new_figure, save_figure
from crowd_env.rendering.palette import BACKGROUND, FAINT, INK, QUIET, Color
from crowd_env.rendering.place import NARROW, draw_passages, draw_place
from crowd_env.rendering.plan import round_length

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NO_EXIT = (
    "No exit is given yet: read two points on the edge off the axes and give them, --exit x1,y1,x2,y2, for each exit."
)

# Inches.
_LONGEST = 9.5  # of one plan
_LEFT, _RIGHT, _BOTTOM = 1.0, 0.45, 0.75
_LEGEND = 3.6
_LINE = 0.21  # of text
_ROWS = 60  # of the legend, at most
_COLUMNS = 3
_CELL = (5.2, 3.4)  # of a plan on a sheet, at most
_GAP = 0.55
_DPI, _SHEET_DPI = 130, 92


def draw_sheet(path: str | Path, checks: Sequence[PlanCheck]) -> Path:
    """Draw plans and return the path: one with axes and all that was found out, or several on a sheet.

    Parameters
    ----------
    path : ends in .png.

    Raises
    ------
    ValueError
        If the suffix is another, or there is no plan.
    """
    if not checks:
        raise ValueError("a sheet needs at least one plan")
    return save_figure(_one(checks[0]) if len(checks) == 1 else _several(checks), path, formulas=False)


def _one(check: PlanCheck) -> "Figure":
    width, height = _size(check, (_LONGEST, _LONGEST))
    margin = 0.32 + 0.015 * max(width, height)  # inch, so that names beside exits have room
    box = (width + 2 * margin, height + 2 * margin)
    lines = _head(check, int(10.5 * (_LEFT + box[0] + _LEGEND)))
    top = 0.35 + _LINE * (1.6 + len(lines))
    rows = _count(check)
    tall = max(box[1] + _BOTTOM, _LINE * 1.12 * rows + 0.4)
    size = (_LEFT + box[0] + _LEGEND + _RIGHT, top + tall)
    figure = new_figure(size, dpi=_DPI, background=BACKGROUND, constrained=False)
    axes = _axes(figure, (_LEFT, size[1] - top - box[1]), box, size)
    layers = draw_place(axes, check, widths=True)
    narrow = draw_passages(axes, check)
    scale = max((check.bounds[2] - check.bounds[0]) / width, 1e-9)
    _show(axes, check, margin * scale)
    _ticks(axes, box)
    _title(figure, check, lines, 0.2, size)
    entries = [*layers.exits, *layers.regions, *layers.people, *narrow, *layers.others]
    if len(entries) > _ROWS:
        entries = entries[: _ROWS - 1] + layers.others[-1:]
    axes.legend(
        handles=entries,
        loc="upper left",
        bbox_to_anchor=((box[0] + 0.15) / box[0], 1.0),
        borderaxespad=0,
        frameon=False,
        fontsize=8.5,
        labelcolor=hex_of(INK),
        labelspacing=0.62,
        handlelength=1.6,
    )
    return figure


def _several(checks: Sequence[PlanCheck]) -> "Figure":
    """Draw plans in rows of three, each with its title right above and its legend right below it."""
    columns = min(_COLUMNS, len(checks))
    rows = [checks[k : k + columns] for k in range(0, len(checks), columns)]
    wrapped = int(12.5 * _CELL[0])
    titles = [[textwrap.wrap(check.title, wrapped) for check in row] for row in rows]
    above = [_LINE * (1.9 + max(map(len, words))) for words in titles]
    below = [0.55 + _LINE * max(_entries(check) for check in row) for row in rows]
    tall = [max(_size(check, _CELL)[1] for check in row) + 0.7 for row in rows]
    size = (columns * (_CELL[0] + _GAP) + _GAP, 0.35 + sum(above) + sum(below) + sum(tall))
    figure = new_figure(size, dpi=_SHEET_DPI, background=BACKGROUND, constrained=False)
    top = size[1] - 0.3
    for row, words, title, plan, legend in zip(rows, titles, above, tall, below, strict=True):
        for k, check in enumerate(row):
            left = _GAP + k * (_CELL[0] + _GAP)
            width, height = _size(check, _CELL)
            box = (width + 0.7, height + 0.7)
            _title(figure, check, words[k], left, size, size[1] - top)
            axes = _axes(figure, (left - 0.35, top - title - box[1]), box, size)
            layers = draw_place(axes, check, widths=False, edge=False, size=7.5)
            scale = (check.bounds[2] - check.bounds[0]) / width
            _show(axes, check, 0.35 * scale)
            axes.set_axis_off()
            _scale_bar(axes, check, 0.48 * scale)
            axes.legend(
                handles=[*layers.regions, *(layers.people if len(layers.people) > 1 else ()), *layers.others],
                loc="upper left",
                bbox_to_anchor=(0.3 / box[0], -0.22 / box[1]),
                borderaxespad=0,
                frameon=False,
                fontsize=7.5,
                ncol=2,
                labelcolor=hex_of(INK),
                handlelength=1.4,
                columnspacing=1.2,
            )
        top -= title + plan + legend
    return figure


def _size(check: PlanCheck, most: tuple[float, float]) -> tuple[float, float]:
    """Return how large a plan is drawn [inch]."""
    x0, y0, x1, y1 = check.bounds
    scale = min(most[0] / (x1 - x0), most[1] / (y1 - y0))
    return max(scale * (x1 - x0), 1e-3), max(scale * (y1 - y0), 1e-3)


def _count(check: PlanCheck) -> int:
    return min(2 * len(check.widths) + len(check.geometry.regions) + len(check.people.parts) + 4, _ROWS)


def _entries(check: PlanCheck) -> int:
    """Return how many rows the legend of a panel has."""
    parts = len(check.people.parts)
    return -(-(len(check.geometry.regions) + (parts if parts > 1 else 0) + 2 * bool(check.unreached)) // 2)


def _head(check: PlanCheck, columns: int) -> list[tuple[str, Color]]:
    x0, y0, x1, y1 = check.geometry.bounds
    least, most = check.body
    body = f"{least:.2f} m" if most - least < 1e-9 else f"{least:.2f} to {most:.2f} m"
    facts = (
        f"{check.geometry.area:.1f} m² in {x1 - x0:.2f} m x {y1 - y0:.2f} m;  bodies {body} wide;  "
        f"a center fits on {check.free_area:.1f} m²;  at most {check.capacity} people fit where they start"
    )
    lines = [(line, QUIET) for text in (check.title, facts) for line in textwrap.wrap(text, columns)]
    said = check.remarks if check.widths else (NO_EXIT, *check.remarks)
    return lines + [(line, NARROW) for text in said[:6] for line in textwrap.wrap(text, columns)]


def _title(
    figure: "Figure", check: PlanCheck, lines: Sequence[Any], left: float, size: tuple[float, float], top: float = 0.25
) -> None:
    """Write name and title, the upper left corner ``left`` and ``top`` inches from that of the figure."""
    style: dict[str, Any] = {"ha": "left", "va": "top"}
    x = left / size[0]
    figure.text(x, 1 - top / size[1], check.name, color=hex_of(INK), fontsize=12, fontweight="bold", **style)
    for k, line in enumerate(lines):
        text, color = line if isinstance(line, tuple) else (line, QUIET)
        y = 1 - (top + _LINE * (1.25 + k)) / size[1]
        figure.text(x, y, text, color=hex_of(color), fontsize=9, **style)


def _axes(figure: "Figure", corner: tuple[float, float], box: tuple[float, float], size: tuple[float, float]) -> "Axes":
    return figure.add_axes((corner[0] / size[0], corner[1] / size[1], box[0] / size[0], box[1] / size[1]))


def _show(axes: "Axes", check: PlanCheck, margin: float) -> None:
    """Show all of a plan and ``margin`` meters around it."""
    x0, y0, x1, y1 = check.bounds
    axes.set_xlim(x0 - margin, x1 + margin)
    axes.set_ylim(y0 - margin, y1 + margin)
    axes.set_aspect("equal")
    axes.set_facecolor(hex_of(BACKGROUND))


def _ticks(axes: "Axes", box: tuple[float, float]) -> None:
    """Number the axes in full meters and parts of them, also far away from the origin, with a light grid over the floor."""
    from matplotlib.ticker import AutoMinorLocator, MaxNLocator, ScalarFormatter

    sides: list[tuple[Any, float, Callable[[], tuple[float, float]]]] = [
        (axes.xaxis, box[0], axes.get_xlim),
        (axes.yaxis, box[1], axes.get_ylim),
    ]
    for axis, length, limits in sides:
        digits = len(f"{max(map(abs, limits())):.0f}")
        most = length / 0.45 if axis is axes.yaxis else length / (0.25 + 0.085 * (digits + 2))
        axis.set_major_locator(MaxNLocator(nbins=int(min(max(most, 2), 20)), steps=[1, 2, 5, 10]))
        axis.set_minor_locator(AutoMinorLocator())
        numbers = ScalarFormatter(useOffset=False)
        numbers.set_scientific(False)
        axis.set_major_formatter(numbers)
    axes.grid(which="major", color="#d9d5cc", linewidth=0.6)
    axes.grid(which="minor", color="#eae7e0", linewidth=0.4)
    axes.set_axisbelow("line")
    axes.tick_params(which="both", colors=hex_of(QUIET), labelsize=8.5, top=True, right=True, direction="in")
    for side in axes.spines.values():
        side.set_color(hex_of(FAINT))
    axes.set_xlabel("x [m]", color=hex_of(INK), fontsize=9.5)
    axes.set_ylabel("y [m]", color=hex_of(INK), fontsize=9.5)


def _scale_bar(axes: "Axes", check: PlanCheck, below: float) -> None:
    x0, y0, x1, _ = check.bounds
    meters = round_length(0.25 * (x1 - x0))
    line: dict[str, Any] = {"color": hex_of(QUIET), "linewidth": 1.5, "solid_capstyle": "butt", "clip_on": False}
    axes.plot([x0, x0 + meters], [y0 - below, y0 - below], **line)
    text: dict[str, Any] = {"color": hex_of(QUIET), "fontsize": 7, "va": "center"}
    axes.text(x0 + meters + 0.02 * (x1 - x0), y0 - below, f"{meters:g} m", **text)
