"""The figure of the gate experiment: the plan with the first positions, and N(t) recorded and simulated."""

from pathlib import Path

import numpy as np

from crowd_env.rendering.canvas import new_figure, quiet_axes, save_figure
from validation.cases.gate import PLAN, Counts, Floats

# Told apart in print and by color-blind eyes; the recording is black.
_COLORS = ("#0f7680", "#89478f", "#9e7a16", "#4a5ca0", "#a03c3c", "#5d7a2b", "#747b83")
_WALL, _QUIET = "#37414d", "#747b83"


def draw(path: Path, measured: Counts, results: list[Counts], starts: Floats, radius: float) -> None:
    """Write the figure: every run is a thin line, flat to the right where it got stuck."""
    from matplotlib.patches import Circle

    figure = new_figure((10.5, 4.6), dpi=130)
    left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.9])
    corners = np.array(PLAN)
    quiet_axes(left, "x [m]", "y [m]")
    left.plot(*corners[:5].T, color=_WALL, lw=2)
    left.plot(*corners[5:].T, color=_WALL, lw=2)
    left.plot(*corners[4:6].T, color="#269462", lw=2)
    for x, y in starts:
        left.add_patch(Circle((x, y), radius, facecolor="#a8bccd", edgecolor=_WALL, lw=0.6))
    left.set(aspect="equal", xlim=(-3.1, 3.1), ylim=(-1.4, 7.0))
    left.set_title(f"first positions, radius {radius:g} m", loc="left", fontsize=9, color=_QUIET)

    people = measured.times.shape[1]
    end = 1.05 * float(np.nanmax(np.concatenate([measured.times, *(result.times for result in results)])))
    quiet_axes(right, "time since the first frame [s]", "people through the gate")
    for color, result in zip(_COLORS, results, strict=False):
        for k, times in enumerate(result.times):
            label = None if k else _label(result)
            right.step(*_curve(times, end), where="post", color=color, lw=0.9, alpha=0.6, label=label)
    right.step(*_curve(measured.times[0], end), where="post", color="black", lw=1.8, label=_label(measured))
    right.set(xlim=(0, end), ylim=(0, people + 1))
    for line in right.legend(frameon=False, loc="lower right", fontsize=9).get_lines():
        line.set(linewidth=2.0, alpha=1.0)
    right.set_title(f"desired speed {results[0].desired_speed} m/s", loc="left", fontsize=9, color=_QUIET)
    save_figure(figure, path)


def _curve(times: Floats, end: float) -> tuple[Floats, Floats]:
    """Return N(t) up to ``end``, or to the last person if everyone passed."""
    passed = times[np.isfinite(times)]
    stuck = len(passed) < len(times)
    count = np.arange(len(passed) + 1.0)
    at = np.concatenate([[0.0], passed])
    return (np.append(at, end), np.append(count, count[-1])) if stuck else (at, count)


def _label(counts: Counts) -> str:
    figure = counts.finding().figure
    flow, stuck = figure["flow, 1/s"], figure["stuck"]
    many = f", {figure['runs']} runs" if counts.name != "recorded" else ""
    text = f"{counts.name}{many}: {'–' if flow is None else f'{flow:.2f} /s'}"
    return text + (f", {stuck} got stuck" if stuck else "")
