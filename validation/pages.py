"""The tables of measured figures in docs/, each made by commands that anyone can run, and written by none but this.

Between ``<!-- table: NAME -->`` and ``<!-- end -->`` stands what `TABLES` makes of ``--json``; nothing there is typed by hand.
"""

import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from crowd_env import SCHEMES
from crowd_env.files.atomic import write_text
from validation import reproduced

ROOT = Path(__file__).resolve().parent.parent

Command = Callable[[str], dict[str, Any]]  # runs a command line of Python modules, returns what it prints


class Table(NamedTuple):
    """A table of a page.

    Attributes
    ----------
    page : where it stands, below the root of the repository.
    head : of the columns.
    rows : makes the cells, from commands.
    """

    page: str
    head: tuple[str, ...]
    rows: Callable[[Command], list[list[str]]]


def fill(name: str, command: Command, root: Path = ROOT) -> Path:
    """Make a table anew and write it into its page, which is returned.

    Raises
    ------
    ValueError
        If the page has no place for the table, or a command fails; nothing is written then.
    """
    table = TABLES[name]
    page = root / table.page
    text = page.read_text(encoding="utf-8")
    before, mark, rest = text.partition(f"<!-- table: {name} -->\n")
    _, end, after = rest.partition("<!-- end -->")
    if not end:
        raise ValueError(f"{table.page} has no place for {name}; mark one with <!-- table: {name} --> and <!-- end -->")
    write_text(page, f"{before}{mark}{markdown(table.head, table.rows(command))}{end}{after}")
    return page


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table as Markdown, a line a row."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def run(line: str) -> dict[str, Any]:
    """Run ``python -m LINE --json`` and return the object that it prints.

    Raises
    ------
    ValueError
        If the command fails.
    """
    words = [sys.executable, "-m", *line.split(), "--json"]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        raise ValueError(f"python -m {line} --json failed: {(done.stderr.strip().splitlines() or ['no message'])[-1]}")
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def _spread(found: dict[str, Any] | None, digits: int) -> str:
    return "–" if not found or found["mean"] is None else f"{found['mean']:.{digits}f} ± {found['sd']:.{digits}f}"


def _signed(value: float, digits: int) -> str:
    return f"{value:+.{digits}f}".replace("-", "−")


def _left(row: dict[str, Any]) -> str:
    if not row["unfinished"]:
        return "nobody"
    return f"{row['unfinished']} people in {row['unfinished_runs']} of {row['runs']} runs"


def _schemes(command: Command) -> list[list[str]]:
    rows = []
    for scheme in SCHEMES:
        found = command(f"crowd_env run room-v0 --scheme {scheme} --runs 50")
        overlap = found["overlap_mm"]
        rows.append(
            [
                f"`{scheme}`",
                f"{overlap['mean']:.3g} / {overlap['max']:.3g}",
                _spread(found["evacuation_time"], 2),
                _spread(found["flow"], 2),
                _left(found),
                f"{found['max_speed']:.1f}",
            ]
        )
    return rows


def _clogging(command: Command) -> list[list[str]]:
    rows = []
    for speed in ("1.0", "1.5", "1.8"):
        (found,) = command(f"crowd_env clogging --speed {speed} --n 200 --runs 10")["sets"]
        gaps, tail = found["gaps"], found["tail"]
        cells = ["–"] * 3
        if tail is not None:
            later = tail["alpha_open"]
            cells = [
                f"{tail['alpha']:.2f} ± {tail['error']:.2f}",
                "–" if later is None else f"{later:.2f}",
                f"{_signed(tail['ratio'], 1)} (p = {tail['p']:.2g})",
            ]
        blocked = f"{found['blocked_runs']} of {found['runs']}"
        rows.append([speed, str(gaps["count"]), f"{gaps['mean']:.2f}", f"{gaps['cv']:.2f}", *cells, blocked])
    return rows


def _strategies(command: Command) -> list[list[str]]:
    schemes = ("dem", "nsm1", "nsm2", "hertz")
    names = ("shortest", "fastest", "comfortable", "nearest")
    found = command(
        f"agents.evaluate --scenario two-exit-hall-v0 --policies {' '.join(names)} --schemes {' '.join(schemes)} --runs 20"
    )
    by = {(row["policy"], row["scheme"]): row for row in found["rows"]}
    return [[name, *(_beside_first(by[name, scheme]) for scheme in schemes)] for name in names]


def _beside_first(row: dict[str, Any]) -> str:
    """Return the time of the last person, who was left inside, and the interval of the difference to the first policy."""
    text = f"{'≥ ' if row['unfinished'] else ''}{row['unfinished_at_limit']['last']:.1f}"
    longer = row["minus_first"]["evacuation_time"]
    if row["minus_first"]["policy"] != row["policy"]:
        text += f" ({_signed(longer['ci95'][0], 1)} to {_signed(longer['ci95'][1], 1)})"
    return text if not row["unfinished"] else f"{text}; left inside: {_left(row)}"


_GAPS = ("gaps", "mean, s", "sd / mean", "exponent α", "with open gaps", "against an exponential", "blocked")

TABLES: dict[str, Table] = {
    "schemes": Table(
        "docs/physics.md",
        ("scheme", "overlap, mean / max, mm", "evacuation time, s", "flow, 1/s", "left inside", "largest speed, m/s"),
        _schemes,
    ),
    "clogging": Table("docs/clogging.md", ("desired speed, m/s", *_GAPS), _clogging),
    "strategies": Table("docs/routing.md", ("last person out, s", "`dem`", "`nsm1`", "`nsm2`", "`hertz`"), _strategies),
}
TABLES |= {name: Table("docs/reproduce.md", *table) for name, table in reproduced.TABLES.items()}
