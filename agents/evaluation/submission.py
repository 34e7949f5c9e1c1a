"""Submissions: all that a policy did on a task in one file, figures and every run, which can be held against the task again."""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from crowd_env.core.files.atomic import write_text
from crowd_env.core.files.json_file import json_number, read_json

from .. import PRETRAINED
from ..networks import network_digest
from ..runs import versions
from ..tasks import TASKS, Task
from ..walking import RuleAtShare
from .comparison import last_times, mean_times
from .entries import RULE
from .evaluation import HELD_OUT_SEED, Evaluation
from .protocol import task_row
from .robustness import Found, make_trials, summary_of_trials

REFERENCES = (RULE, RuleAtShare.name)  # that every submission holds beside its policy, on the same draws
FORMAT = 1
_DIGITS = 7  # of figures
_KEYS = ("format", "task", "policy", "seeds", "rows", "robustness", "runs", "versions")


def make_submission(
    task: Task, policy: str, source: Path | None, results: Sequence[Evaluation], found: Found
) -> dict[str, Any]:
    """Return the submission of a policy, ready for JSON; nothing in it depends on how fast the machine is.

    Parameters
    ----------
    policy : its name in ``results``.
    source : file of its network, if it has one.
    results : of the policy and of `REFERENCES` on the held-out draws of the task.
    found : trials of at least the policy and the rule on the variations of the task, with their results; empty: none.
    """
    place = task.place()
    named = dict.fromkeys((*REFERENCES, policy))
    mine = [one for one in results if one.policy in named]
    beside = [(trial, [one for one in those if one.policy in named]) for trial, those in found]
    robustness = None
    if beside:
        runs = next(one.runs for _, those in beside for one in those)
        robustness = summary_of_trials(task, beside, runs, 0)
        robustness = {name: robustness[name] for name in ("runs", "variations", "rows")}
    raw = [_runs_of(one, "task") for one in mine]
    raw += [
        _runs_of(one, trial.variation.name)
        for trial, those in beside
        for one in those
        if trial.variation.name != "task"
    ]
    return {
        "format": FORMAT,
        "task": task.identity(),
        "policy": {"name": policy, "sha256": None if source is None else network_digest(source)},
        "seeds": {"first": HELD_OUT_SEED, "runs": mine[0].runs},
        "rows": [task_row(task, place, one, mine) for one in mine],
        "robustness": robustness,
        "runs": raw,
        "versions": versions(),
    }


def write_submission(path: Path, content: Mapping[str, Any]) -> None:
    """Write a submission, whole or not at all, with the figures of all runs in one line each."""
    text = json.dumps(_rounded(content), indent=1, allow_nan=False)
    text = re.sub(r"\[[^][{}\"]*\]", lambda found: "[" + " ".join(found[0][1:-1].split()) + "]", text)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, text + "\n")


def read_submission(path: Path) -> dict[str, Any]:
    """Return a submission that has been held against its task as it stands.

    Raises
    ------
    ValueError
        If it cannot be read, is of an unknown task, of another version of it or of other draws, if its figures are not those of
        its runs, or if it names a shipped policy but holds the digest of another network.
    """
    content = read_json(path)
    if not isinstance(content, dict) or any(name not in content for name in _KEYS) or content["format"] != FORMAT:
        raise ValueError(f"{path} is no submission (format {FORMAT}); crowd-env submit makes one")
    try:
        _check(path, content)
    except (KeyError, TypeError, IndexError, AttributeError) as error:
        raise ValueError(f"{path} is damaged: {type(error).__name__} {error}") from None
    return content


def _check(path: Path, content: dict[str, Any]) -> None:
    told = content["task"]
    if told["name"] not in TASKS:
        raise ValueError(f"{path} is of the task {told['name']!r}; known: {', '.join(TASKS)}")
    task = TASKS[told["name"]]
    if told != task.identity():
        raise ValueError(
            f"{path} is of {task.name} version {told['version']} (digest {told['digest']}), which is version {task.version} "
            f"(digest {task.digest()}) now: figures of two versions do not stand in one table; submit again"
        )
    seeds = content["seeds"]
    if seeds["first"] != task.seeds.start or seeds["runs"] != task.runs:
        raise ValueError(
            f"{path} holds {seeds['runs']} draws from seed {seeds['first']}; the task has {task.runs} from {task.seeds.start}"
        )
    name, digest = content["policy"]["name"], content["policy"]["sha256"]
    if name in PRETRAINED and network_digest(PRETRAINED[name]) != digest:
        raise ValueError(f"{path} names the shipped policy {name}, but holds the digest of another network")
    if name not in [row["policy"] for row in content["rows"]]:
        raise ValueError(f"{path} has no row of its policy {name!r}")
    if content["robustness"] is not None:
        _check_variations(path, content, task)
    for row in content["rows"]:
        if row["runs"] != task.runs:
            raise ValueError(f"{path} has a row of {row['runs']} draws; the task has {task.runs}")
    robust = [] if content["robustness"] is None else content["robustness"]["rows"]
    for variation, row in [*(("task", row) for row in content["rows"]), *((row["variation"], row) for row in robust)]:
        _check_row(path, variation, row, content["runs"])


def _check_variations(path: Path, content: dict[str, Any], task: Task) -> None:
    """Raise ValueError unless the variations are those of the task as they stand."""
    told = content["robustness"]["variations"]
    now = [trial.facts(task, content["robustness"]["runs"], 0) for trial in make_trials(task, [RULE])]
    for one, other in zip(told, now, strict=False):
        if one != other:
            raise ValueError(f"{path}: the variation {one['variation']!r} of {task.name} is another now; submit again")
    if len(told) != len(now):
        raise ValueError(f"{path} holds {len(told)} variations of {task.name}, which has {len(now)} now; submit again")


def _check_row(path: Path, variation: str, row: dict[str, Any], raw: Sequence[dict[str, Any]]) -> None:
    """Raise ValueError unless a row says what its runs say."""
    what = f"{path}: {row['policy']} on {variation!r}"
    runs = [one for one in raw if (one["policy"], one["variation"]) == (row["policy"], variation)]
    if len(runs) != 1:
        raise ValueError(f"{what} has no runs of its own")
    of = {name: value[: row["runs"]] for name, value in runs[0].items() if isinstance(value, list)}
    clearing = [time for time, left in zip(of["last_time"], of["unfinished"], strict=True) if not left]
    said = {
        "runs": len(of["last_time"]),
        "blocked": sum(of["blocked"]),
        "unfinished": sum(left > 0 for left in of["unfinished"]),
        "left": sum(of["unfinished"]),
        "escaped": sum(of["escaped"]),
        "clearing_time": np.mean(clearing) if clearing else None,
        "mean_exit": np.mean(of["mean_exit"]),
        "max_speed": max(of["max_speed"]),
        "max_overlap": max(of["max_overlap"]),
    }
    for name, value in said.items():
        told = row[name]["mean"] if name in ("clearing_time", "mean_exit") else row[name]
        if told != value and (told is None or value is None or abs(told - value) > 1e-5 * max(1.0, abs(value))):
            raise ValueError(f"{what} says {name} {told}, its runs say {value}")


def _runs_of(result: Evaluation, variation: str) -> dict[str, Any]:
    """Return the figures of every run of a policy; ``last_time`` and ``mean_exit`` [s] count who is left until the limit."""
    measured = result.measured
    assert measured is not None
    columns = {
        "last_time": last_times(result),
        "mean_exit": mean_times(result),
        "flow": result.column("flow"),
        "contact_impulse": result.column("contact_impulse"),
        "max_overlap": result.column("max_overlap"),
        "max_speed": result.column("max_speed"),
        "max_pressure": measured.max_pressure,
        "crushed_time": measured.crushed.sum(axis=1),
    }
    counts = {
        "unfinished": result.column("unfinished"),
        "blocked": np.isfinite(result.column("blocked_since")),
        "escaped": result.column("escaped"),
        "crushed": (measured.crushed > 0.0).sum(axis=1),
    }
    return {
        "variation": variation,
        "policy": result.policy,
        "scheme": result.scheme,
        **{name: [int(one) for one in values] for name, values in counts.items()},
        **{name: [json_number(one) for one in values.tolist()] for name, values in columns.items()},
    }


def _rounded(value: Any) -> Any:
    """Return plain data with numbers of `_DIGITS` digits."""
    if isinstance(value, float):
        return float(f"{value:.{_DIGITS}g}")
    if isinstance(value, Mapping):
        return {name: _rounded(one) for name, one in value.items()}
    return [_rounded(one) for one in value] if isinstance(value, list) else value
