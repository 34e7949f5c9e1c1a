"""Plans as they were understood: one large, with axes to read coordinates off; several on a sheet, a panel each."""

import textwrap
from collections.abc import Sequence
from itertools import zip_longest
from typing import Any

from crowd_env.analysis.plan_check import PlanCheck, body_width
from crowd_env.rendering.canvas import hex_of, new_figure, without_formulas
from crowd_env.rendering.libraries import Axes, Figure
from crowd_env.rendering.palette import BACKGROUND, FAINT, INK, QUIET
from crowd_env.rendering.place import NARROW, draw_passages, draw_place
from crowd_env.rendering.plan import round_length

NO_EXIT = (
    "No exit is given yet: read two points on the edge off the axes and give them, --exit x1,y1,x2,y2, for each exit."
)

# Inches.
_LONGEST, _LEGEND, _LINE = 9.5, 4.6, 0.22  # a plan, the legend beside it, a line of text
_COLUMNS, _CELL = 3, (5.2, 3.4)  # of a sheet
_ROWS = 60  # of the legend, at most
_DPI, _SHEET_DPI = 130, 92


def draw_sheet(checks: Sequence[PlanCheck]) -> Figure:
    """Draw plans and return the figure: one with axes and all findings, or several on a sheet."""
    return plan_figure(checks[0]) if len(checks) == 1 else _several(checks)


def plan_figure(check: PlanCheck) -> Figure:
    """Return one plan with axes and all findings."""
    width, height = _size(check, (_LONGEST, _LONGEST))
    rows = 2 * len(check.widths) + len(check.geometry.regions) + len(check.people.parts) + 4
    letters = int(10.5 * (width + _LEGEND))
    x0, y0, x1, y1 = check.geometry.bounds
    facts = (
        f"{check.geometry.area:.1f} m² in {x1 - x0:.2f} m x {y1 - y0:.2f} m;  bodies {body_width(check)} wide;  "
        f"a center fits on {check.free_area:.1f} m²;  room for {check.room_words}"
    )
    doubts = check.remarks[:6] if check.widths else (NO_EXIT, *check.remarks[:5])
    above = [line for text in (check.title, facts) for line in textwrap.wrap(text, letters)]
    below = [line for text in doubts for line in textwrap.wrap(text, letters)]
    tall = max(height + 1.0, _LINE * min(rows, _ROWS)) + _LINE * (len(above) + len(below) + 2)
    figure = new_figure((width + 1.0 + _LEGEND, tall), dpi=_DPI, background=BACKGROUND)
    axes = figure.subplots()
    layers = draw_place(axes, check, widths=True)
    narrow = draw_passages(axes, check)
    _show(axes, check, (0.32 + 0.015 * max(width, height)) / width)
    _ticks(axes, width, height)
    _title(axes, check, above, 12)
    figure.supxlabel("\n".join(below), x=0.02, ha="left", color=hex_of(NARROW), fontsize=9)
    entries = [*layers.exits, *layers.regions, *layers.people, *narrow, *layers.others]
    kept = entries if len(entries) <= _ROWS else [*entries[: _ROWS - 1], *layers.others[-1:]]
    axes.legend(handles=kept, loc="upper left", bbox_to_anchor=(1.02, 1.0), fontsize=8.5, **_legend())
    return without_formulas(figure)


def _several(checks: Sequence[PlanCheck]) -> Figure:
    """Draw plans in rows of three, each with its title above and its legend below it."""
    columns = min(_COLUMNS, len(checks))
    rows = [checks[k : k + columns] for k in range(0, len(checks), columns)]
    tall = [max(_size(check, _CELL)[1] for check in row) + 1.8 for row in rows]
    figure = new_figure((columns * (_CELL[0] + 0.3), sum(tall)), dpi=_SHEET_DPI, background=BACKGROUND)
    panels = figure.subplots(len(rows), columns, squeeze=False, gridspec_kw={"height_ratios": tall})
    for axes, check in zip_longest(panels.flat, checks):
        axes.set_axis_off()
        axes.set_anchor("N")
        if check is None:
            continue
        layers = draw_place(axes, check, widths=False, edge=False, size=7.5)
        _show(axes, check, 0.06)
        _title(axes, check, textwrap.wrap(check.title, int(12.5 * _CELL[0])), 10)
        _scale_bar(axes, check)
        people = layers.people if len(layers.people) > 1 else []
        if entries := [*layers.regions, *people, *layers.others]:
            axes.legend(
                handles=entries, loc="upper left", bbox_to_anchor=(0.0, -0.04), ncol=2, fontsize=7.5, **_legend()
            )
    return without_formulas(figure)


def _size(check: PlanCheck, most: tuple[float, float]) -> tuple[float, float]:
    """Return how large a plan is drawn [inch]."""
    x0, y0, x1, y1 = check.bounds
    scale = min(most[0] / (x1 - x0), most[1] / (y1 - y0))
    return max(scale * (x1 - x0), 1e-3), max(scale * (y1 - y0), 1e-3)


def _legend() -> dict[str, Any]:
    return {"borderaxespad": 0, "frameon": False, "labelcolor": hex_of(INK), "labelspacing": 0.62, "handlelength": 1.6}


def _title(axes: Axes, check: PlanCheck, lines: Sequence[str], size: float) -> None:
    axes.set_title("\n".join(lines), loc="left", color=hex_of(QUIET), fontsize=0.8 * size)
    above = (0, 8 + 1.3 * 0.8 * size * len(lines))
    axes.annotate(
        check.name, (0.0, 1.0), above, xycoords="axes fraction", textcoords="offset points",
        color=hex_of(INK), fontsize=size, fontweight="bold",
    )  # fmt: skip


def _show(axes: Axes, check: PlanCheck, share: float) -> None:
    """Show all of a plan, and around it a ``share`` of its width."""
    x0, y0, x1, y1 = check.bounds
    margin = share * (x1 - x0)
    axes.set(xlim=(x0 - margin, x1 + margin), ylim=(y0 - margin, y1 + margin), aspect="equal")
    axes.set_facecolor(hex_of(BACKGROUND))


def _ticks(axes: Axes, width: float, height: float) -> None:
    """Number the axes in full meters and parts of them, also far away from the origin, with a light grid over the floor."""
    from matplotlib.ticker import AutoMinorLocator, MaxNLocator, ScalarFormatter

    for axis, length, limits in ((axes.xaxis, width, axes.get_xlim()), (axes.yaxis, height, axes.get_ylim())):
        digits = len(f"{max(map(abs, limits)):.0f}")
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


def _scale_bar(axes: Axes, check: PlanCheck) -> None:
    x0, y0, x1, _ = check.bounds
    span = x1 - x0
    meters, y = round_length(0.25 * span), y0 - 0.05 * span
    axes.plot([x0, x0 + meters], [y, y], color=hex_of(QUIET), linewidth=1.5, solid_capstyle="butt", clip_on=False)
    axes.text(x0 + meters + 0.02 * span, y, f"{meters:g} m", color=hex_of(QUIET), fontsize=7, va="center")
