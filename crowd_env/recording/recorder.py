"""Recorders of a rollout: they write or keep the evacuations while they run."""

from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from crowd_env.core.checks import COUNT, NOT_NEGATIVE, POSITIVE, Plain, number, whole
from crowd_env.core.files.json_file import json_number
from crowd_env.envs.arguments import parts_of
from crowd_env.envs.crowd import CrowdEnv, Step
from crowd_env.envs.rollout import Driver, rollout
from crowd_env.recording.formats import check_writable, open_writer
from crowd_env.recording.frames import FrameSampler, facts_of
from crowd_env.recording.recording import Recording, joined
from crowd_env.recording.writer import Writer, plain, remove_part
from crowd_env.scenarios import make_scenario
from crowd_env.scenarios.scenario import Scenario

_ROWS_AT_ONCE, _SECONDS_AT_ONCE = 10_000, 1.0  # of frames that wait to be written


class RunningRecording:
    """An evacuation that is being recorded, into the file ``path``, or (None) in memory."""

    def __init__(self, path: Path | None, sampler: FrameSampler, first: Recording) -> None:
        self.sampler = sampler
        self.writer: Writer | None = None if path is None else open_writer(path, first)
        self._waiting: list[Recording] = []
        self._rows, self._written_until = 0, -np.inf
        self.add(first)  # is written at once: the file can be read from the start

    def add(self, frame: Recording | None) -> None:
        """Take the next frame; write the waiting ones if they are many, or span a second."""
        if frame is None:
            return
        self._waiting.append(frame)
        self._rows += len(frame.person)
        late = float(frame.times[-1]) - self._written_until >= _SECONDS_AT_ONCE - 1e-9
        if self.writer is not None and (late or self._rows >= _ROWS_AT_ONCE):
            self._flush()
            self._written_until, self._rows = float(frame.times[-1]), 0

    def _flush(self) -> None:
        if self.writer is not None and self._waiting:
            waiting, self._waiting = self._waiting, []  # a failed write is not repeated
            self.writer.append(joined(waiting))

    def finish(self, facts: Plain) -> Any:
        """Return the path of the whole file, or the recording itself."""
        self.sampler.stop()
        if self.writer is None:
            whole = joined(self._waiting)
            return replace(whole, facts=plain({**whole.facts, **facts}), outline=plain(whole.outline))
        self._flush()
        return self.writer.finish(facts)

    def abandon(self) -> None:
        """Write the waiting frames, if possible, and leave the file unfinished."""
        self.sampler.stop()
        with suppress(OSError):
            self._flush()
        if self.writer is not None:
            self.writer.abandon()


class RunRecorder:
    """Records evacuations of a rollout, each into a file of its own, or in memory.

    It is a `crowd_env.envs.rollout.Recorder`, for `run_episodes` and `rollout`, and changes no bit of them.  Of each run it
    keeps the path of its file, a `Recording` if there is no file, or None if the run is not recorded.  Where the file cannot be
    written any more, it keeps the OSError, and the run continues without.  A file appears under its name when its evacuation
    is over.  Until then `NAME.part.SUFFIX` holds the frames so far, at most a second of the evacuation or 10 000 rows behind.
    Used as a context it closes files of evacuations that broke off.

    Parameters
    ----------
    path : of the file, or if several runs are recorded of `NAME-0.sqlite`, `NAME-1.sqlite` ...; None = in memory.
    runs : which are recorded: the first ones up to this number, or a list of numbers.
    contacts : whether to record contacts and their forces.
    every : s, from one frame to the next, a whole multiple of the decision step; by default that.
    seed : of the rollout, for the facts.
    facts : plain data that the recording holds beside its own facts.

    Raises
    ------
    ValueError
        If a value is out of range, or the suffix is that of no format.
    ModuleNotFoundError
        If the library that writes the format is not installed.
    """

    def __init__(
        self,
        path: str | Path | None = None,
        *,
        runs: int | Collection[int] = 1,
        contacts: bool = False,
        every: float | None = None,
        seed: int | None = None,
        facts: Plain | None = None,
    ) -> None:
        self.path = None if path is None else check_writable("the recording", path)
        numbers = runs if isinstance(runs, Collection) else range(whole("runs to record", runs, COUNT))
        self.runs = frozenset(whole("a run to record", run, NOT_NEGATIVE) for run in numbers)
        self.contacts = contacts
        self.every = None if every is None else number("every", every, POSITIVE, "s")
        self.seed, self.facts = seed, dict(facts or {})
        self._running: dict[int, RunningRecording] = {}
        self._finished: dict[int, Any] = {}
        self._numbers: Sequence[int] = ()  # of the runs of the batch

    def path_of(self, run: int) -> Path | None:
        """Return where a run is written."""
        if self.path is None or len(self.runs) == 1:
            return self.path
        return self.path.with_name(f"{self.path.stem}-{run}{self.path.suffix}")

    def begin(self, env: CrowdEnv, runs: Sequence[int]) -> None:
        """Begin the recordings of a batch with its first moment."""
        for running in self._running.values():  # of a batch that broke off
            running.sampler.stop()
        self._running, self._finished, self._numbers = {}, {}, runs
        every = 1 if self.every is None else parts_of("every", self.every, "decisions", env.decision_dt)
        longest = float(env.time_limit.max())
        if self.every is not None and self.every > longest:
            raise ValueError(
                f"every is {self.every:g} s, longer than the {longest:g} s of a run; take less than a second"
            )
        for e, run in enumerate(runs):
            if run in self.runs:
                seed = None if self.seed is None else self.seed + run
                facts = facts_of(env, e, every=every, contacts=self.contacts, run=run, seed=seed)
                sampler = FrameSampler(env, e, {**facts, **self.facts}, every=every, contacts=self.contacts)
                first = sampler.first(env)
                try:
                    self._running[e] = RunningRecording(self.path_of(run), sampler, first)
                except OSError as error:
                    sampler.stop()
                    self._drop(e, error)

    def add(self, env: CrowdEnv, step: Step) -> None:
        """Record the moment after a step, and finish the recordings of evacuations that ended in it."""
        for e, running in list(self._running.items()):
            last = bool(step.info["finished"][e])
            try:
                running.add(running.sampler.after_step(env, last))
                if last:
                    running.add(running.sampler.after_end(env))
                    self._finished[e] = running.finish(_end_of(env, e, step))
            except OSError as error:
                running.abandon()
                self._drop(e, error)
            if e in self._finished:
                del self._running[e]

    def _drop(self, e: int, error: OSError) -> None:
        """Give up a recording, and release its disk space: others, and the tables of results, may need it."""
        path, self._finished[e] = self.path_of(self._numbers[e]), error
        if path is not None:
            remove_part(path)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state of a copy, here or in another process: it begins without a running evacuation."""
        return {**vars(self), "_running": {}, "_finished": {}}

    def record(self, env: CrowdEnv, e: int) -> Any:
        """Return the record of the evacuation in environment ``e``, which has just ended."""
        return self._finished.pop(e, None)

    def close(self) -> None:
        """Write the waiting frames of evacuations that broke off, and leave their files unfinished."""
        for running in self._running.values():
            running.abandon()
        self._running = {}

    def __enter__(self) -> "RunRecorder":
        """Return itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close the files."""
        self.close()


def _end_of(env: CrowdEnv, e: int, step: Step) -> Plain:
    """Return the facts that are known at the end."""
    end = float(env.simulation.state.time[e])
    turned_away = int(np.isnan(env.simulation.entrances.times_of(e, end)).sum())
    return {
        "end": end,
        "unfinished": step.info["metrics"][e].unfinished,
        **({"turned_away": turned_away} if turned_away else {}),
        "blocked_since": json_number(step.info["metrics"][e].blocked_since),
        "finished": True,
    }


def record(
    env: CrowdEnv | Scenario | str,
    *,
    seed: int = 0,
    contacts: bool = False,
    every: float | None = None,
    facts: Plain | None = None,
    driver: Callable[[int], Driver] | None = None,
    **options: Any,
) -> Recording:
    """Run one evacuation and return its recording.

    Parameters
    ----------
    env : one environment without autoreset, in which all pedestrians walk by its strategy; or a scenario, or its name.
    contacts, every, facts : see `RunRecorder`.
    driver : decides; see `crowd_env.envs.rollout.rollout`.
    **options : of the environment of a scenario, such as ``strategy``.

    Raises
    ------
    ValueError
        If an option is unknown or out of range, the crowd does not fit, or ``env`` is a batch.
    """
    if isinstance(env, CrowdEnv):
        if env.num_envs != 1:
            raise ValueError(f"record needs a single environment; this batch has {env.num_envs}")
        of_env, driver = Driver(env), driver or (lambda _: of_env)
    place = env.scenario_of_env[0] if isinstance(env, CrowdEnv) else make_scenario(env)
    recorder = RunRecorder(contacts=contacts, every=every, seed=seed, facts=facts)
    (episode,) = rollout(place, 1, seed=seed, driver=driver, recorder=recorder, **options)
    return episode.record
