"""Tables of evaluations, for people and for programs."""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from crowd_env.analysis.figures import cell, median_time, number, percent, spread

from .comparison import minus_first, ranking
from .evaluation import Evaluation

Cells = Callable[[Evaluation, Evaluation], Mapping[str, str]]
"""From a result and that of the first policy beside it to the cells of its row, by the headings of their columns."""

# What the columns of `_times` are.
_WORDS = (
    "Seconds. half: when the last person was out in half of all runs; last and mean: of the last person, ± sd, and of all, in "
    "the runs that cleared; Δ: longer than the first policy on the draws that both cleared, and its 95 % interval; left: in so "
    "many more runs someone was left inside;"
)
_EXITS = 4  # more do not fit side by side
# Of `crowding_table`; a star is behind what nobody would feel.
_CROWDING = {
    "flow\n1/s": "{flow[mean]:.2f}",
    "dens.\n1/m2": "{max_density[mean]:.1f}",
    "pressure\nkN/m": "{max_pressure[mean]:k}{star}",
    "crushed\n%": "{crushed_share[mean]:%}{star}",
    "\ns": "{crushed_time[mean]:.1f}",
    "impulse\nkN s": "{impulse:.2f}",
    "way\nm": "{walked[mean]:.1f}",
    "overlap\nmm": "{max_overlap:m}",
    "fastest\nm/s": "{max_speed:.1f}",
    "comp.\nms/s": "{computing:m}",
    "plan\nms/s": "{replanning_per_simulated_second:m}",
}


def table_console() -> Console:
    """Return where tables go: standard output, 104 columns wide where that is no terminal."""
    console = Console()
    return console if console.is_terminal else Console(width=104)


def table_of(groups: Mapping[str, Sequence[Evaluation]], cells: Cells, caption: str, title: str = "") -> Table:
    """Return a table with a row for each result, and a section for each group that has a name."""
    left: dict[str, Any] = {"title_justify": "left", "caption_justify": "left"}
    table = Table(title=title or None, caption=caption, box=SIMPLE_HEAD, padding=(0, 1, 0, 0), **left)
    table.add_column("policy", overflow="fold", max_width=20)  # what is too long goes on below, numbers stay whole
    rows = {group: [(one.policy, cells(one, results[0])) for one in results] for group, results in groups.items()}
    for heading in next((found for some in rows.values() for _, found in some), ()):
        table.add_column(heading, justify="right", no_wrap=True)
    for group, some in rows.items():
        if group:
            table.add_section()
            table.add_row(Text(group, style="bold"))
        for policy, found in some:
            table.add_row(Text(f" {policy}"), *map(Text, found.values()))
    return table


def by_scheme(results: Sequence[Evaluation]) -> dict[str, list[Evaluation]]:
    """Return the results under each scheme."""
    found: dict[str, list[Evaluation]] = {}
    for result in results:
        found.setdefault(result.scheme, []).append(result)
    return found


def comparison_table(results: Sequence[Evaluation], title: str) -> Table:
    """Return a table of policies against what they are judged by; the others are compared with the first."""
    caption = (
        f"{_WORDS} in: people left inside; runs left: % of runs in which someone was, and its 95 % interval; N s: contact "
        "impulse per person."
    )

    def cells(result: Evaluation, first: Evaluation) -> dict[str, str]:
        row, times = result.row(), _times(result, first, digits=2)
        return {
            **{name: times[name] for name in ("half", "last", "Δ last", "left", "mean", "in")},
            "runs left %": percent(row["unfinished_share"]),
            "N s": number(row["contact_impulse"]["mean"], digits=0),
        }

    return table_of({"": results}, cells, caption, title)


# ------------------------------------------------------------------------------------------ policies under many schemes


def times_table(results: Sequence[Evaluation], title: str) -> Table:
    """Return a table of how long policies took, and how much longer than the first one on the same draws."""
    caption = f"{_WORDS} 95 %: when 95 % were out in half of all runs; in: people left inside."
    return table_of(by_scheme(results), _times, caption, title)


def _times(result: Evaluation, first: Evaluation, digits: int = 1) -> dict[str, str]:
    row, longer, own = result.row(), minus_first(result, first), result is first
    return {
        "half": half(row["median_time"], digits),
        "last": spread(row["evacuation_time"], digits=digits),
        "Δ last": "" if own else with_interval(longer["evacuation_time"], digits, "+"),
        "left": "" if own else f"{longer['evacuation_time']['more_left']:+d}",
        "95 %": half(median_time(result.exit_time_95()), digits),
        "mean": number(row["mean_exit"]["mean"], digits=digits),
        "Δ mean": "" if own else with_interval(longer["mean_exit_time"], digits, "+"),
        "in": str(row["unfinished"]),
    }


def left_table(results: Sequence[Evaluation]) -> Table:
    """Return a table of the runs in which someone was left inside, and of those whose exits blocked."""
    caption = (
        "Runs in which someone was left inside, and those of them in which the exits blocked: how many, and % of runs with "
        "its 95 % interval (Wilson): none of few runs does not mean never."
    )

    def cells(result: Evaluation, first: Evaluation) -> dict[str, str]:
        row = result.row()
        return {
            "in": str(row["unfinished"]),
            "runs left": f"{row['unfinished_runs']} of {row['runs']}",
            "left %": percent(row["unfinished_share"]),
            "blocked": f"{row['blocked_runs']} of {row['runs']}",
            "blocked %": percent(row["blocked_share"]),
        }

    return table_of(by_scheme(results), cells, caption)


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
    for scheme in dict.fromkeys(result.scheme for result in results if not result.pressure_is_force):
        caption += f" *{scheme} has no forces: its impulses keep bodies apart, and nobody would feel that pressure."

    def cells(result: Evaluation, first: Evaluation) -> dict[str, str]:
        row = result.row()
        row |= {
            "star": " " if row["pressure_is_force"] else "*",
            "impulse": row["contact_impulse"]["mean"] / 1e3,
            "computing": row["physics_per_simulated_second"] + row["replanning_per_simulated_second"],
        }
        return {heading: cell(text, row) for heading, text in _CROWDING.items()}

    return table_of(by_scheme(results), cells, caption)


def exits_table(results: Sequence[Evaluation]) -> Table | None:
    """Return a table of how many people took which exit; None if there is one alone, or too many for a table."""
    if not 1 < len(set(results[0].exit_names)) <= _EXITS:
        return None

    def cells(result: Evaluation, first: Evaluation) -> dict[str, str]:
        found = {}
        for name, taken in result.row()["exits"].items():
            time = taken["mean_exit_time"]
            found[name] = number(taken["people"]["mean"], digits=1) + ("" if time is None else f"  {time:6.1f} s")
        return found

    return table_of(by_scheme(results), cells, "People by each exit, and their mean exit time.")


def ranking_lines(results: Sequence[Evaluation]) -> list[str]:
    """Return the order of the policies under every scheme, and what to make of it, in words."""
    found = ranking(results)
    width = max(len(scheme) for scheme in found["schemes"])
    lines = [f"{scheme:{width}}  {_order(row['order'], row['times'])}" for scheme, row in found["schemes"].items()]
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


def half(time: float | None, digits: int = 1) -> str:
    """Return when half of all runs had cleared, in words if they never did."""
    return "never" if time is None else f"{time:.{digits}f}"


def with_interval(found: Mapping[str, Any], digits: int = 1, sign: str = "") -> str:
    """Return "52.3 (51.2..53.4)": a mean with its interval, "-" for none; the larger the numbers, the fewer digits."""
    if found["mean"] is None:
        return "-"
    bounds = [bound for bound in found["ci95"] if bound is not None]
    largest = max(abs(value) for value in (found["mean"], *bounds))
    digits = min(digits, 2 if largest < 9.995 else 1 if largest < 99.95 else 0)
    between = "..".join(f"{bound:{sign}.{digits}f}" for bound in bounds)
    return f"{found['mean']:{sign}.{digits}f}" + (f" ({between})" if between else "")
