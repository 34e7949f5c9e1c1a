"""Tables of evaluations, for people and for programs."""

from typing import Any

from rich.table import Table

from agents.evaluation import Evaluation


def _cell(summary: dict[str, Any], digits: int) -> str:
    return "-" if summary["mean"] is None else f"{summary['mean']:.{digits}f}"


def _with_spread(summary: dict[str, Any], digits: int) -> str:
    if summary["sd"] is None:
        return _cell(summary, digits)
    return f"{_cell(summary, digits)} ± {summary['sd']:.{digits}f}"


def _interval(summary: dict[str, Any], digits: int) -> str:
    low, high = summary["ci95"]
    return "-" if low is None else f"{low:.{digits}f}..{high:.{digits}f}"


def comparison_table(results: list[Evaluation], title: str) -> Table:
    """Return a table of policies against what they are judged by."""
    caption = "over runs in which all got out; ± sd over runs; in: people left inside;\nN s: contact impulse per person"
    table = Table(title=title, caption=caption)
    table.add_column("policy", style="bold", no_wrap=True)
    for name in ("evacuation s", "95 % of mean", "exit s", "flow 1/s", "in", "N s"):
        table.add_column(name, justify="right", no_wrap=True)
    for result in results:
        row = result.row()
        time, flow = row["evacuation_time"], row["flow"]
        table.add_row(
            row["policy"],
            _with_spread(time, 2),
            _interval(time, 2),
            _cell(row["mean_exit_time"], 2),
            _cell(flow, 2),
            str(row["unfinished"]),
            _cell(row["contact_impulse"], 0),
        )
    return table
