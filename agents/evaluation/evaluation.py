"""Evaluate policies on the same draws: the same people at the same starting positions, for every policy and scheme."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Required, TypedDict

import numpy as np
from typing_extensions import Unpack

from crowd_env import CrowdEnv, EpisodeMetrics, Scenario, make_scenario
from crowd_env.analysis.figures import columns_of, figures_of, median_time, named
from crowd_env.analysis.results.measurements import Measured, MeasurementRecorder
from crowd_env.core.arrays.state import Bools, Floats
from crowd_env.core.behaviors.headway import Headway
from crowd_env.core.behaviors.outline import Outline
from crowd_env.core.executors import Executor, Serial, WorkerDied
from crowd_env.core.executors.executor import never
from crowd_env.core.files.json_file import json_number
from crowd_env.envs.rollout import BatchDone, RunBatch, make_batches, simulate_batch
from crowd_env.envs.settings import EnvArguments
from crowd_env.envs.tasks.task import HELD_OUT_SEED
from crowd_env.physics import SCHEMES

from ..controllers import Controller
from ..drivers import UNHINDERED, DrivenCrowd, Hindrance
from ..mixed import learned_people
from ..plain import Plain
from ..policy import Policy
from .goals import at_goals

# Draws on which the best network of a training is chosen: neither trained on nor used for the final table.
VALIDATION_SEED = 2_000_000
# From here on are draws on which what did best on those is tried again, and from 10 million on those that belong to one
# policy alone: see `crowd_env.agents.learned.significance_test` and `crowd_env.agents.evaluation.submission`.
FINAL_SEED, OWN_SEED = 3_000_000, 10_000_000
_MEANS = ("mean_exit", "contact_impulse", "mean_exit_learned", "mean_exit_others", "walked")
_WITH_MAX = ("max_density", "max_pressure", "hurry")  # beside their mean stands the largest of all runs


class Draws(TypedDict, total=False):
    """Which evacuations are run, and whether they are measured; see `evaluate_crowds`."""

    runs: Required[int]
    first_seed: int
    measure: bool
    progress: Callable[[int], None] | None


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Many evacuations under one policy and scheme; people who strayed count as left inside, see `at_goals`."""

    policy: str
    scheme: str
    episodes: list[EpisodeMetrics]
    exit_times: list[np.ndarray]  # (N,) s each, nan for those still inside
    ended: Floats  # (R,) s  when each run ended: all out, or the first decision at or after the time limit, or blocked
    time_limit: float  # s
    exit_names: tuple[str, ...] = ()  # of the rows of Geometry.exits
    measured: Measured | None = None
    constants: Plain = field(default_factory=dict)  # of a policy that is made of constants
    learned: Bools | None = None  # (R, N)  whom the policy moves in a mixed crowd; the others follow the rule

    @property
    def runs(self) -> int:
        """Number of evacuations."""
        return len(self.episodes)

    def column(self, name: str) -> Floats:
        """Return one metric of every run (runs,)."""
        return columns_of(self.episodes)[name]

    def times_of_all(self) -> Floats:
        """Return the exit times (runs, N) [s]; people who did not get out count until the time limit.

        They count until the end of the run if that was later, so that nobody who stayed inside counts as out sooner than
        somebody who left in the last decision step.
        """
        times = np.array(self.exit_times)
        return np.where(np.isfinite(times), times, np.maximum(self.ended, self.time_limit)[:, None])

    @property
    def learned_share(self) -> float:
        """Share of the people whom the policy moves."""
        return 1.0 if self.learned is None else float(self.learned.mean())

    def mean_exit_of(self, those: Bools) -> Floats:
        """Return the mean exit time (runs,) [s] of ``those`` (R, N); nan where there are none, or one is left inside."""
        count, times = those.sum(axis=1), np.where(those, self.exit_times, 0.0)
        return np.where(count > 0, times.sum(axis=1) / np.maximum(count, 1), np.nan)

    def exit_time_95(self) -> Floats:
        """Return when 95 % of the people were out (runs,) [s]; nan where fewer got out."""
        times = np.sort(np.array(self.exit_times), axis=1)  # nan go last
        return times[:, int(np.ceil(0.95 * times.shape[1] - 1e-9)) - 1]

    def columns(self) -> dict[str, Floats]:
        """Return of every run (runs,) what `figures_of_runs` is made of: its metrics and, where it was measured, the rest."""
        found = columns_of(self.episodes) | {"mean_exit": np.array(self.exit_times).mean(axis=1)}
        if self.learned is not None:
            found["mean_exit_learned"] = self.mean_exit_of(self.learned)
            found["mean_exit_others"] = self.mean_exit_of(~self.learned)
        if (measured := self.measured) is not None:
            found |= {name: getattr(measured, name) for name in _WITH_MAX}
            found["walked"] = measured.walked.mean(axis=1)
            found["crushed"] = (measured.crushed > 0.0).sum(axis=1).astype(np.float64)
            found["crushed_time"] = measured.crushed.sum(axis=1)
        return found

    def row(self) -> Plain:
        """Return the figures as one JSON row, in SI units: `figures_of_runs`, and those of single people.

        ``exit_time_95`` is when 95 % of the people were out, ``mean_exit_time`` is over the people that got out.
        """
        out = np.concatenate(self.exit_times)
        out = out[np.isfinite(out)]
        row = {
            "policy": self.policy,
            "scheme": self.scheme,
            "learned_share": self.learned_share,
            "constants": self.constants,
            **figures_of_runs(self.columns(), self.scheme, len(self.exit_times[0])),
            "exit_time_95": named(self.exit_time_95()),
            "last_exit": float(out.max()) if len(out) else None,
            "mean_exit_time": named(self.column("mean_exit_time")),
        }
        if (measured := self.measured) is None:
            return row
        simulated = max(measured.simulated, 1e-9)
        return row | {
            "exits": self._exits(measured),
            "computing_seconds": measured.computing,
            "simulated_seconds": measured.simulated,
            "physics_per_simulated_second": (measured.computing - measured.replanning) / simulated,
            "replanning_per_simulated_second": measured.replanning / simulated,
        }

    def _exits(self, measured: Measured) -> dict[str, Plain]:
        """Return for each exit how many took it in a run, when on average, and when its last one did."""
        times, names = np.array(self.exit_times), np.array([*self.exit_names, ""])
        taken = names[measured.exit_index]
        found: dict[str, Plain] = {}
        for name in dict.fromkeys(self.exit_names):
            by_this = taken == name
            last = np.where(by_this, times, -1.0).max(axis=1)
            found[name] = {
                "people": named(by_this.sum(axis=1)),
                "mean_exit_time": json_number(times[by_this].mean() if by_this.any() else np.nan),
                "last_exit": named(np.where(last >= 0.0, last, np.nan)),
            }
        return found


def figures_of_runs(runs: Mapping[str, Floats], scheme: str, people: int) -> Plain:
    """Return the figures that the `Evaluation.columns` of R runs amount to, ready for JSON.

    ``evacuation_time`` and ``mean_exit`` are over the runs in which everyone got out, ``median_time`` is when the last
    person was out in half of all runs.  Impulse and way are means per person.

    ``crushed_share`` is of the people who at any time bore more than 1600 N/m, ``crushed_time`` how long these did, see
    `crowd_env.physics.pressure.INJURY`; ``hurry`` is the largest of anyone's mean speed over the desired speed.
    """
    found = {
        **figures_of(runs),
        "median_time": median_time(runs["evacuation_time"]),
        **{name: named(runs[name]) for name in _MEANS if name in runs},
        **{name: {**named(runs[name]), "max": json_number(runs[name].max())} for name in _WITH_MAX if name in runs},
        "max_overlap": float(runs["max_overlap"].max()),
    }
    if "crushed" not in runs:
        return found
    crushed = runs["crushed"]
    return found | {
        "crushed_share": named(crushed / people),
        "crushed_time": named(np.where(crushed > 0.0, runs["crushed_time"] / np.maximum(crushed, 1.0), np.nan)),
        "pressure_is_force": pressure_is_force(scheme),
    }


def pressure_is_force(scheme: str) -> bool:
    """Return whether a scheme has forces that a body bears, or impulses that only keep bodies apart."""
    return scheme not in SCHEMES or SCHEMES[scheme].info.impulses_are_forces


def evaluate(
    policy: str | Policy | Controller,
    scenario: str | Scenario = "room-v0",
    *,
    runs: int = 50,
    first_seed: int = HELD_OUT_SEED,
    measure: bool = False,
    progress: Callable[[int], None] | None = None,
    learned_share: float | None = None,
    hindrance: Hindrance = UNHINDERED,
    **arguments: Unpack[EnvArguments],
) -> Evaluation:
    """Run ``runs`` evacuations under a policy or controller, draw ``first_seed + k`` for run ``k``.

    Parameters
    ----------
    measure, progress : see `evaluate_crowds`.
    learned_share, hindrance : see `crowd_env.agents.drivers.DrivenCrowd`.
    arguments : of `CrowdEnv`, such as ``physics``; those that the policy was made for override them.

    Raises
    ------
    ValueError, TypeError
        As `evaluate_crowd`, and if `CrowdEnv` refuses an argument.
    """
    from .. import make_policy  # which knows this file by its tasks

    policy = make_policy(policy) if isinstance(policy, str) else policy
    if own := [name for name in ("num_envs", "autoreset") if name in arguments]:
        raise ValueError(f"an evaluation sets {own[0]} by itself; leave it out")
    changes = {} if arguments.get("people") is None else {"people": arguments.pop("people")}
    crowd = DrivenCrowd(
        policy, make_scenario(scenario, **changes), arguments, learned_share=learned_share, hindrance=hindrance
    )
    return evaluate_crowd(crowd, runs=runs, first_seed=first_seed, measure=measure, progress=progress)


def evaluate_crowd(crowd: DrivenCrowd, **draws: Unpack[Draws]) -> Evaluation:
    """Run evacuations of one crowd, here; ``draws`` are those of `evaluate_crowds`.

    Raises
    ------
    ValueError
        If the number of runs or the seed is out of range, or the crowd does not fit.
    """
    found: list[Evaluation] = []
    evaluate_crowds([crowd], finished=lambda _, result: found.append(result), **draws)
    return found[0]


def evaluate_crowds(
    crowds: Sequence[DrivenCrowd],
    *,
    runs: int,
    first_seed: int = HELD_OUT_SEED,
    measure: bool = False,
    executor: Executor | None = None,
    finished: Callable[[int, Evaluation], None],
    progress: Callable[[int], None] | None = None,
) -> None:
    """Run the evacuations of all crowds: every evaluation of policies and controllers comes here.

    The runs of a crowd are cut into batches, always the same ones, and put together in their order: an evaluation does not
    depend on where its batches were simulated.  Crowds that have come to rest for good are not simulated to the end of the
    wait, see `crowd_env.agents.drivers.PolicyDriver`; their figures are those of the whole wait.

    Parameters
    ----------
    measure : take a sample every decision step, see `crowd_env.analysis.results.measurements`.
    executor : simulates the batches, by default one after the other here.
    finished : called with the number of a crowd and its evaluation, as soon as all of its runs have ended.
    progress : called with the number of runs that have just finished.

    Raises
    ------
    ValueError
        If the number of runs or the seed is out of range, the crowd does not fit, or a process of the executor has died.
    """
    executor, settled = executor or Serial(), dict[int, DrivenCrowd]()
    pieces: list[tuple[int, RunBatch]] = []
    outcomes: list[dict[int, BatchDone]] = [{} for _ in crowds]  # of each crowd, by the first run of the batch

    def done(number: int, outcome: BatchDone) -> None:
        k, batch = pieces[number]
        outcomes[k][batch.runs[0]] = outcome
        if progress is not None:
            progress(len(batch.runs))
        if sum(len(one.episodes) for one in outcomes[k].values()) == runs:
            batch.reused.clear()  # no batch of the crowd is left to use its environment again
            finished(k, _joined(settled[k], [outcomes[k][first] for first in sorted(outcomes[k])]))
            outcomes[k].clear()

    try:
        executor.run(_settled, crowds, settled.__setitem__)  # a search of constants is work for an executor too
        for k in range(len(crowds)):
            driver, scenario = replace(settled[k], passes_rest=True), crowds[k].scenario
            recorder = MeasurementRecorder(scenario.geometry) if measure else None
            batches = make_batches(scenario, runs, seed=first_seed, driver=driver, recorder=recorder, workers=1)
            pieces += [(k, batch) for batch in batches]
        executor.run(_simulate, [batch for _, batch in pieces], done)
    except WorkerDied as error:
        raise ValueError(str(error)) from None


def _settled(crowd: DrivenCrowd, stopped: Callable[[], bool] = never) -> DrivenCrowd:
    return crowd.settled()


def _simulate(batch: RunBatch, stopped: Callable[[], bool]) -> BatchDone:
    if batch.recorder is not None and isinstance(batch.driver, DrivenCrowd):
        _warm_up(batch.driver)
    return simulate_batch(batch, stopped)


_warm: set[tuple[str, bool, bool, bool]] = set()  # kernels that this process has loaded: law, and which options are on


def _warm_up(crowd: DrivenCrowd) -> None:
    """Load the kernels, once in a process, so that compiling them is not counted as computing."""
    physics, headway = crowd.physics, crowd.scenario.behavior(Headway, crowd.walking.manner)
    outline = crowd.scenario.behavior(Outline, physics.outline)
    key = (physics.law.info.name, headway is None, outline is None, physics.balance is None)
    if key in _warm:
        return
    physics = replace(physics, dt=None, outline=outline, threads=1)
    env = CrowdEnv("room-v0", physics=physics, walking=headway, routing="fastest")
    env.reset(seed=0)
    env.step(None)
    _warm.add(key)


def _joined(crowd: DrivenCrowd, batches: Sequence[BatchDone]) -> Evaluation:
    """Return the evaluation that the batches of a crowd, in their order, amount to."""
    scenario = crowd.scenario
    episodes = [at_goals(episode, scenario) for batch in batches for episode in batch.episodes]
    recorder, learned = batches[0].recorder, None
    for batch in batches[1:] if recorder is not None else ():
        recorder.merge(batch.recorder)
    if crowd.learned_share is not None:
        seeds = [episode.seed for episode in episodes]
        learned = learned_people(seeds, scenario.population.people, crowd.learned_share)
    return Evaluation(
        crowd.name,
        crowd.physics.law.info.name,
        [episode.metrics for episode in episodes],
        [episode.exit_time for episode in episodes],
        np.array([episode.end for episode in episodes]),
        episodes[0].time_limit,
        scenario.geometry.exit_names,
        None if recorder is None else recorder.measured(episodes),
        crowd.constants,
        learned,
    )
