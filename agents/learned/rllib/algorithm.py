"""RLlib's PPO, set up as the native one: the same network, start, hyperparameters and number of rooms."""

from typing import cast

import torch
from ray.rllib.algorithms.ppo import PPO, PPOConfig
from ray.rllib.core.learner.learner import Learner

from crowd_env.envs.protocol import WalkingBatch

from ...networks import MLP
from ...training_config import TrainingConfig, make_env
from .module import model_config, policy_in, state_with
from .runner import CrowdEnvRunner

_MODULE = "default_policy"
_RESTART_AFTER = 5.0  # s  between the failure of a runner and the next try to restart it, here or on another node

_ANSWER = 2.0  # s  within which a runner that has restarted answers; it is asked before every update


def make_algorithm(config: TrainingConfig, runners: int) -> PPO:
    """Return an untrained algorithm whose environments are shared out to ``runners``.

    A runner that fails restarts, on another node if its own is gone; until then the others go on without it.
    """
    settings = config.ppo
    torch.set_num_threads(1)  # the network is small: a second thread costs more than it brings
    rooms = -(-config.envs // runners)
    env = cast(WalkingBatch, make_env(config, envs=1))
    # At most a quarter of the slots of a round: so many people are inside in one, and RLlib asks for no second.
    size = min(settings.batch_size, -(-settings.n_steps * rooms * runners * env.num_people // 4))
    spaces = {"observation_space": env.single_observation_space, "action_space": env.single_action_space}
    options = {"run": config, "envs": rooms}
    return (
        PPOConfig()
        .environment("crowds", env_config=options, disable_env_checking=True, **spaces)
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


def policy_of(algorithm: PPO) -> MLP:
    """Return the network of the policy as it is now."""
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
