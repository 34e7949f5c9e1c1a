"""Tables of evaluations, for people and for programs."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from crowd_env.analysis.figures import number, percent, spread
from crowd_env.core.arrays.state import Floats

from .comparison import last_times, mean_times, minus_first, ranking
from .evaluation import Evaluation

_EXITS = 4  # more do not fit side by side


def table_console() -> Console:
    """Return where tables go: standard output, 104 columns wide where that is no terminal."""
    console = Console()
    return console if console.is_terminal else Console(width=104)


def comparison_table(results: list[Evaluation], title: str) -> Table:
    """Return a table of policies against what they are judged by; the others are compared with the first."""
    first = results[0]
    caption = (
        f"± sd over runs; Δ: longer than {first.policy} on the same draws, and its 95 % interval; in: people left inside, who "
        "count until the end (then ≥); runs left: % of runs in which someone was, and its 95 % interval; N s: contact impulse "
        "per person"
    )
    table = new_table(caption, "last s", "Δ last s", "mean s", "in", "runs left %", "N s", title=title)
    for result in results:
        row = result.row()
        add_row(
            table,
            result.policy,
            _at_least(last_times(result), 2) if row["unfinished"] else spread(row["evacuation_time"], digits=2),
            "" if result is first else difference(minus_first(result, first)["evacuation_time"], 2),
            _at_least(mean_times(result), 2) if row["unfinished"] else number(row["mean_exit_time"]["mean"], digits=2),
            str(row["unfinished"]),
            percent(row["unfinished_share"]),
            number(row["contact_impulse"]["mean"], digits=0),
        )
    return table


# ------------------------------------------------------------------------------------------ policies under many schemes


def times_table(results: Sequence[Evaluation], title: str) -> Table:
    """Return a table of how long policies took, and how much longer than the first one on the same draws."""
    first = results[0].policy
    caption = (
        f"Seconds. last: of the last person, ± sd over runs; Δ: longer than {first} on the same draws, and its 95 % interval; "
        "faster: share of runs; 95 %: when 95 % were out; mean: of all people; in: people left inside, who count until "
        "the time limit, or until the end if that was later (then ≥)."
    )
    table = new_table(caption, "last", "Δ last", "faster", "95 %", "mean", "Δ mean", "in", title=title)
    for result, reference in with_first(results, table):
        row, longer, own = result.row(), minus_first(result, reference), result is reference
        late = result.exit_time_95()
        add_row(
            table,
            result.policy,
            _at_least(last_times(result)) if row["unfinished"] else spread(row["evacuation_time"], digits=1),
            "" if own else difference(longer["evacuation_time"]),
            "" if own else f"{100 * longer['evacuation_time']['faster']:.0f} %",
            number(row["exit_time_95"]["mean"], digits=1)
            if np.isfinite(late).all()
            else _at_least(result.exit_time_95(counted=True)),
            _at_least(mean_times(result)) if row["unfinished"] else number(row["mean_exit_time"]["mean"], digits=1),
            "" if own else difference(longer["mean_exit_time"]),
            str(row["unfinished"]),
        )
    return table


def left_table(results: Sequence[Evaluation]) -> Table:
    """Return a table of the runs in which someone was left inside, and of those whose exits blocked."""
    caption = (
        "Runs in which someone was left inside, and those of them in which the exits blocked: how many, and % of runs with "
        "its 95 % interval (Wilson): none of few runs does not mean never."
    )
    table = new_table(caption, "in", "runs left", "%", "blocked", "%")
    for result, _ in with_first(results, table):
        row = result.row()
        cells = (
            f"{row[f'{name}_runs']} of {row['runs']}" if k == 0 else percent(row[f"{name}_share"])
            for name in ("unfinished", "blocked")
            for k in (0, 1)
        )
        add_row(table, result.policy, str(row["unfinished"]), *cells)
    return table


def crowding_table(results: Sequence[Evaluation]) -> Table:
    """Return a table of how close people came, how hard they pressed, how far they walked, and what it took to compute."""
    caption = (
        "Means over runs. dens.: greatest, people within 1 m; pressure: greatest contact "
        "force on someone over circumference, mean of 0.1 s; crushed: people who bore more than 1.6 kN/m (injury, Helbing et "
        "al. 2000; friction included) in any 0.1 s, and for how long in all, mean of these; impulse, way: per person; overlap: "
        "deepest; fastest: largest speed of anyone; comp.: processor time per simulated second, and what planning anew takes "
        "of it."
    )
    for result in results:
        if lost := result.row()["escaped"]:
            caption += (
                f" VOID: {lost} people were outside of the plan in runs of {result.policy} under {result.scheme}."
            )
    forceless = dict.fromkeys(result.scheme for result in results if not result.pressure_is_force)
    for scheme in forceless:
        caption += f" *{scheme} has no forces: its impulses keep bodies apart, and nobody would feel that pressure."
    names = (
        "flow\n1/s",
        "dens.\n1/m2",
        "pressure\nkN/m",
        "crushed\n%",
        "\ns",
        "impulse\nkN s",
        "way\nm",
        "overlap\nmm",
    )
    table = new_table(caption, *names, "fastest\nm/s", "comp.\nms/s", "plan\nms/s")
    for result, _ in with_first(results, table):
        row = result.row()
        density, pressure = row["max_density"], row["max_pressure"]
        replanning, star = row["replanning_per_simulated_second"], " " if row["pressure_is_force"] else "*"
        add_row(
            table,
            result.policy,
            number(row["flow"]["mean"], digits=2),
            f"{density['mean']:.1f}",
            f"{pressure['mean'] / 1e3:.1f}{star}",
            f"{100.0 * row['crushed_share']['mean']:.0f}{star}",
            number(row["crushed_time"]["mean"], digits=1),
            f"{row['contact_impulse']['mean'] / 1e3:.2f}",
            number(row["walked"]["mean"], digits=1),
            f"{1e3 * row['max_overlap']:.1f}",
            f"{row['max_speed']:.1f}",
            f"{1e3 * (row['physics_per_simulated_second'] + replanning):.1f}",
            f"{1e3 * replanning:.1f}",
        )
    return table


def exits_table(results: Sequence[Evaluation]) -> Table | None:
    """Return a table of how many people took which exit; None if there is one alone, or too many for a table."""
    names = list(dict.fromkeys(results[0].exit_names))
    if not 1 < len(names) <= _EXITS:
        return None
    table = new_table("People by each exit, and their mean exit time.", *names)
    for result, _ in with_first(results, table):
        cells = []
        for found in result.row()["exits"].values():
            time = found["mean_exit_time"]
            cells.append(
                number(found["people"]["mean"], digits=1) + (f"  {time:6.1f} s" if time is not None else " " * 10)
            )
        add_row(table, result.policy, *cells)
    return table


def ranking_lines(results: Sequence[Evaluation]) -> list[str]:
    """Return the order of the policies under every scheme, and what to make of it, in words."""
    found = ranking(results)
    width = max(len(scheme) for scheme in found["schemes"])
    lines = []
    for scheme, row in found["schemes"].items():
        lines.append(f"{scheme:{width}}  {_order(row['order'], row['times'])}")
    if len(found["schemes"]) > 1:
        taus = [tau for tau in found["tau"].values() if tau is not None]
        agree = f" (Kendall's tau of the least alike: {min(taus):.2f})" if taus else ""
        lines.append(f"The order is {'the same under all schemes' if found['same'] else 'not the same'}{agree}.")
        for one in found["contradictions"]:
            a, b = one["policies"]
            under, against = (", ".join(one[key]) for key in ("first_faster_under", "second_faster_under"))
            lines.append(
                f"Contradiction: {a} is clearly faster than {b} under {under}, clearly slower under {against}."
            )
        if not found["same"] and not found["contradictions"]:
            lines.append("No two schemes contradict each other beyond the 95 % intervals.")
    return lines


def _order(names: Sequence[str], times: dict[str, float]) -> str:
    text = names[0]
    for before, name in pairwise(names):
        text += (" = " if times[before] == times[name] else " < ") + name
    return text


def new_table(caption: str, *columns: str, title: str = "") -> Table:
    """Return an empty table with a column for the policy before these."""
    left: dict[str, Any] = {"title_justify": "left", "caption_justify": "left"}
    table = Table(title=title or None, caption=caption, box=SIMPLE_HEAD, padding=(0, 1, 0, 0), **left)
    table.add_column("policy", overflow="fold", max_width=20)  # what is too long goes on below, numbers stay whole
    for name in columns:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def add_row(table: Table, policy: str, *cells: str) -> None:
    """Add the row of a policy."""
    table.add_row(Text(f" {policy}"), *(Text(cell) for cell in cells))


def with_first(results: Sequence[Evaluation], table: Table) -> Iterator[tuple[Evaluation, Evaluation]]:
    """Yield each result with the one of the first policy under its scheme, and begin a section for each scheme."""
    for scheme in dict.fromkeys(result.scheme for result in results):
        those = [result for result in results if result.scheme == scheme]
        table.add_section()
        table.add_row(Text(scheme, style="bold"))
        for result in those:
            yield result, those[0]


def _at_least(times: Floats, digits: int = 1) -> str:
    return f"≥{times.mean():.{digits if times.mean() < 99.95 else 0}f}"


def difference(paired: dict[str, Any], digits: int = 1) -> str:
    """Return a paired difference with its interval."""
    low, high = paired["ci95"]
    largest = max(abs(paired["mean"]), *(abs(bound or 0.0) for bound in (low, high)))
    digits = min(digits, 2 if largest < 9.995 else 1 if largest < 99.95 else 0)
    interval = "" if low is None else f" ({low:+.{digits}f}..{high:+.{digits}f})"
    return f"{paired['mean']:+.{digits}f}{interval}"
