"""Table 7 and Figure 6: a movie theatre is evacuated by two routes, on a synthetic plan, with and without control rules."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.envs.rollout import Episode
from crowd_env.rendering.canvas import (
    draw_bodies,
    draw_geometry,
    hex_of,
    mark,
    name_panel,
    new_figure,
    quiet_axes,
    series,
)
from crowd_env.rendering.libraries import Axes, Figure
from crowd_env.rendering.palette import INK, QUIET
from crowd_env.reproduce.pecol2011 import theatre
from crowd_env.reproduce.pecol2011.room import PAPER_MARK
from crowd_env.reproduce.pecol2011.settings import PecolSettings
from crowd_env.reproduce.pecol2011.theatre import IMPLIED, PRINTED, ROUTES, Egress
from crowd_env.reproduce.result import Result, mean_of_runs, mean_row
from crowd_env.routing.fields.grid import nearest_nodes
from crowd_env.scenarios.scenario import Scenario

_EXERCISE: dict[str, Any] = {"color": "black", "marker": "D", "ls": "", "ms": 7}
_RUN = "#b4b9bf"  # the curve of one of many
# ---------------------------------------------------------------------------------------------------------- Table 7

_RULES = (
    "5 or more in rectangle 1: from A to B",
    "5 or more in rectangle 2: from A to B",
    "15 or more in rectangle 3: from B to A",
)


def table7(settings: PecolSettings, runs: Mapping[str, Sequence[Episode]]) -> Result:
    """Return Table 7, and what the control rules change in it."""
    done = {rules: Egress(episodes) for rules, episodes in runs.items()}
    ruled, free = done["yes"], done["no"]
    unruled, changes = [], []
    for name in (*PRINTED, *IMPLIED):
        values, unit = free.quantities[name], "s" if name in PRINTED else "people"
        unruled.append(mean_row(f"{name}, no rules", values, unit, "the same draws without control rules"))
        apart = ruled.quantities[name] - values
        changes.append(mean_row(f"{name}: rules change it by", apart, unit, "paired by draw"))
    unruled.append(theatre.unfinished_row("left inside, no rules", free))
    sent = (ruled.route != free.route).sum(axis=1).astype(np.float64)
    changes.append(mean_row("other route than without rules", sent, "people", "in the same draw"))
    reading = "at any moment; most come back when the rule is off"
    turned = [mean_row("turned away for a while", ruled.turned, "people", reading)]
    turned += [mean_row(f"rule {k + 1} is on", ruled.ruled[:, k], "s", _RULES[k]) for k in range(3)]

    def draw() -> object:
        return theatre_table(theatre.theatre(), {"here, with rules": ruled, "here, without rules": free})

    sections = [theatre.rows_with_rules(ruled), unruled, changes, turned]
    return Result(sections, theatre.raw_times(done), draw, theatre.remarks(settings), "s")


def theatre_table(scenario: Scenario, done: Mapping[str, Egress]) -> Figure:
    """Return the theatre, whose population has recorded starts, and below it the times of Table 7 beside the paper's.

    ``done`` are the evacuations under two conditions, by their labels.
    """
    figure = new_figure((9.4, 9.6))
    above, below = figure.subplots(2, 1, height_ratios=[1.25, 1.0])
    _plan(above, scenario)
    _times(below, done)
    return figure


def _plan(axes: Axes, scenario: Scenario) -> None:
    geometry, people = scenario.geometry, scenario.population.parts[0]
    draw_geometry(axes, geometry, wall=1.6, exit=3.0, margin=0.03)
    assert people.starts is not None
    fields = {route.name: route.field for route in scenario.route_set().routes}
    nodes = nearest_nodes(people.starts, fields["A"].origin, fields["A"].spacing, fields["A"].travel_time.shape)
    nearer = np.argmin([fields[name].travel_time[nodes] for name in ROUTES], axis=0)
    for k, name in enumerate(ROUTES):
        mine = people.starts[nearer == k]
        draw_bodies(axes, mine, people.radius.low, facecolor=series(k), edgecolor="white", linewidth=0.4, zorder=2)
        x, y = geometry.exits[[exit_name == name for exit_name in geometry.exit_names]].mean(axis=(0, 1))
        axes.text(x, y, f" {name}: {len(mine)} ", color=series(k), fontsize=13, ha="left" if name == "B" else "right")
    for rule in scenario.rules:
        x0, y0, x1, y1 = geometry.regions[rule.region].bounds
        axes.plot([x0, x1, x1, x0, x0], [y0, y0, y1, y1, y0], "k--", lw=1.1, zorder=5)
        axes.text(x0 + 0.14, y1 - 0.1, rule.region, fontsize=10.5, va="top", zorder=6)
    said = f"{len(people.starts)} people by their shortest path; dashed: where people are counted"
    name_panel(axes, f"Synthetic theatre: {said}")


def _times(axes: Axes, done: Mapping[str, Egress]) -> None:
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


# --------------------------------------------------------------------------------------------------------- Figure 6

_SHARES = (0.1, 0.5, 0.9)
_NOT_PRINTED = (
    "The exercise's curve is not printed. Drawn of it is what Table 7 tells: when the last person was out, and the mean time; "
    "how many took which route is implied by the three means."
)


def fig6(settings: PecolSettings, runs: Mapping[str, Sequence[Episode]]) -> Result:
    """Return Figure 6."""
    done = Egress(runs["yes"])
    ordered, people = np.sort(done.time, axis=1), done.time.shape[1]
    rows = [mean_row("first person out", ordered[:, 0], "s", "mean of the runs")]
    for share in _SHARES:
        number = int(np.ceil(share * people))
        rows.append(mean_row(f"{number} people out", ordered[:, number - 1], "s", f"{100 * share:.0f} % of all"))
    said = [*theatre.remarks(settings), _NOT_PRINTED]
    sections = [theatre.rows_with_rules(done), rows]
    return Result(sections, theatre.raw_times({"yes": done}), lambda: egress_panels(done), said, "s")


def egress_panels(done: Egress) -> Figure:
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
        axes.set(xlim=(0.0, end), ylim=(0.0, 1.05 * people))
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


def _egress(axes: Axes, runs: Floats, end: float) -> None:
    grid = np.linspace(0.0, end, 500)
    counts = np.zeros((len(runs), len(grid)))
    for k, times in enumerate(runs):
        out = np.sort(times[np.isfinite(times)])
        counts[k] = np.searchsorted(out, grid, side="right")
        at, number = np.append(out, end), np.append(np.arange(1.0, len(out) + 1.0), len(out))
        axes.step(at, number, where="post", color=_RUN, lw=0.8, alpha=0.6, zorder=2)
    axes.plot(grid, counts.mean(axis=0), color="black", lw=2.4, ls=(0, (1, 1)), zorder=4)


def _printed(axes: Axes, name: str, people: tuple[int, int]) -> None:
    """Mark what the paper prints of the exercise, black, and of its simulation: the last person, and the mean time."""
    fills, colors = ("black", "white"), ("black", hex_of(QUIET))
    printed = zip(PRINTED[f"last, {name}"], PRINTED[f"mean, {name}"], people, fills, colors, strict=True)
    for last, mean, number, fill, color in printed:
        axes.plot(float(last), number, **{**PAPER_MARK, "mfc": fill}, zorder=6, clip_on=False)
        axes.plot(float(mean), 0.0, marker=2, color=color, ms=11, mew=2.0, zorder=6, clip_on=False)
