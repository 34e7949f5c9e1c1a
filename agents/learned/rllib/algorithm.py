"""RLlib's PPO with the network, start, hyperparameters and number of rooms of the native training."""

from collections.abc import Mapping
from pathlib import Path
from typing import cast

import gymnasium
import numpy as np
import torch
from ray.rllib.algorithms.ppo import PPO, PPOConfig
from ray.rllib.core.learner.learner import Learner
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig

from crowd_env.envs.protocol import CrowdBatch, WalkingBatch

from ...evaluation.entries import RULE
from ...networks import MLP
from ...training_config import PPOSettings, TrainingConfig, make_env
from ..actor_critic import network_of
from ..ppo import make_ppo
from ..starts import begin
from .runner import CrowdEnvRunner

_MODULE = "default_policy"
_RESTART_AFTER = 5.0  # s  from the failure of a runner to the next try to restart it, here or on another node
_ANSWER = 2.0  # s  within which a restarted runner must answer; the algorithm probes it before every update
# Layers of the policy in RLlib's network for PPO, and the logarithms of standard deviations of a Gaussian.
_LAYERS = ("encoder.actor_encoder.net.mlp.0", "encoder.actor_encoder.net.mlp.2", "pi.net.mlp.0")
_LOG_STD = "pi.log_std"
_ACTIVATION = "relu"  # of the native network


def make_algorithm(config: TrainingConfig, runners: int) -> PPO:
    """Return an untrained algorithm with environments on ``runners`` processes.

    A failed runner restarts, on another node if its own is gone; meanwhile the others continue without it.
    """
    settings = config.ppo
    torch.set_num_threads(1)  # a second thread costs more than it saves in a small network
    rooms = -(-config.envs // runners)
    env = cast(WalkingBatch, make_env(config, envs=1))
    # At most a quarter of the slots of a round: that many pedestrians are inside, and RLlib requests no second round.
    size = min(settings.batch_size, -(-settings.n_steps * rooms * runners * env.num_people // 4))
    spaces = {"observation_space": env.single_observation_space, "action_space": env.single_action_space}
    return (
        PPOConfig()
        .environment("crowds", env_config={"run": config, "envs": rooms}, disable_env_checking=True, **spaces)
        .env_runners(
            env_runner_cls=CrowdEnvRunner,
            num_env_runners=runners,
            num_envs_per_env_runner=1,
            rollout_fragment_length="auto",
            num_cpus_per_env_runner=1,
            sample_timeout_s=None,
        )
        .learners(num_learners=0)
        .rl_module(model_config=model_config(env, settings))
        .training(
            lr=settings.learning_rate,
            gamma=settings.gamma,
            lambda_=settings.gae_lambda,
            clip_param=settings.clip_range,
            vf_clip_param=float("inf"),
            vf_loss_coeff=0.5,
            entropy_coeff=settings.ent_coef,
            grad_clip=0.5,
            use_kl_loss=False,
            num_epochs=settings.n_epochs,
            minibatch_size=size,
            train_batch_size_per_learner=size,
            shuffle_batch_per_epoch=True,
        )
        .fault_tolerance(
            restart_failed_env_runners=True,
            ignore_env_runner_failures=False,
            delay_between_env_runner_restarts_s=_RESTART_AFTER,
            max_num_env_runner_restarts=1_000_000,
            env_runner_health_probe_timeout_s=_ANSWER,
        )
        .debugging(seed=config.seed, log_level="ERROR")
        .build_algo()
    )


def model_config(env: CrowdBatch, settings: PPOSettings) -> DefaultModelConfig:
    """Return RLlib's description of the network: the policy of the native one, and separate layers for values."""
    return DefaultModelConfig(
        fcnet_hiddens=[settings.hidden] * 2,
        fcnet_activation=_ACTIVATION,
        vf_share_layers=False,
        free_log_std=isinstance(env.single_action_space, gymnasium.spaces.Box),
    )


def first_policy(config: TrainingConfig, folder: Path, threads: int) -> MLP:
    """Return the policy with which the native training starts."""
    model = make_ppo(make_env(config, envs=1 if config.start == RULE else None), config.ppo, config.seed)
    begin(model, config, folder, threads)
    return network_of(model)


def state_with(state: Mapping[str, np.ndarray], policy: MLP, log_std: float) -> dict[str, np.ndarray]:
    """Return the state of RLlib's network with the layers of a policy, and the ``log_std`` of continuous actions."""
    found = dict(state)
    for layer, arrays in zip(_LAYERS, policy.layers, strict=True):
        found[f"{layer}.weight"], found[f"{layer}.bias"] = (one.astype(np.float32) for one in arrays)
    if _LOG_STD in found:
        found[_LOG_STD] = np.full_like(np.asarray(found[_LOG_STD]), log_std)
    return found


def policy_in(state: Mapping[str, np.ndarray]) -> MLP:
    """Return the policy in the state of RLlib's network, with its most likely actions."""
    weights, biases = ([np.asarray(state[f"{layer}.{name}"]) for layer in _LAYERS] for name in ("weight", "bias"))
    return MLP(tuple(weights), tuple(biases), _ACTIVATION)


def policy_of(algorithm: PPO) -> MLP:
    """Return the present policy."""
    return policy_in(algorithm.learner_group.get_weights(module_ids={_MODULE})[_MODULE])


def begin_with(algorithm: PPO, policy: MLP, log_std: float) -> None:
    """Set the policy of an untrained algorithm, here and in all runners."""
    state = algorithm.learner_group.get_weights(module_ids={_MODULE})
    algorithm.learner_group.set_weights({_MODULE: state_with(state[_MODULE], policy, log_std)})
    algorithm.env_runner_group.sync_weights(from_worker_or_learner_group=algorithm.learner_group, inference_only=True)


def set_rate(algorithm: PPO, rate: float) -> None:
    """Set the learning rate."""

    def change(learner: Learner) -> None:
        for _, optimizer in learner.get_optimizers_for_module(_MODULE):
            learner._set_optimizer_lr(optimizer, rate)

    algorithm.learner_group.foreach_learner(change)
