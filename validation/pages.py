"""The measured figures in docs/, each made by commands that anyone can run, and written by none but this.

Between ``<!-- table: NAME -->`` and ``<!-- end -->`` stands what `TABLES` makes, a table and sentences that say its figures in
words; nothing there is typed by hand.
"""

import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from crowd_env.agents.tasks import TASKS
from crowd_env.core.files.atomic import write_text
from crowd_env.core.files.json_file import read_json
from validation import blocked, bodies_tables, map_tables, reproduced, tables, task_pages, training_tables
from validation.cases.case import DISC
from validation.finished import complete_rows, draws, of_bodies

ROOT = Path(__file__).resolve().parent.parent

Command = Callable[[str], dict[str, Any]]  # runs a command line of Python modules, returns what it prints


class Sources:
    """What a table is made of: what commands print, or the files of the folder that a finished run has written.

    A command that several parts of a table ask for is run once.

    Attributes
    ----------
    folder : of the finished run; None for a table that runs commands.
    """

    def __init__(self, command: Command, folder: Path | None = None) -> None:
        self._command, self.folder = cache(command), folder

    def __call__(self, line: str) -> dict[str, Any]:
        """Return the object that ``python -m LINE --json`` prints."""
        return self._command(line)

    def path(self, file: str) -> Path:
        """Return the path of a file of the finished run."""
        assert self.folder is not None  # of a table with `made_by`; `fill` has seen to it
        return self.folder / file

    def read(self, file: str) -> Any:
        """Return the content of a JSON file of the finished run; ValueError if there is none."""
        return read_json(self.path(file))

    def rows(self, case: str, outline: str = DISC) -> list[dict[str, Any]]:
        """Return the finished rows of a case of ``python -m validation``; ValueError if there are none."""
        folder = of_bodies(self.path(""), outline)
        found = [row._asdict() for row in complete_rows(folder, case)]
        if not found:
            made_by = f"python -m validation {case}{'' if outline == DISC else f' --outline {outline}'} --out DIR"
            raise ValueError(f"{folder / case} holds no finished rows; made by {made_by}")
        return found

    def draws(self, case: str, outline: str = DISC) -> str:
        """Return how many draws a case has had, in words."""
        least, most = draws(of_bodies(self.path(""), outline), case)
        return f"{least}{f' to {most}' if most > least else ''} draw{'s' if most > 1 else ''}"


class Table(NamedTuple):
    """A table of a page.

    Attributes
    ----------
    page : that it stands on, below the root of the repository.
    head : of the columns; without one there are only sentences.
    rows : makes the cells.
    note : makes the sentences below the table.
    made_by : command line that takes long, or reads data which is not in the repository: the table is made of the folder that
        it has written.  Empty for a table that runs its commands itself.
    data : a JSON file of the package that has the same as data, and what makes the keys that it takes from there.
    """

    page: str
    head: tuple[str, ...]
    rows: Callable[[Sources], list[list[str]]]
    note: Callable[[Sources], str] | None = None
    made_by: str = ""
    data: tuple[str, Callable[[Sources], dict[str, Any]]] | None = None


def fill(name: str, command: Command, *, folder: Path | None = None, root: Path = ROOT) -> Path:
    """Make a table anew and write it into its page, which is returned.

    Raises
    ------
    ValueError
        If the page has no place for the table, a command fails, or a finished run is missing; nothing is written then.
    """
    table = TABLES[name]
    if table.made_by and folder is None:
        raise ValueError(f"{name} is made of the folder that this has written: {table.made_by}; name it by --from")
    page = root / table.page
    text = page.read_text(encoding="utf-8")
    replaced(text, f"table: {name}", "", table.page)  # before the work
    sources = Sources(command, folder)
    parts = [markdown(table.head, table.rows(sources))] if table.head else []
    if table.note is not None:
        parts.append(f"{table.note(sources)}\n")
    if table.data is not None:
        file, make = root / table.data[0], table.data[1]
        content = {**(read_json(file) if file.exists() else {}), **make(sources)}
        write_text(file, json.dumps(content, indent=1, ensure_ascii=False) + "\n")
    write_text(page, replaced(text, f"table: {name}", "\n".join(parts), table.page))
    return page


def replaced(text: str, mark: str, content: str, page: str) -> str:
    """Return the text of a page with other content between ``<!-- MARK -->`` and ``<!-- end -->``.

    Raises
    ------
    ValueError
        If the page has no such place.
    """
    before, begin, rest = text.partition(f"<!-- {mark} -->\n")
    _, end, after = rest.partition("<!-- end -->")
    if not end:
        name = mark.rpartition(" ")[2]
        raise ValueError(f"{page} has no place for {name}; mark one with <!-- {mark} --> and <!-- end -->")
    return f"{before}{begin}{content}{end}{after}"


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]], numbers: bool = False) -> str:
    """Return a table as Markdown, a line a row; ``numbers`` are set to the right, in all columns but the first."""
    lines = [head, ["---", *["---:" if numbers else "---"] * (len(head) - 1)], *rows]
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


_MAP_COMMAND = f"python -m validation {' '.join(map_tables.CASES)} --data DATA --out DIR"
_GAPS = ("gaps", "mean, s", "sd / mean", "exponent α", "with open gaps", "against an exponential", "blocked")

TABLES: dict[str, Table] = {
    "schemes": Table(
        "docs/physics.md",
        (
            "scheme",
            "step, s",
            "overlap, mean / max, mm",
            "beyond a wall, mm",
            "evacuation time, s",
            "flow, 1/s",
            "left inside",
            "largest speed, m/s",
        ),
        tables.schemes,
        tables.schemes_note,
    ),
    "halls": Table(
        "docs/physics.md",
        (
            "scheme",
            "outside of the plan",
            "fastest of 500, m/s",
            "of 1000",
            "of 2000",
            "of 5000",
            "deepest overlap, mm",
        ),
        tables.halls,
        made_by="python -m validation halls great-halls --out DIR",
    ),
    "jambs": Table(
        "docs/physics.md",
        ("scheme", "manner", "door of 0.5 m", "door of 0.6 m", "door of 0.8 m"),
        tables.jambs,
        made_by="python -m validation jambs --out DIR",
    ),
    "bodies-gate": Table(
        "docs/physics.md",
        bodies_tables.GATE_HEAD,
        bodies_tables.gate,
        bodies_tables.gate_note,
        made_by=bodies_tables.GATE_MADE_BY,
    ),
    "bodies-doors": Table(
        "docs/physics.md",
        bodies_tables.DOORS_HEAD,
        bodies_tables.doors,
        bodies_tables.doors_note,
        made_by=bodies_tables.DOORS_MADE_BY,
    ),
    "clogging": Table("docs/clogging.md", ("desired speed, m/s", *_GAPS), tables.clogging, tables.clogging_note),
    "frozen": Table(
        "docs/clogging.md",
        blocked.HEAD,
        blocked.frozen,
        blocked.frozen_note,
        made_by="python -m validation frozen --out DIR",
    ),
    "forces": Table("docs/clogging.md", (), lambda _: [], tables.forces_note),
    "strategies": Table(
        "docs/routing.md",
        ("last person out, s", *(f"`{scheme}`" for scheme in tables.STRATEGY_SCHEMES)),
        tables.strategies,
        tables.strategies_note,
    ),
    "controller": Table(
        "docs/routing.md",
        ("", "last person, s", "learned minus this", "mean, s", "left inside"),
        tables.controller,
        tables.controller_note,
        made_by="crowd-env train --scenario two-exit-hall-v0 --decides routing",
    ),
    "tasks": Table(
        "docs/training.md",
        (
            "task",
            "what it is",
            "scenario and its options",
            "people",
            "scheme, step",
            "rule, manner",
            "time limit / blocked after",
            "draws",
            "decides",
            "version",
        ),
        tables.tasks,
    ),
    "training": Table(
        "docs/training.md",
        training_tables.TRAINING_HEAD,
        training_tables.training,
        training_tables.training_note,
        made_by="python train.py",
    ),
    "map": Table(
        "docs/validation.md",
        map_tables.PASSED_HEAD,
        map_tables.passed,
        map_tables.criteria,
        made_by=_MAP_COMMAND,
        data=("crowd_env/rendering/report/page_parts/limits.json", map_tables.as_data),
    ),
    "measured": Table("docs/validation.md", map_tables.FIGURES_HEAD, map_tables.figures, made_by=_MAP_COMMAND),
    "full-speed": Table(
        "docs/validation.md",
        map_tables.FULL_SPEED_HEAD,
        map_tables.full_speed,
        map_tables.full_speed_note,
        made_by=f"python -m validation gate doors --manner {map_tables.FULL_SPEED} --data DATA --out DIR",
    ),
    "scenarios": Table(
        "docs/scenarios.md",
        ("runs with people left inside", *(f"`{scheme}`" for scheme in tables.SCENARIO_SCHEMES)),
        tables.scenarios,
    ),
    "foyer": Table("docs/scenarios.md", (), lambda _: [], tables.foyer_note),
}
TABLES |= {name: Table("docs/reproduce.md", *table) for name, table in reproduced.TABLES.items()}
TABLES["leaderboard"] = Table(
    "docs/tasks/README.md", task_pages.LEADERS_HEAD, task_pages.leaders, task_pages.leaders_note
)
for _name in TASKS:
    _page = f"docs/tasks/{_name}.md"
    _floor, _note = task_pages.floor(_name), task_pages.results_note(_name)
    TABLES[f"{_name}-facts"] = Table(_page, task_pages.FACTS_HEAD, task_pages.facts(_name), _floor)
    TABLES[f"{_name}-preset"] = Table(_page, task_pages.PRESET_HEAD, task_pages.preset(_name))
    TABLES[f"{_name}-results"] = Table(_page, task_pages.RESULTS_HEAD, task_pages.results(_name), _note)

# Name -> tables that are made together.
GROUPS: dict[str, tuple[str, ...]] = {
    "tasks": ("tasks", *(f"{name}-facts" for name in TASKS)),
    "presets": tuple(f"{name}-preset" for name in TASKS),
    "leaderboard": ("leaderboard", *(f"{name}-results" for name in TASKS)),
}
