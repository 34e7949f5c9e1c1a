"""Many evacuations under a bar, on all cores, and what an interruption has left of them."""

import time
from collections.abc import Callable, Collection, Sequence
from typing import Any, NamedTuple

from crowd_env.core.checks import counted, whole
from crowd_env.core.console import interrupted, progress_bar
from crowd_env.core.executors import Processes, all_cores
from crowd_env.envs.rollout import Episode, Recorder, RunsInterrupted, run_episodes
from crowd_env.scenarios.scenario import Scenario

_WORTH_A_PROCESS = 5.0  # s of work; a process takes seconds to start
_BATCHES = 8  # of a process: a batch is what an interruption loses, and by what the bar moves


class Evacuations(NamedTuple):
    """What came of a command's runs."""

    episodes: list[Episode]  # that were finished, in the order of their numbers
    stopped: RunsInterrupted | None  # the interruption, if they are not all
    records: dict[int, Any]  # what the recorder kept, by the numbers of the runs


def evacuate(
    title: str,
    place: Scenario,
    runs: int,
    *,
    workers: int | None = None,
    kept: Sequence[Episode] = (),
    keep: Callable[[Sequence[Episode]], object] | None = None,
    recorder: Recorder | None = None,
    recorded: Collection[int] = (),
    **options: Any,
) -> Evacuations:
    """Run evacuations under a bar; without a single one an interruption ends the command.

    One run comes first and alone, in this process: mistakes show at once, and what is not compiled is compiled once.

    Parameters
    ----------
    workers : most processes; default one a core.
    kept : runs that were finished before.
    keep : is given the runs that have just ended.
    recorder : sees all runs, and keeps something of those that are ``recorded``, which are run again if they were kept.
    **options : of `crowd_env.envs.rollout.rollout`.

    Raises
    ------
    ValueError
        If the number of runs or the seed is out of range, the crowd does not fit, or a process has died.
    """
    whole("runs", runs)
    found = {episode.run: episode for episode in kept}
    records: dict[int, Any] = {}
    todo = [run for run in range(runs) if run not in found or run in recorded]
    stopped: RunsInterrupted | None = None
    with progress_bar(f"{title}, runs", len(todo)) as progress:

        def take(episodes: Sequence[Episode]) -> None:
            records.update({episode.run: episode.record for episode in episodes if episode.run in recorded})
            found.update({episode.run: episode._replace(record=None) for episode in episodes})
            progress(len(episodes))
            if keep is not None:
                keep([found[episode.run] for episode in episodes])

        try:
            begin = time.monotonic()
            if todo:
                run_episodes(place, runs, only=todo[:1], recorder=recorder, keep=take, **options)
            if rest := todo[1:]:
                work = (time.monotonic() - begin) * len(rest)
                processes = min(all_cores() if workers is None else workers, len(rest))
                executor = Processes(processes) if processes > 1 and work > _WORTH_A_PROCESS else None
                at_once = -(-len(rest) // (_BATCHES * processes))
                way: dict[str, Any] = {"executor": executor, "at_once": at_once, "recorder": recorder, "keep": take}
                run_episodes(place, runs, only=rest, **way, **options)
        except KeyboardInterrupt:
            stopped = RunsInterrupted([found[run] for run in sorted(found)], runs)
    if stopped is not None and not found:
        interrupted(f"0 of {counted(runs, 'run', 'runs')} were finished")
    return Evacuations([found[run] for run in sorted(found)], stopped, records)
