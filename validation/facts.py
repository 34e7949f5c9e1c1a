"""The figures that pages state in sentences: counts of what there is, and cells of the tables of docs/tables/."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from crowd_env import SCENARIOS, SCHEMES
from crowd_env.agents import PRETRAINED
from crowd_env.agents.tasks import TASKS
from crowd_env.core.behaviors import BEHAVIORS
from crowd_env.core.behaviors.headway import MANNERS
from crowd_env.core.files.json_file import read_json
from crowd_env.scenarios import generated
from validation.pages import ROOT, Rows, read_table, read_toml

_CELLS: dict[str, list[Any]] = read_toml(Path(__file__).with_name("facts.toml"))
_SEEDS = {"training-cpu": "training, CPU", "seeds-ratio": "of that"}


def facts() -> Rows:
    """One row a fact that a page may state: its name and its value."""
    counts: dict[str, Iterable[object]] = {
        "tasks": TASKS,
        "tasks-with-policy": TASKS.keys() & {name.partition("/")[0] for name in PRETRAINED},
        "policies": PRETRAINED,
        "schemes": SCHEMES,
        "laws": {type(scheme).__module__ for scheme in SCHEMES.values()},
        "generated-laws": generated.LAWS,
        "scenarios": SCENARIOS,
        "behaviors": BEHAVIORS,
        "notebooks": (ROOT / "docs/notebooks").glob("*.ipynb"),
    }
    values: dict[str, object] = {name: len(list(found)) for name, found in counts.items()}
    values |= {"manners": ", ".join(f"`{name}`" for name in MANNERS)}
    for name, policy in (("door-policy-cpu", "competitive-door/ppo"), ("generalist-cpu", "generalist")):
        card = read_json(PRETRAINED[policy].with_suffix(".json"))
        values[name] = f"{card['spent']['cpu_seconds']:.0f}"
    values |= {name: _cell(*where) for name, where in _CELLS.items()}
    values |= {name: _range("seeds", column) for name, column in _SEEDS.items()}
    return [{"fact": name, "value": value} for name, value in (values | {"generalist-later": _later()}).items()]


def _later() -> str:
    """Return by how many per cent half of the draws of `generalist` are later than in the best row of a task, at most."""
    k, rows = _column("submissions", "half of all draws")
    times = {(task, policy): float(row[k]) for row in rows if row[k] != "never" for task, policy in [row[:2]]}
    best = {task: min(time for (where, _), time in times.items() if where == task) for task, _ in times}
    ratios = [time / best[task] for (task, policy), time in times.items() if policy == "`generalist`"]
    return f"{100.0 * max(ratios) - 100.0:.1f}"


def _column(table: str, column: str) -> tuple[int, list[list[str]]]:
    head, *rows = read_table(table)
    return next(k for k, name in enumerate(head) if name.startswith(column)), rows


def _cell(table: str, row: str, column: str, digits: int | None = None) -> str:
    k, rows = _column(table, column)
    (text,) = (one[k] for one in rows if ", ".join(one).replace("`", "").startswith(f"{row}, "))
    text = re.split(r" [\[(]", text)[0]  # without the interval
    return text if digits is None else f"{float(text):.{digits}f}"


def _range(table: str, column: str) -> str:
    k, rows = _column(table, column)
    values = sorted((one[k] for one in rows), key=float)
    return f"{values[0]} to {values[-1]}"
