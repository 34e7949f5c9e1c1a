"""MaskablePPO of sb3-contrib: python examples/clients/maskable_ppo.py --steps 300000

People choose among two exits, of which one shuts after 3 s.  A mask takes away exits that are shut, and all others until a
second after a choice; `MaskedRolloutBuffer` takes away the rows of those who have left.
"""

from typing import Annotated

import numpy as np
import torch
import typer
from sb3_contrib import MaskablePPO
from sb3_contrib.common.maskable.buffers import MaskableRolloutBuffer, MaskableRolloutBufferSamples

from crowd_env import FULL_SPEED, TABLE_4, CrowdEnv, DoorEvent, Geometry, Population, Scenario
from crowd_env.envs.adapters.sb3 import CrowdVecEnv, MaskedRolloutBuffer

EXITS = {"west": [(0, 2), (0, 3)], "east": [(12, 2), (12, 3)]}
HALL = Scenario(
    "hall",
    Geometry.from_polygon([(0, 0), (12, 0), (12, 5), (0, 5)], exits=EXITS, doors={"gate": "west"}),
    Population(30, **TABLE_4),
    time_limit=30.0,
    door_events=(DoorEvent("gate", opens=False, at=3.0),),
    **FULL_SPEED,
)
SEEN = ("velocity", "travel_time", "walls", "neighbors", "routes", "queues_seen")
ROOM = {"scenario": HALL, "physics": "dem", "action": "speeds-exits", "observation": {"terms": SEEN}}


class Buffer(MaskedRolloutBuffer, MaskableRolloutBuffer):
    samples = MaskableRolloutBufferSamples


def make_model(rooms: int, seed: int) -> MaskablePPO:
    torch.set_num_threads(1)  # for networks this small a second thread costs more than it brings
    env = CrowdEnv(**ROOM, num_envs=rooms, autoreset=True)
    return MaskablePPO(
        "MlpPolicy",
        CrowdVecEnv(env),
        rollout_buffer_class=Buffer,
        n_steps=64,
        batch_size=rooms * 128,
        n_epochs=4,
        gamma=0.98,  # per decision step of 0.1 s
        learning_rate=1e-3,
        seed=seed,
        device="cpu",
    )


def judge(model: MaskablePPO, draws: int = 10) -> str:
    """Return how a model does in rooms not seen in training."""
    env = CrowdEnv(**ROOM, num_envs=draws)
    observation, info = env.reset(seed=list(range(1_000_000, 1_000_000 + draws)))
    while not env.finished.all():
        action, _ = model.predict(observation, action_masks=info["action_mask"], deterministic=True)
        observation, *_, info = env.step(action)
    told = [env.metrics(e) for e in range(draws)]
    return f"{np.mean([one.mean_exit_time for one in told]):.1f} s inside, {sum(one.unfinished for one in told)} left"


def main(
    steps: Annotated[int, typer.Option(min=1)] = 300_000, seed: Annotated[int, typer.Option(min=0)] = 0
) -> MaskablePPO:
    """Train for this many steps of single slots."""
    model = make_model(rooms=4, seed=seed)
    print(f"before: {judge(model)}")
    model.learn(steps, log_interval=None)
    print(f"after:  {judge(model)}")
    return model


if __name__ == "__main__":
    typer.run(main)
