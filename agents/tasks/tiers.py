"""The benchmark: settings of tasks in three tiers, by how near the best learned policy is to what people can do.

The yardstick of a setting is `lower_bounds.bound_time`.  Solved: a learned policy leaves nobody inside in any draw, is at most
25 % later than that, and not later than the best rule beyond the interval of their difference.  Hard: the same, at most 75 %
later.  Open: all others.  What `crowd_env.agents.evaluation.tiers` measures decides; it is held against ``tiers.toml`` by a
test.
"""

import tomllib
from pathlib import Path
from typing import NamedTuple

from crowd_env.envs.tasks.task import Task, make_task

from ..plain import Plain
from .variations import AS_IT_STANDS, Variation, variations

# Tier -> how much later than the bound the best learned policy may be.
TIERS = {"solved": 0.25, "hard": 0.75, "open": float("inf")}
RUNS = 40


class Setting(NamedTuple):
    """One line of the benchmark."""

    tier: str
    task: Task
    variation: Variation
    runs: int  # held-out draws

    @property
    def title(self) -> str:
        """Name of the setting, and of the file with its results."""
        return self.task.name if self.variation is AS_IT_STANDS else f"{self.task.name}-{self.variation.name}"


def _read(tier: str, facts: Plain) -> Setting:
    told = dict(facts)
    task, runs = make_task(told.pop("task")), told.pop("runs", RUNS)
    name = told.pop("name", AS_IT_STANDS.name)
    found = Variation(name, **told) if told else next(one for one in variations(task) if one.name == name)
    return Setting(tier, task, found, runs)


_FILE = Path(__file__).with_name("tiers.toml")
SETTINGS: tuple[Setting, ...] = tuple(
    _read(tier, facts) for tier, those in tomllib.loads(_FILE.read_text(encoding="utf-8")).items() for facts in those
)
