"""Many evacuations of one scenario, each of a draw of its own, and what they amount to."""

import copy
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from crowd_env.checks import NOT_NEGATIVE, whole
from crowd_env.envs.crowd import CrowdEnv, Step
from crowd_env.envs.metrics import EpisodeMetrics, share_interval, summarise
from crowd_env.executors import Executor, WorkerDied
from crowd_env.files.json_file import json_number
from crowd_env.headway import Manner, plain_manner
from crowd_env.outline import BodyShape, plain_outline
from crowd_env.physics import ContactScheme, make_scheme
from crowd_env.scenarios.scenario import Scenario
from crowd_env.state import Floats, Ints

# Evacuations and people simulated side by side: enough to fill a call, few enough to show progress.
_RUNS_AT_ONCE = 50
_PEOPLE_AT_ONCE = 2000


class Episode(NamedTuple):
    """One finished evacuation of N people."""

    run: int  # number of the run, from 0
    seed: int  # that fixes its draw
    metrics: EpisodeMetrics
    exit_time: Floats  # (N,)  s    nan for people who did not get out
    exit_index: Ints  # (N,)  row of Geometry.exits; -1 for people who did not get out
    time_limit: float  # s
    end: float  # s    when it ended: everyone out, or the first decision at or after the time limit, or the exits blocked
    record: Any = None  # what the recorder of the rollout kept of it


class Driver:
    """A batch of evacuations together with what decides in it: here everyone walks as the strategy of the environment says.

    Parameters
    ----------
    env : the crowds, made without autoreset.
    """

    def __init__(self, env: CrowdEnv) -> None:
        self.env = env

    def reset(self, seeds: list[int]) -> None:
        """Start new evacuations, each from its seed."""
        self.env.reset(seeds)

    def step(self) -> Step:
        """Decide, if a decision is due, and let one decision step of ``env`` pass."""
        return self.env.step(None)


class Recorder(Protocol):
    """Keeps what a caller wants to know of evacuations beyond an `Episode`; one recorder sees one batch after the other."""

    def begin(self, env: CrowdEnv, runs: Sequence[int]) -> None:
        """Look at the first moment of a batch, after its reset; environment ``e`` makes the run of the number ``runs[e]``."""
        ...

    def add(self, env: CrowdEnv, step: Step) -> None:
        """Look at the batch after a step, also after the step in which an evacuation ends."""
        ...

    def record(self, env: CrowdEnv, e: int) -> Any:
        """Return what was kept of the evacuation in environment ``e``, which has just ended."""
        ...


class RunsInterrupted(KeyboardInterrupt):
    """Ctrl-C in the middle of many runs.

    Attributes
    ----------
    episodes : the runs that were finished by then, in the order of their numbers.
    runs : how many were to be made.
    """

    def __init__(self, episodes: list[Episode], runs: int) -> None:
        super().__init__(f"{len(episodes)} of {runs} runs are finished")
        self.episodes, self.runs = episodes, runs


def rollout(
    scenario: Scenario,
    runs: int,
    *,
    seed: int = 0,
    driver: Callable[[int], Driver] | None = None,
    recorder: Recorder | None = None,
    progress: Callable[[int], object] | None = None,
    threads: int = 1,
    **options: Any,
) -> Iterator[Episode]:
    """Run ``runs`` evacuations, several side by side, and yield each as soon as it is over; run ``k`` is the draw ``seed + k``.

    Evacuations that end in the same batch are yielded in the order in which they end; `run_episodes` sorts them.  Every
    finished evacuation has been yielded when Ctrl-C, or an error, leaves the loop.

    Parameters
    ----------
    driver : makes a batch of so many evacuations of ``scenario``; by default everyone walks as the strategy says.
    recorder : sees every moment of every batch; what it kept of an evacuation is `Episode.record`.
    progress : called with the number of evacuations that have just been yielded.
    threads : of the simulation, at most one an evacuation.
    **options : of `crowd_env.envs.crowd.CrowdEnv`; a driver of one's own has made its environments already and takes none.

    Raises
    ------
    ValueError
        If the number of runs or the seed is out of range, or the crowd does not fit.
    """
    batches = make_batches(scenario, runs, seed=seed, driver=driver, recorder=recorder, threads=threads, **options)
    return _finished(batches, progress)


def _finished(batches: Sequence["RunBatch"], progress: Callable[[int], object] | None) -> Iterator[Episode]:
    for batch in batches:
        yield from batch.episodes(progress)


class ReusedDriver:
    """Makes drivers, and gives the last one again where the next batch is as large; its copy elsewhere begins with none."""

    def __init__(self, make: Callable[[int], Driver]) -> None:
        self.make = make
        self.last: Driver | None = None

    def __call__(self, num_envs: int) -> Driver:
        """Return a driver of so many evacuations."""
        if self.last is None or self.last.env.num_envs != num_envs:
            self.last = self.make(num_envs)
        return self.last

    def __getstate__(self) -> dict[str, Any]:
        return {"make": self.make, "last": None}


@dataclass(frozen=True)
class _RuleDriver:
    scenario: Scenario
    threads: int
    options: dict[str, Any]

    def __call__(self, num_envs: int) -> Driver:
        return Driver(CrowdEnv(self.scenario, num_envs=num_envs, threads=min(self.threads, num_envs), **self.options))


@dataclass(frozen=True, eq=False)
class RunBatch:
    """Runs that are simulated side by side: a piece of work for an executor."""

    runs: range  # their numbers
    seed: int  # run k is the draw seed + k
    driver: ReusedDriver
    recorder: Recorder | None

    def episodes(
        self, progress: Callable[[int], object] | None = None, stopped: Callable[[], bool] | None = None
    ) -> Iterator[Episode]:
        """Yield the evacuations as they end.

        Raises
        ------
        KeyboardInterrupt
            If ``stopped``, which is called every step, says so.
        """
        driver, recorder = self.driver(len(self.runs)), self.recorder
        env = driver.env
        driver.reset([self.seed + run for run in self.runs])
        if recorder is not None:
            recorder.begin(env, self.runs)
        while not env.finished.all():
            if stopped is not None and stopped():
                raise KeyboardInterrupt
            step = driver.step()
            if recorder is not None:
                recorder.add(env, step)
            ended = [int(e) for e in np.flatnonzero(step.info["finished"])]
            for e in ended:
                state, people = env.simulation.state, env.people(e)
                yield Episode(
                    self.runs[e],
                    self.seed + self.runs[e],
                    step.info["metrics"][e],
                    state.exit_time[people].copy(),
                    state.exit_index[people].copy(),
                    float(env.time_limit[e]),
                    float(state.time[e]),
                    None if recorder is None else recorder.record(env, e),
                )
            if progress is not None and ended:
                progress(len(ended))


class BatchDone(NamedTuple):
    """What came of a `RunBatch`."""

    episodes: list[Episode]  # in the order of their numbers
    recorder: Any  # that saw the batch


def simulate_batch(batch: RunBatch, stopped: Callable[[], bool]) -> BatchDone:
    """Return what comes of a batch: the work of an executor."""
    return BatchDone(sorted(batch.episodes(stopped=stopped), key=lambda episode: episode.run), batch.recorder)


def make_batches(
    scenario: Scenario,
    runs: int,
    *,
    seed: int = 0,
    driver: Callable[[int], Driver] | None = None,
    recorder: Recorder | None = None,
    threads: int = 1,
    workers: int | None = None,
    **options: Any,
) -> list[RunBatch]:
    """Return the batches of a `rollout`, whose parameters these are.

    What a driver of one's own draws at random may depend on the batch, so its batches are always the same; where the rule
    decides, nothing depends on them.

    Parameters
    ----------
    workers : None = all batches are simulated here, one after the other, and share one recorder; else about how many are at a
        time, elsewhere: then each has its own copy of the recorder, and those under the rule are small enough to occupy all.
    """
    runs, seed = whole("runs", runs), whole("seed", seed, NOT_NEGATIVE)
    at_once = max(1, min(_RUNS_AT_ONCE, _PEOPLE_AT_ONCE // scenario.population.count))
    if workers is not None and driver is None:
        at_once = min(at_once, -(-runs // workers))
    reused = ReusedDriver(driver or _RuleDriver(scenario, threads, options))
    parts = [range(first, min(first + at_once, runs)) for first in range(0, runs, at_once)]
    return [RunBatch(part, seed, reused, recorder if workers is None else copy.deepcopy(recorder)) for part in parts]


def run_episodes(scenario: Scenario, runs: int, *, executor: Executor | None = None, **options: Any) -> list[Episode]:
    """Return the evacuations of a `rollout`, whose options these are, in the order of their numbers.

    Parameters
    ----------
    executor : does the batches elsewhere, with a copy of the recorder each: all that is kept of them is `Episode.record`.

    Raises
    ------
    ValueError
        If the number of runs or the seed is out of range, the crowd does not fit, or a process of the executor has died.
    RunsInterrupted
        On Ctrl-C, with the evacuations that were finished by then.
    """
    found: dict[int, Episode] = {}
    try:
        if executor is None:
            for episode in rollout(scenario, runs, **options):
                found[episode.run] = episode
        else:
            _spread(scenario, runs, executor, found, **options)
    except KeyboardInterrupt:
        raise RunsInterrupted([found[run] for run in sorted(found)], runs) from None
    except WorkerDied as error:
        raise ValueError(f"{error}; {len(found)} of {runs} runs were finished") from None
    return [found[run] for run in range(runs)]


def _spread(
    scenario: Scenario,
    runs: int,
    executor: Executor,
    found: dict[int, Episode],
    *,
    progress: Callable[[int], object] | None = None,
    **options: Any,
) -> None:
    """Let an executor do the batches, and put the evacuations into ``found`` by their numbers."""

    def done(k: int, batch: BatchDone) -> None:
        found.update({episode.run: episode for episode in batch.episodes})
        if progress is not None:
            progress(len(batch.episodes))

    executor.run(simulate_batch, make_batches(scenario, runs, workers=executor.workers, **options), done)


def report(
    scenario: Scenario,
    scheme: str | ContactScheme,
    episodes: Sequence[Episode],
    manner: Manner | None = None,
    outline: BodyShape | None = None,
) -> dict[str, Any]:
    """Return the figures of many evacuations, ready for JSON: times in s, flow in 1/s, lengths in mm, residual in m/s.

    ``manner`` and ``outline`` are those of the run, by default the scenario's.

    ``blocked`` lists the runs in which the exits blocked: the number of the run, since when [s], and how many were left.
    ``evacuation_time`` and ``flow`` (per-run least-squares slopes) are over the runs in which everyone, or at least three
    people, got out; ``overlap_mm.mean`` is the mean over runs of the mean over all overlapping contacts of a run;
    ``outside_mm`` is the furthest that any body reached beyond a wall.  The shares of runs in which someone was left inside,
    and in which the exits blocked, have Wilson's interval.
    """
    metrics = [episode.metrics for episode in episodes]
    return {
        "scenario": scenario.name,
        "scheme": make_scheme(scheme).info.name,
        "manner": plain_manner(scenario.manner_of_run(manner)),
        "outline": plain_outline(scenario.outline_of_run(outline)),
        "people": scenario.population.count,
        **figures_of(metrics),
        "blocked": [
            {"run": episode.run, "since": episode.metrics.blocked_since, "left": episode.metrics.unfinished}
            for episode in episodes
            if np.isfinite(episode.metrics.blocked_since)
        ],
        "overlap_mm": {
            "mean": 1e3 * float(column(metrics, "mean_overlap").mean()),
            "max": 1e3 * float(column(metrics, "max_overlap").max()),
        },
        "outside_mm": 1e3 * float(column(metrics, "max_outside").max()),
        "residual": float(column(metrics, "residual").max()),
        "unconverged_steps": int(column(metrics, "unconverged").sum()),
    }


def figures_of(metrics: Sequence[EpisodeMetrics]) -> dict[str, Any]:
    """Return the figures that every report of many evacuations has, ready for JSON; see `report`."""
    runs, unfinished = len(metrics), column(metrics, "unfinished")
    left, blocked = int((unfinished > 0).sum()), int(np.isfinite(column(metrics, "blocked_since")).sum())
    return {
        "runs": runs,
        "unfinished": int(unfinished.sum()),
        "unfinished_runs": left,
        "unfinished_share": share(left, runs),
        "blocked_runs": blocked,
        "blocked_share": share(blocked, runs),
        "evacuation_time": named(column(metrics, "evacuation_time")),
        "flow": named(column(metrics, "flow")),
        "max_speed": float(column(metrics, "max_speed").max()),
        "escaped": int(column(metrics, "escaped").sum()),
    }


def column(metrics: Sequence[EpisodeMetrics], name: str) -> Floats:
    """Return one of the metrics of every evacuation (R,)."""
    return np.array([getattr(one, name) for one in metrics], dtype=np.float64)


def named(values: np.ndarray) -> dict[str, Any]:
    """Return mean, spread and interval of the mean of the finite values, ready for JSON."""
    mean, sd, ci95 = summarise(values)
    return {"mean": json_number(mean), "sd": json_number(sd), "ci95": [json_number(bound) for bound in ci95]}


def share(count: int, of: int) -> dict[str, Any]:
    """Return a share with its Wilson interval, ready for JSON."""
    return {"mean": count / of, "ci95": list(share_interval(count, of))}
