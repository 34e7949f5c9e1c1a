"""RLlib: python examples/clients/rllib_ppo.py --iterations 5

Each pedestrian is an agent of RLlib; those who get out leave, which it understands as it is.  One network serves everybody.
Dictionaries cost more than the physics here: `python train.py --backend rllib` steps whole batches instead.
"""

from typing import Annotated, Any

import ray
import typer
from ray.rllib.algorithms.ppo import PPO, PPOConfig
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.rllib.env.wrappers.pettingzoo_env import ParallelPettingZooEnv
from ray.tune.registry import register_env

from crowd_env import parallel_env

ROOM = {
    "scenario": "room-v0",
    "people": 12,
    "time_limit": 20.0,
    "action": "speeds",  # a choice among five speeds along the way out
}
NAME, EVERYBODY = "crowd", "everybody"
ROLLOUT = 200  # decision steps of the room between two updates


def make_room(options: dict[str, Any]) -> ParallelPettingZooEnv:
    return ParallelPettingZooEnv(parallel_env(**options))


def make_algorithm(runners: int = 1, seed: int = 0) -> PPO:
    """Return PPO whose rooms are stepped by so many processes."""
    register_env(NAME, make_room)
    config = (
        PPOConfig()
        .environment(NAME, env_config=dict(ROOM), disable_env_checking=True)
        .multi_agent(policies={EVERYBODY}, policy_mapping_fn=lambda agent, episode, **_: EVERYBODY)
        .rl_module(model_config=DefaultModelConfig(fcnet_hiddens=[64, 64], vf_share_layers=False))
        .env_runners(num_env_runners=runners)
        # Batches are counted in steps of the room, minibatches in those of people, of which each of these is many.
        .training(
            train_batch_size=ROLLOUT, minibatch_size=ROLLOUT, num_epochs=4, lr=1e-3, gamma=0.98, entropy_coeff=0.003
        )
        .debugging(seed=seed)
    )
    return config.build_algo()


def main(
    iterations: Annotated[int, typer.Option(min=1)] = 5,
    runners: Annotated[int, typer.Option(min=0)] = 1,
    seed: Annotated[int, typer.Option(min=0)] = 0,
) -> None:
    """Train for so many updates."""
    ray.init(include_dashboard=False)
    algorithm = make_algorithm(runners, seed)
    for _ in range(iterations):
        found = algorithm.train()["env_runners"]
        print(
            f"{found['num_agent_steps_sampled_lifetime']}: mean return {found.get('episode_return_mean', float('nan')):.2f}"
        )
    algorithm.stop()
    ray.shutdown()


if __name__ == "__main__":
    typer.run(main)
