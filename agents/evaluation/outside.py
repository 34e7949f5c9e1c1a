"""A task for learners of other libraries: the room that its preset trains in, and the figures of what they have learned.

Nothing here needs a learning library.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from crowd_env import ObservationLayout
from crowd_env.analysis.figures import cell
from crowd_env.core.checks import whole
from crowd_env.envs.settings import arguments_of

from ..plain import Plain
from ..tasks import make_preset, make_task
from ..tasks.presets import training_place
from .entries import policy_entry
from .protocol import task_rows
from .same_draws import compare

_LINE = "{policy}: left inside in {unfinished} of {runs}; half of them {median_time:.1f} s, mean exit {mean_exit[mean]:.1f} s"


def training_options(task: str) -> Plain:
    """Return the arguments of `crowd_env.parallel_env` and of `crowd_env.CrowdEnv` for the room that a task's preset trains in.

    Raises
    ------
    ValueError
        If the task is unknown or has no preset.
    """
    judged, preset = make_task(task), make_preset(task)
    place = training_place(judged.scenario, {**judged.options, **preset.options}, preset.people)
    physics = {"scheme": judged.scheme, "dt": preset.dt, "strategy": judged.rule, "manner": judged.manner}
    learned = {"action": preset.action, "observation": {"terms": preset.terms}, "reward": preset.reward}
    return {"scenario": place, "decision_dt": judged.decision_dt, **arguments_of({**physics, **learned})}


@dataclass(frozen=True)
class Outside:
    """A policy of any library, with the action and the observation of a task's preset.

    Parameters
    ----------
    name : what tables call it.
    task : of the preset.
    choose : takes observations (K, D) and returns actions (K,) or (K, A): it sees no more than each person does.
    """

    name: str
    task: str
    choose: Callable[[np.ndarray], np.ndarray]

    @property
    def env_options(self) -> Plain:
        """Options of `CrowdEnv` that it was made for."""
        preset = make_preset(self.task)
        return {"frame": "path", "action": preset.action, "observation": ObservationLayout(terms=preset.terms)}

    def reset(self, env_mask: np.ndarray) -> None:
        """Nothing to forget."""

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
