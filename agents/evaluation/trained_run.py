"""Judge what a training run has learned: the table on held-out draws, the curves, and the film beside the rule."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from rich.table import Table

from crowd_env.analysis.figures import named
from crowd_env.core.console import progress_bar
from crowd_env.core.executors import Executor, Processes, Serial
from crowd_env.core.files.json_file import json_number, write_json
from crowd_env.envs.settings import arguments_of
from crowd_env.envs.tasks.task import HELD_OUT_SEED
from crowd_env.scenarios.titles import run_title

from .. import starts_from, told_start
from ..controllers import FixedSplit, RandomController
from ..networks import NETWORK, network_digest
from ..plain import Plain
from ..rules import StrategyPolicy
from ..tasks.presets import ALL_PLACES
from ..trained import SAMPLED, LearnedPolicy, load_trained
from ..training_config import TrainingConfig, judged_place, law_of, physics_of, task_of
from ..walking import HeadwayRule
from . import shipped
from .comparison import by_scheme, clearing_means, clearing_times, last_times, minus_first, paired, ratio
from .entries import RULE, Entry, make_entries
from .evaluation import VALIDATION_SEED, Evaluation, evaluate
from .folder import EvaluationFolder, settings_of
from .plans import RULES as PLAN_RULES
from .plans import figures as plan_figures
from .plans import judge_plans
from .plans import table as plans_table
from .protocol import task_rows
from .report import comparison_table, crowding_table, task_table
from .same_draws import compare

LEARNED = "learned"
RESULTS = "results.json"
# The first is what the others are compared with.
_OF_SCENARIO = ("shortest", "stand-still", "random")
_OF_ROUTES = ("fastest", "nearest", "shortest")


def title_of(config: TrainingConfig) -> str:
    """Return what stands above the table and the egress curves."""
    task, place = config.task, judged_place(config)
    said = run_title(place, law_of(config).info.name)
    return said if task is None else f"{task}, version {task_of(config).version}: {said}"


def judge(folder: Path, config: TrainingConfig, runs: int, threads: int, *, fresh: bool = False) -> list[Evaluation]:
    """Evaluate the baselines and the learned policy, which comes last, on the same held-out draws and write ``results.json``.

    The learned policy takes its most likely action; before it stands the same as it acted in training, drawing every action.

    Beside the figures it holds all that a shipped policy's card says: the task, the network, what was spent, and the figures
    of the network on the validation draws, by which it was chosen.

    A task is judged as it stands: with all its people, at its own physics step.  What has been evaluated is kept in the folder,
    so that an interrupted evaluation goes on.  What rules did in a task as it stands ships with it, and is taken unless a
    ``fresh`` evaluation is wanted.
    """
    task, place = task_of(config), judged_place(config)
    own = config.task is not None
    rules = make_entries(named_beside(config), place, task)
    if config.routing is not None:
        rules += [Entry(kind.name, kind(config.routing), task=task) for kind in (FixedSplit, RandomController)]
    kinds = _kinds(folder)
    networks = make_entries([f"{folder / NETWORK}{kind}" for kind in kinds], place, task)
    named = [replace(entry, name=LEARNED + kind) for entry, kind in zip(networks, kinds, strict=True)]
    known = shipped.shipped(task, place, law_of(config), runs) if own and not fresh else {}
    kept = EvaluationFolder(folder / f"held-out-{runs}", settings_of(place, runs, 0, task if own else None))
    entries = [entry for entry in (*rules, *named) if entry.name not in known]
    computed = iter(compare(entries, place, [law_of(config)], runs=runs, threads=threads, folder=kept))
    results = [known.get(entry.name) or next(computed) for entry in (*rules, *named)]
    rule, learned = results[0], results[-1]
    rows = task_rows(task, place, results) if own else [{**one.row(), **_beside(one, learned)} for one in results]
    starts = starts_of(config, results)
    content = {
        "config": config.as_table(),
        "task": task.identity() if own else None,
        "network": network_digest(folder / NETWORK),
        **training_of(folder),
        "learned_minus_rule": minus_first(learned, rule),
        "learned_over_rule": ratio(learned, rule),
        "rows": [{**row, "starts_from": starts[row["policy"]]} for row in rows],
    }
    write_json(folder / RESULTS, content)
    return results


def judge_in_plans(folder: Path, config: TrainingConfig, plans: int, threads: int = 1) -> Table:
    """Judge the network of a finished training in all places beside the rules, and beside the network that PPO began with.

    It writes ``results.json``, and returns the table.
    """
    from ..learned.callbacks import START

    executor: Executor = Processes(threads) if threads > 1 else Serial()
    networks = {"start of PPO": str(folder / START), LEARNED: str(folder / NETWORK)}
    policies = (*PLAN_RULES, *networks.values())
    with progress_bar("judging in generated places", len(policies) * plans) as progress:
        found = judge_plans(policies, plans, folder=folder / "plans", executor=executor, progress=progress)
    found |= {name: found.pop(network) for name, network in networks.items()}
    rows, made = plan_figures(found), {"task": dict(ALL_PLACES), "network": network_digest(folder / NETWORK)}
    write_json(folder / RESULTS, {"config": config.as_table(), **made, **training_of(folder), "rows": rows})
    return plans_table(rows, f"{plans} generated places that training never draws")


def _beside(result: Evaluation, learned: Evaluation) -> Plain:
    """Return the times of a policy, of runs that cleared, and how much longer the learned one takes on the same draws."""
    of = {"last": clearing_times, "mean": clearing_means}
    more = {name: paired(times(learned), times(result)) for name, times in of.items()}
    return {**{name: named(times(result)) for name, times in of.items()}, "learned_minus_this": more}


def named_beside(config: TrainingConfig) -> tuple[str, ...]:
    """Return what is judged beside the learned policy."""
    if config.routing is not None:
        return _OF_ROUTES if config.task is None else (RULE, *_OF_ROUTES)
    if config.task is None:
        return _OF_SCENARIO
    all_alike = task_of(config).learned_share is None  # a manner is everyone's
    return tuple(name for name in shipped.OF_TASK if all_alike or name != HeadwayRule.name)


def _kinds(folder: Path) -> tuple[str, ...]:
    """Return what stands behind the name of the policy where it is judged: drawing its actions too, if it can; and not."""
    try:
        LearnedPolicy.load(folder / NETWORK).sampled()
    except ValueError:
        return ("",)
    return SAMPLED, ""


def _curve(folder: Path) -> tuple[list[dict[str, float]], dict[str, float]]:
    """Return the learning curve of a training, and the row of the network that was kept."""
    from ..learned.curve import CURVE, read_curve
    from ..learned.significance_test import kept_row

    curve = read_curve(folder / CURVE)
    return curve, kept_row(folder, curve)


def training_of(folder: Path) -> Plain:
    """Return what the training took in all, and the figures of the network that was kept."""
    from ..learned.significance_test import outcome

    curve, kept = _curve(folder)
    return {
        "spent": {name: curve[-1][name] for name in ("steps", "seconds", "cpu_seconds")},
        "validation": {name: json_number(value) for name, value in kept.items()},
        "confirmation": outcome(folder),
    }


def tables(config: TrainingConfig, results: list[Evaluation]) -> list[Table]:
    """Return the tables that are printed at the end of a run."""
    title = f"{title_of(config)}, {results[0].runs} held-out draws"
    if config.task is None:
        return [comparison_table(results, title)]
    return [task_table(by_scheme(results), title, starts=starts_of(config, results)), crowding_table(results)]


def starts_of(config: TrainingConfig, results: Sequence[Evaluation]) -> dict[str, str]:
    """Return what each policy of a run knew before it learned."""
    learned = {LEARNED + kind: told_start(config.start) for kind in ("", SAMPLED)}
    return {name: learned.get(name) or starts_from(name) for name in (one.policy for one in results)}


def draw(folder: Path, config: TrainingConfig, results: list[Evaluation]) -> None:
    """Write learning curve, egress curves and the film of the rule beside the learned policy."""
    from crowd_env.rendering import egress_curves, save_figure

    _draw_curve(folder, config, results)
    shown = {one.policy: one.exit_times for one in results if one.policy in (results[0].policy, LEARNED, "density-cap")}
    save_figure(egress_curves(shown, title=title_of(config)), folder / "egress_curves.png")
    _write_film(folder, config, results)


def _draw_curve(folder: Path, config: TrainingConfig, results: list[Evaluation]) -> None:
    from crowd_env.rendering import learning_curve, save_figure

    curve, kept = _curve(folder)
    told = (
        "kept, the start"
        if kept is curve[0]
        else f"kept, {'last' if task_of(config).selfish else 'best'} of {len(curve)}"
    )
    figure = learning_curve(
        [row["steps"] for row in curve],
        {LEARNED: [row["evacuation_time"] for row in curve]},
        errors={LEARNED: [row["standard_error"] for row in curve]},
        reference={**_references(config, results), told: kept["evacuation_time"]},
        title=f"{config.eval_runs} validation draws at each point, ± standard error",
        xlabel="training steps of all slots",
    )
    save_figure(figure, folder / "learning_curve.png")


def _references(config: TrainingConfig, results: list[Evaluation]) -> dict[str, float]:
    """Return the times [s] that a learning curve is compared with."""
    if config.task is not None:  # of the runs that cleared: the rule blocks, which would leave no room for the rest
        judged = {result.policy: result.row()["evacuation_time"]["mean"] for result in results}
        named = {name: judged.get(name) for name in ("rule-best-speed", "density-cap", "zipper")}
        return {f"{name}, held-out draws": time for name, time in named.items() if time is not None}
    # The curve was measured on validation draws, so the rule it is compared with is too.
    rule = StrategyPolicy(config.strategy)
    place, physics = judged_place(config), arguments_of(physics_of(config))
    beside = evaluate(rule, place, **physics, runs=config.eval_runs, first_seed=VALIDATION_SEED)
    return {f"{config.strategy} path": float(last_times(beside).mean())}


def _write_film(folder: Path, config: TrainingConfig, results: list[Evaluation]) -> None:
    """Write the film of a draw in which the rule leaves somebody inside, if there is one."""
    from .side_by_side import RULE_AHEAD, record_beside, write_beside

    task, place = task_of(config), judged_place(config)
    stuck = np.flatnonzero(results[0].column("unfinished") > 0)
    seed = HELD_OUT_SEED + (int(stuck[0]) if len(stuck) else 0)
    shown = {RULE_AHEAD: StrategyPolicy(task.rule), LEARNED: load_trained(folder / NETWORK)}
    entries = [Entry(title, who, task=task, learned_share=task.learned_share) for title, who in shown.items()]
    ways = {one.name: partial(one.driver, physics=law_of(config)) for one in entries}
    write_beside(folder / "evacuation.gif", record_beside(ways, place, seed))
