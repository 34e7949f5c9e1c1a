"""The table that ``crowd-env run`` prints."""

from typing import Any

from rich.table import Table

from crowd_env.analysis.results.report import exit_widths
from crowd_env.core.arrays.state import MAX_SPEED
from crowd_env.core.checks import counted
from crowd_env.scenarios.scenario import Scenario
from crowd_env.scenarios.titles import run_title

_EXITS_SHOWN = 4
_RUNS_SHOWN = 10


def figures_table(place: Scenario, figures: dict[str, Any], seconds: float) -> Table:
    """Return the table of the figures of `crowd_env.analysis.results.report.report`.

    Parameters
    ----------
    seconds : that computing took.
    """
    people, runs = counted(figures["people"], "person", "people"), counted(figures["runs"], "run", "runs")
    title = run_title(place, figures["scheme"], people=people, runs=runs)
    settings = f"seed {figures['seed']}, step {figures['dt']:g} s, {figures['strategy']}"
    table = Table(title=title, show_header=False, caption=f"{settings}; {seconds:.1f} s of computing")
    x0, y0, x1, y1 = place.geometry.bounds
    table.add_row("plan", f"{place.geometry.area:.1f} m2 in {x1 - x0:.2f} m x {y1 - y0:.2f} m")
    table.add_row("exits", _widths(place))
    for row in _times(figures):
        table.add_row(*row)
    table.add_row("flow", f"{_spread(figures['flow'])} 1/s")
    if len(figures["exits"]) > 1:
        table.add_row("shares of the exits", _shares(figures["exits"]))
    table.add_row("unfinished", _unfinished(figures))
    for blocked in figures["blocked"][:_RUNS_SHOWN]:
        table.add_row(
            "  blocked", f"run {blocked['run']}: nobody out after {blocked['since']:.1f} s, {blocked['left']} left"
        )
    if len(figures["blocked"]) > _RUNS_SHOWN:
        table.add_row("", f"and {counted(len(figures['blocked']) - _RUNS_SHOWN, 'run', 'runs')} more")
    overlap = figures["overlap_mm"]
    table.add_row("overlap of bodies", f"mean {_number(overlap['mean'])}, at most {_number(overlap['max'])} mm")
    table.add_row("reach beyond a wall", f"at most {_number(figures['outside_mm'])} mm")
    table.add_row("largest speed", _speed(figures["max_speed"]))
    out = counted(figures["escaped"], "person", "people")
    table.add_row(
        "outside of the plan", f"[bold red]{out}: these figures are void[/]" if figures["escaped"] else "nobody"
    )
    table.add_row("solver residual", f"at most {figures['residual']:.1e} m/s")
    return table


def _times(figures: dict[str, Any]) -> list[tuple[str, str]]:
    evacuation = figures["evacuation_time"]
    rows = [("evacuation time", f"{_spread(evacuation)} s")]
    if evacuation["ci95"][0] is not None:
        interval = " to ".join(_number(bound) for bound in evacuation["ci95"])
        rows.append(("  95 % interval of the mean", f"{interval} s"))
    rows.append(("95 % of the people out", f"{_spread(figures['t95'])} s"))
    rows.append(("mean exit time", f"{_spread(figures['mean_exit_time'])} s"))
    return rows


def _number(value: float | None, digits: int = 2) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _spread(figure: dict[str, Any]) -> str:
    return _number(figure["mean"]) + ("" if figure["sd"] is None else f" ± {_number(figure['sd'])}")


def _speed(most: float) -> str:
    """Return the largest speed, and whether it is the bound to which faster people are held."""
    return f"{most:.2f} m/s" + (" (the bound: some were pushed harder)" if most >= MAX_SPEED * (1 - 1e-12) else "")


def _listed(shown: list[str]) -> str:
    """Return the first few of the exits and how many more there are."""
    more = [f"and {len(shown) - _EXITS_SHOWN} more"] if len(shown) > _EXITS_SHOWN else []
    return ", ".join([*shown[:_EXITS_SHOWN], *more])


def _widths(place: Scenario) -> str:
    return _listed([f"{name} {width:.2f} m" for name, width in exit_widths(place.geometry).items()])


def _shares(exits: dict[str, Any]) -> str:
    parts = []
    for name, taken in exits.items():
        mean = taken["share"]["mean"]
        parts.append(f"{name} {'-' if mean is None else f'{100.0 * mean:.0f} %'}")
    return _listed(parts)


def _unfinished(figures: dict[str, Any]) -> str:
    people, runs = figures["unfinished"], figures["unfinished_runs"]
    low, high = (100.0 * bound for bound in figures["unfinished_share"]["ci95"])
    share = f", {100.0 * figures['unfinished_share']['mean']:.0f} % ({low:.0f} to {high:.0f} %)"
    return f"{counted(people, 'person', 'people')} in {counted(runs, 'run', 'runs')}" + (share if runs else "")
