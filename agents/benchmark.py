"""Algorithms beside each other over several seeds: train on a task, judge on held-out draws, sum up.

Every result is one JSON file, written whole, with the best network beside it.  Several processes may share a folder.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple, TypeAlias, cast

import numpy as np

from crowd_env.analysis.figures import cell
from crowd_env.core.arrays.state import Floats
from crowd_env.core.files.json_file import json_number
from crowd_env.core.files.store import Store, claimed
from crowd_env.envs.metrics import share_interval
from crowd_env.envs.protocol import WalkingBatch
from crowd_env.envs.settings import arguments_of

from . import make_policy, starts_from, told_start
from .evaluation.comparison import clearing_times, last_times, mean_times
from .evaluation.entries import RULE, policy_entry
from .evaluation.evaluation import VALIDATION_SEED, Evaluation, evaluate
from .evaluation.folder import digest_of, source_stamp
from .evaluation.plans import interquartile_mean
from .evaluation.protocol import task_rows
from .evaluation.same_draws import compare
from .plain import Plain
from .policy import Policy
from .rules import StrategyPolicy
from .tasks import Task, make_task
from .trained import NUMBERS, LearnedPolicy
from .training_config import TrainingConfig, make_env, physics_of, place_of, task_config

if TYPE_CHECKING:
    from .learned.callbacks import ComparisonCallback

Results: TypeAlias = Mapping[str, Sequence[Plain]]  # name -> its finished results, one a seed
_RESAMPLES = 20_000
_FEWEST = 10  # seeds: an interval of fewer is too short, see `bootstrap_interval`


def _ppo(config: TrainingConfig, callback: "ComparisonCallback") -> None:
    from .learned.starts import first_rule
    from .learned.training import train_ppo

    train_ppo(cast(WalkingBatch, make_env(config)), config.ppo, config.seed, callback, first_rule(config))


def _mappo(config: TrainingConfig, callback: "ComparisonCallback") -> None:
    from .learned.training import train_ppo

    train_ppo(cast(WalkingBatch, make_env(config)), config.ppo, config.seed, callback, central=True)


def _evolution(config: TrainingConfig, callback: "ComparisonCallback") -> None:
    from .learned.evolution import evolve

    evolve(place_of(config), physics_of(config), config.seed, callback, endless=True)


class Algorithm(NamedTuple):
    """A way to learn: trains one policy that all people share, in the training batch of a task's preset.

    Parameters
    ----------
    about : a line for people.
    train : takes the config of a run, and the callback that ends it.
    start : what it begins at; None = as the preset has it, which may be a better rule that is cloned.
    """

    about: str
    train: Callable[[TrainingConfig, "ComparisonCallback"], None]
    start: str | None = RULE


ALGORITHMS: Mapping[str, Algorithm] = MappingProxyType(
    {
        "ppo": Algorithm("PPO by stable-baselines3, begun at the rule", _ppo),
        "ppo-cloned": Algorithm("the same, begun as a training of the task is", _ppo, None),
        "mappo": Algorithm("MAPPO, PPO whose critic sees the crowd, begun at the rule", _mappo),
        "evolution": Algorithm("CMA-ES over seven weights of what is seen, begun at full speed", _evolution),
    }
)


class Plan(NamedTuple):
    """What every job of a comparison shares."""

    task: str
    minutes: float  # of processor time for each training
    checkpoints: int = 6  # beside the start
    validation_runs: int = 12  # draws of each checkpoint
    runs: int = 40  # held-out draws of the final evaluation


class Job(NamedTuple):
    """An algorithm with a seed, or a fixed policy without one."""

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
        If there is a result of another plan, of other parameters, or of other code.
    """
    store, of_plan = Store(folder), _of_plan(job, plan)
    with claimed(folder / f".{job.title}.claim") if store.path(job.title) is None else nullcontext(True) as mine:
        if not mine:
            return None
        if store.path(job.title) is None:
            if job.seed is None:
                policy: Policy = fixed_policy(job.name, make_task(plan.task))
                made: Plain = {"policy": job.name}
            else:
                policy, made = _trained(job, plan, folder)
            store.keep(job.title, {**made, **_final(policy, plan)}, of_plan)
    return read_result(folder, job, plan)


def read_result(folder: Path, job: Job, plan: Plan) -> Plain | None:
    """Return the finished result of a job, if there is one.

    Raises
    ------
    ValueError
        If it is of another plan, of other parameters, or of other code.
    """
    return Store(folder).load(job.title, _of_plan(job, plan))


def _of_plan(job: Job, plan: Plan) -> dict[str, object]:
    """Return what decides the result of a job."""
    told: dict[str, object] = {"task": plan.task, "task_digest": make_task(plan.task).digest(), "runs": plan.runs}
    if job.seed is not None:
        told |= {name: getattr(plan, name) for name in ("minutes", "checkpoints", "validation_runs")}
        told["config"] = _config(job, plan).as_table()
    elif (network := digest_of(job.name)) is not None:
        told["network"] = network
    return told | {"code": source_stamp()}


def _config(job: Job, plan: Plan) -> TrainingConfig:
    """Return the parameters of a training."""
    return task_config(plan.task, job.seed or 0, start=ALGORITHMS[job.name].start)


def fixed_policy(name: str, task: Task) -> Policy:
    """Return a policy that is not trained here: the rule of the task, or what `crowd_env.agents.make_policy` takes."""
    return StrategyPolicy(task.rule, name=RULE) if name == RULE else make_policy(name)


def _trained(job: Job, plan: Plan, folder: Path) -> tuple[Policy, Plain]:
    """Train; return the best policy of all checkpoints and what led to it.  Its network is kept beside the result."""
    from .learned.callbacks import ComparisonCallback

    config = _config(job, plan)
    place, physics = place_of(config), arguments_of(physics_of(config))

    def judge(policy: Policy) -> dict[str, object]:
        return checkpoint(evaluate(policy, place, runs=plan.validation_runs, first_seed=VALIDATION_SEED, **physics))

    callback = ComparisonCallback(60.0 * plan.minutes, judge, plan.checkpoints)
    ALGORITHMS[job.name].train(config, callback)
    assert callback.best is not None  # the start is always judged
    policy, row = callback.best
    if isinstance(policy, LearnedPolicy):
        policy.save(folder / f"{job.title}{NUMBERS}")
    facts = {"algorithm": job.name, "seed": job.seed, "start": config.start, "curve": callback.curve, "best": row}
    return policy, facts


def checkpoint(result: Evaluation) -> dict[str, object]:
    """Return the figures of a checkpoint: ``order`` says which is better, fewer runs unfinished first, then sooner out."""
    last = last_times(result)
    cleared = result.column("unfinished") == 0
    return {
        "unfinished": int((~cleared).sum()),
        "clearing_time": json_number(last[cleared].mean()) if cleared.any() else None,
        "mean_exit": float(mean_times(result).mean()),
        "order": [int((~cleared).sum()), float(last.mean())],
    }


def _final(policy: Policy, plan: Plan) -> Plain:
    """Return the figures of a policy in the task as it stands, on held-out draws, and those of every run."""
    task = make_task(plan.task)
    (result,) = compare([policy_entry(policy, task)], task.place(), [task.scheme], runs=plan.runs)
    (row,) = task_rows(task, task.place(), [result])
    runs = {
        "clearing_times": clearing_times(result),
        "mean_exits": mean_times(result),
        "blocked_runs": np.isfinite(result.column("blocked_since")),
    }
    return {
        # Beside nothing else than itself.
        "final": {name: value for name, value in row.items() if name not in ("minus_first", "credible")},
        "of_runs": {name: [json_number(float(one)) for one in values] for name, values in runs.items()},
        "constants": result.constants,
    }


# ----------------------------------------------------------------------------------------------------------- what came out


def bootstrap_interval(values: Sequence[float] | Floats) -> tuple[float, float]:
    """Return the 95 % percentile bootstrap interval of the interquartile mean (Agarwal et al. 2021), always the same one.

    Fewer than ten values have no interval, (nan, nan): of 400 samples with one hump, and of 400 with two, "95 %" held the true
    value in 76 and 72 % for 3 values, in 87 and 88 % for 5, in 95 and 91 % for 10, in 94 and 93 % for 20.
    """
    if len(values) < _FEWEST:
        return float("nan"), float("nan")
    from scipy.stats import bootstrap  # which the extra "train" brings

    found = bootstrap(
        (values,),
        lambda drawn, axis: interquartile_mean(drawn),
        vectorized=True,
        n_resamples=_RESAMPLES,
        method="percentile",
        random_state=np.random.default_rng(0),
    )
    return float(found.confidence_interval.low), float(found.confidence_interval.high)


def summarize(results: Results) -> dict[str, Plain]:
    """Return a row for each algorithm or policy, ready for JSON.

    ``clearing_time`` is the interquartile mean over seeds of the mean clearing time on held-out draws, of runs that cleared,
    with its bootstrap interval over seeds; of a policy without seeds the mean over draws, with its interval over draws.
    ``unfinished`` counts runs of all seeds, with Wilson's interval of their share.
    """
    rows: dict[str, Plain] = {}
    for name, found in results.items():
        times = [np.array(one["of_runs"]["clearing_times"], dtype=np.float64) for one in found]  # null is nan
        of_seed = np.array([np.nanmean(one) if np.isfinite(one).any() else np.nan for one in times])
        known = of_seed[np.isfinite(of_seed)]
        unfinished, runs = sum(int(np.isnan(one).sum()) for one in times), sum(map(len, times))
        seeds = "seed" in found[0]
        middle = float(interquartile_mean(known)) if len(known) else np.nan
        interval = bootstrap_interval(known) if seeds else found[0]["final"]["clearing_time"]["ci95"]
        curves = [result["curve"][-1] for result in found if "curve" in result]
        rows[name] = {
            "seeds": len(found) if seeds else 0,
            "start": told_start(found[0].get("start")) if seeds else starts_from(name),
            "clearing_time": {
                "iqm": json_number(middle),
                "ci95": [None if one is None else json_number(one) for one in interval],
            },
            "of_seeds": [json_number(value) for value in of_seed],
            "unfinished": {"runs": unfinished, "of": runs, "ci95": list(share_interval(unfinished, runs))},
            "mean_exit": json_number(np.mean([result["final"]["mean_exit"]["mean"] or np.nan for result in found])),
            "flow": json_number(np.mean([result["final"]["flow"] or np.nan for result in found])),
            "steps": int(np.mean([row["steps"] for row in curves])) if curves else None,
            "seconds": float(np.mean([row["seconds"] for row in curves])) if curves else None,
        }
    return rows


_COLUMNS = {
    "policy": "`{policy}`",
    "starts from": "{start}",
    "seeds": "{of}",
    "unfinished runs": "{unfinished[runs]} of {unfinished[of]} ({unfinished[ci95][0]:%} to {unfinished[ci95][1]:%} %)",
    "clearing time, s": "{clearing_time[iqm]:.1f}{interval}",
    "mean exit, s": "{mean_exit:.1f}",
    "flow, 1/s": "{flow:.2f}",
    "decisions, 10⁶": "{millions:.2f}",
    "training, CPU s": "{seconds:.0f}",
}


def table(rows: Mapping[str, Plain]) -> str:
    """Return the rows as a table in Markdown, the soonest first."""

    def soonest(item: tuple[str, Plain]) -> tuple[bool, float]:
        middle = item[1]["clearing_time"]["iqm"]
        return item[1]["unfinished"]["runs"] > 0, np.inf if middle is None else middle

    lines = [list(_COLUMNS), ["---"] * len(_COLUMNS)]
    for name, row in sorted(rows.items(), key=soonest):
        known = None not in row["clearing_time"]["ci95"]
        more = {"policy": name, "of": row["seeds"] or None, "millions": row["steps"] and row["steps"] / 1e6}
        more["interval"] = cell(" [{clearing_time[ci95][0]:.1f}, {clearing_time[ci95][1]:.1f}]", row) if known else ""
        lines.append([cell(text, {**row, **more}) for text in _COLUMNS.values()])
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)
