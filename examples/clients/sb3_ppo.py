"""stable-baselines3: python examples/clients/sb3_ppo.py --steps 1500000

`CrowdVecEnv` shows every pedestrian of a batch as one sub-environment, so that one policy is shared by all; its timesteps count
every slot, also those of people who have left.  `MaskedRolloutBuffer` keeps these out of the loss.
"""

from typing import Annotated

import torch
import typer
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecMonitor

from crowd_env import CrowdEnv
from crowd_env.envs.adapters.sb3 import CrowdVecEnv, MaskedRolloutBuffer

# 30 people and a door that passes one at a time: if everybody presses, they block it; who waits for a turn gets out sooner.
ROOM = {
    "scenario": {"name": "room-v0", "door_width": 0.6},
    "people": 30,
    "time_limit": 40.0,
    "action": "speeds",  # a choice among five speeds along the way out
    "reward": {"weights": {"progress": 0.5, "time": 1.0, "contact": 1.0}},
}


def make_model(rooms: int, seed: int) -> PPO:
    torch.set_num_threads(1)  # for networks this small a second thread costs more than it brings
    env = CrowdEnv(**ROOM, num_envs=rooms, autoreset=True)
    model = PPO(
        "MlpPolicy",
        VecMonitor(CrowdVecEnv(env), info_keywords=("steps_inside", "is_success")),
        rollout_buffer_class=MaskedRolloutBuffer,
        n_steps=64,
        batch_size=rooms * 128,
        n_epochs=4,
        gamma=0.98,  # per decision step of 0.1 s
        learning_rate=1e-3,
        ent_coef=0.003,
        seed=seed,
        device="cpu",
    )
    with torch.no_grad():  # at first "full speed along the way out", the rule, is the likeliest choice
        model.policy.action_net.bias[env.action_kind.neutral] += 2.0
    return model


def judge(model: PPO | None, draws: int = 20) -> str:
    """Return how a model does in rooms not seen in training; without one everybody walks the shortest path at full speed."""
    env = CrowdEnv(**ROOM, num_envs=draws)
    observation, _ = env.reset(seed=list(range(1_000_000, 1_000_000 + draws)))
    seconds = 0.0
    while not env.finished.all():
        seconds += env.active.mean() * env.decision_dt
        observation = env.step(None if model is None else model.predict(observation, deterministic=True)[0]).observation
    stuck = sum(env.metrics(e).unfinished for e in range(draws))
    return f"{seconds:.2f} s inside per person, {stuck} of {env.num_people} people still inside at the end"


def main(steps: Annotated[int, typer.Option(min=1)] = 1_500_000, seed: Annotated[int, typer.Option(min=0)] = 0) -> PPO:
    """Train for this many steps of single slots."""
    model = make_model(rooms=16, seed=seed)
    model.learn(steps, log_interval=5)
    print(f"rule:    {judge(None)}\nlearned: {judge(model)}")
    return model


if __name__ == "__main__":
    typer.run(main)
