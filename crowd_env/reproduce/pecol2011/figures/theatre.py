"""Figures of the movie theatre: its plan with who sits where, the times of Table 7, and egress curves like Figure 6."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.rendering.canvas import (
    draw_floor,
    draw_lines,
    hex_of,
    mark,
    name_panel,
    new_figure,
    quiet_axes,
    series,
    show_plan,
)
from crowd_env.rendering.palette import EXIT, INK, QUIET, WALL
from crowd_env.reproduce.pecol2011.figures.room import PAPER_MARK
from crowd_env.reproduce.pecol2011.flow import mean_of_runs
from crowd_env.reproduce.pecol2011.theatre import IMPLIED, PRINTED, ROUTES, Egress
from crowd_env.routing.fields.field import NavigationField
from crowd_env.scenarios.scenario import Scenario

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_EXERCISE: dict[str, Any] = {"color": "black", "marker": "D", "ls": "", "ms": 7}
_RUN = "#b4b9bf"  # the curve of one of many


# ------------------------------------------------------------------------------------------------------------- Table 7


def theatre_table(scenario: Scenario, done: Mapping[str, Egress]) -> "Figure":
    """Return the theatre, whose population has recorded starts, and below it the times of Table 7 beside the paper's.

    ``done`` are the evacuations under two conditions, by their labels.
    """
    figure = new_figure((9.4, 9.6))
    above, below = figure.subplots(2, 1, height_ratios=[1.25, 1.0])
    _plan(above, scenario)
    _times(below, done)
    return figure


def _plan(axes: "Axes", scenario: Scenario) -> None:
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Circle

    geometry, people = scenario.geometry, scenario.population.parts[0]
    draw_floor(axes, geometry)
    draw_lines(axes, geometry.walls, WALL, 1.6, 3, capstyle="projecting")
    draw_lines(axes, geometry.exits, EXIT, 3.0, 4)
    assert people.starts is not None
    fields = {route.name: route.field for route in scenario.route_set().routes}
    nearer = np.argmin([[_time(fields[name], at) for name in ROUTES] for at in people.starts], axis=1)
    for k, name in enumerate(ROUTES):
        mine = [Circle((x, y), people.radius.low) for x, y in people.starts[nearer == k]]
        axes.add_collection(PatchCollection(mine, facecolor=series(k), edgecolor="white", lw=0.4, zorder=2))
        x, y = geometry.exits[[exit_name == name for exit_name in geometry.exit_names]].mean(axis=(0, 1))
        axes.text(x, y, f" {name}: {len(mine)} ", color=series(k), fontsize=13, ha="left" if name == "B" else "right")
    for rule in scenario.rules:
        x0, y0, x1, y1 = geometry.regions[rule.region].bounds
        axes.plot([x0, x1, x1, x0, x0], [y0, y0, y1, y1, y0], "k--", lw=1.1, zorder=5)
        axes.text(x0 + 0.14, y1 - 0.1, rule.region, fontsize=10.5, va="top", zorder=6)
    show_plan(axes, geometry, 0.03)
    name_panel(
        axes, f"Synthetic theatre: {len(people.starts)} people by their shortest path; dashed: where people are counted"
    )


def _time(field: NavigationField, at: Floats) -> float:
    j, i = np.rint((np.asarray(at) - field.origin) / field.spacing).astype(int)
    return float(field.travel_time[i, j])


def _times(axes: "Axes", done: Mapping[str, Egress]) -> None:
    quiet_axes(axes, "", "time [s]", grid=True)
    rng = np.random.default_rng(0)  # for the offsets of the points sideways
    at = np.arange(len(PRINTED))
    for (label, egress), color, aside in zip(done.items(), (series(3), series(2)), (-0.12, 0.14), strict=True):
        for x, name in enumerate(PRINTED):
            values = egress.quantities[name]
            columns = x + aside + rng.uniform(-0.07, 0.07, len(values))
            axes.plot(columns, values, ".", color=color, alpha=0.3, ms=4.5, mew=0, zorder=2)
        means = [mean_of_runs(egress.quantities[name]).value or np.nan for name in PRINTED]
        axes.plot(at + aside, means, "o", color=color, mec="white", ms=8, zorder=4, label=label)
    exercise, simulation = np.array([[float(time) for time in times] for times in PRINTED.values()]).T
    axes.plot(at - 0.32, exercise, **_EXERCISE, zorder=5, label="exercise, as the paper prints it")
    axes.plot(at + 0.33, simulation, **PAPER_MARK, zorder=5, label="the paper's simulation")
    axes.set_xticks(at, list(PRINTED), fontsize=10, color=hex_of(INK))
    axes.set_ylim(bottom=0.0)
    axes.legend(frameon=False, fontsize=9.5, loc="lower right", ncols=2)


# ------------------------------------------------------------------------------------------------------------ Figure 6


def egress_panels(done: Egress) -> "Figure":
    """Return how many are out against time, every run light, their mean bold and dotted (Figure 6): all, and by route."""
    figure = new_figure((12.6, 4.9))
    runs, people = done.time.shape
    latest = max(float(time) for name in ("all", *ROUTES) for time in PRINTED[f"last, {name}"])
    end = 1.04 * max(float(done.time[np.isfinite(done.time)].max(initial=1.0)), latest)
    for axes, name in zip(figure.subplots(1, 1 + len(ROUTES), sharey=True), ("all", *ROUTES), strict=True):
        title = "Both routes" if name == "all" else f"Route {name} (the paper implies how many people)"
        quiet_axes(axes, "time [s]", "people out" if name == "all" else "", title=title, grid=True)
        _egress(axes, done.time if name == "all" else done.by(name), end)
        _printed(axes, name, IMPLIED.get(f"people by {name}", (people, people)))
        axes.set_xlim(0.0, end)
        axes.set_ylim(0.0, 1.05 * people)
    figure.legend(
        handles=[
            mark(f"{runs} simulation{'s' if runs > 1 else ''}, synthetic plan", color=_RUN, lw=1.2),
            mark("their mean", color="black", lw=2.4, ls=(0, (1, 1))),
            mark("exercise: last person, and number (Table 7)", **_EXERCISE),
            mark("the paper's simulation", **PAPER_MARK),
            mark("mean times of both, on the axis", color=hex_of(QUIET), marker="|", ls="", ms=11, mew=1.8),
        ],
        loc="outside lower center", ncols=5, frameon=False, fontsize=9, columnspacing=1.4,
    )  # fmt: skip
    return figure


def _egress(axes: "Axes", runs: Floats, end: float) -> None:
    grid = np.linspace(0.0, end, 500)
    counts = np.zeros((len(runs), len(grid)))
    for k, times in enumerate(runs):
        out = np.sort(times[np.isfinite(times)])
        counts[k] = np.searchsorted(out, grid, side="right")
        at, number = np.append(out, end), np.append(np.arange(1.0, len(out) + 1.0), len(out))
        axes.step(at, number, where="post", color=_RUN, lw=0.8, alpha=0.6, zorder=2)
    axes.plot(grid, counts.mean(axis=0), color="black", lw=2.4, ls=(0, (1, 1)), zorder=4)


def _printed(axes: "Axes", name: str, people: tuple[int, int]) -> None:
    """Mark what the paper prints of the exercise, black, and of its simulation: the last person, and the mean time."""
    fills, colors = ("black", "white"), ("black", hex_of(QUIET))
    printed = zip(PRINTED[f"last, {name}"], PRINTED[f"mean, {name}"], people, fills, colors, strict=True)
    for last, mean, number, fill, color in printed:
        axes.plot(float(last), number, **{**PAPER_MARK, "mfc": fill}, zorder=6, clip_on=False)
        axes.plot(float(mean), 0.0, marker=2, color=color, ms=11, mew=2.0, zorder=6, clip_on=False)
