"""Figures of the movie theatre: its plan with who sits where, the times of Table 7, and egress curves like Figure 6."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.rendering.canvas import hex_of, mark, new_figure, quiet_axes, series
from crowd_env.rendering.palette import EXIT, FLOOR, INK, OBSTACLE, QUIET, WALL
from crowd_env.reproduce.pecol2011.figures.room import PAPER_MARK
from crowd_env.reproduce.pecol2011.theatre import IMPLIED, PRINTED, ROUTES, Egress
from crowd_env.routing.fields.field import NavigationField
from crowd_env.scenarios.scenario import Scenario

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ROUTE_COLORS = {"A": series(0), "B": series(1)}
_EXERCISE: dict[str, Any] = {"color": "black", "marker": "D", "ls": "", "ms": 7}
_RUN = "#b4b9bf"  # the curve of one of many
_STAIR = 0.35  # m, from one drawn step to the next
_LIGHT, _DARK = "#9aa1a8", "#000000"  # arrows, as in the paper: the usual way, and the other


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
    from matplotlib.collections import LineCollection, PatchCollection
    from matplotlib.patches import Circle, Polygon, Rectangle

    geometry, people = scenario.geometry, scenario.population.parts[0]
    route_set = {route.name: route.field for route in scenario.route_set().routes}
    shells = [np.asarray(geometry.walkable.exterior.coords)]
    holes = [np.asarray(ring.coords) for ring in geometry.walkable.interiors]
    axes.add_collection(PatchCollection([Polygon(ring) for ring in shells], facecolor=hex_of(FLOOR), lw=0.0, zorder=0))
    axes.add_collection(
        PatchCollection([Polygon(ring) for ring in holes], facecolor=hex_of(OBSTACLE), lw=0.0, zorder=1)
    )
    for zone in scenario.zones:
        x0, y0, x1, y1 = geometry.regions[zone.region].bounds
        steps = np.arange(x0, x1 + 1e-9, _STAIR)
        lines = [[(x, y0), (x, y1)] for x in steps]
        axes.add_collection(LineCollection(lines, colors="#dcd8cf", linewidths=0.8, zorder=1))
    axes.add_collection(
        LineCollection(list(geometry.walls), colors=hex_of(WALL), linewidths=1.6, capstyle="projecting", zorder=3)
    )
    axes.add_collection(LineCollection(list(geometry.exits), colors=hex_of(EXIT), linewidths=3.0, zorder=4))
    assert people.starts is not None
    nearer = np.array([[_time(route_set[name], at) for name in _ROUTE_COLORS] for at in people.starts]).argmin(axis=1)
    for k, (name, color) in enumerate(_ROUTE_COLORS.items()):
        mine = [Circle((x, y), people.radius.low) for x, y in people.starts[nearer == k]]
        axes.add_collection(PatchCollection(mine, facecolor=color, edgecolor="white", lw=0.4, zorder=2))
        exits = geometry.exits[[exit_name == name for exit_name in geometry.exit_names]]
        middle = exits.mean(axis=(0, 1))
        aside = 0.9 if name == "B" else -0.9
        text = f"{name}: {len(mine)}" if name == "B" else f"{len(mine)}: {name}"
        axes.text(
            middle[0] + aside, middle[1], text, color=color, fontsize=13, fontweight="bold", va="center",
            ha="left" if name == "B" else "right",
        )  # fmt: skip
    for rule in scenario.rules:
        x0, y0, x1, y1 = geometry.regions[rule.region].bounds
        axes.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, fill=False, ec=_DARK, lw=1.1, ls=(0, (3, 2)), zorder=5))
        axes.text(x0 + 0.14, y1 - 0.1, rule.region, fontsize=10.5, fontweight="bold", va="top", zorder=6)
        middle, usual = np.array([0.5 * (x0 + x1), 0.5 * (y0 + y1)]), "A" if rule.route == "B" else "B"
        for name, color in ((usual, _LIGHT), (rule.route, _DARK)):
            _arrow(axes, middle, _direction(route_set[name], middle), color)
    low, high = geometry.walls.min(axis=(0, 1)), geometry.walls.max(axis=(0, 1))
    axes.plot([low[0] + 0.12] * 2, [2.8, 8.4], color="#b9b5ab", lw=4.0, solid_capstyle="butt", zorder=2)
    axes.text(low[0] + 0.5, 5.6, "screen", rotation=90, va="center", fontsize=9, color=hex_of(QUIET))
    axes.set_xlim(low[0] - 0.6, high[0] + 0.6)
    axes.set_ylim(low[1] - 0.5, high[1] + 0.5)
    axes.set_aspect("equal")
    axes.axis("off")
    axes.set_title(
        f"Synthetic theatre: {len(people.starts)} people by their shortest way; where people are counted (dashed), the usual "
        "way (light) and the other (dark)", loc="left", color=hex_of(INK), fontsize=9.5,
    )  # fmt: skip


def _node(field: NavigationField, at: Floats) -> tuple[int, int]:
    j, i = np.rint((np.asarray(at) - field.origin) / field.spacing).astype(int)
    return int(i), int(j)


def _time(field: NavigationField, at: Floats) -> float:
    return float(field.travel_time[_node(field, at)])


def _direction(field: NavigationField, at: Floats) -> Floats:
    return np.asarray(field.direction[_node(field, at)])


def _arrow(axes: "Axes", at: Floats, direction: Floats, color: str) -> None:
    (x0, y0), (x1, y1) = at + 0.1 * direction, at + 0.95 * direction
    style = {"arrowstyle": "-|>", "color": color, "lw": 1.8, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 13}
    axes.annotate("", (x1, y1), (x0, y0), arrowprops=style, zorder=6)


def _times(axes: "Axes", done: Mapping[str, Egress]) -> None:
    quiet_axes(axes, "", "time [s]", grid=True)
    colors = (series(3), series(2))
    rng = np.random.default_rng(0)  # for the offsets of the points sideways
    for x, (name, (exercise, simulation)) in enumerate(PRINTED.items()):
        for egress, color, aside in zip(done.values(), colors, (-0.12, 0.14), strict=True):
            values = egress.quantities[name][np.isfinite(egress.quantities[name])]
            columns = x + aside + rng.uniform(-0.07, 0.07, len(values))
            axes.plot(columns, values, ".", color=color, alpha=0.3, ms=4.5, mew=0, zorder=2)
            if len(values):
                axes.plot(x + aside, values.mean(), "o", color=color, mec="white", mew=1.0, ms=8, zorder=4)
        axes.plot(x - 0.32, float(exercise), **_EXERCISE, zorder=5)
        axes.plot(x + 0.33, float(simulation), **PAPER_MARK, zorder=5)
    axes.set_xticks(range(len(PRINTED)), list(PRINTED), fontsize=10, color=hex_of(INK))
    axes.set_ylim(bottom=0.0)
    marks = [
        mark("exercise, as the paper prints it", **_EXERCISE),
        *(mark(label, color=color, marker="o", ls="", ms=8) for label, color in zip(done, colors, strict=True)),
        mark("the paper's simulation", **PAPER_MARK),
    ]
    axes.legend(handles=marks, frameon=False, fontsize=9.5, loc="lower right", ncols=2)


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
