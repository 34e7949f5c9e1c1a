"""Tables of evaluations, for people: each is a format for every column, filled from judged rows."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TypeAlias

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from crowd_env.analysis.figures import cell, median_time
from crowd_env.core.console import literal_console

from ..plain import Plain
from .comparison import by_scheme, ranking, rows_beside
from .evaluation import Evaluation

Columns: TypeAlias = Mapping[str, str]  # heading -> the format of its cells, see `crowd_env.analysis.figures.cell`
Sections: TypeAlias = Mapping[str, Sequence[Plain]]  # what stands above some rows -> these

# What the columns of `_TIMES` are.
_WORDS = (
    "Seconds. half: when the last person was out in half of all runs; last and mean: of the last person, ± sd, and of all, in "
    "the runs that cleared; Δ: longer than the first policy on the draws that both cleared, and its 95 % interval; left: in so "
    "many more runs someone was left inside;"
)
_TIMES = {
    "half": "{median_time:half}",
    "last": "{evacuation_time:spread}",
    "Δ last": "{longer[evacuation_time]:difference}",
    "left": "{longer[evacuation_time][more_left]:+d}",
    "95 %": "{half_95:half}",
    "mean": "{mean_exit[mean]:.1f}",
    "Δ mean": "{longer[mean_exit_time]:difference}",
    "in": "{unfinished}",
}
_COMPARISON = {
    "half": "{median_time:half/2}",
    "last": "{evacuation_time:spread/2}",
    "Δ last": "{longer[evacuation_time]:difference/2}",
    "left": _TIMES["left"],
    "mean": "{mean_exit[mean]:.2f}",
    "in": _TIMES["in"],
    "runs left %": "{unfinished_share:percent}",
    "N s": "{contact_impulse[mean]:.0f}",
}
_LEFT = {
    "in": _TIMES["in"],
    "runs left": "{unfinished_runs} of {runs}",
    "left %": "{unfinished_share:percent}",
    "blocked": "{blocked_runs} of {runs}",
    "blocked %": "{blocked_share:percent}",
}
_TASK = {
    "blocked": _LEFT["blocked"],
    "%": _LEFT["blocked %"],
    "unfinished": "{unfinished_runs}",
    "half": _TIMES["half"],
    "clearing": "{evacuation_time:interval}",
    "mean exit": "{mean_exit:interval}",
    "flow\n1/s": "{flow[mean]:.2f}",
}
# A star is behind what nobody would feel.
_CROWDING = {
    "flow\n1/s": _TASK["flow\n1/s"],
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
_EXITS = 4  # more do not fit side by side


def table_console() -> Console:
    """Return where tables go: standard output, 104 columns wide where that is no terminal."""
    console = literal_console()
    return console if console.is_terminal else literal_console(width=104)


def table_of(sections: Sections, columns: Columns, caption: str, title: str = "") -> Table:
    """Return a table with a row for each policy, and a section for each name that is not empty."""
    table = Table(
        title=title or None,
        caption=caption,
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        title_justify="left",
        caption_justify="left",
    )
    table.add_column("policy", overflow="fold", max_width=20)  # what is too long goes on below, numbers stay whole
    for heading in columns:
        table.add_column(heading, justify="right", no_wrap=True)
    for name, rows in sections.items():
        if name:
            table.add_section()
            table.add_row(Text(name, style="bold"))
        for row in rows:
            table.add_row(Text(f" {row['policy']}"), *(Text(cell(text, row)) for text in columns.values()))
    return table


def _sections(groups: Mapping[str, Sequence[Evaluation]]) -> Sections:
    return {name: list(map(_shown, results, rows_beside(results))) for name, results in groups.items()}


def _shown(result: Evaluation, row: Plain) -> Plain:
    """Return a row with what only tables show: ``longer`` than the first policy, which has no such thing itself."""
    found = {
        **row,
        "longer": None if row["minus_first"]["policy"] == row["policy"] else row["minus_first"],
        "half_95": median_time(result.exit_time_95()),
        "impulse": row["contact_impulse"]["mean"] / 1e3,
    }
    if result.measured is None:
        return found
    return found | {
        "star": " " if row["pressure_is_force"] else "*",
        "computing": row["physics_per_simulated_second"] + row["replanning_per_simulated_second"],
        "by_exit": list(row["exits"].values()),
    }


def comparison_table(results: Sequence[Evaluation], title: str) -> Table:
    """Return a table of policies against what they are judged by; the others are compared with the first."""
    caption = (
        f"{_WORDS} in: people left inside; runs left: % of runs in which someone was, and its 95 % interval; N s: contact "
        "impulse per person."
    )
    return table_of(_sections({"": results}), _COMPARISON, caption, title)


def times_table(results: Sequence[Evaluation], title: str) -> Table:
    """Return a table of how long policies took, and how much longer than the first one on the same draws."""
    caption = f"{_WORDS} 95 %: when 95 % were out in half of all runs; in: people left inside."
    return table_of(_sections(by_scheme(results)), _TIMES, caption, title)


def left_table(results: Sequence[Evaluation]) -> Table:
    """Return a table of the runs in which someone was left inside, and of those whose exits blocked."""
    caption = (
        "Runs in which someone was left inside, and those of them in which the exits blocked: how many, and % of runs with "
        "its 95 % interval (Wilson): none of few runs does not mean never."
    )
    return table_of(_sections(by_scheme(results)), _LEFT, caption)


def task_table(
    groups: Mapping[str, Sequence[Evaluation]], title: str, note: str = "", starts: Mapping[str, str] | None = None
) -> Table:
    """Return a table of the figures by which policies are judged on a task, with a section for each group.

    ``starts`` says what policies knew before they learned (`crowd_env.agents.starts_from`): a line below, for want of room.
    """
    caption = (
        "Runs of all in which the exits blocked, and in which someone was left inside, blocked ones included; %: with its "
        "95 % interval (Wilson). half: s, when the last person was out in half of all runs. clearing, of the last person, and "
        f"mean exit, of everybody: s, in the runs that cleared, with the 95 % interval.{note}"
    )
    known = starts or {}
    for start in dict.fromkeys(known.values()):
        caption += f" Starts from {start}: {', '.join(name for name in known if known[name] == start)}."
    return table_of(_sections(groups), _TASK, caption, title)


def crowding_table(results: Sequence[Evaluation]) -> Table:
    """Return a table of how close people came, how hard they pressed, how far they walked, and what it took to compute."""
    caption = (
        "Means over runs. dens.: one over the least floor of anyone; pressure: greatest contact "
        "force on someone over circumference, mean of 0.1 s; crushed: people who bore more than 1.6 kN/m (injury, Helbing et "
        "al. 2000; friction included) in any 0.1 s, and for how long in all, mean of these; impulse, way: per person; overlap: "
        "deepest; fastest: largest speed of anyone; comp.: processor time per simulated second, and what planning anew takes "
        "of it."
    )
    sections = _sections(by_scheme(results))
    for scheme, rows in sections.items():
        for row in (row for row in rows if row["escaped"]):
            caption += (
                f" VOID: {row['escaped']} people were outside of the plan in runs of {row['policy']} under {scheme}."
            )
        if not rows[0]["pressure_is_force"]:
            caption += f" *{scheme} has no forces: its impulses keep bodies apart, and nobody would feel that pressure."
    return table_of(sections, _CROWDING, caption)


def exits_table(results: Sequence[Evaluation]) -> Table | None:
    """Return a table of how many people took which exit; None if there is one alone, or too many for a table."""
    names = list(dict.fromkeys(results[0].exit_names))
    if not 1 < len(names) <= _EXITS:
        return None
    text = "{by_exit[%d][people][mean]:.1f}  {by_exit[%d][mean_exit_time]:6.1f} s"
    columns = {name: text % (k, k) for k, name in enumerate(names)}
    return table_of(_sections(by_scheme(results)), columns, "People by each exit, and their mean exit time.")


def ranking_lines(results: Sequence[Evaluation]) -> list[str]:
    """Return the order of the policies under every scheme, and what to make of it, in words."""
    found = ranking(results)
    width = max(len(scheme) for scheme in found["schemes"])
    lines = [f"{scheme:{width}}  {_order(**row)}" for scheme, row in found["schemes"].items()]
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


def _order(order: Sequence[str], times: Mapping[str, float | None]) -> str:
    text = order[0]
    for before, name in pairwise(order):
        text += (" = " if times[before] == times[name] else " < ") + name
    return text
