"""Tables of evaluations, for people and for programs."""

from typing import Any

from rich.table import Table

from agents.evaluation import Evaluation


def _cell(summary: dict[str, Any], digits: int) -> str:
    return "-" if summary["mean"] is None else f"{summary['mean']:.{digits}f}"


def _spread(summary: dict[str, Any], digits: int) -> str:
    return "-" if summary["sd"] is None else f"{summary['sd']:.{digits}f}"


def _interval(summary: dict[str, Any], digits: int) -> str:
    low, high = summary["ci95"]
    return "-" if low is None else f"{low:.{digits}f} to {high:.{digits}f}"


def comparison_table(results: list[Evaluation], title: str) -> Table:
    """Return a table of policies against what they are judged by."""
    table = Table(title=title, caption="times over finished runs; ± sd over runs; interval of the mean by bootstrap")
    table.add_column("policy", style="bold")
    for name in ("evacuation time\ns", "95 % interval\ns", "mean exit\ntime s", "flow\n1/s"):
        table.add_column(name, justify="right")
    table.add_column("unfinished\npeople", justify="right")
    table.add_column("contact impulse\nN s per person", justify="right")
    for result in results:
        row = result.row()
        time, flow = row["evacuation_time"], row["flow"]
        table.add_row(
            row["policy"],
            f"{_cell(time, 2)} ± {_spread(time, 2)}",
            _interval(time, 2),
            _cell(row["mean_exit_time"], 2),
            f"{_cell(flow, 2)} ± {_spread(flow, 2)}",
            f"{row['unfinished']} of {sum(len(times) for times in result.exit_times)}",
            _cell(row["contact_impulse"], 0),
        )
    return table
