"""TorchRL: python examples/clients/torchrl_ppo.py --steps 2000 [--task competitive-door]

With a task, the room is the one that the task's preset trains in, and what was learned is judged on held-out draws of the task.
All pedestrians are one group that shares a network.  Two flags matter: ``use_mask=True``, since the wrapper keeps a row for
those who have left and the mask says whose rows count, and ``done_on_any=False``, without which an episode ends when the
first one is out.
"""

from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
import torch
import typer
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch.distributions import Categorical
from torchrl.collectors import Collector
from torchrl.envs.libs.pettingzoo import PettingZooWrapper
from torchrl.envs.utils import ExplorationType, set_exploration_type
from torchrl.modules import MLP, ProbabilisticActor
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

from crowd_env import parallel_env
from crowd_env.agents.evaluation.outside import Outside, judge_outside, line_of

ROOM = {
    "scenario": "room-v0",
    "people": 12,
    "time_limit": 20.0,
    "action": "speeds",  # a choice among five speeds along the way out
}
GROUP = "pedestrian"  # the wrapper groups agents by name: pedestrian_0, pedestrian_1 ...
ROLLOUT = 100  # decision steps between two updates


def make_room(room: Mapping[str, Any] = ROOM) -> PettingZooWrapper:
    return PettingZooWrapper(parallel_env(**room), use_mask=True, done_on_any=False)


def make_networks(room: PettingZooWrapper) -> tuple[ProbabilisticActor, TensorDictModule]:
    """Return an actor and a critic, the same for every pedestrian."""
    size, choices = room.observation_spec[GROUP, "observation"].shape[-1], room.action_spec_unbatched[GROUP, "action"].n
    net, observation = {"in_features": size, "num_cells": [64]}, [(GROUP, "observation")]
    actor = ProbabilisticActor(
        TensorDictModule(MLP(out_features=choices, **net), observation, [(GROUP, "logits")]),
        in_keys={"logits": (GROUP, "logits")},
        out_keys=[(GROUP, "action")],
        distribution_class=Categorical,
        return_log_prob=True,
        log_prob_key=(GROUP, "log_prob"),
    )
    return actor, TensorDictModule(MLP(out_features=1, **net), observation, [(GROUP, "state_value")])


def samples_of(rollout: TensorDict) -> TensorDict:
    """Return the rows (M,) of those who were inside when they acted: the others teach nothing."""
    inside = rollout[GROUP, "mask"]  # (T, N)
    return TensorDict({GROUP: rollout[GROUP][inside]}, batch_size=[int(inside.sum())])


def got_out(rollout: TensorDict) -> int:
    """Return how many people got out: the rows of those who are out already say so again in every step."""
    return int(rollout["next", GROUP, "terminated"][rollout[GROUP, "mask"]].sum())


def outside(actor: ProbabilisticActor, task: str) -> Outside:
    """Return what was learned as a policy of a task: the likeliest choice of each person."""

    def choose(observation: np.ndarray) -> np.ndarray:
        seen = TensorDict({GROUP: {"observation": torch.from_numpy(observation)}}, [len(observation)])
        with torch.no_grad(), set_exploration_type(ExplorationType.DETERMINISTIC):
            return actor(seen)[GROUP, "action"].numpy()

    return Outside("torchrl-ppo", task, choose)


def main(
    steps: Annotated[int, typer.Option(min=1)] = 2000,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    task: str = "",
    runs: Annotated[int, typer.Option(min=1)] = 40,
) -> ProbabilisticActor:
    """Train for this many decision steps of the room; of a task, judge on so many held-out draws."""
    torch.manual_seed(seed)
    torch.set_num_threads(1)  # for networks this small a second thread costs more than it brings
    room = make_room({"scenario": task} if task else ROOM)
    actor, critic = make_networks(room)
    keys = {name: (GROUP, name) for name in ("reward", "done", "terminated", "advantage", "value_target")}
    advantage = GAE(gamma=0.98, lmbda=0.95, value_network=critic)
    advantage.set_keys(value=(GROUP, "state_value"), **keys)
    loss = ClipPPOLoss(actor, critic, entropy_coeff=0.003, critic_coeff=0.5, normalize_advantage=True)
    loss.set_keys(value=(GROUP, "state_value"), action=(GROUP, "action"), sample_log_prob=(GROUP, "log_prob"), **keys)
    optimizer = torch.optim.Adam(loss.parameters(), lr=1e-3)
    room.set_seed(seed)
    collector = Collector(
        room,
        actor,
        frames_per_batch=ROLLOUT,
        total_frames=-(-steps // ROLLOUT) * ROLLOUT,
        auto_register_policy_transforms=True,
    )
    for rollout in collector:
        with torch.no_grad():
            advantage(rollout)
        samples = samples_of(rollout)
        for _ in range(4):
            for part in torch.randperm(len(samples)).split(256):
                losses = loss(samples[part])
                optimizer.zero_grad()
                sum(value for name, value in losses.items() if name.startswith("loss_")).backward()
                torch.nn.utils.clip_grad_norm_(loss.parameters(), 0.5)
                optimizer.step()
        print(f"{len(samples)} decisions, {got_out(rollout)} people got out in {ROLLOUT / 10:g} s")
    if task:
        print(line_of(judge_outside(outside(actor, task), runs)))
    return actor


if __name__ == "__main__":
    typer.run(main)
