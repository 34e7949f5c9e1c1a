"""BenchMARL: python examples/clients/benchmarl_mappo.py --iterations 10

The task wraps the environment as for TorchRL, and gives the critic of MAPPO the state of the whole crowd.  BenchMARL has no
mask for people: the rows of those who have left, zeros that earn nothing, stay in its loss.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from benchmarl.algorithms import MappoConfig
from benchmarl.environments.pettingzoo.common import PettingZooClass
from benchmarl.experiment import Experiment, ExperimentConfig
from benchmarl.models.mlp import MlpConfig
from torch import nn
from torchrl.envs import EnvBase
from torchrl.envs.libs.pettingzoo import PettingZooWrapper

from crowd_env import parallel_env

ROOM = {"scenario": "room-v0", "people": 8, "time_limit": 20.0, "action": "speeds"}
GROUP = "pedestrian"


class Evacuation(PettingZooClass):
    """One evacuation; ``config`` holds the options of `crowd_env.parallel_env`."""

    def get_env_fun(
        self, num_envs: int, continuous_actions: bool, seed: int | None, device: Any
    ) -> Callable[[], EnvBase]:
        return lambda: PettingZooWrapper(
            parallel_env(**self.config),
            use_mask=True,  # people leave one by one
            done_on_any=False,  # and the episode goes on until the last one
            return_state=True,
            seed=seed,
            device=device,
        )

    def supports_continuous_actions(self) -> bool:
        return "action" not in self.config

    def supports_discrete_actions(self) -> bool:
        return not self.supports_continuous_actions()

    def has_render(self, env: EnvBase) -> bool:
        return False

    def max_steps(self, env: EnvBase) -> int:
        return env.max_cycles

    @staticmethod
    def env_name() -> str:
        return "crowd_env"


def make_experiment(iterations: int, seed: int, folder: Path) -> Experiment:
    config = ExperimentConfig.get_from_yaml()
    config.max_n_iters, config.max_n_frames = iterations, None
    config.on_policy_collected_frames_per_batch, config.on_policy_n_envs_per_worker = 200, 1
    config.on_policy_minibatch_size, config.on_policy_n_minibatch_iters = 100, 8
    config.lr, config.gamma = 1e-3, 0.98
    config.evaluation, config.render = False, False
    config.loggers, config.create_json, config.save_folder = [], False, str(folder)
    folder.mkdir(parents=True, exist_ok=True)
    net = MlpConfig(num_cells=[64], activation_class=nn.Tanh, layer_class=nn.Linear)
    return Experiment(
        task=Evacuation("room-v0", ROOM),
        algorithm_config=MappoConfig.get_from_yaml(),
        model_config=net,
        critic_model_config=net,
        seed=seed,
        config=config,
    )


def main(
    iterations: Annotated[int, typer.Option(min=1)] = 10,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    folder: Path = Path("runs/benchmarl"),
) -> Experiment:
    """Train for as many rollouts of 200 decision steps."""
    experiment = make_experiment(iterations, seed, folder)
    experiment.run()
    return experiment


if __name__ == "__main__":
    typer.run(main)
