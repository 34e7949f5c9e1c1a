"""The figure of the gate experiment: the plan with the first positions, and N(t) recorded and simulated."""

import os
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from validation.gate import PLAN, Counts, Floats

# Told apart in print and by colour-blind eyes; the recording is black.
_COLOURS = ("#0f7680", "#89478f", "#9e7a16", "#4a5ca0")
_WALL, _QUIET = "#37414d", "#747b83"


def draw(path: Path, measured: Counts, results: list[Counts], starts: Floats, radius: float, note: str) -> None:
    """Write the figure; simulations as the mean time of each person over runs, with the range of the runs as a band."""
    figure = Figure(figsize=(10.5, 4.6), dpi=130, layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.9])
    _draw_plan(left, starts, radius)
    people = measured.times.shape[1]
    count = np.arange(1, people + 1)
    right.step(measured.times[0], count, where="post", color="black", lw=1.8, label=_label(measured))
    for colour, result in zip(_COLOURS, results, strict=False):
        through = count <= np.isfinite(result.times).sum(axis=1).min()
        times = result.times[:, through]
        right.fill_betweenx(count[through], times.min(axis=0), times.max(axis=0), color=colour, alpha=0.2, lw=0)
        right.plot(times.mean(axis=0), count[through], color=colour, lw=1.6, label=_label(result))
    right.set(xlabel="time since the first frame [s]", ylabel="people through the gate", xlim=(0, None), ylim=(0, people + 1))
    right.legend(frameon=False, loc="lower right", fontsize=9)
    right.spines[["top", "right"]].set_visible(False)
    right.set_title(note, loc="left", fontsize=9, color=_QUIET)
    part = path.with_name(f".{path.name}.part")
    figure.savefig(part, format="png")
    os.replace(part, path)


def _label(counts: Counts) -> str:
    flow = counts.row()["flow"]["mean"]
    runs = "" if len(counts.times) == 1 else f", {len(counts.times)} runs"
    return f"{counts.name}{runs}: {'-' if flow is None else f'{flow:.2f}'} /s"


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
