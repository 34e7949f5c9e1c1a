"""One job of a benchmark: train one algorithm with one seed, or take a fixed policy, and judge it on held-out draws."""

from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

from crowd_env import ObservationLayout, Scenario
from crowd_env.core.files.fingerprint import fingerprint
from crowd_env.core.files.json_file import json_number, read_json, write_json
from crowd_env.core.files.store import claimed

from .. import make_policy
from ..drivers import policy_driver
from ..evaluation.comparison import last_times, mean_times
from ..evaluation.entries import RULE
from ..evaluation.evaluation import VALIDATION_SEED, Evaluation, evaluate_driver
from ..evaluation.protocol import task_row
from ..policy import Policy
from ..rules import StrategyPolicy
from ..tasks import Task, make_task
from ..trained import NUMBERS, LearnedPolicy
from ..training_config import place_of, task_config
from .algorithms import ALGORITHMS

_RAW = ("clearing_times", "mean_exits", "blocked_runs")


class Plan(NamedTuple):
    """What every job of a benchmark shares."""

    task: str
    minutes: float  # of processor time for each training
    checkpoints: int  # beside the start
    validation_runs: int  # draws of each checkpoint
    runs: int  # held-out draws of the final evaluation


class Job(NamedTuple):
    """An algorithm with a seed, or a fixed policy without one."""

    name: str
    seed: int | None

    @property
    def file(self) -> str:
        """Name of the file of its result."""
        return f"{self.name}.json" if self.seed is None else f"{self.name}-seed{self.seed}.json"


def do(job: Job, plan: Plan, folder: Path) -> dict[str, Any] | None:
    """Return the result of a job: from its file if it is done, else do it; None if another process is about it.

    Raises
    ------
    ValueError
        If the file is of another plan.
    """
    path = folder / job.file
    if not path.exists():
        with claimed(folder / f".{path.stem}.claim") as mine:
            if not mine:
                return None
            if not path.exists():
                write_json(path, _fixed(job, plan) if job.seed is None else _trained(job, job.seed, plan, path))
    return read_result(path, job, plan)


def read_result(path: Path, job: Job, plan: Plan) -> dict[str, Any]:
    """Return the result in a file.

    Raises
    ------
    ValueError
        If it cannot be read, or is of another plan.
    """
    found = read_json(path)
    expected = _of_plan(job, plan)
    given = {name: found.get(name) for name in expected} if isinstance(found, dict) else {}
    for name, value in expected.items():
        if given.get(name) != value:
            raise ValueError(
                f"{path} has {name} {given.get(name)!r}, where this benchmark has {value!r}; take another folder with --out"
            )
    return cast(dict[str, Any], found)


def _of_plan(job: Job, plan: Plan) -> dict[str, Any]:
    """Return what the file of a job says of its plan."""
    told: dict[str, Any] = {"task": plan.task, "task_digest": make_task(plan.task).digest(), "runs": plan.runs}
    if job.seed is not None:
        told |= {name: getattr(plan, name) for name in ("minutes", "checkpoints", "validation_runs")}
    return told


def _fixed(job: Job, plan: Plan) -> dict[str, Any]:
    """Judge a policy that is not trained here."""
    task = make_task(plan.task)
    return {**_of_plan(job, plan), "policy": job.name, **_final(fixed_policy(job.name, task), plan)}


def fixed_policy(name: str, task: Task) -> Policy:
    """Return a policy that is not trained here: the rule of the task, or what `crowd_env.agents.make_policy` takes."""
    return StrategyPolicy(task.rule, name=RULE) if name == RULE else make_policy(name)


def _trained(job: Job, seed: int, plan: Plan, path: Path) -> dict[str, Any]:
    """Train, and judge the best policy of all checkpoints; a network is kept beside the result, under the same name."""
    from ..learned.watch import Watch

    algorithm = ALGORITHMS[job.name]
    config = task_config(plan.task, seed, start=algorithm.start)
    terms = [*config["observation"]["terms"], *algorithm.terms]
    config["observation"] = ObservationLayout(terms=list(dict.fromkeys(terms))).as_table()
    place = place_of(config)

    def judge(policy: Policy) -> dict[str, Any]:
        return checkpoint(_evaluated(policy, place, plan.validation_runs, VALIDATION_SEED, _training(config)))

    watch = Watch(60.0 * plan.minutes, judge, plan.checkpoints, config["decision_dt"])
    algorithm.train(config, watch)
    assert watch.best is not None  # the start is always judged
    policy, row = watch.best
    if isinstance(policy, LearnedPolicy):
        policy.save(path.with_suffix(NUMBERS))
    return {
        **_of_plan(job, plan),
        "algorithm": job.name,
        "seed": seed,
        "curve": watch.curve,
        "best": row,
        **_final(policy, plan),
        "config": config,
    }


def checkpoint(result: Evaluation) -> dict[str, Any]:
    """Return the figures of a checkpoint: ``order`` says which is better, fewer runs unfinished first, then sooner out."""
    last = last_times(result)
    cleared = result.column("unfinished") == 0
    return {
        "unfinished": int((~cleared).sum()),
        "clearing_time": json_number(last[cleared].mean()) if cleared.any() else None,
        "mean_exit": float(mean_times(result).mean()),
        "order": [int((~cleared).sum()), float(last.mean())],
    }


def _training(config: dict[str, Any]) -> dict[str, Any]:
    """Return the options of `CrowdEnv` under which checkpoints are judged: those of training."""
    return {name: config[name] for name in ("scheme", "dt", "decision_dt", "strategy", "manner", "outline")}


def _final(policy: Policy, plan: Plan) -> dict[str, Any]:
    """Return the figures of a policy in the task as it stands, on held-out draws, and those of every run."""
    task = make_task(plan.task)
    options = {"scheme": task.scheme, "rules": False, **task.env_options(task.scheme)}
    result = _evaluated(policy, task.place(), plan.runs, task.seeds.start, options, measure=True)
    row = task_row(task, task.place(), result, [result])
    del row["minus_first"], row["credible"]  # beside nothing else than itself
    cleared = result.column("unfinished") == 0
    raw = (
        np.where(cleared, last_times(result), np.nan),
        mean_times(result),
        np.isfinite(result.column("blocked_since")),
    )
    runs = {name: [json_number(one) for one in values.astype(float)] for name, values in zip(_RAW, raw, strict=True)}
    return {"final": row, "of_runs": runs, "constants": result.constants, "options": fingerprint(options)}


def _evaluated(
    policy: Policy, place: Scenario, runs: int, seed: int, options: dict[str, Any], *, measure: bool = False
) -> Evaluation:
    driver = policy_driver(policy, place, **options)
    return evaluate_driver(driver, place, policy.name, options["scheme"], runs=runs, first_seed=seed, measure=measure)
