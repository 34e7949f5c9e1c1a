"""One number beside the paper's, and all that one table or figure amounts to."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, astuple, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import Plain
from crowd_env.core.files.csv_table import write_csv
from crowd_env.core.files.json_file import write_json
from crowd_env.envs.metrics import summarise

_COLUMNS = {"expected": "closed_form"}  # that have another name outside
_EQUAL = 1e-9  # relative; what the solvers leave


@dataclass(frozen=True)
class Row:
    """One quantity, the paper's value beside ours."""

    quantity: str  # unique within a result
    paper: str | None  # as printed, so that its digits can be counted; None where the paper prints none
    here: float | None  # None where it does not exist: not simulated, or without an exit
    unit: str  # "1" for pure numbers
    n: int  # runs, exits, draws or steps behind it
    reading: str  # estimator and reading of the paper
    expected: float | None = None  # closed form of the same quantity
    sd: float | None = None  # over runs
    ci95: tuple[float, float] | None = None  # of the mean, over runs; of runs that are counted, of their share (Wilson)

    @property
    def decimals(self) -> int:
        """Number of decimals that the paper prints."""
        return len((self.paper or "").partition(".")[2])

    def shown(self) -> str:
        """Return our value with the digits that can be compared."""
        if self.here is None:
            return "-"
        value = 0.0 if abs(self.here) < 1e-12 else self.here
        if self.decimals >= 4:
            return f"{value:.{self.decimals}f}"
        if self.unit == "s":
            return f"{value:.1f}"
        return f"{value:.2f}" if self.unit in ("1/s", "share") else f"{value:.6g}"

    def difference(self) -> str:
        """Return "exact" if every printed digit agrees, else how far our value is from the paper's or the closed form."""
        if self.here is None or (self.paper is None and self.expected is None):
            return "-"
        if self.paper is None:
            assert self.expected is not None
            return _percent(self.here, self.expected)
        apart = self.here - float(self.paper)
        if self.unit in ("1/s", "s"):
            return _percent(self.here, float(self.paper), 1) if float(self.paper) else f"{apart:+.2f}"
        if self._rounds_to_it() and (self.decimals >= 4 or abs(apart) < _EQUAL):
            return "exact"
        return f"{apart:+.2g}"

    def explained(self) -> str:
        """Return the reading with the closed form and the spread."""
        text = self.reading
        if self.expected is not None and self.here is not None:
            met = _percent(self.here, self.expected) == "0"
            text += "; meets the closed form" if met else f"; closed form {self.expected:.6g}"
        if self.unit not in ("1/s", "s") and self._rounds_to_it() and self.difference() != "exact":
            text += "; rounds to the printed one"
        if self.sd is not None:
            text += f"; sd {self.sd:.2f}"
        if self.ci95 is not None and self.unit == "runs":
            text += f"; of all runs, 95 %: {100 * self.ci95[0]:.0f} to {100 * self.ci95[1]:.0f} %"
        elif self.ci95 is not None:
            text += f"; 95 % {self.ci95[0]:.2f} to {self.ci95[1]:.2f}"
        return text

    def _rounds_to_it(self) -> bool:
        if self.here is None or self.paper is None:
            return False
        return float(f"{self.here:.{self.decimals}f}") == float(self.paper)

    def as_json(self) -> Plain:
        """Return what ``--json`` prints."""
        told = {_COLUMNS.get(name, name): value for name, value in asdict(self).items()}
        paper, ci95 = (self.paper and float(self.paper)), (self.ci95 and list(self.ci95))
        return {**told, "paper": paper, "ci95": ci95}


class Estimate(NamedTuple):
    """A number with its spread; None where there is too little to tell."""

    value: float | None
    n: int  # runs or exits that it rests on
    sd: float | None = None  # over runs
    ci95: tuple[float, float] | None = None  # over runs: t; of a pooled line by the jackknife


def mean_of_runs(values: Floats) -> Estimate:
    """Return the mean over the runs (R,) that have a value, not nan, and of two or more its spread."""
    mean, sd, ci95 = summarise(values)
    n = int(np.isfinite(values).sum())
    return Estimate(mean, n, sd, ci95) if n > 1 else Estimate(mean if n else None, n)


def mean_row(
    quantity: str, values: Floats, unit: str, reading: str, paper: str | None = None, *, interval: bool = True
) -> Row:
    """Return the mean of ``values`` (R,) over the runs that have one, with its spread and, if wanted, its ``interval``."""
    mean, n, sd, ci95 = mean_of_runs(values)
    return Row(quantity, paper, mean, unit, n, reading, sd=sd, ci95=ci95 if interval else None)


def _percent(value: float, other: float, decimals: int = 2) -> str:
    if abs(value - other) <= _EQUAL * max(1.0, abs(other)):
        return "0"
    return f"{100 * (value / other - 1):+.{decimals}f} %" if other else f"{value:+.1e}"


class RawTable(NamedTuple):
    """Numbers behind the rows, for a CSV file."""

    header: Sequence[str]
    rows: Iterable[Sequence[object]]


@dataclass(frozen=True)
class Result:
    """A table or figure of the paper, redone."""

    sections: Sequence[Sequence[Row]]  # of the table, a line between each two
    raw: Mapping[str, RawTable]  # end of the file name -> numbers
    draw: Callable[[], Any]  # makes the figure, of matplotlib
    remarks: Sequence[str] = ()  # what is and is not reproduced, in words
    unit: str = ""  # that the title names, of most rows
    film: Callable[[Path], Path] | None = None  # writes a film, a GIF
    of: str = ""  # that the title adds in brackets, such as a scheme
    # Of the figure that was redone.
    name: str = ""
    title: str = ""
    options: Mapping[str, object] = field(default_factory=dict)  # only values that differ from the defaults

    @property
    def rows(self) -> list[Row]:
        """The rows of all sections."""
        return [row for section in self.sections for row in section]

    def as_json(self) -> Plain:
        """Return what ``--json`` prints."""
        return {
            "name": self.name,
            "rows": [row.as_json() for row in self.rows],
            "remarks": list(self.remarks),
            "options": dict(self.options),
        }

    def save(self, folder: Path) -> list[Path]:
        """Write the rows as CSV, rows and remarks as JSON, and the numbers behind them as CSV; return the paths."""
        header = ("quantity", "paper", "here", "unit", "n", "reading", "closed_form", "sd", "ci95_low", "ci95_high")
        rows = [(*astuple(row)[:8], *(row.ci95 or (None, None))) for row in self.rows]
        paths = [write_csv(folder / f"{self.name}.csv", header, rows)]
        paths.append(folder / f"{self.name}.json")
        write_json(paths[-1], self.as_json())
        return paths + [write_csv(folder / f"{self.name}-{ending}.csv", *table) for ending, table in self.raw.items()]
