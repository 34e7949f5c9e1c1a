"""A shipped policy moves a crowd in the PettingZoo environment: python -m examples.shipped_policy (from the checkout).

The policy decides for everyone at once, one row an agent; it was trained on the observations that its `env_options` name.
"""

import numpy as np

import crowd_env
from crowd_env import agents
from crowd_env.agents.tasks import make_task
from crowd_env.envs.settings import arguments_of


def main(people: int = 100, seed: int = 1_000_000) -> float:
    """Return when the last one of so many people is out of the competitive door [s]."""
    task, policy = make_task("competitive-door"), agents.load("competitive-door/ppo")
    env = crowd_env.parallel_env(task.place(people), **{**task.arguments(), **arguments_of(policy.env_options)})
    rng, layout = np.random.default_rng(seed), policy.env_options["observation"]
    observations, infos = env.reset(seed=seed)
    while env.agents:
        rows = np.array([observations[agent] for agent in env.agents])
        actions = policy.act(rows, layout, rng)
        observations, _, _, _, infos = env.step(dict(zip(env.agents, actions, strict=True)))
    return float(next(iter(infos.values()))["metrics"]["evacuation_time"])


if __name__ == "__main__":
    print(f"the last one is out after {main():.1f} s")
