"""A training run in this process: the network of a config, by stable-baselines3's PPO."""

from pathlib import Path
from typing import Any

from stable_baselines3.common.logger import configure

from crowd_env.core.console import notes

from ..evaluation.entries import RULE
from ..evaluation.evaluation import HELD_OUT_SEED
from ..training_config import facts_of, judged_place, make_env, physics_of, start_of
from .checkpoint import read_checkpoint
from .cloning import clone
from .ppo import PPOSettings, make_ppo
from .training import PolicyCallback, read_curve


def train_here(folder: Path, config: dict[str, Any], threads: int = 1) -> bool:
    """Train, or go on training, in ``folder`` on so many threads; False if it was interrupted."""
    notes.print("compiling the physics (half a minute the first time, cached afterwards) ...")
    env = make_env(config, threads=threads)
    model = make_ppo(env, PPOSettings(**config["ppo"]), config["seed"], folder / "tensorboard")
    curve = read_curve(folder / "learning_curve.csv")
    if curve:
        read_checkpoint(folder / "checkpoint.pt", model)
        # The learning loop resets the environment with the seed of the VecEnv.
        venv: Any = model.get_env()
        venv.seed((config["seed"] + model.num_timesteps) % HELD_OUT_SEED)  # other draws
        notes.print(f"going on at {model.num_timesteps} steps")
    elif config["start"] != RULE:
        notes.print(f"cloning {config['start']}, a fraction of a minute ...")
        clone(model, start_of(config), config["seed"])
    model.set_logger(configure(str(folder / "tensorboard"), ["tensorboard"]))
    callback = PolicyCallback(
        folder,
        env,
        judged_place(config),
        {**physics_of(config), "threads": threads},
        max_seconds=60.0 * config["minutes"],
        eval_every=config["eval_every"],
        eval_runs=config["eval_runs"],
        trained=facts_of(config),
        curve=curve,
    )
    left = config["steps"] - model.num_timesteps
    if left > 0 and (not curve or curve[-1]["seconds"] < 60.0 * config["minutes"]):
        try:
            model.learn(left, callback=callback, reset_num_timesteps=False)
        finally:
            callback.close()
    return not callback.interrupted
