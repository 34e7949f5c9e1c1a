"""Submissions: all that a policy did on a task in one file, a line for each run, which can be held against the task again.

What every policy stands beside, the rule at full and at its best speed, lies once for each task in a file of its own:
``TASK.json`` beside the folder ``TASK`` with a file for each policy.  Figures are not kept: they are made of the runs.

The draws of a task are known, so that a policy may be chosen by what it does on them.  So each is also judged, beside the rule,
on draws of its own, whose seeds follow from the policy (`own_seed`): another policy has others.
"""

import base64
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from crowd_env import EpisodeMetrics, Scenario
from crowd_env.analysis.figures import figures_of, median_time, named
from crowd_env.core.files.atomic import write_text
from crowd_env.core.files.json_file import read_json
from crowd_env.physics import SCHEMES

from .. import PRETRAINED
from ..networks import network_digest
from ..runs import versions
from ..tasks import TASKS, Task
from ..tasks.variations import AS_IT_STANDS, Variation, variations
from ..walking import RuleAtShare
from .comparison import clearing_means, clearing_times
from .entries import RULE
from .evaluation import OWN_SEED, Evaluation
from .protocol import task_figures
from .robustness import Found, facts_of_variation

REFERENCES = (RULE, RuleAtShare.name)  # that every policy stands beside, on the same draws
FORMAT = 3
OWN_DRAWS = Variation("own-draws", "draws of its own")
_PART = 4  # of the draws of a task: as many are a policy's own
_MIXED = ("mean_exit_learned", "mean_exit_others")  # figures of mixed crowds
# Column of a run -> its digits.  The first four are numbers of people; of ``blocked``, whether the run was.
_DIGITS = {
    **dict.fromkeys(("unfinished", "blocked", "escaped", "crushed", "last_time", "mean_exit", "contact_impulse"), 5),
    **dict.fromkeys(("crushed_time", "flow", "max_overlap", "max_speed", "max_pressure"), 4),
    **dict.fromkeys(("walked", "max_density", "hurry", *_MIXED), 5),
}
_COLUMNS = tuple(_DIGITS)
_OWN = _COLUMNS[12:]  # beside those of `EpisodeMetrics` and crushes
_WITH_MAX = {"max_density", "max_pressure", "hurry"}  # beside their mean stands the largest of all runs
_FIGURES = 6  # digits of other numbers
_KEYS = {"format", "task", "policies", "networks", "columns", "trials", "versions"}
_RUNS = dict[str, np.ndarray]  # column -> (R,)


def own_seed(policy: str, network: str | None, constants: Mapping[str, Any]) -> int:
    """Return the seed of a policy's own draws, of the digest of its network or, of a rule, of its name and constants."""
    text = network or json.dumps([policy, _rounded(constants)], sort_keys=True)
    return OWN_SEED + int(hashlib.sha256(text.encode()).hexdigest(), 16) % 2**40


def own_runs(task: Task) -> int:
    """Return how many draws of its own a policy is judged on: a quarter of those of the task."""
    return max(1, task.runs // _PART)


def write_submissions(
    folder: Path,
    task: Task,
    policies: Mapping[str, Path | None],
    results: Sequence[Evaluation],
    own: Mapping[str, Sequence[Evaluation]],
    found: Found,
) -> list[Path]:
    """Write the file of a task's references and one for each policy; return the paths of the latter.

    Parameters
    ----------
    policies : names in ``results``, with the file of the network if there is one.
    results : of the policies and of `REFERENCES` on the held-out draws of the task; where the references lie there already
        (`references_known`) the rule on some of the draws is enough, to hold the code against them.
    own : by policy, its results and those of the rule on its own draws.
    found : trials of at least the policies and the rule on the variations of the task, with their results; empty: none.

    Raises
    ------
    ValueError
        If the references that lie there did other things: they were made by other code.
    """
    as_it_stands, own_facts = (facts_of_variation(task, one, task.place()) for one in (AS_IT_STANDS, OWN_DRAWS))
    trials, judged = [as_it_stands], [results]
    for trial, those in found:
        if trial.variation.name != "task":
            trials.append(facts_of_variation(task, trial.variation, trial.place))
            judged.append(those)

    def content(named: Mapping[str, Path | None]) -> dict[str, Any]:
        of = [
            {**facts, "of": {one.policy: _kept(one) for one in those if one.policy in named}}
            for facts, those in zip(trials, judged, strict=True)
        ]
        digests = {name: None if path is None else network_digest(path) for name, path in named.items()}
        networks = {
            name: base64.b64encode(path.read_bytes()).decode()
            for name, path in named.items()
            if path is not None and name not in PRETRAINED
        }
        for name in named.keys() & own.keys():
            kept = {one.policy: _kept(one) for one in own[name]}
            seed = own_seed(name, digests[name], kept[name].get("constants", {}))
            of.insert(1, {**own_facts, "first_seed": seed, "of": kept})
        facts = {"format": FORMAT, "task": task.identity(), "policies": digests, "networks": networks}
        return {**facts, "columns": list(_COLUMNS), "trials": of, "versions": versions()}

    path, by_name = folder / f"{task.name}.json", {one.policy: one for one in results}
    anew = by_name.keys() >= set(REFERENCES)
    if path.exists():
        before = read_json(path)["trials"][0]["of"][RULE]["runs"]
        now = _kept(by_name[RULE])["runs"]
        then, here = (_runs_of({"runs": one[: len(now)]}, _COLUMNS)["last_time"] for one in (before, now))
        if (anew and len(before) != len(now)) or not np.allclose(then, here, rtol=1e-4, equal_nan=True):
            raise ValueError(f"{path}: the rule does other things here, so the code is another; submit all of it again")
    if anew:
        write_content(path, content(dict.fromkeys(REFERENCES)))
    paths = []
    for name, source in policies.items():
        paths.append(folder / task.name / f"{name.replace('/', '-')}.json")
        write_content(paths[-1], content({name: source}))
    return paths


def references_known(path: Path, task: Task, few: int) -> bool:
    """Return whether ``path`` holds the references of a task as it is now, on ``few`` draws of each variation."""
    try:
        trials = _read(path)["trials"]
    except (ValueError, KeyError):
        return False
    beside = {len(kept["runs"]) for trial in trials[1:] for kept in trial["of"].values()}
    return len(trials[0]["of"][RULE]["runs"]) == task.runs and beside == ({few} if few else set())


def write_content(path: Path, content: Mapping[str, Any]) -> None:
    """Write a file of submissions, whole or not at all, with a line for each run."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(_rounded(content), indent=0, allow_nan=False)
    write_text(path, re.sub(r"\[[^][{}\"]*\]", lambda found: "".join(found[0].split()), text) + "\n")


def read_submission(path: Path) -> dict[str, Any]:
    """Return a submission that has been held against its task as it stands, with the figures that its runs amount to.

    ``rows`` are those of the policy and of `REFERENCES` in the task (`crowd_env.agents.evaluation.protocol.task_figures`),
    ``own`` those of the policy and the rule on draws of its own.  ``robustness`` has those of both in all variations, over as
    many draws of the task as of the others; ``runs`` holds the columns of all runs.

    Raises
    ------
    ValueError
        If it cannot be read, is of an unknown task, of another version or variation of it or of other draws, or if its digest
        is not that of the network that it holds or of the shipped policy that it names.
    """
    references = path.parent.with_suffix(".json")
    content, beside = _read(path), _read(references)
    try:
        ((policy, digest),) = content["policies"].items()
        task = TASKS[content["task"]["name"]]
        if policy in PRETRAINED and network_digest(PRETRAINED[policy]) != digest:
            raise ValueError(f"{path} names the shipped policy {policy}, but holds the digest of another network")
        if policy not in PRETRAINED and digest is not None:
            network = base64.b64decode(content["networks"][policy], validate=True)
            if hashlib.sha256(network).hexdigest() != digest:
                raise ValueError(f"{path} holds another network than its digest says")
        named = dict.fromkeys((*REFERENCES, policy))
        rows: list[dict[str, Any]] = []
        few: list[dict[str, Any]] = []
        runs: list[dict[str, Any]] = []
        public = [trial for trial in content["trials"] if trial["variation"] != OWN_DRAWS.name]
        least = min(len(one["runs"]) for trial in public for one in trial["of"].values())
        by_name = {one["variation"]: one for one in beside["trials"]}
        constants = public[0]["of"].get(policy, {}).get("constants", {})
        for trial in content["trials"]:
            variation, mine = trial["variation"], trial["variation"] == OWN_DRAWS.name
            if mine and trial["first_seed"] != own_seed(policy, digest, constants):
                raise ValueError(f"{path}: the draws of its own are not those of {policy}; submit again")
            place = _now(task.name, repr(task)).places[variation]
            rules = trial["of"] if mine else by_name[variation]["of"]
            of = {name: (rules if name in REFERENCES else trial["of"]).get(name) for name in named}
            for name in {"task": named, OWN_DRAWS.name: (RULE, policy)}.get(variation, (RULE,)):
                if of[name] is None:
                    raise ValueError(f"{path}: there are no runs of {name} in {variation}; submit again")
            columns = {name: _runs_of(one, _COLUMNS) for name, one in of.items() if one is not None}
            if len({len(one["last_time"]) for one in columns.values()}) != 1:
                raise ValueError(f"{path}: {variation} has other numbers of draws than {references.name}")
            for found, count in ((rows, task.runs), (few, least)):
                figures = [_figures(name, trial, of[name], columns[name], place, count) for name in columns]
                found += [{**task_figures(task.name, place, one, figures), "variation": variation} for one in figures]
            runs += [{**trial, "policy": name, **one} for name, one in columns.items()]
    except (KeyError, TypeError, IndexError, AttributeError, ValueError) as error:
        if str(error).startswith(str(path)):
            raise
        raise ValueError(f"{path} is damaged: {type(error).__name__} {error}") from None
    few = [row for row in few if row["policy"] in (RULE, policy) and row["variation"] != OWN_DRAWS.name]
    return {
        "task": content["task"],
        "policy": {"name": policy, "sha256": digest},
        "seeds": {"first": task.seeds.start, "runs": task.runs},
        "rows": [row for row in rows if row["variation"] == "task"],
        "own": [row for row in rows if row["variation"] == OWN_DRAWS.name],
        "robustness": {"runs": least, "rows": few} if len(public) > 1 else None,
        "runs": runs,
        "versions": content["versions"],
    }


def _read(path: Path) -> dict[str, Any]:
    """Return what a file holds, held against its task."""
    content = read_json(path)
    if not isinstance(content, dict) or not set(content) >= _KEYS or content["format"] != FORMAT:
        raise ValueError(f"{path} is no submission (format {FORMAT}); crowd-env submit makes one")
    told = content["task"]
    if told["name"] not in TASKS:
        raise ValueError(f"{path} is of the task {told['name']!r}; known: {', '.join(TASKS)}")
    task = TASKS[told["name"]]
    now = _now(task.name, repr(task))
    if told != now.identity:
        raise ValueError(
            f"{path} is of {task.name} version {told['version']} (digest {told['digest']}), which is version {task.version} "
            f"(digest {now.identity['digest']}) now: figures of two versions do not stand in one table; submit again"
        )
    if content["columns"] != list(_COLUMNS):
        raise ValueError(f"{path} has other columns than {', '.join(_COLUMNS)}")
    names, of_one = [one["variation"] for one in content["trials"]], len(content["policies"]) == 1
    expected = [name for name in now.facts if of_one or name != OWN_DRAWS.name]
    if names not in (expected, expected[: 1 + of_one]):
        raise ValueError(f"{path} holds other variations than {task.name} has now: {', '.join(expected)}; submit again")
    for one in content["trials"]:
        facts = {name: one[name] for name in one if name not in ("of", "first_seed")}
        if facts != now.facts[one["variation"]]:
            raise ValueError(f"{path}: the variation {one['variation']!r} of {task.name} is another now; submit again")
    for one, count in zip(content["trials"], (task.runs, own_runs(task))[: 1 + of_one], strict=False):
        draws = {len(kept["runs"]) for kept in one["of"].values()}
        if draws != {count}:
            raise ValueError(f"{path} holds {min(draws, default=0)} draws; {one['about']} has {count}")
    return content


class _Now(NamedTuple):
    """A task as it stands."""

    identity: dict[str, Any]
    facts: dict[str, dict[str, Any]]  # by variation
    places: dict[str, Scenario]


@cache
def _now(name: str, described: str) -> _Now:
    """Return what a task is now; ``described`` tells two of one name apart."""
    task = TASKS[name]
    trials = (AS_IT_STANDS, OWN_DRAWS, *variations(task)[1:])
    places = {one.name: one.place(task) for one in trials}
    facts = {one.name: facts_of_variation(task, one, places[one.name]) for one in trials}
    return _Now(task.identity(), facts, places)


def _kept(result: Evaluation) -> dict[str, Any]:
    """Return what a file holds of a policy in a variation."""
    measured = result.measured
    assert measured is not None
    learned = np.zeros_like(measured.crushed, dtype=bool) if result.learned is None else result.learned
    others = learned if result.learned is None else ~learned
    columns = {
        "blocked": np.isfinite(result.column("blocked_since")),
        "crushed": (measured.crushed > 0.0).sum(axis=1),
        "last_time": clearing_times(result),  # not known where somebody is left inside, also below
        "mean_exit": clearing_means(result),
        "max_pressure": measured.max_pressure,
        "crushed_time": measured.crushed.sum(axis=1),
        "walked": measured.walked.mean(axis=1),
        "max_density": measured.max_density,
        "hurry": measured.hurry,
        "mean_exit_learned": result.mean_exit_of(learned),  # none where all are alike
        "mean_exit_others": result.mean_exit_of(others),
    }
    values = [columns[name] if name in columns else result.column(name) for name in _COLUMNS]
    lines = [_line(run) for run in zip(*values, strict=True)]
    return {**({"constants": result.constants} if result.constants else {}), "runs": lines}


def _runs_of(kept: Mapping[str, Any], columns: Sequence[str]) -> _RUNS:
    """Return the columns of the runs that a file holds."""
    lines = [[np.nan if one == "-" else float(one or 0) for one in line.split(",")] for line in kept["runs"]]
    return dict(zip(columns, np.array(lines, dtype=np.float64).T, strict=True))


def _figures(
    policy: str, trial: Mapping[str, Any], kept: Mapping[str, Any], runs: _RUNS, place: Scenario, count: int
) -> dict[str, Any]:
    """Return the figures of a policy as `Evaluation.row` has them, made of its first ``count`` runs."""
    runs = {name: values[:count] for name, values in runs.items()}
    known = {name: values for name, values in runs.items() if name in EpisodeMetrics._fields}
    known["evacuation_time"] = np.where(runs["unfinished"] == 0, runs["last_time"], np.nan)
    runs["mean_exit"] = np.where(runs["unfinished"] == 0, runs["mean_exit"], np.nan)
    known["blocked_since"] = np.where(runs["blocked"] > 0, 0.0, np.nan)
    unknown: dict[str, Any] = dict.fromkeys(EpisodeMetrics._fields, np.nan)
    of_runs = (dict(zip(known, values, strict=True)) for values in zip(*known.values(), strict=True))
    episodes = [EpisodeMetrics(**(unknown | one)) for one in of_runs]
    crushed = runs["crushed"]
    runs["crushed_share"] = crushed / place.population.people
    runs["crushed_time"] = np.where(crushed > 0, runs["crushed_time"] / np.maximum(crushed, 1), np.nan)
    names = ("mean_exit", "contact_impulse", "max_pressure", "crushed_share", "crushed_time", *_OWN)
    if trial["learned_share"] == 1.0:
        names = names[: -len(_MIXED)]
    found = {name: named(runs[name]) for name in names}
    for name in runs.keys() & _WITH_MAX:
        found[name]["max"] = float(runs[name].max())
    return {
        "policy": policy,
        "scheme": trial["scheme"],
        "learned_share": trial["learned_share"],
        "constants": kept.get("constants", {}),
        **figures_of(episodes),
        "median_time": median_time(known["evacuation_time"]),
        **found,
        "max_overlap": float(runs["max_overlap"].max()),
        "pressure_is_force": SCHEMES[trial["scheme"]].info.impulses_are_forces,
    }


def _line(run: Sequence[float]) -> str:
    """Return a run in few letters: nothing for 0, a dash for what is not known."""
    rounded = zip(run, _DIGITS.values(), strict=True)
    return ",".join(f"{float(one):.{n}g}".lstrip("0") if np.isfinite(one) else "-" for one, n in rounded)


def _rounded(value: Any) -> Any:
    """Return plain data with numbers of `_FIGURES` digits."""
    if isinstance(value, float):
        return float(f"{value:.{_FIGURES}g}")
    if isinstance(value, Mapping):
        return {name: _rounded(one) for name, one in value.items()}
    return [_rounded(one) for one in value] if isinstance(value, list | tuple) else value
