"""BenchMARL: python examples/clients/benchmarl_mappo.py --iterations 10 [--task competitive-door]

With a task, the room is the one that the task's preset trains in, and what was learned is judged on held-out draws of the task.
The task wraps the environment as for TorchRL, and gives the critic of MAPPO the state of the whole crowd.  BenchMARL has no
mask for people: the rows of those who have left, zeros that earn nothing, stay in its loss.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
import typer
from benchmarl.algorithms import MappoConfig
from benchmarl.environments.pettingzoo.common import PettingZooClass
from benchmarl.experiment import Experiment, ExperimentConfig
from benchmarl.models.mlp import MlpConfig
from tensordict import TensorDict
from torch import nn
from torchrl.envs import EnvBase
from torchrl.envs.libs.pettingzoo import PettingZooWrapper
from torchrl.envs.utils import ExplorationType, set_exploration_type

from crowd_env import parallel_env
from crowd_env.agents.evaluation.outside import Outside, judge_outside, line_of

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


def make_experiment(
    iterations: int, seed: int, folder: Path, name: str = "room-v0", room: Mapping[str, Any] = ROOM
) -> Experiment:
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
        task=Evacuation(name, dict(room)),
        algorithm_config=MappoConfig.get_from_yaml(),
        model_config=net,
        critic_model_config=net,
        seed=seed,
        config=config,
    )


def outside(experiment: Experiment, task: str) -> Outside:
    """Return what was learned as a policy of a task: the likeliest choice of each person."""
    people = experiment.group_map[GROUP]

    def choose(observation: np.ndarray) -> np.ndarray:
        # The network takes as many people at once as it was trained with.
        rows = -(-len(observation) // len(people)) * len(people)
        seen = np.zeros((rows, observation.shape[1]), dtype=np.float32)
        seen[: len(observation)] = observation
        groups = torch.from_numpy(seen).reshape(-1, len(people), seen.shape[1])
        crowd = TensorDict({GROUP: TensorDict({"observation": groups}, groups.shape[:2])}, groups.shape[:1])
        with torch.no_grad(), set_exploration_type(ExplorationType.DETERMINISTIC):
            return experiment.policy(crowd)[GROUP, "action"].reshape(-1).numpy()[: len(observation)]

    return Outside("benchmarl-mappo", task, choose)


def main(
    iterations: Annotated[int, typer.Option(min=1)] = 10,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    folder: Path = Path("runs/benchmarl"),
    task: str = "",
    runs: Annotated[int, typer.Option(min=1)] = 40,
) -> Experiment:
    """Train for as many rollouts of 200 decision steps; of a task, judge on so many held-out draws."""
    torch.set_num_threads(1)  # for networks this small a second thread costs more than it brings
    named = {"name": task, "room": {"scenario": task}} if task else {}
    experiment = make_experiment(iterations, seed, folder, **named)
    experiment.run()
    if task:
        print(line_of(judge_outside(outside(experiment, task), runs)))
    return experiment


if __name__ == "__main__":
    typer.run(main)
