"""The figure of the gate experiment: the plan with the first positions, and N(t) recorded and simulated."""

import os
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from validation.gate import PLAN, Counts, Floats

# Told apart in print and by color-blind eyes; the recording is black.
_COLOURS = ("#0f7680", "#89478f", "#9e7a16", "#4a5ca0")
_WALL, _QUIET = "#37414d", "#747b83"


def draw(path: Path, measured: Counts, results: list[Counts], starts: Floats, radius: float, note: str) -> None:
    """Write the figure: every run is a thin line, flat to the right where it got stuck."""
    figure = Figure(figsize=(10.5, 4.6), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.9])
    _draw_plan(left, starts, radius)
    people = measured.times.shape[1]
    end = 1.05 * float(np.nanmax(np.concatenate([measured.times, *(result.times for result in results)])))
    for color, result in zip(_COLOURS, results, strict=False):
        for k, times in enumerate(result.times):
            right.step(
                *_curve(times, end), where="post", color=color, lw=0.9, alpha=0.6, label=None if k else _label(result)
            )
    right.step(*_curve(measured.times[0], end), where="post", color="black", lw=1.8, label=_label(measured))
    right.set(
        xlabel="time since the first frame [s]", ylabel="people through the gate", xlim=(0, end), ylim=(0, people + 1)
    )
    legend = right.legend(frameon=False, loc="lower right", fontsize=9)
    for line in legend.get_lines():
        line.set(linewidth=2.0, alpha=1.0)
    right.spines[["top", "right"]].set_visible(False)
    right.set_title(note, loc="left", fontsize=9, color=_QUIET)
    part = path.with_name(f".{path.name}.part")
    figure.savefig(part, format="png")
    os.replace(part, path)


def _curve(times: Floats, end: float) -> tuple[Floats, Floats]:
    """Return N(t) up to ``end``, or to the last person if everyone passed."""
    passed = times[np.isfinite(times)]
    stuck = len(passed) < len(times)
    count = np.arange(len(passed) + 1.0)
    at = np.concatenate([[0.0], passed])
    return (np.append(at, end), np.append(count, count[-1])) if stuck else (at, count)


def _label(counts: Counts) -> str:
    row = counts.row()
    if len(counts.times) == 1 and counts.name == "recorded":
        return f"recorded: {row['flow']['mean']:.2f} /s"
    flow, stuck = row["flow"]["mean"], row["unfinished_runs"]
    text = f"{counts.name}, {row['runs']} runs: {'-' if flow is None else f'{flow:.2f} /s'}"
    return text + (f", {stuck} got stuck" if stuck else "")


def _draw_plan(axes, starts: Floats, radius: float) -> None:  # type: ignore[no-untyped-def]
    corners = np.array(PLAN)
    axes.plot(*corners[:5].T, color=_WALL, lw=2)
    axes.plot(*corners[5:].T, color=_WALL, lw=2)
    axes.plot(*corners[4:6].T, color="#269462", lw=2)
    for x, y in starts:
        axes.add_patch(Circle((x, y), radius, facecolor="#a8bccd", edgecolor=_WALL, lw=0.6))
    axes.set(aspect="equal", xlim=(-3.1, 3.1), ylim=(-1.4, 7.0), xlabel="x [m]", ylabel="y [m]")
    axes.set_title(f"first positions, radius {radius:g} m", loc="left", fontsize=9, color=_QUIET)
    axes.spines[["top", "right"]].set_visible(False)
