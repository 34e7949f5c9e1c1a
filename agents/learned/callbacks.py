"""Evaluation callbacks, which every training calls between its updates.

stable-baselines3, the evolution search, and RLlib each call `EvaluationCallback.on_update` before every update.
"""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Generic, TypeVar, cast

import numpy as np
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from crowd_env.core.console import notes, say, stops_by
from crowd_env.envs.settings import arguments_of

from ..evaluation.evaluation import VALIDATION_SEED, evaluate
from ..evaluation.plans import judge_plan
from ..networks import NETWORK
from ..plain import Plain
from ..policy import Policy
from ..trained import NUMBERS, LearnedController, LearnedPolicy
from ..training_config import TrainingConfig, judged_place, physics_of, task_of
from .curve import CURVE, SEARCH, best_row, figures_in_plans, figures_of, read_curve, score, write_curve

START, LOOKS = "start.safetensors", "looks"  # the first network of a training, and the folder of all

Trained = LearnedPolicy | LearnedController
Learner = TypeVar("Learner", contravariant=True)


class EvaluationCallback(ABC, Generic[Learner]):
    """Evaluates a policy during its training, and ends the training."""

    @property
    def progress(self) -> float:
        """Share of the budget that is spent: the learning rate falls with it."""
        return 0.0

    @property
    def stopped(self) -> bool:
        """Whether to end now, in the middle of a rollout."""
        return False

    @abstractmethod
    def on_update(self, steps: int, policy: Callable[[], Learner], returns: Sequence[float] = ()) -> bool:
        """Evaluate the policy if that is due; return whether to continue the training.

        Parameters
        ----------
        steps : decision steps of pedestrians so far.
        policy : returns the present policy; later training must not change it.
        returns : of the episodes that have ended since the last call.
        """


class RunCallback(EvaluationCallback[Trained]):
    """Evaluates a training on validation draws; writes the curve, every network, the first, and the best to its folder.

    For a selfish task it keeps the last network instead of the best.  It ends the training at its time limit, or at the first
    Ctrl-C or SIGTERM; a second one ends it at once.

    Parameters
    ----------
    folder, config : of the run.
    keep : writes a checkpoint; it takes each new row of the curve, before the file of the curve holds the row.
    threads : of the evaluations.

    Attributes
    ----------
    curve : a row for each evaluation, including earlier parts of the run.
    steps : decision steps of all slots so far.
    cpu_elsewhere : s, processor time of other processes.
    interrupted : whether Ctrl-C or SIGTERM has arrived.
    """

    def __init__(
        self, folder: Path, config: TrainingConfig, keep: Callable[[dict[str, float]], object], threads: int = 1
    ) -> None:
        self.folder, self.config, self.interrupted, self.cpu_elsewhere = folder, config, False, 0.0
        self.curve = read_curve(folder / CURVE)
        last = self.curve[-1] if self.curve else dict.fromkeys(("steps", "seconds", "cpu_seconds"), 0.0)
        self.steps, self._due = int(last["steps"]), last["steps"] + (config.eval_every if self.curve else 0)
        self._begun = self.steps, time.monotonic()
        self._seconds = time.monotonic() - last["seconds"]
        self._cpu_seconds = time.process_time() - last["cpu_seconds"]
        self._keep, self._threads = keep, threads
        self._returns: list[float] = []
        self._searched: list[dict[str, float]] = []
        self._bar = Progress(  # on the error stream: the table goes to standard output
            TextColumn("training"),
            BarColumn(),
            TextColumn("{task.percentage:3.0f} %"),
            TextColumn("{task.fields[figures]}"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=notes,
        )
        self._task = self._bar.add_task("", total=1.0, figures="")

    @contextmanager
    def running(self) -> Iterator[None]:
        """Show the progress bar, and take Ctrl-C and SIGTERM as interrupts."""
        with stops_by(self.interrupt), self._bar:
            yield

    def interrupt(self, number: int, frame: FrameType | None) -> None:
        """End the training as soon as possible; at once if called a second time."""
        if self.interrupted:
            raise KeyboardInterrupt
        self.interrupted = True
        say("stopping: saving what there is (Ctrl-C again stops at once)")

    @property
    def seconds(self) -> float:
        """Training time so far [s], earlier parts of the run included."""
        return time.monotonic() - self._seconds

    @property
    def _time_share(self) -> float:
        return self.seconds / (60.0 * self.config.minutes)

    @property
    def progress(self) -> float:
        """Share of the steps that is spent, or of the second half of the time.

        So a training that needs less than half of its time depends on its seed alone, not on the load of the machine.
        """
        return max(self.steps / self.config.steps, 2.0 * self._time_share - 1.0)

    @property
    def stopped(self) -> bool:
        """Whether the time limit is over, or the training was interrupted."""
        return self.interrupted or self._time_share > 1.0

    @property
    def over(self) -> bool:
        """Whether the budget is spent, or the training was interrupted."""
        return self.stopped or self.steps >= self.config.steps

    def on_update(self, steps: int, policy: Callable[[], Trained], returns: Sequence[float] = ()) -> bool:
        """Evaluate the policy if that is due, and before the first update; return whether to continue the training."""
        self.steps = steps
        self._returns += returns
        if not self.curve or (self._due <= steps and not self.over):
            self.evaluate(policy())
        rate = (steps - self._begun[0]) / max(time.monotonic() - self._begun[1], 1e-9)
        best = min(self.curve, key=score)
        left = f", {best['unfinished']:.0f} left" if best["unfinished"] else ""
        done = min(max(steps / self.config.steps, self._time_share), 1.0)
        self._bar.update(
            self._task, completed=done, figures=f"{rate:.0f} steps/s, best {best['evacuation_time']:.2f} s{left}"
        )
        return not self.over

    def on_end(self, steps: int, policy: Callable[[], Trained]) -> None:
        """Evaluate the policy after its last update."""
        self.steps = steps
        if self.curve[-1]["steps"] < steps:
            self.evaluate(policy())

    def evaluate(self, policy: Trained) -> None:
        """Add a row to the curve; save the policy if it is the first, or the best so far."""
        row = self._row(policy, self.steps)
        self._returns.clear()
        self._due = self.steps + self.config.eval_every
        self.curve.append(row)
        self._keep(row)
        policy.save(self.folder / LOOKS / f"{row['steps']:.0f}{NUMBERS}")
        if len(self.curve) == 1:
            policy.save(self.folder / START)
        if best_row(self.curve) is row or task_of(self.config).selfish:
            policy.save(self.folder / NETWORK)
        write_curve(self.folder / CURVE, self.curve)
        if not notes.is_terminal:  # a line in place of the bar
            say(
                f"{row['steps']:.0f} of {self.config.steps} steps, {row['seconds']:.0f} s: evacuation "
                f"{row['evacuation_time']:.2f} ± {row['standard_error']:.2f} (standard error) s, "
                f"{row['unfinished']:.0f} left inside"
            )

    def on_search(self, steps: int, policy: Policy) -> None:
        """Add the present best policy of a search to the curve of the search."""
        self._searched.append(self._row(policy, steps))
        write_curve(self.folder / SEARCH, self._searched)

    def _row(self, policy: Policy | LearnedController, steps: int) -> dict[str, float]:
        config, runs, cpu = self.config, self.config.eval_runs, time.process_time() - self._cpu_seconds
        row = {"steps": float(steps), "seconds": self.seconds, "cpu_seconds": cpu + self.cpu_elsewhere}
        if config.places is not None:
            plans = range(VALIDATION_SEED, VALIDATION_SEED + runs)
            row |= figures_in_plans([judge_plan(cast(Policy, policy), seed) for seed in plans])
        else:
            options = arguments_of({**physics_of(config), "threads": self._threads})
            options |= {"learned_share": task_of(config).learned_share}
            result = evaluate(policy, judged_place(config), runs=runs, first_seed=VALIDATION_SEED, **options)
            row |= figures_of(result)
        reward = float(np.mean(self._returns)) if self._returns else np.nan
        return row | {"reward": reward, "episodes": float(len(self._returns))}


class ComparisonCallback(EvaluationCallback[Policy]):
    """Ends a training after a budget of processor time, and judges the policy at checkpoints.

    Parameters
    ----------
    seconds : of processor time of this process from the first update on, without the time in ``judge``.
    judge : takes a policy and returns figures; a smaller ``order`` is better.
    checkpoints : number of judgements after the one at the start; the last one is at the end.

    Attributes
    ----------
    curve : a row for each judgement: ``steps``, ``seconds`` of processor time, and the figures of ``judge``.
    best : the policy of the best row, and the number of the row.
    """

    def __init__(self, seconds: float, judge: Callable[[Policy], Plain], checkpoints: int) -> None:
        self.seconds, self.checkpoints = seconds, checkpoints
        self.curve: list[Plain] = []
        self.best: tuple[Policy, int] | None = None
        self._judge = judge
        self._begun: float | None = None

    @property
    def progress(self) -> float:
        """Share of the processor time that is spent."""
        return min(self._spent() / self.seconds, 1.0)

    def _spent(self) -> float:
        """Return the processor time [s] since the first update: compiling and building come before it."""
        now = time.process_time()
        if self._begun is None:
            self._begun = now
        return now - self._begun

    def on_update(self, steps: int, policy: Callable[[], Policy], returns: Sequence[float] = ()) -> bool:
        """Judge the policy if that is due; return whether processor time remains."""
        spent = self._spent()
        if len(self.curve) <= self.checkpoints * min(spent / self.seconds, 1.0):
            found = policy()
            row = {"steps": int(steps), "seconds": round(spent, 3), **self._judge(found)}
            if self.best is None or row["order"] < self.curve[self.best[1]]["order"]:
                self.best = found, len(self.curve)
            self.curve.append(row)
            self._begun = time.process_time() - spent  # without the time of the judgement
        return spent < self.seconds
