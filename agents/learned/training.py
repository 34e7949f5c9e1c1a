"""The training loop's companion: progress, periodic evaluation, checkpoints, a clean stop."""

import csv
import io
import time
from contextlib import ExitStack
from pathlib import Path
from types import FrameType
from typing import Any, cast

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from stable_baselines3.common.callbacks import BaseCallback

from agents.evaluation.comparison import last_times
from agents.evaluation.evaluation import Evaluation, evaluate
from agents.learned.checkpoint import write_checkpoint
from agents.learned.export import network_of
from agents.learned.rate import FallingRate
from agents.stopping import stops_by
from agents.trained import LearnedPolicy
from crowd_env import CrowdEnv, Scenario
from crowd_env.files.atomic import write_text

# Draws on which the best network is chosen: neither trained on nor used for the final table.
VALIDATION_SEED = 2_000_000
# evacuation_time and its standard error are over all validation draws, whoever is left inside counted as in
# `Evaluation.times_of_all`; reward is the mean return of the episodes that ended since the row before.
CURVE_COLUMNS = (
    "steps",
    "seconds",
    "evacuation_time",
    "standard_error",
    "unfinished",
    "contact_impulse",
    "reward",
    "episodes",
)


class Companion(BaseCallback):
    """Watches over one training run.

    Every ``eval_every`` steps it evaluates the mean action on validation draws, writes the learning curve, the checkpoint and,
    if it is the best so far, ``best.npz``.  Training stops when ``max_seconds`` have passed or at the first Ctrl-C or SIGTERM;
    a second one stops at once.

    Parameters
    ----------
    folder : of the run.
    env, scenario, scheme : what is trained in.
    total_steps, max_seconds : budget; whichever is used up first.
    eval_every, eval_runs : steps between evaluations, evacuations in each.
    trained : what is said of the training in the files of the networks.
    curve : rows of an earlier part of the same run.
    """

    def __init__(
        self,
        folder: Path,
        env: CrowdEnv,
        scenario: Scenario,
        *,
        total_steps: int,
        max_seconds: float,
        eval_every: int,
        eval_runs: int,
        trained: dict[str, Any] | None = None,
        curve: list[dict[str, float]] | None = None,
    ) -> None:
        super().__init__()
        self.folder = folder
        self.env = env
        self.scenario = scenario
        self.total_steps = total_steps
        self.max_seconds = max_seconds
        self.eval_every = eval_every
        self.eval_runs = eval_runs
        self.trained = trained or {}
        self.curve = curve or []
        self.interrupted = False
        self.out_of_time = False
        self._seconds_before = self.curve[-1]["seconds"] if self.curve else 0.0
        self._returns: list[float] = []
        self._while_training = ExitStack()
        self._progress = Progress(  # on the error stream: the table goes to standard output
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.percentage:3.0f} %"),
            TextColumn("{task.fields[speed]}"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[best]}"),
            console=Console(stderr=True),
        )

    @property
    def seconds(self) -> float:
        """Training time so far [s], earlier parts of the run included."""
        return self._seconds_before + time.monotonic() - self._begin

    def _on_training_start(self) -> None:
        self._begin = time.monotonic()
        self._first_steps = self.model.num_timesteps
        self._next_eval = self.model.num_timesteps + self.eval_every
        self._while_training.enter_context(stops_by(self._interrupt))
        self._task = self._progress.add_task("training", total=1.0, speed="", best="")
        self._while_training.enter_context(self._progress)
        if not self.curve:
            self._evaluate()

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        if self.interrupted:
            raise KeyboardInterrupt
        self.interrupted = True
        self._progress.console.print("stopping: saving what there is (Ctrl-C again stops at once)")

    def _on_step(self) -> bool:
        infos = self.locals["infos"]
        self._returns.extend(infos[slot]["episode"]["r"] for slot in np.flatnonzero(self.locals["dones"]))
        self.out_of_time = self.seconds > self.max_seconds
        return not (self.interrupted or self.out_of_time)

    def _on_rollout_end(self) -> None:
        steps = self.model.num_timesteps
        cast(FallingRate, self.model.learning_rate).time_spent = self.seconds / self.max_seconds
        done = max(steps / self.total_steps, self.seconds / self.max_seconds)
        rate = (steps - self._first_steps) / max(time.monotonic() - self._begin, 1e-9)
        best = min((row["evacuation_time"] for row in self.curve if row["unfinished"] == 0), default=float("nan"))
        self._progress.update(
            self._task, completed=min(done, 1.0), speed=f"{rate / 1000:.0f}k steps/s", best=f"best {best:.2f} s"
        )
        if self._next_eval <= steps < self.total_steps:  # the end of the training is evaluated anyway
            self._next_eval = steps + self.eval_every
            self._evaluate()

    def _on_training_end(self) -> None:
        self._evaluate()
        self._progress.update(self._task, completed=1.0)
        self.close()

    def close(self) -> None:
        """Take the bar away and handle signals as before; also after an error."""
        self._while_training.close()

    def _evaluate(self) -> None:
        policy = LearnedPolicy(network_of(self.model), env_options_of(self.env), self.trained)
        result = evaluate(
            policy,
            self.scenario,
            scheme=self.env.simulation.scheme,
            runs=self.eval_runs,
            first_seed=VALIDATION_SEED,
            dt=self.env.simulation.dt,
            decision_dt=self.env.decision_dt,
        )
        row = self._row(result)
        best_before = min(map(score, self.curve), default=(np.inf, np.inf))
        self.curve.append(row)
        for name, value in row.items():
            self.logger.record(f"eval/{name}", value)
        self.logger.dump(self.model.num_timesteps)
        write_checkpoint(self.folder / "checkpoint.pt", self.model)
        if score(row) < best_before:
            policy.save(self.folder / "best.npz")
        write_curve(self.folder / "learning_curve.csv", self.curve)
        if not self._progress.console.is_terminal:  # no bar there: say the same in lines
            text = f"{row['steps']:.0f} of {self.total_steps} steps, {self.seconds:.0f} s: evacuation"
            spread = f"± {row['standard_error']:.2f} (standard error)"
            left = f"{row['unfinished']:.0f} left inside"
            self._progress.console.print(f"{text} {row['evacuation_time']:.2f} {spread} s, {left}", highlight=False)

    def _row(self, result: Evaluation) -> dict[str, float]:
        times = last_times(result)
        values = (
            self.model.num_timesteps,
            self.seconds,
            times.mean(),
            times.std(ddof=1) / np.sqrt(len(times)) if len(times) > 1 else np.nan,
            result.column("unfinished").sum(),
            result.column("contact_impulse").mean(),
            np.mean(self._returns) if self._returns else np.nan,
            len(self._returns),
        )
        self._returns.clear()
        return dict(zip(CURVE_COLUMNS, map(float, values), strict=True))


def env_options_of(env: CrowdEnv) -> dict[str, Any]:
    """Return what a policy trained in ``env`` must know of it."""
    return {"frame": env.frame, "action": env.action_kind, "observation": env.layout}


def score(row: dict[str, float]) -> tuple[float, float]:
    """Fewer people left behind first, then sooner out."""
    return row["unfinished"], row["evacuation_time"]


def write_curve(path: Path, curve: list[dict[str, float]]) -> None:
    """Write the learning curve as CSV, whole or not at all."""
    text = io.StringIO()
    writer = csv.DictWriter(text, CURVE_COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(curve)
    write_text(path, text.getvalue())


def read_curve(path: Path) -> list[dict[str, float]]:
    """Read what `write_curve` wrote; no file is an empty curve.

    Raises
    ------
    ValueError
        If the file has other columns, or something in it is no number.
    """
    if not path.exists():
        return []
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        if not rows or tuple(rows[0]) != CURVE_COLUMNS:
            raise ValueError(f"its columns must be {', '.join(CURVE_COLUMNS)}")
        return [{name: float(row[name]) for name in CURVE_COLUMNS} for row in rows]
    except (OSError, ValueError, TypeError, csv.Error) as error:
        raise ValueError(f"cannot go on from {path}: {error}") from None
