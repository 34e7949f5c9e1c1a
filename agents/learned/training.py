"""A training run: stable-baselines3's PPO trains the network of a config and calls an evaluation callback between updates.

It trains policies of pedestrians' steps, and controllers that send pedestrians to exits.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Generic, TypeVar, cast

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import VecEnv

from crowd_env.core.console import say
from crowd_env.core.files.atomic import written
from crowd_env.envs.action import SpeedTable, make_action
from crowd_env.envs.adapters.sb3 import CrowdVecEnv, MaskedRolloutBuffer
from crowd_env.envs.protocol import WalkingBatch
from crowd_env.envs.routing.env import RoutingVectorEnv
from crowd_env.envs.tasks.task import HELD_OUT_SEED

from ..networks import MLP, BetweenMLP, Network
from ..plain import Plain
from ..trained import LearnedController, LearnedPolicy
from ..training_config import PPOSettings, TrainingConfig, facts_of, make_env
from .actor_critic import network_of, std_of
from .callbacks import EvaluationCallback, RunCallback, Trained
from .cloning import DECISIONS, ROUNDS, Expert, clone
from .ppo import FallingRate, make_ppo
from .starts import begin

_CHECKPOINT = "crowd_env checkpoint 1"  # format
_PARTS = {"policy": "policy", "optimizer": "policy.optimizer"}  # name in checkpoints -> name in stable-baselines3
_ENDLESS = 10**12  # steps: the evaluation callback ends the training
Learner = TypeVar("Learner")


def train_here(folder: Path, config: TrainingConfig, threads: int = 1) -> bool:
    """Train, or resume training, in ``folder`` on ``threads`` threads of this machine; False if it was interrupted."""
    say("compiling the physics (half a minute the first time, cached afterwards) ...")
    env = make_env(config, threads=threads)
    model = make_ppo(env, config.ppo, config.seed)
    checkpoint = folder / "checkpoint.pt"

    def keep(row: dict[str, float]) -> None:
        write_checkpoint(checkpoint, model)
        for name, value in row.items():
            model.logger.record(f"eval/{name}", value)
        model.logger.dump(model.num_timesteps)

    def policy() -> Trained:
        return trained_in(env, network_of(model), config, std_of(model))

    callback = RunCallback(folder, config, keep, threads)
    if callback.curve:
        read_checkpoint(checkpoint, model)
        # The learning loop resets the environment with the seed of the VecEnv.
        cast(VecEnv, model.get_env()).seed((config.seed + model.num_timesteps) % HELD_OUT_SEED)  # other draws
        say(f"going on at {model.num_timesteps} steps")
    else:
        begin(model, config, folder, threads, callback.on_search)
    model.set_logger(configure(str(folder / "tensorboard"), ["tensorboard"]))
    if not (callback.curve and callback.over):
        with callback.running():
            updates = _Updates(callback, policy)
            model.learn(config.steps - model.num_timesteps, callback=updates, reset_num_timesteps=False)
            callback.on_end(model.num_timesteps, policy)
    return not callback.interrupted


def write_checkpoint(path: Path, model: PPO) -> None:
    """Write weights, state of the optimizer, and steps, from which training is resumed, whole or not at all."""
    parameters = model.get_parameters()
    content = {name: parameters[part] for name, part in _PARTS.items()}
    with written(path) as file:
        torch.save({"format": _CHECKPOINT, **content, "steps": model.num_timesteps}, file)


def read_checkpoint(path: Path, model: PPO) -> None:
    """Load a checkpoint into a model of the same network.  A file that holds more than numbers is refused.

    Raises
    ------
    ValueError
        If the file is missing, damaged, or of another network.
    """
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
        if content["format"] != _CHECKPOINT:
            raise ValueError(f"its format is {content['format']!r}")
        model.set_parameters({part: content[name] for name, part in _PARTS.items()}, device="cpu")
        model.num_timesteps = int(content["steps"])
    except Exception as error:  # zip, pickle and torch each have errors of their own
        reason = str(error).strip().split("\n")[0]
        raise ValueError(f"{path} is not a checkpoint of this training: {reason}") from None


def train_ppo(
    env: WalkingBatch,
    settings: PPOSettings,
    seed: int,
    callback: EvaluationCallback[LearnedPolicy],
    start: Expert | None = None,
    *,
    central: bool = False,
) -> None:
    """Train by PPO until the ``callback`` ends it; the callback counts decisions of pedestrians inside.

    Parameters
    ----------
    env : made with ``autoreset=True``.
    start : a policy to clone first.  Cloning counts as training, with the decisions of all pedestrians.
    central : train by MAPPO, see `make_ppo`.
    """
    model, decided = make_ppo(env, settings, seed, central=central), 0
    if start is not None:
        clone(model, start, seed)
        decided = ROUNDS * DECISIONS * env.num_people
    updates = _Updates(callback, lambda: LearnedPolicy(network_of(model), env_options_of(env)), decided)
    model.learn(_ENDLESS, callback=updates, reset_num_timesteps=False)


class _Updates(BaseCallback, Generic[Learner]):
    """Calls an evaluation callback between the updates of stable-baselines3.

    Parameters
    ----------
    callback : the evaluation callback.
    policy : returns the present policy.
    decided : earlier decisions of pedestrians inside, if the callback counts these; None = it counts steps of all slots.
    """

    model: PPO

    def __init__(
        self, callback: EvaluationCallback[Learner], policy: Callable[[], Learner], decided: int | None = None
    ) -> None:
        super().__init__()
        self.callback, self.policy, self.decided = callback, policy, decided
        self.goes_on, self.returns = True, list[float]()

    def _on_training_start(self) -> None:
        self._ask()

    def _on_step(self) -> bool:
        self.returns += [self.locals["infos"][row]["episode"]["r"] for row in np.flatnonzero(self.locals["dones"])]
        return self.goes_on and not self.callback.stopped

    def _on_rollout_end(self) -> None:
        buffer = self.model.rollout_buffer
        if self.decided is not None:
            self.decided += int(cast(MaskedRolloutBuffer, buffer).mask.sum())
        for name, value in saturation(buffer, self.model.action_space).items():
            self.logger.record(f"rollout/{name}", value)
        self._ask()

    def _ask(self) -> None:
        steps = self.num_timesteps if self.decided is None else self.decided
        self.goes_on = self.callback.on_update(steps, self.policy, self.returns)
        self.returns = []
        cast(FallingRate, self.model.learning_rate).spent = self.callback.progress


def trained_in(
    env: WalkingBatch | RoutingVectorEnv, network: Network, config: TrainingConfig, std: list[float] | None = None
) -> Trained:
    """Return the policy or controller of a network trained in ``env``; ``std`` is that of a Gaussian action.

    A policy of all places acts between the speeds of its table.
    """
    facts = facts_of(config)
    if isinstance(env, RoutingVectorEnv):
        return LearnedController(network, env.batch.choices, dict(config.routing or {}), facts)
    table, options = env.action_kind.decode, env_options_of(env)
    if config.places is not None and isinstance(network, MLP) and type(table) is SpeedTable:
        network = BetweenMLP(network.weights, network.biases, network.activation, table)
        return LearnedPolicy(network, {**options, "action": make_action("continuous")}, facts)
    return LearnedPolicy(network, options, facts, std)


def policy_of(model: PPO) -> LearnedPolicy:
    """Return what a model has learned in a `CrowdVecEnv`, to be saved, judged and filmed without torch.

    Raises
    ------
    ValueError
        If it was trained elsewhere, or its network has no such file, see `network_of`.
    """
    venv = model.get_env()
    if not isinstance(inner := getattr(venv, "unwrapped", venv), CrowdVecEnv):
        raise ValueError(f"it was trained in a {type(inner).__name__}, not in a CrowdVecEnv")
    return LearnedPolicy(network_of(model), env_options_of(inner.env), spread=std_of(model))


def env_options_of(env: WalkingBatch) -> Plain:
    """Return the options of ``env`` that a policy trained in it keeps."""
    return {"frame": env.action_kind.frame, "action": env.action_kind, "observation": env.layout}


def saturation(buffer: RolloutBuffer, space: gymnasium.Space[np.ndarray]) -> dict[str, float]:
    """Return how far a Gaussian policy exceeds the bounds of its actions; nothing for other spaces than a Box.

    A mean beyond a bound means that the policy no longer explores the other side of the bound.

    Parameters
    ----------
    buffer : a full rollout; with a ``mask``, only the masked samples count.

    Returns
    -------
    ``clipped_share``, the share of actions with a component beyond its bounds, and ``raw_action_<k>``, the mean of each
    component before clipping.
    """
    if not isinstance(space, gymnasium.spaces.Box):
        return {}
    drawn = buffer.actions.reshape(*buffer.actions.shape[:2], -1)
    drawn = drawn[getattr(buffer, "mask", np.ones(drawn.shape[:2], dtype=bool))]
    beyond = (drawn < space.low.ravel()) | (drawn > space.high.ravel())
    means = {f"raw_action_{k}": float(value) for k, value in enumerate(drawn.mean(axis=0))}
    return {"clipped_share": float(beyond.any(axis=1).mean()), **means}
