"""Policies on the settings of the benchmark: ``crowd-env tiers``.

A file for each setting holds the runs of all policies that were tried there; a policy that is finished is not run again.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crowd_env import Scenario
from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import known
from crowd_env.core.console import say
from crowd_env.core.files.store import Store

from .. import PRETRAINED, starts_from
from ..plain import Plain
from ..tasks.lower_bounds import bound_time
from ..tasks.tiers import SETTINGS, TIERS, Setting
from .comparison import clearing_times, order_of, paired, rounded
from .credible import credibility
from .entries import RULE
from .evaluation import Evaluation
from .folder import digest_of
from .robustness import facts_of_variation, make_trial
from .same_draws import compare

FOLDER = Path("docs/tasks/tiers")  # of a checkout
# The generalist of the doors and, where it ships, that of all places.
_ROWS = (RULE, "follow", "evolution", "competitive-door/ppo", "hertz-room/ppo", "generalist")
_KEPT = ("policy", "scheme", "runs", "unfinished_runs", "escaped", "max_overlap", "max_speed")  # for `credibility`


def usual(setting: Setting) -> list[str]:
    """Return the policies that are tried in a setting: rules, the search, shipped generalists, and those of its task."""
    own = [name for name in PRETRAINED if name.startswith(f"{setting.task.name}/")]
    return [name for name in dict.fromkeys((*_ROWS, *own)) if name != "generalist" or name in PRETRAINED]


def identity(setting: Setting) -> Plain:
    """Return what decides the runs of a setting, ready for JSON, but for the policy."""
    task, one = setting.task, setting.variation
    facts = facts_of_variation(task, one, one.place(task))
    return {
        "task": task.identity(),
        "place": facts["digest"],
        "scheme": facts["scheme"],
        "learned_share": facts["learned_share"],
        "hindrances": one.hindrances(),
        "runs": setting.runs,
    }


def judge(setting: Setting, policies: Sequence[str], folder: Path = FOLDER) -> dict[str, Plain]:
    """Return what policies did in a setting, by name; what is in the folder is taken from there, what is not is made.

    Raises
    ------
    ValueError
        As `crowd_env.agents.evaluation.entries.make_entries`.
    """
    store, made_by = Store(folder), identity(setting)
    for name in policies:
        rows = (store.load(setting.title, made_by, redo=True) or {}).get("rows", {})
        network = digest_of(name)
        if name in rows and rows[name]["network"] == network:
            continue
        trial = make_trial(setting.task, setting.variation, [name])
        if trial.left_out:
            say(f"{setting.title}: {name} cannot move these people there")
            continue
        (result,) = compare(trial.entries, trial.place, [made_by["scheme"]], runs=setting.runs)
        rows[name] = {"network": network, **_figures(result)}
        store.keep(setting.title, {"bound": bound_time(setting.task, setting.variation), "rows": rows}, made_by)
        say(f"{setting.title}: {name}: {order_of(clearing_times(result))}")
    return dict((store.load(setting.title, made_by, redo=True) or {}).get("rows", {}))


def _figures(result: Evaluation) -> Plain:
    """Return when the last person of each run was out [s], and what says whether that can be believed."""
    row = result.row()
    kept = {name: row[name] for name in _KEPT} | {"flow": row["flow"]["mean"], "hurry": row["hurry"]["max"]}
    return {"last_time": rounded(clearing_times(result)), **kept}


class Standing(NamedTuple):
    """How a setting stands; times are the medians of all draws, of runs in which somebody was left infinite."""

    setting: Setting
    bound: float  # s
    best: str  # learned policy; "" = none was tried that is credible
    best_left: int  # draws in which it left somebody inside
    best_time: float  # s
    rule: str  # the best policy that is a rule
    rule_left: int
    rule_time: float
    later: bool  # whether the best learned policy is later than that rule, beyond the 95 % interval over draws
    hindsight: float  # s  could the soonest policy be picked in every draw; nan where all leave somebody in one

    @property
    def gap(self) -> float:
        """How much later than the bound the best learned policy is, as a share."""
        return self.best_time / self.bound - 1.0

    @property
    def tier(self) -> str:
        """The tier that the figures amount to, see `crowd_env.agents.tasks.tiers`."""
        if self.best_left or self.later:
            return "open"
        return next(name for name, most in TIERS.items() if self.gap <= most)


def standing(setting: Setting, folder: Path) -> Standing | None:
    """Return how a setting stands by what is in a folder; None if no rule and no learned policy were tried.

    Raises
    ------
    ValueError
        If the runs there are of another version of the task or of another setting.
    """
    content = Store(folder).load(setting.title, identity(setting))
    if content is None:
        return None
    place, rows = setting.variation.place(setting.task), content["rows"]
    times = {name: np.array(row["last_time"], dtype=np.float64) for name, row in rows.items()}
    times = {name: of for name, of in times.items() if _credible(name, rows, place)}
    learned = {name: of for name, of in times.items() if starts_from(name) != "a rule"}
    rules = {name: of for name, of in times.items() if name not in learned}
    if not learned or not rules:
        return None
    _, hindsight = order_of(np.fmin.reduce(list(times.values())))
    best, rule = _best(learned), _best(rules)
    low, _ = paired(learned[best[0]], rules[rule[0]])["ci95"]
    return Standing(setting, content["bound"], *best, *rule, low is not None and low > 0.0, hindsight)


def _credible(name: str, rows: Mapping[str, Plain], place: Scenario) -> bool:
    told = {k: {**row, "flow": {"mean": row["flow"]}, "hurry": {"max": row["hurry"]}} for k, row in rows.items()}
    return credibility(told[name], list(told.values()), place)["ok"] is not False


def _best(times: Mapping[str, Floats]) -> tuple[str, int, float]:
    name = min(times, key=lambda one: order_of(times[one]))
    return name, *order_of(times[name])


def judge_tiers(tiers: Sequence[str], policies: Sequence[str] | None = None, folder: Path = FOLDER) -> None:
    """Try policies in the settings of some tiers, by default those of `usual`; what is finished in the folder stays.

    Raises
    ------
    ValueError
        If a tier is unknown, or as `judge`.
    """
    chosen = [known("tier", one, TIERS) for one in tiers]
    for setting in (one for one in SETTINGS if one.tier in chosen):
        judge(setting, policies or usual(setting), folder)
