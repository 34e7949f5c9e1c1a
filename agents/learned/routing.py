"""A learned controller for ``crowd_env/Routing-v0``: stock PPO of stable-baselines3, and what watches over its training."""

import json
import os
import time
import zipfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from agents.routing import judge
from agents.runs import write_json
from crowd_env.adapters.sb3_vector import VectorVecEnv
from crowd_env.routing_batch import RoutingBatch
from crowd_env.routing_env import RoutingVectorEnv

# Draws on which the best controller is chosen: neither trained on nor used for the final table.
VALIDATION_SEED = 2_000_000
# Member of the model's zip file that says what it was trained for.
_SIDECAR = "crowd_env.json"


@dataclass(frozen=True)
class RoutingSettings:
    """Hyperparameters, a line each."""

    learning_rate: float = 1e-3  # falls linearly to zero over the steps
    n_steps: int = 32  # decisions per rollout and evacuation
    batch_size: int = 256
    n_epochs: int = 8
    gamma: float = 0.99
    gae_lambda: float = 0.95
    ent_coef: float = 0.003
    target_kl: float = 0.03
    hidden: int = 64  # units in each of two layers
    nearest_logit: float = 2.0  # head start of the nearest exit: learning begins at the rule, not at chaos


class LearnedController:
    """A trained model as a controller; takes the most likely choices.

    Parameters
    ----------
    options : scenario and options of `RoutingVectorEnv` that it was trained with.
    """

    name = "learned"

    def __init__(self, model: PPO, options: dict[str, Any]) -> None:
        self.model = model
        self.options = options

    def act(self, observation: np.ndarray, batch: RoutingBatch, rng: np.random.Generator) -> np.ndarray:
        """Return the most likely choices."""
        action, _ = self.model.predict(observation, deterministic=True)
        return action

    def save(self, path: Path) -> None:
        """Write the model and its options to one zip file, whole or not at all."""
        part = path.with_name(f".{path.name}.part.zip")
        self.model.save(part)
        with zipfile.ZipFile(part, "a") as archive:
            archive.writestr(_SIDECAR, json.dumps(self.options))
        os.replace(part, path)

    @classmethod
    def load(cls, path: Path) -> "LearnedController":
        """Read what `save` wrote.

        Raises
        ------
        ValueError
            If the file is missing or no such model.
        """
        try:
            with zipfile.ZipFile(path) as archive:
                options = json.loads(archive.read(_SIDECAR))
            return cls(PPO.load(path, device="cpu"), options)
        except Exception as error:  # zip, JSON, pickle and torch each have errors of their own
            raise ValueError(f"{path} is not a controller saved by agents.train_routing: {error}") from None


def make_routing_ppo(env: RoutingVectorEnv, settings: RoutingSettings, seed: int) -> PPO:
    """Return an untrained PPO model whose first choice in every region is the exit nearest to its centre."""
    torch.set_num_threads(1)  # the networks are small: a second thread costs more than it brings
    model = PPO(
        "MlpPolicy",
        VectorVecEnv(env),
        learning_rate=lambda remaining: settings.learning_rate * remaining,
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
        ways = batch.env.ways[0]
        nearest = ways.nearest(names, batch.regions.centre)
        numbers = [ways.number(name) for name in names]
        with torch.no_grad():
            bias = cast(torch.nn.Linear, model.policy.action_net).bias
            for region, way in enumerate(nearest):
                bias[region * len(batch.layout.routes) + routes[numbers.index(way)]] += settings.nearest_logit
    return model


class Watch(BaseCallback):
    """Judges the controller on validation draws now and then, keeps the best, shows a bar, stops in time.

    Parameters
    ----------
    folder : where ``best.zip`` and ``learning_curve.json`` go.
    options : scenario and options of the environment.
    max_seconds : training stops after so long.
    eval_every, eval_runs : decisions between judgements, evacuations in each.
    """

    def __init__(
        self, folder: Path, options: dict[str, Any], *, max_seconds: float, eval_every: int = 8192, eval_runs: int = 50
    ) -> None:
        super().__init__()
        self.folder, self.options, self.max_seconds = folder, options, max_seconds
        self.eval_every, self.eval_runs = eval_every, eval_runs
        self.curve: list[dict[str, float]] = []
        self._progress = Progress(
            TextColumn("training"),
            BarColumn(),
            TextColumn("{task.percentage:3.0f} % {task.fields[told]}"),
            TimeElapsedColumn(),
            console=Console(stderr=True),
        )

    @property
    def best(self) -> dict[str, float]:
        """The row of the curve of the best controller so far: fewest left inside, then the highest return."""
        return min(self.curve, key=lambda row: (row["unfinished"], row["last"] + row["mean"]))

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
        best = self.best
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

    def stop(self, why: str = "") -> None:
        """Take the bar away."""
        self._progress.stop()
        if why:
            self._progress.console.print(why)

    def _judge(self) -> None:
        controller = LearnedController(cast(PPO, self.model), self.options)
        judged = judge(controller, runs=self.eval_runs, first_seed=VALIDATION_SEED, **self.options)
        row = {"steps": float(self.num_timesteps), "seconds": time.monotonic() - self._begin}
        row |= {"last": float(judged.last.mean()), "mean": float(judged.mean.mean())}
        self.curve.append({**row, "unfinished": float(judged.unfinished)})
        if self.best is self.curve[-1]:
            controller.save(self.folder / "best.zip")
        write_json(self.folder / "learning_curve.json", self.curve)
        if not self._progress.console.is_terminal:  # no bar there: say the same in lines
            text = f"{row['steps']:.0f} decisions, {row['seconds']:.0f} s: last {row['last']:.2f} s"
            self._progress.console.print(f"{text}, mean {row['mean']:.2f} s", highlight=False)


def train_controller(
    folder: Path, options: dict[str, Any], *, envs: int, steps: int, seconds: float, seed: int, **watch: Any
) -> dict[str, Any]:
    """Train until ``steps`` decisions are made, ``seconds`` have passed or Ctrl-C; return settings and learning curve."""
    settings = RoutingSettings()
    env = RoutingVectorEnv(num_envs=envs, **options)
    model = make_routing_ppo(env, settings, seed)
    companion = Watch(folder, options, max_seconds=seconds, **watch)
    try:
        model.learn(steps, callback=companion)
    except KeyboardInterrupt:
        companion.stop("stopped: going on with the best so far")
    return {"ppo": asdict(settings), "curve": companion.curve, "best": companion.best}
