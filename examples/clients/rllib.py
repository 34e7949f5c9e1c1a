"""RLlib: PPO with one network that all pedestrians share, on dictionaries; see docs/ray.md for the quick way.

In an environment of its own, because Ray pins Gymnasium: pip install 'crowd-env[ray]'
"""

import ray
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from ray.rllib.env.wrappers.pettingzoo_env import ParallelPettingZooEnv
from ray.tune.registry import register_env

import crowd_env


def make_env(options):
    """Return a room in which every pedestrian is an agent of RLlib; those who get out leave."""
    return ParallelPettingZooEnv(crowd_env.parallel_env("room-v0", time_limit=20.0, **options))


def main(iterations=2, runners=1):
    """Train a little and return the mean return of an episode, over all pedestrians, after each iteration."""
    register_env("crowd", make_env)
    config = (
        PPOConfig()
        .environment("crowd", env_config={"scheme": "nsm2"})
        .multi_agent(policies={"everyone"}, policy_mapping_fn=lambda agent, episode: "everyone")
        .rl_module(rl_module_spec=RLModuleSpec(model_config={"fcnet_hiddens": [64, 64], "vf_share_layers": False}))
        .env_runners(num_env_runners=runners)
        # Counted in steps of the room; each is one of everybody inside.
        .training(train_batch_size=200, minibatch_size=128, num_epochs=2, lr=3e-4, gamma=0.97)
        .debugging(seed=0)
    )
    algorithm = config.build_algo()
    returns = [algorithm.train()["env_runners"].get("episode_return_mean") for _ in range(iterations)]
    algorithm.stop()
    return returns


if __name__ == "__main__":
    ray.init(num_cpus=2, include_dashboard=False)
    print(main())
