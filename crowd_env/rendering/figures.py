"""Figures of results: egress curves, of simulations and of experiments, and learning curves."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from crowd_env.core.arrays.state import Floats
from crowd_env.rendering.canvas import hex_of, new_figure, quiet_axes, save_figure
from crowd_env.rendering.palette import INK, QUIET, SERIES, Color

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SIZE = (6.4, 4.0)  # inch
_DPI = 150


def egress_curves(path: str | Path, curves: Mapping[str, Iterable[ArrayLike]], *, title: str = "") -> Path:
    """Draw how many people are inside against time and return the path.

    Each evacuation is a light line, the mean of those with one label a bold one.

    Parameters
    ----------
    path : ends in .png.
    curves : label -> exit times (N,) [s] of each evacuation, simulated or recorded; nan for those who did not get out.

    Raises
    ------
    ValueError
        If the suffix is another or a label has no evacuation.
    """
    runs = {label: _exit_times(label, times) for label, times in curves.items()}
    if not runs:
        raise ValueError("egress curves need at least one label with evacuations")
    figure, axes = _axes(title, "time [s]", "people inside")
    every = [times for of_label in runs.values() for times in of_label]
    known = np.concatenate(every)
    end = 1.03 * float(np.max(known[np.isfinite(known)], initial=1e-3))
    for k, (label, times) in enumerate(runs.items()):
        _draw_egress(axes, times, end, SERIES[k % len(SERIES)])
        _name_curve(axes, k, _egress_label(label, times), SERIES[k % len(SERIES)])
    axes.set_xlim(0.0, end)
    axes.set_ylim(0.0, 1.04 * max(map(len, every)))
    axes.locator_params(axis="y", integer=True)
    return save_figure(figure, path, formulas=False)


def learning_curve(
    path: str | Path,
    steps: ArrayLike,
    series: Mapping[str, ArrayLike],
    *,
    errors: Mapping[str, ArrayLike] | None = None,
    reference: Mapping[str, float] | None = None,
    title: str = "",
    xlabel: str = "decisions of one pedestrian",
    ylabel: str = "evacuation time [s]",
) -> Path:
    """Draw how something changes while a policy learns and return the path.

    Parameters
    ----------
    path : ends in .png.
    steps : (T,), where ``series`` were measured.
    series : label -> (T,) values, or (R, T) of R training runs: then their mean is bold within their range.
    errors : label of a series -> (T,) by how much its values are uncertain: a band of so much on both sides.
    reference : label -> value, drawn as level lines to compare with.

    Raises
    ------
    ValueError
        If the suffix is another, there is no series, one or its errors have not T values, or errors are of no series.
    """
    at = np.asarray(steps, dtype=np.float64)
    if not series:
        raise ValueError("a learning curve needs at least one series")
    for label, error in (errors or {}).items():
        if label not in series or np.shape(error) != at.shape:
            raise ValueError(f"errors of {label!r} have shape {np.shape(error)}; they must be ({len(at)},) of a series")
    figure, axes = _axes(title, xlabel, ylabel)
    labels: list[tuple[float, str, Color]] = []
    for k, (label, values) in enumerate(series.items()):
        runs, color = np.atleast_2d(np.asarray(values, dtype=np.float64)), SERIES[k % len(SERIES)]
        if runs.ndim != 2 or runs.shape[1] != len(at):
            raise ValueError(f"series {label!r} has shape {np.shape(values)}; its last axis must have {len(at)} values")
        mean = runs.mean(axis=0)
        if len(runs) > 1:
            axes.fill_between(at, runs.min(axis=0), runs.max(axis=0), color=hex_of(color), alpha=0.15, linewidth=0)
        if errors and label in errors:
            error = np.asarray(errors[label], dtype=np.float64)
            axes.fill_between(at, mean - error, mean + error, color=hex_of(color), alpha=0.25, linewidth=0)
        axes.plot(at, mean, color=hex_of(color), linewidth=2.0, marker="o" if len(at) < 2 else None)
        known = mean[np.isfinite(mean)]
        labels.append((float(known[-1]) if len(known) else np.nan, label, color))
    for label, value in (reference or {}).items():
        axes.axhline(value, color=hex_of(QUIET), linewidth=1.2, dashes=(4, 3), zorder=1)
        labels.append((value, f"{label} {value:.3g}", QUIET))
    axes.margins(x=0.0)
    axes.ticklabel_format(axis="x", style="sci", scilimits=(-3, 5), useMathText=True)
    _name_at_right(axes, [entry for entry in labels if np.isfinite(entry[0])])
    return save_figure(figure, path)


def _exit_times(label: str, curves: Iterable[ArrayLike]) -> list[Floats]:
    runs = [np.sort(np.atleast_1d(np.asarray(times, dtype=np.float64))) for times in curves]  # nan go last
    if not runs:
        raise ValueError(f"{label!r} has no evacuation; give at least one array of exit times")
    return runs


def _steps(times: Floats, end: float) -> tuple[Floats, Floats]:
    """Return corners of N(t) for sorted exit ``times``, from 0 to ``end``."""
    out = times[np.isfinite(times)]
    inside = len(times) - np.arange(len(out) + 1)
    return np.concatenate([[0.0], out, [end]]), np.concatenate([inside, inside[-1:]]).astype(np.float64)


def _draw_egress(axes: "Axes", runs: Sequence[Floats], end: float, color: Color) -> None:
    for times in runs:
        faint = float(np.clip(3.0 / len(runs), 0.08, 0.35))
        axes.step(*_steps(times, end), where="post", color=hex_of(color), alpha=faint, linewidth=0.9)
    if len(runs) > 1:
        grid = np.linspace(0.0, end, 600)
        mean = np.mean([len(times) - np.searchsorted(times, grid, side="right") for times in runs], axis=0)
        axes.plot(grid, mean, color=hex_of(color), linewidth=2.2, zorder=3)
    else:
        axes.step(*_steps(runs[0], end), where="post", color=hex_of(color), linewidth=2.2, zorder=3)


def _egress_label(label: str, runs: Sequence[Floats]) -> str:
    finished = [float(times[-1]) for times in runs if len(times) and np.isfinite(times[-1])]
    text = f"{label}: "
    if finished:
        text += (
            f"{np.mean(finished):.1f} s" if len(runs) == 1 else f"{np.mean(finished):.1f} s, mean of {len(finished)}"
        )
    if len(finished) < len(runs):
        text += f"{'; ' if finished else ''}{len(runs) - len(finished)} unfinished"
    return text


def _axes(title: str, xlabel: str, ylabel: str) -> "tuple[Figure, Axes]":
    figure = new_figure(_SIZE, dpi=_DPI)
    axes = quiet_axes(figure.add_subplot(), xlabel, ylabel, grid=True)
    axes.set_title(title, loc="left", color=hex_of(INK), fontsize=11.5, fontweight="bold", pad=10)
    return figure, axes


def _name_curve(axes: "Axes", row: int, text: str, color: Color) -> None:
    """Write ``text`` into the upper right corner, which falling curves leave free."""
    axes.text(
        0.99,
        0.95 - 0.068 * row,
        text,
        transform=axes.transAxes,
        color=hex_of(color),
        fontsize=9.5,
        fontweight="bold",
        ha="right",
        va="top",
        zorder=6,
        bbox={"facecolor": "white", "alpha": 0.85, "edgecolor": "none", "pad": 1.2},
    )


def _name_at_right(axes: "Axes", labels: Sequence[tuple[float, str, Color]]) -> None:
    """Write each label beside the end of its line, moved apart where two would overlap."""
    low, high = axes.get_ylim()
    gap = 0.055 * (high - low)
    height = -np.inf
    for value, text, color in sorted(labels):
        height = max(value, height + gap)
        axes.annotate(
            text,
            (1.0, height),
            xycoords=("axes fraction", "data"),
            xytext=(6, 0),
            textcoords="offset points",
            color=hex_of(color),
            fontsize=9.5,
            fontweight="bold",
            va="center",
            annotation_clip=False,
        )
