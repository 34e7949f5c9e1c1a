"""A learned controller for ``crowd_env/Routing-v0``: stock PPO of stable-baselines3, and what watches over its training."""

import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from agents.evaluation.comparison import last_times, mean_times
from agents.evaluation.routing import evaluate_controller
from agents.learned.export import network_of
from agents.learned.rate import FallingRate
from agents.trained import LearnedController
from crowd_env.adapters.vec_env import VectorVecEnv
from crowd_env.envs.routing.env import RoutingVectorEnv
from crowd_env.files.json_file import write_json

# Draws on which the best controller is chosen: neither trained on nor used for the final table.
VALIDATION_SEED = 2_000_000
# Others, on which the best few are judged again: the best of many judgements of few draws owes part of that to luck.
FINAL_SEED = 3_000_000
_FINALISTS = 3


@dataclass(frozen=True)
class RoutingSettings:
    """Hyperparameters, a line each."""

    learning_rate: float = 1e-3  # falls linearly to zero over steps and time, whichever is further
    n_steps: int = 32  # decisions per rollout and evacuation
    batch_size: int = 256
    n_epochs: int = 8
    gamma: float = 0.99
    gae_lambda: float = 0.95
    ent_coef: float = 0.003
    target_kl: float = 0.03
    hidden: int = 64  # units in each of two layers
    nearest_logit: float = 2.0  # head start of the nearest exit: learning begins at the rule, not at chaos


def make_routing_ppo(env: RoutingVectorEnv, settings: RoutingSettings, seed: int) -> PPO:
    """Return an untrained PPO model whose first choice in every region is the exit nearest to its center."""
    torch.set_num_threads(1)  # the networks are small: a second thread costs more than it brings
    model = PPO(
        "MlpPolicy",
        VectorVecEnv(env),
        learning_rate=FallingRate(settings.learning_rate),
        n_steps=settings.n_steps,
        batch_size=min(settings.batch_size, settings.n_steps * env.num_envs),
        n_epochs=settings.n_epochs,
        gamma=settings.gamma,
        gae_lambda=settings.gae_lambda,
        ent_coef=settings.ent_coef,
        target_kl=settings.target_kl,
        policy_kwargs={"net_arch": [settings.hidden] * 2},
        seed=seed,
        device="cpu",
    )
    batch = env.batch
    names = [name for name in batch.layout.routes if name in batch.layout.exits]
    if names:
        routes = [batch.layout.routes.index(name) for name in names]
        route_set = batch.env.route_set[0]
        nearest = route_set.nearest(names, batch.regions.center)
        numbers = [route_set.number(name) for name in names]
        with torch.no_grad():
            bias = cast(torch.nn.Linear, model.policy.action_net).bias
            for region, way in enumerate(nearest):
                bias[region * len(batch.layout.routes) + routes[numbers.index(way)]] += settings.nearest_logit
    return model


class Watch(BaseCallback):
    """Judges the controller on validation draws now and then, keeps the best, shows a bar, stops in time.

    Parameters
    ----------
    folder : where ``best.npz`` and ``learning_curve.json`` go.
    options : scenario and options of the environment.
    max_seconds : training stops after so long.
    eval_every, eval_runs : decisions between judgements, evacuations in each.
    final_runs : evacuations in which the best few are judged again when training has ended.
    """

    def __init__(
        self,
        folder: Path,
        options: dict[str, Any],
        *,
        max_seconds: float,
        eval_every: int = 8192,
        eval_runs: int = 50,
        final_runs: int = 500,
    ) -> None:
        super().__init__()
        self.folder, self.options, self.max_seconds = folder, options, max_seconds
        self.eval_every, self.eval_runs, self.final_runs = eval_every, eval_runs, final_runs
        self.curve: list[dict[str, float]] = []
        self.finalists: list[dict[str, float]] = []
        self._kept: list[tuple[dict[str, float], LearnedController]] = []
        self._progress = Progress(
            TextColumn("training"),
            BarColumn(),
            TextColumn("{task.percentage:3.0f} % {task.fields[told]}"),
            TimeElapsedColumn(),
            console=Console(stderr=True),
        )

    @property
    def best(self) -> dict[str, float] | None:
        """The row of the best controller so far; None before the first is judged."""
        return min(self.finalists or self.curve, key=_score, default=None)

    def _on_training_start(self) -> None:
        self._begin = time.monotonic()
        self._next = self.eval_every
        self._task = self._progress.add_task("", total=1.0, told="")
        self._progress.start()
        self._judge()

    def _on_step(self) -> bool:
        return time.monotonic() - self._begin < self.max_seconds

    def _on_rollout_end(self) -> None:
        seconds = time.monotonic() - self._begin
        steps = self.num_timesteps
        cast(FallingRate, self.model.learning_rate).time_spent = seconds / self.max_seconds
        best = min(self.curve, key=_score)
        told = f"{steps / seconds:.0f} decisions/s, best {best['last']:.2f} s (mean {best['mean']:.2f} s)"
        done = max(seconds / self.max_seconds, 1.0 - self.model._current_progress_remaining)
        self._progress.update(self._task, completed=min(done, 1.0), told=told)

    def _on_rollout_start(self) -> None:
        if self.num_timesteps >= self._next:
            self._next = self.num_timesteps + self.eval_every
            self._judge()

    def _on_training_end(self) -> None:
        self._judge()
        self.stop()

    def stop(self) -> None:
        """Take the bar away."""
        self._progress.stop()

    def _judge(self) -> None:
        model = cast(PPO, self.model)
        controller = LearnedController(network_of(model), cast(Any, model.action_space).nvec, self.options)
        row = {"steps": float(self.num_timesteps), "seconds": time.monotonic() - self._begin}
        self.curve.append(row | self._figures(controller, self.eval_runs, VALIDATION_SEED))
        row = self.curve[-1]
        self._kept = sorted([*self._kept, (row, controller)], key=lambda one: _score(one[0]))[:_FINALISTS]
        if self.best is row:
            controller.save(self.folder / "best.npz")
        write_json(self.folder / "learning_curve.json", self.curve)
        if not self._progress.console.is_terminal:  # no bar there: say the same in lines
            text = f"{row['steps']:.0f} decisions, {row['seconds']:.0f} s: last {row['last']:.2f} s"
            self._progress.console.print(f"{text}, mean {row['mean']:.2f} s", highlight=False)

    def choose(self) -> None:
        """Judge the best few on more draws, on which none was chosen, and keep the best of these."""
        if len(self._kept) < 2:
            return
        told = f"judging the best {len(self._kept)} again, {self.final_runs} other validation draws each"
        self._progress.console.print(told, highlight=False)
        found = []
        for row, controller in self._kept:
            figures = self._figures(controller, self.final_runs, FINAL_SEED)
            found.append(({"steps": row["steps"], "seconds": row["seconds"], **figures}, controller))
        self.finalists = [row for row, _ in found]
        min(found, key=lambda one: _score(one[0]))[1].save(self.folder / "best.npz")

    def _figures(self, controller: LearnedController, runs: int, first_seed: int) -> dict[str, float]:
        """Return mean times [s] over all people and draws, who is left inside counted until the end, and standard error."""
        judged = evaluate_controller(controller, runs=runs, first_seed=first_seed, **self.options)
        last, mean = last_times(judged), mean_times(judged)
        return {
            "last": float(last.mean()),
            "mean": float(mean.mean()),
            "standard_error": float(last.std(ddof=min(1, runs - 1)) / np.sqrt(runs)),
            "runs": float(runs),
            "unfinished": float(judged.column("unfinished").sum()),
        }


def _score(row: dict[str, float]) -> tuple[float, float]:
    """Fewest left inside first, then the highest return."""
    return row["unfinished"] / row["runs"], row["last"] + row["mean"]


def train_controller(
    folder: Path, options: dict[str, Any], *, envs: int, steps: int, seconds: float, seed: int, **watch: Any
) -> dict[str, Any]:
    """Train until ``steps`` decisions are made or ``seconds`` have passed, and choose the best controller.

    Returns
    -------
    ``ppo`` (settings), ``curve``, ``finalists``, ``best`` (a row of these; None if none was judged), and ``interrupted``:
    whether Ctrl-C ended it; then ``best.npz`` is the best so far.
    """
    settings = RoutingSettings()
    env = RoutingVectorEnv(num_envs=envs, **options)
    model = make_routing_ppo(env, settings, seed)
    companion = Watch(folder, options, max_seconds=seconds, **watch)
    interrupted = False
    try:
        model.learn(steps, callback=companion)
        companion.choose()
    except KeyboardInterrupt:
        interrupted = True
    finally:
        companion.stop()
    rows = {"curve": companion.curve, "finalists": companion.finalists, "best": companion.best}
    return {"ppo": asdict(settings), **rows, "interrupted": interrupted}
