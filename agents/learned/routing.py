"""A learned controller for ``crowd_env/Routing-v0``: stock PPO of stable-baselines3, and how the best one is chosen."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from stable_baselines3 import PPO

from crowd_env.core.console import notes
from crowd_env.core.files.json_file import write_json
from crowd_env.envs.adapters.sb3 import VectorVecEnv
from crowd_env.envs.routing.batch import routing_arguments
from crowd_env.envs.routing.env import RoutingVectorEnv

from ..evaluation.comparison import last_times, mean_times
from ..evaluation.evaluation import FINAL_SEED, VALIDATION_SEED
from ..evaluation.routing import evaluate_controller
from ..trained import LearnedController
from .callback import TrainingCallback
from .export import network_of
from .ppo import PPOSettings, new_ppo

# The best few are evaluated again on other draws: the best of many evaluations on few draws is partly luck.
_FINALISTS = 3


@dataclass(frozen=True)
class RoutingSettings(PPOSettings):
    """Hyperparameters where they differ from those of a policy, and one more."""

    learning_rate: float = 1e-3
    n_steps: int = 32  # decisions per rollout and evacuation
    batch_size: int = 256
    n_epochs: int = 8
    gamma: float = 0.99
    target_kl: float = 0.03
    nearest_logit: float = 2.0  # head start of the nearest exit: learning begins at the rule, not at chaos


def make_routing_ppo(env: RoutingVectorEnv, settings: RoutingSettings, seed: int) -> PPO:
    """Return an untrained PPO model whose first choice in every region is the exit nearest to its center."""
    model = new_ppo(VectorVecEnv(env), settings, seed)
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


class ControllerCallback(TrainingCallback):
    """Accompanies the training of a controller: evaluates it on validation draws, and keeps the best in ``best.safetensors``.

    Parameters
    ----------
    options : scenario and options of the environment.
    final_runs : evacuations in which the best few are evaluated again when training has ended.
    training : parameters of `TrainingCallback`.
    """

    def __init__(self, folder: Path, options: dict[str, Any], *, final_runs: int = 500, **training: Any) -> None:
        super().__init__(folder, **{"eval_every": 8192, "eval_runs": 50, **training})
        self.options, self.final_runs = options, final_runs
        self.finalists: list[dict[str, float]] = []
        self._kept: list[tuple[dict[str, float], LearnedController]] = []

    @property
    def best(self) -> dict[str, float] | None:
        """The row of the best controller so far; None before the first is evaluated."""
        return min(self.finalists or self.curve, key=_score, default=None)

    def _on_rollout_start(self) -> None:
        if self._due():
            self._evaluate()

    def _figures(self) -> str:
        best = min(self.curve, key=_score)
        return f"{self.rate:.0f} decisions/s, best {best['last']:.2f} s (mean {best['mean']:.2f} s)"

    def _evaluate(self) -> None:
        model = cast(PPO, self.model)
        controller = LearnedController(network_of(model), cast(Any, model.action_space).nvec, self.options)
        row = {"steps": float(self.num_timesteps), "seconds": self.seconds, "cpu_seconds": self.cpu_seconds}
        row |= self._evaluated(controller, self.eval_runs, VALIDATION_SEED)
        self.curve.append(row)
        self._kept = sorted([*self._kept, (row, controller)], key=lambda one: _score(one[0]))[:_FINALISTS]
        if self.best is row:
            controller.save(self.folder / "best.safetensors")
        write_json(self.folder / "learning_curve.json", self.curve)
        self._note(
            f"{row['steps']:.0f} decisions, {row['seconds']:.0f} s: last {row['last']:.2f} s, mean {row['mean']:.2f} s"
        )

    def choose(self) -> None:
        """Evaluate the best few on more draws, on which none was chosen, and keep the best of these."""
        if len(self._kept) < 2:
            return
        notes.print(f"evaluating the best {len(self._kept)} again, {self.final_runs} other validation draws each")
        found = []
        for row, controller in self._kept:
            figures = self._evaluated(controller, self.final_runs, FINAL_SEED)
            spent = {name: row[name] for name in ("steps", "seconds", "cpu_seconds")}
            found.append(({**spent, **figures}, controller))
        self.finalists = [row for row, _ in found]
        min(found, key=lambda one: _score(one[0]))[1].save(self.folder / "best.safetensors")

    def _evaluated(self, controller: LearnedController, runs: int, first_seed: int) -> dict[str, float]:
        """Return mean times [s] over all people and draws, people left inside counted until the end, and standard error."""
        result = evaluate_controller(controller, runs=runs, first_seed=first_seed, **self.options)
        last, mean = last_times(result), mean_times(result)
        return {
            "last": float(last.mean()),
            "mean": float(mean.mean()),
            "standard_error": float(last.std(ddof=min(1, runs - 1)) / np.sqrt(runs)),
            "runs": float(runs),
            "unfinished": float(result.column("unfinished").sum()),
        }


def _score(row: dict[str, float]) -> tuple[float, float]:
    """Fewest left inside first, then the highest return."""
    return row["unfinished"] / row["runs"], row["last"] + row["mean"]


def train_controller(
    folder: Path, options: dict[str, Any], *, envs: int, steps: int, seconds: float, seed: int, **training: Any
) -> dict[str, Any]:
    """Train until ``steps`` decisions are made or ``seconds`` have passed, and choose the best controller.

    Returns
    -------
    ``ppo`` (settings), ``curve``, ``finalists``, ``best`` (a row of these; None if none was judged), and ``interrupted``:
    whether Ctrl-C ended it; then ``best.safetensors`` is the best so far.
    """
    settings = RoutingSettings()
    env = RoutingVectorEnv(num_envs=envs, **routing_arguments(**options))
    model = make_routing_ppo(env, settings, seed)
    callback = ControllerCallback(folder, options, max_seconds=seconds, **training)
    interrupted = False
    try:
        model.learn(steps, callback=callback)
        callback.choose()
    except KeyboardInterrupt:
        interrupted = True
    finally:
        callback.close()
    rows = {"curve": callback.curve, "finalists": callback.finalists, "best": callback.best}
    return {"ppo": asdict(settings), **rows, "interrupted": interrupted}
