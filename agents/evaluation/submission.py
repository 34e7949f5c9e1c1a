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
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crowd_env import Scenario
from crowd_env.core.arrays.state import Floats
from crowd_env.core.files.atomic import write_text
from crowd_env.core.files.json_file import read_json
from crowd_env.envs.tasks.task import HELD_OUT_SEED

from .. import PRETRAINED
from ..networks import network_digest
from ..plain import Plain
from ..runs import versions
from ..tasks import TASKS, Task
from ..tasks.variations import AS_IT_STANDS, Variation, variations
from ..walking import RuleAtShare
from .contradictions import MIXED, contradiction, crowd_of
from .entries import RULE, Entry
from .evaluation import OWN_SEED, Evaluation, figures_of_runs
from .protocol import task_figures
from .robustness import Judged, Trial, facts_of_variation, judge_trial, make_trial, make_trials

REFERENCES = (RULE, RuleAtShare.name)  # that every policy stands beside, on the same draws
FORMAT = 3
OWN_DRAWS = Variation("own-draws", "draws of its own")
_PART = 4  # of the draws of a task: as many are a policy's own
_CHECKED = 10  # draws of the rule that are held against those that lie there
# Column of a run -> its digits.  The first four are numbers of people; of ``blocked``, whether the run was.
_DIGITS = {
    **dict.fromkeys(("unfinished", "blocked", "escaped", "crushed", "last_time", "mean_exit", "contact_impulse"), 5),
    **dict.fromkeys(("crushed_time", "flow", "max_overlap", "max_speed", "max_pressure"), 4),
    **dict.fromkeys(("walked", "max_density", "hurry", *MIXED), 5),
}
_COLUMNS = tuple(_DIGITS)
_FIGURES = 6  # digits of other numbers
_KEYS = {"format", "task", "policies", "networks", "columns", "trials", "versions"}


def own_seed(policy: str, network: str | None, constants: Plain) -> int:
    """Return the seed of a policy's own draws, of the digest of its network or, of a rule, of its name and constants."""
    text = network or json.dumps([policy, _rounded(constants)], sort_keys=True)
    return OWN_SEED + int(hashlib.sha256(text.encode()).hexdigest(), 16) % 2**40


def own_runs(task: Task) -> int:
    """Return how many draws of its own a policy is judged on: a quarter of those of the task."""
    return max(1, task.runs // _PART)


def submit(
    task: Task, policies: Sequence[str], *, runs: int, few: int, out: Path, folder: Path | None = None
) -> list[Path]:
    """Judge policies by the protocol of a task, write the file of its references and one for each; return the latter's paths.

    Where the references lie in ``out``, the rule is run on some draws alone, to hold the code against them.

    Parameters
    ----------
    policies : names, as `crowd_env.agents.evaluation.entries.make_entries` takes them.
    runs, few : the first draws of the task as it stands, and of each of its variations; none of these at 0.
    folder : keeps what has been evaluated, so that an interrupted submission goes on.

    Raises
    ------
    ValueError
        If a policy is unknown, or the references that lie there did other things: they were made by other code.
    """
    path = out / f"{task.name}.json"
    known = runs == task.runs and not {*policies} & {*REFERENCES} and references_known(path, task, few)
    names = list(dict.fromkeys(((RULE,) if known else REFERENCES) + tuple(policies)))
    whole = make_trial(task, AS_IT_STANDS, names)
    varied = make_trials(task, list(dict.fromkeys(policies if known else (RULE, *policies))))[1:] if few else []

    def judged(trial: Trial, count: int, name: str, seed: int = 0) -> list[Evaluation]:
        return judge_trial(trial, count, seed, folder=None if folder is None else folder / name)

    rule, results = whole.entries[0], list[Evaluation]()
    if known:
        results = judged(whole._replace(entries=[rule]), min(_CHECKED, runs), "checked")
    results += judged(whole._replace(entries=whole.entries[len(results) :]), runs, "all")
    if path.exists():
        _check_rule(path, results[0], None if known else runs)
    found = [(whole, results), *((one, judged(one, few, one.variation.name)) for one in varied)]
    if not known:
        write_content(path, _content(task, [entry for entry in whole.entries if entry.name in REFERENCES], found))
    paths = []
    for given, entry, result in zip(names, whole.entries, results, strict=True):
        if given in policies:
            name, seed = entry.name.replace("/", "-"), own_seed(entry.name, entry.digest, result.constants)
            own = whole._replace(variation=OWN_DRAWS, entries=list(dict.fromkeys((rule, entry))))
            those = judged(own, min(runs, own_runs(task)), f"own-{name}", seed - HELD_OUT_SEED)
            trial = {**_trial(own, those), "first_seed": seed}
            paths.append(out / task.name / f"{name}.json")
            write_content(paths[-1], _content(task, [entry], found, trial))
    return paths


def _check_rule(path: Path, rule: Evaluation, runs: int | None) -> None:
    """Raise ValueError unless the rule of the references did the same, on as many ``runs`` if these are given."""
    before, now = read_json(path)["trials"][0]["of"][RULE]["runs"], _kept(rule)["runs"]
    then, here = (_runs_of(one[: len(now)])["last_time"] for one in (before, now))
    if len(before) != (runs or len(before)) or not np.allclose(then, here, rtol=1e-4, equal_nan=True):
        raise ValueError(f"{path}: the rule does other things here, so the code is another; submit all of it again")


def _content(task: Task, entries: Sequence[Entry], found: Iterable[Judged], own: Plain | None = None) -> Plain:
    """Return what a file holds of some policies: their networks, and their runs in all trials and on draws of their ``own``."""
    names = [entry.name for entry in entries]
    trials = [_trial(one, [result for result in results if result.policy in names]) for one, results in found]
    return {
        "format": FORMAT,
        "task": task.identity(),
        "policies": {entry.name: entry.digest for entry in entries},
        "networks": {
            entry.name: base64.b64encode(entry.source.read_bytes()).decode()
            for entry in entries
            if entry.source is not None and entry.name not in PRETRAINED
        },
        "columns": _COLUMNS,
        "trials": [*trials[:1], *([] if own is None else [own]), *trials[1:]],
        "versions": versions(),
    }


def _trial(trial: Trial, results: Iterable[Evaluation]) -> Plain:
    """Return what a file holds of a trial: what it is, and the runs of some policies."""
    of = {one.policy: _kept(one) for one in results}
    return {**facts_of_variation(trial.task, trial.variation, trial.place), "of": of}


def references_known(path: Path, task: Task, few: int) -> bool:
    """Return whether ``path`` holds the references of a task as it is now, on ``few`` draws of each variation."""
    try:
        trials = _read(path)["trials"]
    except (ValueError, KeyError):
        return False
    beside = {len(kept["runs"]) for trial in trials[1:] for kept in trial["of"].values()}
    return len(trials[0]["of"][RULE]["runs"]) == task.runs and beside == ({few} if few else set())


def write_content(path: Path, content: Plain) -> None:
    """Write a file of submissions, whole or not at all, with a line for each run."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(_rounded(content), indent=0, allow_nan=False)
    write_text(path, re.sub(r"\[[^][{}\"]*\]", lambda found: "".join(found[0].split()), text) + "\n")


def read_submission(path: Path) -> Plain:
    """Return a submission that has been held against its task as it stands, with the figures that its runs amount to.

    ``rows`` are those of the policy and of `REFERENCES` in the task (`crowd_env.agents.evaluation.protocol.task_figures`),
    ``own`` those of the policy and the rule on draws of its own.  ``robustness`` has those of both in all variations, over as
    many draws of the task as of the others; ``runs`` holds the columns of all runs.

    Raises
    ------
    ValueError
        If it cannot be read, is of an unknown task, of another version or variation of it or of other draws, or if its digest
        is not that of the network that it holds or of the shipped policy that it names; or if the file of `REFERENCES` is not
        that of the task.
    """
    references = path.parent.with_suffix(".json")
    content, beside = _read(path), _read(references)
    task, digest = TASKS[beside["task"]["name"]], hashlib.sha256(references.read_bytes()).hexdigest()[:16]
    if task.references not in ("", digest):
        raise ValueError(
            f"{references} is not the file of rules of {task.name} version {task.version}: its digest is {digest}, not "
            f"{task.references}; take that of the repository"
        )
    with _damage_told(path):
        return _judged(path, content, {one["variation"]: one["of"] for one in beside["trials"]})


@contextmanager
def _damage_told(path: Path) -> Iterator[None]:
    """Turn what goes wrong with the content of a file into a ValueError that begins with its path."""
    try:
        yield
    except (KeyError, TypeError, IndexError, AttributeError, ValueError) as error:
        if str(error).startswith(str(path)):
            raise
        what = "" if isinstance(error, ValueError) else f"{type(error).__name__} "
        raise ValueError(f"{path} is damaged: {what}{error}") from None


def _judged(path: Path, content: Plain, beside: Mapping[str, Plain]) -> Plain:
    """Return what `read_submission` does; ``beside`` has what the rules did, by variation."""
    ((policy, digest),) = content["policies"].items()
    task = TASKS[content["task"]["name"]]
    places = _now(task.name, repr(task)).places
    if policy in PRETRAINED and network_digest(PRETRAINED[policy]) != digest:
        raise ValueError(f"{path} names the shipped policy {policy}, but holds the digest of another network")
    if policy not in PRETRAINED and digest is not None:
        network = base64.b64decode(content["networks"][policy], validate=True)
        if hashlib.sha256(network).hexdigest() != digest:
            raise ValueError(f"{path} holds another network than its digest says")
    whole, own, *varied = content["trials"]
    constants = {} if digest else whole["of"].get(policy, {}).get("constants", {})
    runs: list[Plain] = []
    kept: dict[str, dict[str, Plain]] = {}  # variation -> policy -> its runs
    for trial in content["trials"]:
        name, of = trial["variation"], trial["of"]
        if trial is not own:
            of = {**of, **{one: beside[name].get(one) for one in REFERENCES}}
        elif own["first_seed"] != own_seed(policy, digest, constants):
            raise ValueError(f"{path}: the draws of its own are not those of {policy}; submit again")
        needed = {AS_IT_STANDS.name: (*REFERENCES, policy), OWN_DRAWS.name: (RULE, policy)}.get(name, (RULE,))
        for one in needed:
            if of.get(one) is None:
                raise ValueError(f"{path}: there are no runs of {one} in {name}; submit again")
        kept[name] = {one: of[one] for one in dict.fromkeys((*REFERENCES, policy)) if of.get(one) is not None}
        if policy in kept[name] and kept[name][policy].get("constants", {}) != constants:
            raise ValueError(
                f"{path} holds other constants of {policy}; a network has none, a rule the same everywhere"
            )
        columns = {one: _runs_of(found["runs"]) for one, found in kept[name].items()}
        crowd = crowd_of(task, places[name], trial["learned_share"])
        for one, found in columns.items():
            if wrong := contradiction(found, crowd):
                raise ValueError(f"{path}: runs of {one} in {name} contradict themselves: {wrong}")
        if len({len(one["last_time"]) for one in columns.values()}) != 1:
            raise ValueError(f"{path}: {name} has other numbers of draws than {task.name}.json")
        runs += [{"variation": name, "policy": one, **found} for one, found in columns.items()]
    least = min(len(one["runs"]) for trial in (whole, *varied) for one in kept[trial["variation"]].values())

    def rows(trial: Plain, count: int) -> list[Plain]:
        name = trial["variation"]
        figures = [_figures(one, trial, found, count) for one, found in kept[name].items()]
        return [{**row, "variation": name} for row in task_figures(task.name, places[name], figures)]

    few = [row for trial in (whole, *varied) for row in rows(trial, least) if row["policy"] in (RULE, policy)]
    return {
        "task": content["task"],
        "policy": {"name": policy, "sha256": digest},
        "seeds": {"first": task.seeds.start, "runs": task.runs},
        "rows": rows(whole, task.runs),
        "own": rows(own, task.runs),
        "robustness": {"runs": least, "rows": few} if varied else None,
        "runs": runs,
        "versions": content["versions"],
    }


def _read(path: Path) -> Plain:
    """Return what a file holds, held against its task."""
    with _damage_told(path):
        return _held(path, read_json(path))


def _held(path: Path, content: Plain) -> Plain:
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

    identity: Plain
    facts: dict[str, Plain]  # by variation
    places: dict[str, Scenario]


@cache
def _now(name: str, described: str) -> _Now:
    """Return what a task is now; ``described`` tells two of one name apart."""
    task = TASKS[name]
    trials = (AS_IT_STANDS, OWN_DRAWS, *variations(task)[1:])
    places = {one.name: one.place(task) for one in trials}
    facts = {one.name: facts_of_variation(task, one, places[one.name]) for one in trials}
    return _Now(task.identity(), facts, places)


def _kept(result: Evaluation) -> Plain:
    """Return what a file holds of a policy in a trial: its constants, if it has some, and a line for each run."""
    runs, unknown = result.columns(), np.full(result.runs, np.nan)
    runs |= {"blocked": np.isfinite(runs["blocked_since"]), "last_time": runs["evacuation_time"]}
    lines = [_line(run) for run in zip(*(runs.get(name, unknown) for name in _COLUMNS), strict=True)]
    return {**({"constants": result.constants} if result.constants else {}), "runs": lines}


def _runs_of(lines: Sequence[str]) -> dict[str, Floats]:
    """Return the columns of the runs that a file holds."""
    for cells in (line.split(",") for line in lines):
        if len(cells) != len(_COLUMNS):
            raise ValueError(f"a run has {len(cells)} columns, not {len(_COLUMNS)}")
    rows = [[np.nan if one == "-" else float(one or 0) for one in line.split(",")] for line in lines]
    return dict(zip(_COLUMNS, np.array(rows, dtype=np.float64).T, strict=True))


def _figures(policy: str, trial: Plain, kept: Plain, count: int) -> Plain:
    """Return the figures of a policy as `Evaluation.row` has them, made of its first ``count`` runs."""
    runs = _runs_of(kept["runs"][:count])
    cleared = runs["unfinished"] == 0
    runs["evacuation_time"] = np.where(cleared, runs["last_time"], np.nan)
    runs["mean_exit"] = np.where(cleared, runs["mean_exit"], np.nan)
    runs["blocked_since"] = np.where(runs["blocked"] > 0, 0.0, np.nan)
    if trial["learned_share"] == 1.0:
        runs = {name: values for name, values in runs.items() if name not in MIXED}
    facts = {"policy": policy, "scheme": trial["scheme"], "learned_share": trial["learned_share"]}
    figures = figures_of_runs(runs, trial["scheme"], trial["people"])
    return {**facts, "constants": kept.get("constants", {}), **figures}


def _line(run: Sequence[float]) -> str:
    """Return a run in few letters: nothing for 0, a dash for what is not known."""
    rounded = zip(run, _DIGITS.values(), strict=True)
    return ",".join(f"{float(one):.{n}g}".lstrip("0") if np.isfinite(one) else "-" for one, n in rounded)


def _rounded(value: object) -> object:
    """Return plain data with numbers of `_FIGURES` digits."""
    if isinstance(value, float):
        return float(f"{value:.{_FIGURES}g}")
    if isinstance(value, Mapping):
        return {name: _rounded(one) for name, one in value.items()}
    return [_rounded(one) for one in value] if isinstance(value, list | tuple) else value
