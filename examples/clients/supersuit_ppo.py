"""SuperSuit: python examples/clients/supersuit_ppo.py --steps 40000

`black_death_v3` comes first, since the wrappers behind it expect every agent until the end.  It hides that people leave one by
one: who is out goes on as a row of zeros that earns nothing, and all rows end together with the last person.  The rows of
zeros are in the loss; `CrowdVecEnv` with `MaskedRolloutBuffer`, see sb3_ppo.py, has none of this.
"""

from typing import Annotated

import supersuit
import torch
import typer
from stable_baselines3 import PPO
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import VecEnv, VecMonitor

from crowd_env import parallel_env

ROOM = {"scenario": "room-v0", "people": 12, "time_limit": 20.0, "action": "speeds"}


def make_venv(rooms: int, seed: int) -> VecEnv:
    """Return a VecEnv of a row for each pedestrian of each room."""
    everyone = supersuit.black_death_v3(parallel_env(**ROOM))
    rows = supersuit.pettingzoo_env_to_vec_env_v1(everyone)
    venv = supersuit.concat_vec_envs_v1(rows, rooms, num_cpus=1, base_class="stable_baselines3")
    venv.venv.reset(seed=seed)  # stable-baselines3 cannot seed it: later resets go on drawing from this seed
    return VecMonitor(venv)


def main(steps: Annotated[int, typer.Option(min=1)] = 40_000, seed: Annotated[int, typer.Option(min=0)] = 0) -> PPO:
    """Train for this many steps of single rows, also those of people who have left."""
    torch.set_num_threads(1)  # for networks this small a second thread costs more than it brings
    set_random_seed(seed)  # not `PPO(seed=...)`, which would seed the environment too
    options = {"n_steps": 64, "batch_size": 768, "n_epochs": 4, "gamma": 0.98, "learning_rate": 1e-3}
    model = PPO("MlpPolicy", make_venv(4, seed), device="cpu", verbose=1, **options)
    return model.learn(steps, log_interval=5)


if __name__ == "__main__":
    typer.run(main)
