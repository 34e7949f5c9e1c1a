"""What accompanies the training of a shared policy: its learning curve, its checkpoints, a clean stop."""

import csv
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from crowd_env import CrowdEnv, Scenario
from crowd_env.core.console import notes, stops_by
from crowd_env.core.files.csv_table import write_csv

from ..evaluation.comparison import last_times
from ..evaluation.evaluation import VALIDATION_SEED, Evaluation, evaluate
from ..trained import LearnedPolicy
from .callback import TrainingCallback
from .checkpoint import write_checkpoint
from .export import network_of, spread_of

START = "start.safetensors"  # the network that training began with

# evacuation_time and its standard error are over all validation draws, people left inside count as in
# `Evaluation.times_of_all`; reward is the mean return of the episodes that ended since the row before.
CURVE_COLUMNS = (
    "steps",
    "seconds",
    "cpu_seconds",
    "evacuation_time",
    "standard_error",
    "unfinished",
    "contact_impulse",
    "reward",
    "episodes",
)


class PolicyCallback(TrainingCallback):
    """Accompanies the training of a policy that everyone shares.

    Every ``eval_every`` steps it evaluates the mean action on validation draws, writes the learning curve, the checkpoint and,
    if it is the best so far, ``best.safetensors``; the first is ``start.safetensors`` too.  Training stops when ``max_seconds``
    have passed or at the first Ctrl-C or SIGTERM; a second one stops at once.

    Parameters
    ----------
    env : what is trained in.
    scenario : what is evaluated.
    judged : options of `crowd_env.agents.evaluation.evaluation.evaluate`: scheme, steps, strategy, manner, outline.
    trained : facts about the training, for the files of the networks.
    options : of `TrainingCallback`.
    """

    def __init__(
        self,
        folder: Path,
        env: CrowdEnv,
        scenario: Scenario,
        judged: dict[str, Any],
        *,
        trained: dict[str, Any] | None = None,
        **options: Any,
    ) -> None:
        super().__init__(folder, **options)
        self.env, self.scenario, self.judged, self.trained = env, scenario, judged, trained or {}
        self.interrupted = False
        self._returns: list[float] = []
        self._signals = ExitStack()

    def _on_training_start(self) -> None:
        self._signals.enter_context(stops_by(self._interrupt))
        super()._on_training_start()

    def close(self) -> None:
        """Take the bar away and handle signals as before; also after an error."""
        super().close()
        self._signals.close()

    def _interrupt(self, number: int, frame: FrameType | None) -> None:
        if self.interrupted:
            raise KeyboardInterrupt
        self.interrupted = True
        notes.print("stopping: saving what there is (Ctrl-C again stops at once)")

    def _on_step(self) -> bool:
        infos = self.locals["infos"]
        self._returns.extend(infos[slot]["episode"]["r"] for slot in np.flatnonzero(self.locals["dones"]))
        return super()._on_step() and not self.interrupted

    def _on_rollout_end(self) -> None:
        super()._on_rollout_end()
        if self.num_timesteps < self.model._total_timesteps and self._due():  # the end is evaluated anyway
            self._evaluate()

    def _figures(self) -> str:
        best = min((row["evacuation_time"] for row in self.curve if row["unfinished"] == 0), default=float("nan"))
        return f"{self.rate / 1000:.0f}k steps/s, best {best:.2f} s"

    def _evaluate(self) -> None:
        policy = LearnedPolicy(network_of(self.model), env_options_of(self.env), self.trained, spread_of(self.model))
        result = evaluate(policy, self.scenario, runs=self.eval_runs, first_seed=VALIDATION_SEED, **self.judged)
        spent = {"steps": self.model.num_timesteps, "seconds": self.seconds, "cpu_seconds": self.cpu_seconds}
        row = curve_row(result, spent, self._returns)
        self._returns.clear()
        best_before = min(map(score, self.curve), default=(np.inf, np.inf))
        self.curve.append(row)
        for name, value in row.items():
            self.logger.record(f"eval/{name}", value)
        self.logger.dump(self.num_timesteps)
        write_checkpoint(self.folder / "checkpoint.pt", self.model)
        if len(self.curve) == 1:
            policy.save(self.folder / START)
        if score(row) < best_before:
            policy.save(self.folder / "best.safetensors")
        write_curve(self.folder / "learning_curve.csv", self.curve)
        self._note(curve_line(row, self.model._total_timesteps))


def curve_row(result: Evaluation, spent: Mapping[str, float], returns: Sequence[float]) -> dict[str, float]:
    """Return the row of a learning curve: an evaluation, what was spent by then, and returns of episodes since."""
    times = last_times(result)
    values = {
        **spent,
        "evacuation_time": times.mean(),
        "standard_error": times.std(ddof=1) / np.sqrt(len(times)) if len(times) > 1 else np.nan,
        "unfinished": result.column("unfinished").sum(),
        "contact_impulse": result.column("contact_impulse").mean(),
        "reward": np.mean(returns) if len(returns) else np.nan,
        "episodes": len(returns),
    }
    return {name: float(values[name]) for name in CURVE_COLUMNS}


def curve_line(row: Mapping[str, float], steps: float) -> str:
    """Return a row of a learning curve in words, for a training of so many steps."""
    return (
        f"{row['steps']:.0f} of {steps} steps, {row['seconds']:.0f} s: evacuation {row['evacuation_time']:.2f} ± "
        f"{row['standard_error']:.2f} (standard error) s, {row['unfinished']:.0f} left inside"
    )


def env_options_of(env: CrowdEnv) -> dict[str, Any]:
    """Return what a policy trained in ``env`` must know of it."""
    return {"frame": env.action_kind.frame, "action": env.action_kind, "observation": env.layout}


def score(row: dict[str, float]) -> tuple[float, float]:
    """Fewer people left behind first, then sooner out."""
    return row["unfinished"], row["evacuation_time"]


def write_curve(path: Path, curve: list[dict[str, float]]) -> None:
    """Write the learning curve as CSV, whole or not at all."""
    write_csv(path, CURVE_COLUMNS, ([row[name] for name in CURVE_COLUMNS] for row in curve))


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
