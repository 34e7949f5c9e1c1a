"""Many evacuations of one scenario, each of a draw of its own, and what they amount to."""

import copy
import functools
import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from crowd_env.core.arrays.state import Bools, Floats, Ints
from crowd_env.core.checks import NOT_NEGATIVE, whole
from crowd_env.core.executors import Executor, WorkerDied
from crowd_env.envs.crowd import CrowdEnv, Step
from crowd_env.envs.metrics import EpisodeMetrics
from crowd_env.envs.settings import arguments_of
from crowd_env.physics.settings import Physics
from crowd_env.scenarios.scenario import Scenario

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
    radius: Floats  # (N,)  m
    desired_speed: Floats  # (N,)  m/s
    time_limit: float  # s
    end: float  # s    when it ended: everyone out, or the first decision at or after the time limit, or the exits blocked
    record: Any = None  # what the recorder of the rollout kept of it
    crossings: Floats | None = None  # (C, 4) of sections, see `crowd_env.analysis.sections`; None = not counted
    # (N,)  s    0 = there at the start, nan = could not enter, inf = did not come; None = all were there at the start
    entry_time: Floats | None = None

    @property
    def came(self) -> Bools:
        """Which people (N,) were to leave: all but the ones that did not come."""
        everyone = np.ones(len(self.exit_time), dtype=bool)
        return everyone if self.entry_time is None else ~np.isinf(self.entry_time)

    @property
    def entries(self) -> Floats | None:
        """The entry times of the people that `came`; None if all were there at the start."""
        return None if self.entry_time is None else self.entry_time[self.came]

    @property
    def turned_away(self) -> int:
        """How many people came and could not enter."""
        return 0 if self.entry_time is None else int(np.isnan(self.entry_time).sum())


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

    def add(self, env: CrowdEnv, step: Step) -> None:
        """Look at the batch after a step, also after the step in which an evacuation ends."""

    def record(self, env: CrowdEnv, e: int) -> Any:
        """Return what was kept of the evacuation in environment ``e``, which has just ended."""


class Recorders:
    """Several recorders at once, by names: what they keep of an evacuation is a dict of what each keeps."""

    def __init__(self, **recorders: Recorder) -> None:
        self.recorders = recorders

    def begin(self, env: CrowdEnv, runs: Sequence[int]) -> None:
        """Look at the first moment of a batch."""
        for one in self.recorders.values():
            one.begin(env, runs)

    def add(self, env: CrowdEnv, step: Step) -> None:
        """Look at the batch after a step."""
        for one in self.recorders.values():
            one.add(env, step)

    def record(self, env: CrowdEnv, e: int) -> dict[str, Any]:
        """Return what each of them kept of an evacuation."""
        return {name: one.record(env, e) for name, one in self.recorders.items()}


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


def rollout(scenario: Scenario, runs: int, **options: Any) -> Iterator[Episode]:
    """Run ``runs`` evacuations, several side by side, and yield each as soon as it is over; run ``k`` is the draw ``seed + k``.

    Evacuations that end in the same batch are yielded in the order in which they end; `run_episodes` sorts them.  Every
    finished evacuation has been yielded when Ctrl-C, or an error, leaves the loop.

    Parameters
    ----------
    **options : those of `make_batches`, but for ``workers``, such as ``seed``, ``only`` or ``physics``.

    Raises
    ------
    ValueError
        If the number of runs or the seed is out of range, or the crowd does not fit.
    """
    return (episode for batch in make_batches(scenario, runs, **options) for episode in batch.episodes())


def _scripted_driver(scenario: Scenario, options: dict[str, Any], num_envs: int) -> Driver:
    arguments = arguments_of(options)
    physics = Physics.of(arguments.pop("physics", "nsm2"))
    physics = replace(physics, threads=min(physics.threads, num_envs))
    return Driver(CrowdEnv(scenario, num_envs=num_envs, physics=physics, **arguments))


@dataclass(frozen=True, eq=False)
class RunBatch:
    """Runs that are simulated side by side: a piece of work for an executor."""

    runs: Sequence[int]  # their numbers
    seed: int  # run k is the draw seed + k
    driver: Callable[[int], Driver]  # takes a number of evacuations
    recorder: Recorder | None
    reused: list[Driver] = field(
        default_factory=list
    )  # the last one made, shared by batches; a copy elsewhere begins without

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "reused": []}

    def episodes(self, stopped: Callable[[], bool] = lambda: False) -> Iterator[Episode]:
        """Yield the evacuations as they end.

        Raises
        ------
        KeyboardInterrupt
            If ``stopped``, which is called every step, says so.
        """
        if not self.reused or self.reused[0].env.num_envs != len(self.runs):
            self.reused[:] = [self.driver(len(self.runs))]
        driver, recorder = self.reused[0], self.recorder
        env = driver.env
        driver.reset([self.seed + run for run in self.runs])
        if recorder is not None:
            recorder.begin(env, self.runs)
        while not env.finished.all():
            if stopped():
                raise KeyboardInterrupt
            step = driver.step()
            if recorder is not None:
                recorder.add(env, step)
            for e in np.flatnonzero(step.info["finished"]).tolist():
                state, people = env.simulation.state, env.people(e)
                yield Episode(
                    self.runs[e],
                    self.seed + self.runs[e],
                    step.info["metrics"][e],
                    state.exit_time[people].copy(),
                    state.exit_index[people].copy(),
                    env.simulation.bodies.radius[people].copy(),
                    env.simulation.bodies.desired_speed[people].copy(),
                    float(env.time_limit[e]),
                    float(state.time[e]),
                    record=None if recorder is None else recorder.record(env, e),
                    entry_time=env.simulation.entrances.times_of(e, float(state.time[e]))
                    if env.scenario_of_env[e].has_arrivals
                    else None,
                )


class BatchDone(NamedTuple):
    """What came of a `RunBatch`."""

    episodes: list[Episode]  # in the order of their numbers; not all of the batch if it was stopped
    recorder: Any  # that saw the batch


def simulate_batch(batch: RunBatch, stopped: Callable[[], bool]) -> BatchDone:
    """Return what comes of a batch, or of its runs that had ended when it was ``stopped``: the work of an executor."""
    found: list[Episode] = []
    try:
        for episode in batch.episodes(stopped=stopped):
            found.append(episode)
    except KeyboardInterrupt:
        if not stopped():
            raise
    return BatchDone(sorted(found, key=lambda episode: episode.run), batch.recorder)


def make_batches(
    scenario: Scenario,
    runs: int,
    *,
    seed: int = 0,
    driver: Callable[[int], Driver] | None = None,
    recorder: Recorder | None = None,
    only: Sequence[int] | None = None,
    at_once: int | None = None,
    workers: int | None = None,
    **options: Any,
) -> list[RunBatch]:
    """Return the batches of a `rollout`.

    What a driver of one's own draws at random may depend on the batch, so its batches are always the same; where the rule
    decides, nothing depends on them.

    Parameters
    ----------
    seed : of run 0; each run has the next one.
    driver : makes a batch of so many evacuations of ``scenario``; by default everyone walks as the strategy says.
    recorder : sees every moment of every batch; what it kept of an evacuation is `Episode.record`.
    only : numbers of the runs that are wanted, 0 to ``runs`` - 1; by default all.
    at_once : most runs side by side under the rule; fewer end sooner, and are a little slower in all.
    workers : None = all batches are simulated here, one after the other, and share one recorder; else about how many are at a
        time, elsewhere: then each has its own copy of the recorder, and those under the rule are small enough, and alike
        enough, to occupy all.
    **options : arguments of `crowd_env.envs.crowd.CrowdEnv`, or flat settings, see `arguments_of`; a driver of one's own has
        made its environments already and takes none.

    Raises
    ------
    ValueError
        If the number of runs or the seed is out of range.
    """
    runs, seed = whole("runs", runs), whole("seed", seed, NOT_NEGATIVE)
    numbers = range(runs) if only is None else only
    most = max(1, min(_RUNS_AT_ONCE, _PEOPLE_AT_ONCE // scenario.population.people))
    if at_once is not None and driver is None:
        most = min(most, at_once)
    driver_of_batch = driver or functools.partial(_scripted_driver, scenario, options)
    if workers is not None and driver is None:
        rounds = -(-len(numbers) // (most * workers))  # in which every worker has a batch
        edges = np.linspace(0, len(numbers), min(rounds * workers, len(numbers)) + 1).astype(int).tolist()
    else:
        edges = [*range(0, len(numbers), most), len(numbers)]
    parts = [numbers[first:stop] for first, stop in itertools.pairwise(edges)]
    recorders = (recorder if workers is None else copy.deepcopy(recorder) for _ in parts)
    reused: list[Driver] = []
    return [RunBatch(part, seed, driver_of_batch, one, reused) for part, one in zip(parts, recorders, strict=True)]


def run_episodes(
    scenario: Scenario,
    runs: int,
    *,
    executor: Executor | None = None,
    keep: Callable[[Sequence[Episode]], object] | None = None,
    **options: Any,
) -> list[Episode]:
    """Return the evacuations of a `rollout`, whose options these are, in the order of their numbers.

    Parameters
    ----------
    executor : does the batches elsewhere, with a copy of the recorder each: all that is kept of them is `Episode.record`.
    keep : is given the evacuations that have just ended, as soon as they are here.

    Raises
    ------
    ValueError
        If the number of runs or the seed is out of range, the crowd does not fit, or a process of the executor has died.
    RunsInterrupted
        On Ctrl-C, with the evacuations that were finished by then.
    """
    found: dict[int, Episode] = {}

    def take(episodes: Sequence[Episode]) -> None:
        found.update({episode.run: episode for episode in episodes})
        if keep is not None:
            keep(episodes)

    try:
        if executor is None:
            for episode in rollout(scenario, runs, **options):
                take([episode])
        else:
            batches = make_batches(scenario, runs, workers=executor.workers, **options)
            executor.run(simulate_batch, batches, lambda _, done: take(done.episodes))
    except KeyboardInterrupt:
        raise RunsInterrupted([found[run] for run in sorted(found)], runs) from None
    except WorkerDied as error:
        raise ValueError(f"{error}; {len(found)} of {runs} runs were finished") from None
    return [found[run] for run in sorted(found)]
