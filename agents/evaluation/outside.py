"""The figures in a task of what learners of other libraries have learned.

Nothing here needs a learning library.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from crowd_env import ObservationLayout
from crowd_env.analysis.figures import cell
from crowd_env.core.checks import whole

from ..plain import Plain
from ..policy import WithoutMemory
from ..tasks import make_task
from .entries import policy_entry
from .protocol import task_rows
from .same_draws import compare

_LINE = "{policy}: left inside in {unfinished} of {runs}; half of them {median_time:.1f} s, mean exit {mean_exit[mean]:.1f} s"


@dataclass(frozen=True)
class Outside(WithoutMemory):
    """A policy of any library, with the action and the observation of a task.

    Parameters
    ----------
    name : what tables call it.
    task : its name.
    choose : takes observations (K, D) and returns actions (K,) or (K, A): it sees no more than each person does.
    """

    name: str
    task: str
    choose: Callable[[np.ndarray], np.ndarray]

    @property
    def env_options(self) -> Plain:
        """Options of `CrowdEnv` that it was made for."""
        task = make_task(self.task)
        return {"frame": "path", "action": task.action, "observation": ObservationLayout(terms=tuple(task.terms))}

    def act(self, observation: np.ndarray, layout: ObservationLayout, rng: np.random.Generator) -> np.ndarray:
        """Return the actions of all people (P,)."""
        return np.asarray(self.choose(observation))


def judge_outside(policy: Outside, runs: int = 40) -> Plain:
    """Return the figures of a policy in its task as it stands, on the first held-out draws: `protocol.task_figures`.

    Raises
    ------
    ValueError
        If the number of runs is out of range.
    """
    task = make_task(policy.task)
    results = compare([policy_entry(policy, task)], task.place(), [task.scheme], runs=whole("runs", runs))
    return task_rows(task, task.place(), results)[0]


def line_of(row: Plain) -> str:
    """Return the figures of `judge_outside` in a line."""
    return cell(_LINE, row)
