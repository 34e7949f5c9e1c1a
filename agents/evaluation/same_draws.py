"""Entries under contact schemes, all on the same draws, and everything that is said about them as plain data."""

import time
from collections.abc import Sequence
from dataclasses import replace

from crowd_env import Physics, Scenario
from crowd_env.core.console import notes, progress_bar, say
from crowd_env.core.executors import Executor, Processes, Serial
from crowd_env.envs.tasks.task import HELD_OUT_SEED
from crowd_env.physics.settings import AsPhysics

from ..plain import Plain
from ..runs import versions
from ..tasks import Task
from .comparison import clearing_means, ranking, rows_beside
from .entries import Entry
from .evaluation import Draws, Evaluation, evaluate_crowds
from .folder import EvaluationFolder
from .protocol import task_rows

_WORTH_PROCESSES = 50  # runs: a process takes some seconds to begin


def compare(
    entries: Sequence[Entry],
    scenario: Scenario,
    physics: Sequence[AsPhysics],
    *,
    runs: int,
    seed: int = 0,
    threads: int = 1,
    folder: EvaluationFolder | None = None,
    executor: Executor | None = None,
) -> list[Evaluation]:
    """Evaluate every entry under each ``physics``: run ``k`` of all of them starts from the same people in the same places.

    What ``folder`` has kept is taken from there.  The rest is shared out by ``executor``, by default to as many processes as
    ``threads`` where that is worth it, else one batch after the other here; results do not depend on it.
    """
    pairs = [(entry, Physics.of(one)) for one in physics for entry in entries]
    results = [None if folder is None else folder.load_result(*pair) for pair in pairs]
    todo = [k for k, result in enumerate(results) if result is None]
    if executor is None and threads > 1 and runs * len(todo) >= _WORTH_PROCESSES:
        executor, threads = Processes(threads), 1
    executor = executor or Serial()
    all_runs, ended, told = runs * len(todo), list[tuple[float, int]](), list[str]()

    def count(runs: int) -> None:
        progress(runs)
        ended.append((time.monotonic(), runs))
        (began, first), left = ended[0], all_runs - sum(number for _, number in ended)
        timed = all_runs - left - first  # what comes first has waited for processes and kernels
        if timed and 0 < left <= 0.75 * all_runs and not told and not notes.is_terminal:
            told.append(f"{left} of {all_runs} runs are to come, about {(ended[-1][0] - began) * left / timed:.0f} s")
            say(told[0])

    def finished(number: int, result: Evaluation) -> None:
        k = todo[number]
        results[k] = result
        if folder is not None:
            folder.keep_result(*pairs[k], result)
        if not notes.is_terminal:  # no bar there: say in lines how far it is
            title = f"{k + 1}/{len(pairs)} {result.policy}, {result.scheme}"
            say(f"{title}: {(result.column('unfinished') == 0).sum()} of {runs} runs cleared")

    with progress_bar("evaluating", all_runs) as progress:
        crowds = [pairs[k][0].driver(scenario, physics=replace(pairs[k][1], threads=threads)) for k in todo]
        draws: Draws = {"runs": runs, "first_seed": HELD_OUT_SEED + seed, "measure": True, "progress": count}
        evaluate_crowds(crowds, executor=executor, finished=finished, **draws)
    return [result for result in results if result is not None]


def summary(results: Sequence[Evaluation], scenario: Scenario, settings: Plain, task: Task | None = None) -> Plain:
    """Return everything about an evaluation but single runs, ready for JSON; rows of a task are those of its protocol."""
    return {
        **settings,
        "people": scenario.population.people,
        "time_limit": scenario.time_limit,
        "rows": rows_beside(results) if task is None else task_rows(task, scenario, results),
        "ranking": {"last": ranking(results), "mean": ranking(results, of=clearing_means)},
        "versions": versions(),
    }
