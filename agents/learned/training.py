"""The training loop's companion: progress, periodic evaluation, checkpoints, a clean stop."""

import csv
import io
import signal
import time
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from stable_baselines3.common.callbacks import BaseCallback

from agents.evaluation import Evaluation, evaluate
from agents.learned.policy import LearnedPolicy, env_options_of
from agents.runs import write_text
from crowd_env import CrowdEnv, Scenario

# Draws on which the best network is chosen: neither trained on nor used for the final table.
VALIDATION_SEED = 2_000_000
CURVE_COLUMNS = ("steps", "seconds", "evacuation_time", "unfinished", "contact_impulse", "reward")


class Companion(BaseCallback):
    """Watches over one training run.

    Every ``eval_every`` steps it evaluates the mean action on validation draws, writes the learning curve, the checkpoint and,
    if it is the best so far, ``best.zip``.  Training stops when ``max_seconds`` have passed or at the first Ctrl-C; a second
    Ctrl-C stops at once.

    Parameters
    ----------
    folder : of the run.
    env, scenario, scheme : what is trained in.
    total_steps, max_seconds : budget; whichever is used up first.
    eval_every, eval_runs : steps between evaluations, evacuations in each.
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
        self.curve = curve or []
        self.interrupted = False
        self.out_of_time = False
        self._seconds_before = self.curve[-1]["seconds"] if self.curve else 0.0
        self._rewards: list[float] = []
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
        self._handler: Any = signal.signal(signal.SIGINT, self._interrupt)
        self._task = self._progress.add_task("training", total=1.0, speed="", best="")
        self._progress.start()
        if not self.curve:
            self._evaluate()

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        if self.interrupted:
            raise KeyboardInterrupt
        self.interrupted = True
        self._progress.console.print("stopping: saving what there is (Ctrl-C again stops at once)")

    def _on_step(self) -> bool:
        venv: Any = self.training_env
        if venv.take_finished():
            self._rewards.extend(info["r"] for info in map(lambda i: i.get("episode"), self.locals["infos"]) if info)
        self.out_of_time = self.seconds > self.max_seconds
        return not (self.interrupted or self.out_of_time)

    def _on_rollout_end(self) -> None:
        steps = self.model.num_timesteps
        done = max(steps / self.total_steps, self.seconds / self.max_seconds)
        rate = (steps - self._first_steps) / max(time.monotonic() - self._begin, 1e-9)
        best = min((row["evacuation_time"] for row in self.curve if row["unfinished"] == 0), default=float("nan"))
        self._progress.update(
            self._task, completed=min(done, 1.0), speed=f"{rate / 1000:.0f}k steps/s", best=f"best {best:.2f} s"
        )
        if steps >= self._next_eval:
            self._next_eval = steps + self.eval_every
            self._evaluate()

    def _on_training_end(self) -> None:
        self._evaluate()
        self._progress.update(self._task, completed=1.0)
        self._progress.stop()
        signal.signal(signal.SIGINT, self._handler)

    def _evaluate(self) -> None:
        policy = LearnedPolicy(self.model, env_options_of(self.env))
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
        policy.save(self.folder / "checkpoint.zip")
        if score(row) < best_before:
            policy.save(self.folder / "best.zip")
        write_curve(self.folder / "learning_curve.csv", self.curve)
        if not self._progress.console.is_terminal:  # no bar there: say the same in lines
            text = f"{row['steps']:.0f} of {self.total_steps} steps, {self.seconds:.0f} s: evacuation"
            self._progress.console.print(f"{text} {row['evacuation_time']:.2f} s, {row['unfinished']:.0f} unfinished")

    def _row(self, result: Evaluation) -> dict[str, float]:
        reward = float(np.mean(self._rewards)) if self._rewards else float("nan")
        self._rewards.clear()
        # Whoever did not get out is counted as if at the time limit, so that the curve stays comparable.
        times = np.where(np.isfinite(result.column("evacuation_time")), result.column("evacuation_time"), self._limit)
        values = (
            self.model.num_timesteps,
            self.seconds,
            float(times.mean()),
            float(result.column("unfinished").sum()),
            float(result.column("contact_impulse").mean()),
            reward,
        )
        return dict(zip(CURVE_COLUMNS, map(float, values), strict=True))

    @property
    def _limit(self) -> float:
        return self.scenario.time_limit


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
    """Read what `write_curve` wrote; no file is an empty curve."""
    if not path.exists():
        return []
    with path.open(newline="") as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]
