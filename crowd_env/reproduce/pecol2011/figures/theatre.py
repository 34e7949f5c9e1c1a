"""Figures of the movie theatre: its plan with who sits where, the times of Table 7, and egress curves like Figure 6."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from crowd_env.navigation.field import NavigationField
from crowd_env.rendering.canvas import hex_of, new_figure, quiet_axes, save_figure
from crowd_env.rendering.palette import EXIT, FLOOR, INK, OBSTACLE, QUIET, SERIES, WALL
from crowd_env.scenarios.scenario import Scenario
from crowd_env.state import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ROUTE_COLOURS = {"A": hex_of(SERIES[0]), "B": hex_of(SERIES[1])}
_STAIR = 0.35  # m, from one drawn step to the next
_LIGHT, _DARK = "#9aa1a8", "#000000"  # arrows, as in the paper: the usual way, and the other


class Series(NamedTuple):
    """Runs under one condition."""

    label: str
    values: Mapping[str, Floats]  # quantity -> of every run [s], nan where there is none


class EgressPanel(NamedTuple):
    """People who left by one way."""

    title: str
    times: Floats  # (R, N) s, nan for those who did not leave by it
    printed: tuple[
        tuple[float, float, float], tuple[float, float, float]
    ]  # exercise, simulation: last, mean [s], people


# ------------------------------------------------------------------------------------------------------------- Table 7


def theatre_table(
    path: str | Path,
    place: Scenario,
    series: Sequence[Series],
    exercise: Mapping[str, float],
    simulation: Mapping[str, float],
) -> Path:
    """Draw the theatre, and below it the times of Table 7, ours beside the paper's; return the path.

    Parameters
    ----------
    path : ends in .png.
    place : the theatre; its population has recorded starts.
    series : two, each with the quantities of ``exercise``.
    exercise, simulation : quantity -> what the paper prints [s].
    """
    figure = new_figure((9.4, 9.6))
    above, below = figure.subplots(2, 1, height_ratios=[1.25, 1.0])
    _plan(above, place)
    _times(below, series, exercise, simulation)
    return save_figure(figure, path)


def _plan(axes: "Axes", place: Scenario) -> None:
    from matplotlib.collections import LineCollection, PatchCollection
    from matplotlib.patches import Circle, Polygon, Rectangle

    geometry, people = place.geometry, place.population.parts[0]
    route_set = {way.name: way.field for way in place.route_set().routes}
    shells = [np.asarray(geometry.walkable.exterior.coords)]
    holes = [np.asarray(ring.coords) for ring in geometry.walkable.interiors]
    axes.add_collection(PatchCollection([Polygon(ring) for ring in shells], facecolor=hex_of(FLOOR), lw=0.0, zorder=0))
    axes.add_collection(
        PatchCollection([Polygon(ring) for ring in holes], facecolor=hex_of(OBSTACLE), lw=0.0, zorder=1)
    )
    for zone in place.zones:
        x0, y0, x1, y1 = geometry.regions[zone.region].bounds
        steps = np.arange(x0, x1 + 1e-9, _STAIR)
        lines = [[(x, y0), (x, y1)] for x in steps]
        axes.add_collection(LineCollection(lines, colors="#dcd8cf", linewidths=0.8, zorder=1))
    axes.add_collection(
        LineCollection(list(geometry.walls), colors=hex_of(WALL), linewidths=1.6, capstyle="projecting", zorder=3)
    )
    axes.add_collection(LineCollection(list(geometry.exits), colors=hex_of(EXIT), linewidths=3.0, zorder=4))
    assert people.starts is not None
    nearer = np.array([[_time(route_set[name], at) for name in _ROUTE_COLOURS] for at in people.starts]).argmin(axis=1)
    for k, (name, color) in enumerate(_ROUTE_COLOURS.items()):
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
    for rule in place.rules:
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


def _times(
    axes: "Axes", series: Sequence[Series], exercise: Mapping[str, float], simulation: Mapping[str, float]
) -> None:
    from matplotlib.lines import Line2D

    quiet_axes(axes, "", "time [s]", grid=True)
    colors = [hex_of(SERIES[3]), hex_of(SERIES[2])]
    rng = np.random.default_rng(0)  # for the places of the points sideways
    for x, name in enumerate(exercise):
        for one, color, aside in zip(series, colors, (-0.12, 0.14), strict=True):
            values = one.values[name][np.isfinite(one.values[name])]
            places = x + aside + rng.uniform(-0.07, 0.07, len(values))
            axes.plot(places, values, ".", color=color, alpha=0.3, ms=4.5, mew=0, zorder=2)
            if len(values):
                axes.plot(x + aside, values.mean(), "o", color=color, mec="white", mew=1.0, ms=8, zorder=4)
        axes.plot(x - 0.32, exercise[name], "D", color="black", ms=7, zorder=5)
        axes.plot(x + 0.33, simulation[name], "D", mfc="white", mec="black", mew=1.5, ms=7, zorder=5)
    axes.set_xticks(range(len(exercise)), list(exercise), fontsize=10, color=hex_of(INK))
    axes.set_ylim(bottom=0.0)
    marks = [
        Line2D([], [], color="black", marker="D", ls="", ms=7, label="exercise, as the paper prints it"),
        *(Line2D([], [], color=c, marker="o", ls="", ms=8, label=s.label) for s, c in zip(series, colors, strict=True)),
        Line2D([], [], marker="D", mfc="white", mec="black", mew=1.5, ls="", ms=7, label="the paper's simulation"),
    ]
    axes.legend(handles=marks, frameon=False, fontsize=9.5, loc="lower right", ncols=2)


# ------------------------------------------------------------------------------------------------------------ Figure 6


def egress_panels(path: str | Path, panels: Sequence[EgressPanel]) -> Path:
    """Draw how many are out against time, every run light, their mean bold and dotted (Figure 6); return the path.

    Parameters
    ----------
    path : ends in .png.
    panels : side by side.
    """
    from matplotlib.lines import Line2D

    figure = new_figure((12.6, 4.9))
    known = np.concatenate([panel.times[np.isfinite(panel.times)] for panel in panels])
    end = 1.04 * max(float(known.max(initial=1.0)), *(mark[0] for panel in panels for mark in panel.printed))
    for axes, panel in zip(np.atleast_1d(figure.subplots(1, len(panels), sharey=True)), panels, strict=True):
        quiet_axes(axes, "time [s]", "people out" if panel is panels[0] else "", grid=True)
        _egress(axes, panel, end)
        axes.set_xlim(0.0, end)
        axes.set_ylim(0.0, 1.05 * max(panel.times.shape[1] for panel in panels))
        axes.set_title(panel.title, loc="left", color=hex_of(INK), fontsize=11)
    runs = len(panels[0].times)
    grey = hex_of(QUIET)
    figure.legend(
        handles=[
            Line2D([], [], color="#b4b9bf", lw=1.2, label=f"{runs} simulation{'s' if runs > 1 else ''}, synthetic plan"),
            Line2D([], [], color="black", lw=2.4, ls=(0, (1, 1)), label="their mean"),
            Line2D([], [], color="black", marker="D", ls="", ms=7, label="exercise: last person, and number (Table 7)"),
            Line2D([], [], marker="D", mfc="white", mec="black", mew=1.5, ls="", ms=7, label="the paper's simulation"),
            Line2D([], [], color=grey, marker="|", ls="", ms=11, mew=1.8, label="mean times of both, on the axis"),
        ],
        loc="outside lower center", ncols=5, frameon=False, fontsize=9, columnspacing=1.4,
    )  # fmt: skip
    return save_figure(figure, path)


def _egress(axes: "Axes", panel: EgressPanel, end: float) -> None:
    grid = np.linspace(0.0, end, 500)
    counts = np.zeros((len(panel.times), len(grid)))
    for k, times in enumerate(panel.times):
        out = np.sort(times[np.isfinite(times)])
        counts[k] = np.searchsorted(out, grid, side="right")
        axes.step(np.append(out, end), np.append(np.arange(1.0, len(out) + 1.0), len(out)), where="post",
                  color="#b4b9bf", lw=0.8, alpha=0.6, zorder=2)  # fmt: skip
    axes.plot(grid, counts.mean(axis=0), color="black", lw=2.4, ls=(0, (1, 1)), zorder=4)
    fills = ("black", "white")
    for (last, mean, people), fill in zip(panel.printed, fills, strict=True):
        axes.plot(last, people, "D", mfc=fill, mec="black", mew=1.5, ms=7, zorder=6, clip_on=False)
        axes.plot(
            mean,
            0.0,
            marker=2,
            color="black" if fill == "black" else hex_of(QUIET),
            ms=11,
            mew=2.0,
            zorder=6,
            clip_on=False,
        )
