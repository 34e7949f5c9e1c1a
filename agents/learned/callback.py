"""What accompanies every training: a bar, evaluations now and then of which the best is kept, and a stop in time."""

import time
from abc import abstractmethod
from pathlib import Path
from typing import Any, cast

import gymnasium
import numpy as np
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from stable_baselines3.common.callbacks import BaseCallback

from crowd_env.core.console import notes

from .rate import FallingRate


class TrainingCallback(BaseCallback):
    """Shows how a training gets on, evaluates it at its start and end and whenever it is due, and stops it in time.

    Parameters
    ----------
    folder : of the run, for what is written while it trains.
    max_seconds : training stops after so long.
    eval_every, eval_runs : steps between evaluations, evacuations in each.
    curve : rows of an earlier part of the same run.
    """

    def __init__(
        self,
        folder: Path,
        *,
        max_seconds: float,
        eval_every: int,
        eval_runs: int,
        curve: list[dict[str, float]] | None = None,
    ) -> None:
        super().__init__()
        self.folder, self.max_seconds = folder, max_seconds
        self.eval_every, self.eval_runs = eval_every, eval_runs
        self.curve = curve or []
        self._next_evaluation = 0  # set when training starts
        self._seconds_before = self.curve[-1]["seconds"] if self.curve else 0.0
        self._cpu_before = self.curve[-1]["cpu_seconds"] if self.curve else 0.0
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

    @property
    def seconds(self) -> float:
        """Training time so far [s], earlier parts of the run included."""
        return self._seconds_before + time.monotonic() - self._begin

    @property
    def cpu_seconds(self) -> float:
        """CPU time of training and evaluations so far [s], of all threads and of earlier parts of the run."""
        return self._cpu_before + time.process_time() - self._cpu_begin

    @property
    def rate(self) -> float:
        """Steps per second of this part of the run."""
        return (self.num_timesteps - self._first_steps) / max(time.monotonic() - self._begin, 1e-9)

    @abstractmethod
    def _evaluate(self) -> None:
        """Evaluate the network as it is, append a row to the curve, and keep the network if it is the best so far."""

    @abstractmethod
    def _figures(self) -> str:
        """Return what stands beside the bar."""

    def _due(self) -> bool:
        """Return whether `eval_every` steps have passed since this was last true."""
        due = self.num_timesteps >= self._next_evaluation
        if due:
            self._next_evaluation = self.num_timesteps + self.eval_every
        return due

    def _note(self, text: str) -> None:
        """Say in a line what a bar would show, where there is no terminal for one."""
        if not notes.is_terminal:
            notes.print(text)

    def _on_training_start(self) -> None:
        self._begin, self._first_steps = time.monotonic(), self.model.num_timesteps
        self._cpu_begin = time.process_time()
        self._next_evaluation = self._first_steps + self.eval_every
        self._task = self._bar.add_task("", total=1.0, figures="")
        self._bar.start()
        if not self.curve:
            self._evaluate()

    def _on_step(self) -> bool:
        return self.seconds <= self.max_seconds

    def _on_rollout_end(self) -> None:
        for name, value in saturation(cast(Any, self.model).rollout_buffer, self.model.action_space).items():
            self.logger.record(f"rollout/{name}", value)
        spent = self.seconds / self.max_seconds
        cast(FallingRate, self.model.learning_rate).time_spent = spent
        done = max(spent, self.num_timesteps / self.model._total_timesteps)
        self._bar.update(self._task, completed=min(done, 1.0), figures=self._figures())

    def _on_training_end(self) -> None:
        self._evaluate()
        self.close()

    def close(self) -> None:
        """Take the bar away; also after an error."""
        self._bar.stop()


def saturation(buffer: Any, space: gymnasium.Space[Any]) -> dict[str, float]:
    """Return how far a Gaussian policy runs into the bounds of its actions; nothing of other spaces than a Box.

    A mean beyond the bound says that the policy explores nothing on the other side of it any more.

    Parameters
    ----------
    buffer : a full rollout; of one with a ``mask`` the masked samples alone.

    Returns
    -------
    ``clipped_share``, of the actions of which a component lay beyond its bounds, and ``raw_action_<k>``, the mean of each
    component as it was drawn, before it was clipped.
    """
    if not isinstance(space, gymnasium.spaces.Box):
        return {}
    drawn = buffer.actions.reshape(*buffer.actions.shape[:2], -1)
    drawn = drawn[getattr(buffer, "mask", np.ones(drawn.shape[:2], dtype=np.bool_))]
    beyond = (drawn < space.low.ravel()) | (drawn > space.high.ravel())
    mean = drawn.mean(axis=0)
    return {
        "clipped_share": float(beyond.any(axis=1).mean()),
        **{f"raw_action_{k}": float(value) for k, value in enumerate(mean)},
    }
