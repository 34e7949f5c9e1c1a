"""Figures of results: egress curves, of simulations and of experiments, shares of exits, and learning curves."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from crowd_env.analysis.figures import number
from crowd_env.analysis.results.folder import inside
from crowd_env.analysis.storeys import Storey
from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import Plain
from crowd_env.rendering.canvas import hex_of, name_panel, new_figure, quiet_axes, series, without_formulas
from crowd_env.rendering.libraries import Axes, Figure
from crowd_env.rendering.palette import INK, QUIET, SERIES, Color

_SIZE = (6.4, 4.0)  # inch
_DPI = 150


def egress_curves(
    curves: Mapping[str, Iterable[ArrayLike]],
    *,
    title: str = "",
    until: Mapping[str, float] | None = None,
    out: bool = False,
    entries: Mapping[str, Sequence[Floats | None]] | None = None,
) -> Figure:
    """Draw how many people are inside against time, or ``out``, and return the figure.

    A line is the mean over the evacuations of a label, the band about it holds nine of ten of them.

    Parameters
    ----------
    curves : label -> exit times (N,) [s] of each evacuation, simulated or recorded; nan for a pedestrian left inside.
    until : label -> s, beyond which it is not known how many are inside.
    entries : label -> entry times (N,) [s] of each evacuation; None = all are there at the start.

    Raises
    ------
    ValueError
        If there is no label, or a label has no evacuation.
    """
    runs = {label: _exit_times(label, times) for label, times in curves.items()}
    if not runs:
        raise ValueError("egress curves need at least one label with evacuations")
    figure, axes = _axes(title, "time [s]", "people out" if out else "people inside")
    known = np.concatenate([times for of_label in runs.values() for times in of_label])
    end = 1.03 * float(np.max(known[np.isfinite(known)], initial=1e-3))
    grid = np.linspace(0.0, end, 600)
    for k, (label, every) in enumerate(runs.items()):
        time = np.minimum(grid, (until or {}).get(label, np.inf))
        passed = np.array([np.searchsorted(times, time, side="right") for times in every])
        come = (entries or {}).get(label, [None] * len(every))
        count = (
            passed if out else np.array([inside(ends, time, begin) for ends, begin in zip(every, come, strict=True)])
        )
        axes.fill_between(time, *np.quantile(count, (0.05, 0.95), axis=0), color=series(k), alpha=0.16, linewidth=0)
        style = ("-", (0, (5, 2)), (0, (1, 1.3)), (0, (6, 2, 1, 2)))[k % 4]  # also told apart in black and white
        axes.plot(time, count.mean(axis=0), color=series(k), linewidth=2.0, linestyle=style)
        axes.lines[-1].set_label(_shown(label if out else _egress_label(label, every)))
    axes.set_xlim(0.0, end)
    axes.set_ylim(0.0, 1.04 * max(len(times) for every in runs.values() for times in every))
    axes.locator_params(axis="y", integer=True)
    _legend(figure)
    return without_formulas(figure)


def storey_figure(storeys: Sequence[Storey]) -> Figure:
    """Draw how many people are on each storey and stair against time, a row for each, and return the figure.

    A row's height is the most people on any of them; an area is the mean over runs.
    """
    figure = new_figure((8.2, 0.8 + min(0.55, 16.0 / len(storeys)) * len(storeys)), dpi=_DPI)
    axes = quiet_axes(figure.add_subplot(), "time [s]", "", grid=True)
    most = max(one.figures["most"]["mean"] for one in storeys) or 1.0
    end = 1.02 * max((one[-1, 0] for stay in storeys for one in stay.counts if len(one)), default=1.0)
    grid = np.linspace(0.0, end, 600)
    for base, stay in enumerate(reversed(storeys)):
        counts = [np.append(0.0, one[:, 1])[np.searchsorted(one[:, 0], grid, "right")] for one in stay.counts]
        color = series(2 if stay.sheet.slopes else 0)
        axes.fill_between(grid, base, base + 0.85 * np.mean(counts, axis=0) / most, color=color, alpha=0.6, linewidth=0)
        empty = number(stay.figures["empty"]["mean"], "s", 0).replace("-", "no run")
        text = f"at most {number(stay.figures['most']['mean'], digits=1)}\nempty after {empty}"
        axes.annotate(text, (end, base), (6, 1), textcoords="offset points", annotation_clip=False, fontsize=8.5)
    axes.set_yticks(range(len(storeys)), labels=[stay.sheet.title for stay in reversed(storeys)], va="bottom")
    axes.set(xlim=(0.0, end), ylim=(0.0, len(storeys)))
    return without_formulas(figure)


def share_figure(shares: Mapping[str, Plain], exits: Sequence[str]) -> Figure:
    """Return the share of the people who took each exit, a bar for each label and exit.

    Parameters
    ----------
    shares : label -> exit -> share in 0..1, "mean" and "ci95"; exits that a label does not have are left out.
    exits : from top to bottom.
    """
    thick = 0.8 / len(shares)
    figure = new_figure((_SIZE[0], 0.9 + len(exits) * max(0.34, 0.2 * len(shares)) + 0.22 * len(shares)), dpi=_DPI)
    axes = quiet_axes(figure.add_subplot(), "share of those who got out [%]", "")
    for k, (label, of_exit) in enumerate(shares.items()):
        rows = [row for row, name in enumerate(exits) if name in of_exit]
        known = [of_exit[exits[row]] for row in rows]
        at = np.array(rows) + (k - 0.5 * (len(shares) - 1)) * thick
        _bars(axes, at, 0.86 * thick, 100.0 * _means(known), color=series(k), label=_shown(label))
    axes.set_yticks(range(len(exits)), labels=exits)
    axes.set_ylim(len(exits) - 0.5, -0.5)
    axes.set_xlim(0.0, 100.0)
    _legend(figure)
    return without_formulas(figure)


def effect_figure(rows: Sequence[Plain], *, title: str = "") -> Figure:
    """Return by how much each value of an input moves T95, a bar for each with its 95 % interval.

    Parameters
    ----------
    rows : from top to bottom, of `crowd_env.analysis.sweep.figures_of`.
    """
    figure = new_figure((_SIZE[0], 1.1 + 0.34 * len(rows)), dpi=_DPI)
    axes = quiet_axes(figure.add_subplot(), "change of T95 [s]", "")
    name_panel(axes, title, fontsize=11.5, fontweight="bold", pad=10)
    found, at = _means([row["t95_difference"] for row in rows]), np.arange(len(rows))
    _bars(axes, at, 0.7, found, color=[series(0) if value < 0.0 else series(1) for value in found[0]])
    axes.axvline(0.0, color=hex_of(QUIET), linewidth=1.0)
    axes.set_yticks(at, labels=[f"{row['name']} = {row['value']}" for row in rows])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    return without_formulas(figure)


def _means(figures: Sequence[Plain]) -> Floats:
    """Return means and both ends of their 95 % intervals (3, K); nan where one is not known."""
    return np.array([(one["mean"], *one["ci95"]) for one in figures], dtype=np.float64).reshape(-1, 3).T


def _bars(axes: Axes, at: ArrayLike, thick: float, found: Floats, **style: Any) -> None:
    axes.barh(at, np.nan_to_num(found[0]), thick, alpha=0.75, **style)
    around = np.abs(np.nan_to_num(found[1:] - found[0]))
    axes.errorbar(found[0], at, xerr=around, fmt="none", ecolor=hex_of(INK), elinewidth=1.1, capsize=2.5)


def learning_curve(
    steps: ArrayLike,
    series: Mapping[str, ArrayLike],
    *,
    errors: Mapping[str, ArrayLike] | None = None,
    reference: Mapping[str, float] | None = None,
    title: str = "",
    xlabel: str = "decisions of one pedestrian",
    ylabel: str = "evacuation time [s]",
) -> Figure:
    """Draw how something changes while a policy learns and return the figure.

    Parameters
    ----------
    steps : (T,), where ``series`` were measured.
    series : label -> (T,) values, or (R, T) of R training runs: then their mean is bold within their range.
    errors : label of a series -> (T,) by how much its values are uncertain: a band of so much on both sides.
    reference : label -> value, drawn as level lines to compare with.

    Raises
    ------
    ValueError
        If there is no series, one or its errors have not T values, or errors are of no series.
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
    return figure


def _exit_times(label: str, curves: Iterable[ArrayLike]) -> list[Floats]:
    runs = [np.sort(np.atleast_1d(np.asarray(times, dtype=np.float64))) for times in curves]  # nan go last
    if not runs:
        raise ValueError(f"{label!r} has no evacuation; give at least one array of exit times")
    return runs


def _shown(label: str) -> str:
    """Return a label that a legend leaves out in no case."""
    return f" {label}" if label.startswith("_") else label


def _legend(figure: Any) -> None:
    """Name the labels below the axes, where no curve passes."""
    figure.legend(loc="outside lower left", frameon=False, fontsize=9.5, labelcolor=hex_of(INK), handlelength=2.6)


def _egress_label(label: str, runs: Sequence[Floats]) -> str:
    finished = [float(times[-1]) for times in runs if len(times) and np.isfinite(times[-1])]
    mean = "" if len(runs) == 1 else f", mean of {len(finished)}"
    told = [f"{np.mean(finished):.1f} s{mean}"] if finished else []
    if len(finished) < len(runs):
        told.append(f"{len(runs) - len(finished)} unfinished")
    return f"{label}: {'; '.join(told)}"


def _axes(title: str, xlabel: str, ylabel: str) -> tuple[Figure, Axes]:
    figure = new_figure(_SIZE, dpi=_DPI)
    axes = quiet_axes(figure.add_subplot(), xlabel, ylabel, grid=True)
    name_panel(axes, title, fontsize=11.5, fontweight="bold", pad=10)
    return figure, axes


def _name_at_right(axes: Axes, labels: Sequence[tuple[float, str, Color]]) -> None:
    """Write each label beside the end of its line, moved apart where two would overlap."""
    low, high = axes.get_ylim()
    gap = 0.055 * (high - low)
    height = -np.inf
    for value, text, color in sorted(labels):
        height = max(value, height + gap)
        axes.annotate(
            text, (1.0, height), (6, 0), xycoords=("axes fraction", "data"), textcoords="offset points",
            annotation_clip=False, color=hex_of(color), fontsize=9.5, fontweight="bold", va="center",
        )  # fmt: skip
