"""Many evacuations under a bar, on all cores, and what an interruption has left of them."""

import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from rich.console import RenderableType
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeRemainingColumn

from crowd_env.analysis.results.tally import Tally
from crowd_env.core.checks import counted, whole
from crowd_env.core.console import interrupted, notes
from crowd_env.core.executors import Processes, all_cores
from crowd_env.envs.rollout import Episode, Recorder, RunsInterrupted, Together, run_episodes
from crowd_env.scenarios.scenario import Scenario

# s of a core that a process needs before it computes: Python, the imports, the compiled kernels (measured: 1.5 s).
_START = 1.5
# s of a core that a decision takes outside of compiled kernels, which runs of one batch share.
_OF_A_DECISION = 2e-4
_SHARED = 0.1  # of the time of a batch: most that may go into what its runs share


class Evacuations(NamedTuple):
    """What came of a command's runs."""

    episodes: list[Episode]  # that were finished, in the order of their numbers
    stopped: RunsInterrupted | None  # the interruption, if they are not all
    # Run 0 with what its recorders kept of it, in their order, if there were some and it was finished.
    first: Episode | None
    records: dict[int, Any]  # what the recorder of all runs kept of those that it was to record, by their numbers


def evacuate(
    title: str,
    place: Scenario,
    runs: int,
    *,
    workers: int | None = None,
    kept: Sequence[Episode] = (),
    keep: Callable[[Sequence[Episode]], object] | None = None,
    first: Sequence[Recorder] = (),
    recorder: Recorder | None = None,
    recorded: Collection[int] = (),
    **options: Any,
) -> Evacuations:
    """Run evacuations under a bar; without a single one an interruption ends the command.

    One run comes first and alone, in this process: mistakes show at once, what is not compiled is compiled once, what is kept
    of it need not travel, and its time tells whether the others are worth processes of their own.

    Parameters
    ----------
    workers : most processes; default one a core.
    kept : runs that were finished before.
    keep : is given the runs that have just ended.
    first : record run 0, which is run again if it was kept.
    recorder : sees all runs, wherever they are made, and keeps something of those that are ``recorded``, which are run again
        if they were kept.
    **options : of `crowd_env.envs.rollout.rollout`.

    Raises
    ------
    ValueError
        If the number of runs or the seed is out of range, the crowd does not fit, or a process has died.
    """
    whole("runs", runs)
    found = {episode.run: episode for episode in kept}
    wanted = {*recorded, *([0] if first else [])}
    todo = [run for run in range(runs) if run not in found or run in wanted]
    seen: Episode | None = None
    records: dict[int, Any] = {}
    stopped: RunsInterrupted | None = None
    with Tally(runs) as tally, _Bar(title, runs, place.population.people, tally, found):

        def take(episodes: Sequence[Episode]) -> None:
            records.update({episode.run: episode.record for episode in episodes if episode.run in recorded})
            found.update({episode.run: episode._replace(record=None) for episode in episodes})
            for episode in episodes:
                tally.take(episode)
            if keep is not None:
                keep(episodes)

        for episode in kept:
            tally.take(episode)
        try:
            begin = time.monotonic()
            if todo:
                alone = first if todo[0] == 0 else ()
                together = Together([*alone, *([] if recorder is None else [recorder])])
                (seen,) = run_episodes(place, runs, only=todo[:1], watch=tally, recorder=together, **options)
                take([seen._replace(record=None if recorder is None else seen.record[len(alone)])])
            if todo[1:]:
                way = _way(len(todo) - 1, workers, tally.begun - begin, tally)
                run_episodes(place, runs, only=todo[1:], watch=tally, recorder=recorder, keep=take, **way, **options)
        except KeyboardInterrupt:
            stopped = RunsInterrupted([found[run] for run in sorted(found)], runs)
    if stopped is not None and not found:
        interrupted(f"0 of {counted(runs, 'run', 'runs')} were finished")
    return Evacuations([found[run] for run in sorted(found)], stopped, seen if first else None, records)


def _way(runs: int, workers: int | None, setting_up: float, tally: Tally) -> dict[str, Any]:
    """Return how the other runs are made: in processes, if these save twice what they cost, and how many side by side.

    Parameters
    ----------
    setting_up : s, from the plan to the first step of a run; every process, and there every batch, does it again.
    """
    workers = min(all_cores() if workers is None else workers, runs)
    of_a_run = max(tally.spent - _OF_A_DECISION * tally.decisions, 1e-6)
    worth = runs * of_a_run * (1.0 - 1.0 / workers) > 2.0 * (_START + setting_up)
    # As few as make a small part of all that is shared: an interruption loses what has not come to its end.
    shared = max(_OF_A_DECISION * tally.decisions, setting_up) / of_a_run
    at_once = int(min(np.ceil(shared / _SHARED), runs)) or 1
    return {"executor": Processes(workers) if workers > 1 and worth else None, "at_once": at_once}


class _Bar(Progress):
    """Shows how many people are out of all runs so far, and the seconds that were simulated.

    It looks at the tally whenever it is drawn: nothing that computes has to tell it anything.
    """

    def __init__(self, title: str, runs: int, people: int, tally: Tally, found: Mapping[int, Episode]) -> None:
        self._tally, self._found = tally, found  # first: the bar is drawn as soon as it is made
        words = "{task.fields[out]}/{task.total} people out, {task.fields[done]}/{task.fields[runs]} runs, "
        columns = (
            SpinnerColumn(),
            TextColumn("{task.description}"),
            BarColumn(20),
            TextColumn(words + "{task.fields[sofar]}"),
            TimeRemainingColumn(),
        )
        super().__init__(*columns, console=notes, transient=True, refresh_per_second=4, disable=not notes.is_terminal)
        self.add_task(title, total=runs * people, runs=runs, out=0, done=0, sofar="")

    def get_renderables(self) -> Iterator[RenderableType]:
        """Look how far the runs are, and yield the bar."""
        seconds, out = self._tally.sofar()
        sofar = f"{seconds:.0f} s simulated" if seconds > 0 else "setting up"
        for task in self.task_ids:
            self.update(task, completed=out, out=out, done=len(self._found), sofar=sofar)
        yield from super().get_renderables()
