"""The trainings of a comparison of algorithms: each learns a task with a seed, and its best network is judged.

Every result is one JSON file, written whole, with the network beside it.  Several processes may share a folder.
"""

import os
from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from crowd_env.core.files.store import Store, claimed
from crowd_env.envs.settings import arguments_of

from .. import make_policy
from ..evaluation.comparison import clearing_times, last_times, mean_times, rounded
from ..evaluation.entries import RULE, policy_entry
from ..evaluation.evaluation import VALIDATION_SEED, Evaluation, evaluate
from ..evaluation.folder import digest_of, source_stamp
from ..evaluation.same_draws import compare
from ..plain import Plain
from ..policy import Policy
from ..rules import StrategyPolicy
from ..runs import versions
from ..tasks import Task, make_task
from ..tasks.lower_bounds import bound_time
from ..trained import NUMBERS, LearnedPolicy
from ..training_config import NOTHING, TrainingConfig, judged_place, physics_of, task_config

TASKS = ("narrow-door", "competitive-door", "hertz-room", "counter-flow", "crossing")
BOUND = "bound"  # name of the piece that holds the bound of a task


class Algorithm(NamedTuple):
    """A way to learn one policy that all pedestrians share, in the training batch of a task's preset.

    Parameters
    ----------
    about : a line for people.
    version : raised whenever the algorithm learns otherwise: results of another version are not mixed with today's.
    start : of the training config, which has its settings of PPO.
    begins : what it knows at first, in words.
    """

    about: str
    version: int = 1
    start: str = RULE
    begins: str = "full speed"


# What each of them does is in `crowd_env.agents.learned.algorithms`, under the same name.
ALGORITHMS: Mapping[str, Algorithm] = MappingProxyType(
    {
        "ppo-random": Algorithm("PPO by stable-baselines3, begun at random choices", begins="random choices"),
        "ppo": Algorithm("the same, begun at full speed"),
        "mappo": Algorithm("MAPPO, PPO whose critic sees the crowd, begun at full speed"),
        "network-search": Algorithm("CMA-ES over the weights of a network without hidden layers"),
        "search-clone-ppo": Algorithm("the same for half of the time, its clone, then PPO", start=NOTHING),
    }
)


class Plan(NamedTuple):
    """What every job of a comparison shares."""

    minutes: float  # of processor time for each training
    checkpoints: int = 6  # beside the start
    validation_runs: int = 12  # draws of each checkpoint
    runs: int = 40  # held-out draws of the final evaluation


class Job(NamedTuple):
    """An algorithm with a seed, or a fixed policy without one, on a task."""

    task: str
    name: str
    seed: int | None

    @property
    def title(self) -> str:
        """Name of its result, and of the file that holds it."""
        return self.name if self.seed is None else f"{self.name}-seed{self.seed}"


def do(job: Job, plan: Plan, folder: Path) -> Plain | None:
    """Return the result of a job: from the folder if it is done, else do it; None if another process is about it.

    Raises
    ------
    ValueError
        If there is a result of another plan, of other parameters, or of another version of task or algorithm.
    """
    store, made_by = Store(folder / job.task), made_by_of(job, plan)
    claim = claimed(store.folder / f".{job.title}.claim") if store.path(job.title) is None else nullcontext(True)
    with claim as ours:
        if not ours:
            return None
        if store.path(job.title) is None:
            policy, made = (
                (fixed_policy(job.name, make_task(job.task)), {}) if job.seed is None else _trained(job, plan, store)
            )
            stamps = {"code": source_stamp(), "versions": versions(), "load": _load()}
            store.keep(job.title, {**made, **_final(policy, job.task, plan), **stamps}, made_by)
        if store.path(BOUND) is None:
            bound = bound_time(make_task(job.task))
            store.keep(BOUND, {"seconds": bound}, {"task_digest": made_by["task_digest"]})
    return read_result(folder, job, plan)


def read_result(folder: Path, job: Job, plan: Plan) -> Plain | None:
    """Return the finished result of a job, if there is one, with the ``bound`` of its task [s].

    Raises
    ------
    ValueError
        As `do`.
    """
    store, made_by = Store(folder / job.task), made_by_of(job, plan)
    found = store.load(job.title, made_by)
    bound = store.load(BOUND, {"task_digest": made_by["task_digest"]})
    return None if found is None or bound is None else {**found, "bound": bound["seconds"]}


def made_by_of(job: Job, plan: Plan) -> Plain:
    """Return what decides the result of a job.

    Code, libraries and the load of the machine are not among it, but stand beside the result.  The digest of the task changes
    with what physics does, the version of the algorithm with what learning does.
    """
    told = {"task": job.task, "task_digest": make_task(job.task).digest(), "runs": plan.runs}
    if job.seed is None:
        return {**told, "network": digest_of(job.name)}
    config = {name: value for name, value in _config(job).as_table().items() if name != "versions"}
    budget = {name: getattr(plan, name) for name in ("minutes", "checkpoints", "validation_runs")}
    return {**told, **budget, "algorithm": job.name, "version": ALGORITHMS[job.name].version, "config": config}


def _config(job: Job) -> TrainingConfig:
    """Return the parameters of a training."""
    return task_config(job.task, job.seed or 0, start=ALGORITHMS[job.name].start)


def fixed_policy(name: str, task: Task) -> Policy:
    """Return a policy that is not trained here: the rule of the task, or what `crowd_env.agents.make_policy` takes."""
    return StrategyPolicy(task.rule, name=RULE) if name == RULE else make_policy(name)


def _trained(job: Job, plan: Plan, store: Store) -> tuple[Policy, Plain]:
    """Train; return the best policy of all checkpoints and what led to it.  Its network is kept beside the result."""
    from ..learned.algorithms import TRAIN
    from ..learned.callbacks import ComparisonCallback

    config = _config(job)
    place, physics = judged_place(config), arguments_of(physics_of(config))

    def judge(policy: Policy) -> Plain:
        return checkpoint(evaluate(policy, place, runs=plan.validation_runs, first_seed=VALIDATION_SEED, **physics))

    callback = ComparisonCallback(60.0 * plan.minutes, judge, plan.checkpoints)
    TRAIN[job.name](config, callback)
    assert callback.best is not None  # the start is always judged
    policy, row = callback.best
    if isinstance(policy, LearnedPolicy):
        policy.save(store.folder / f"{job.title}{NUMBERS}")
    return policy, {"seed": job.seed, "start": config.start, "curve": callback.curve, "best": row}


def checkpoint(result: Evaluation) -> Plain:
    """Return the figures of a checkpoint: ``order`` says which is better, fewer runs unfinished first, then sooner out."""
    unfinished = int((result.column("unfinished") > 0).sum())
    return {"clearing_times": rounded(clearing_times(result)), "order": [unfinished, float(last_times(result).mean())]}


def _final(policy: Policy, task: str, plan: Plan) -> Plain:
    """Return the times of a policy in the task as it stands, on held-out draws."""
    judge = make_task(task)
    (result,) = compare([policy_entry(policy, judge)], judge.place(), [judge.scheme], runs=plan.runs)
    times = {"clearing_times": rounded(clearing_times(result)), "mean_exits": rounded(mean_times(result))}
    return {"held_out": times, "constants": result.constants}


def _load() -> float | None:
    """Return how many processes wait for the processors, a mean of the last minute; None where no system knows."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else None
