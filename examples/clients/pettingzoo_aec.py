"""PettingZoo, agents in turn (AEC): python examples/clients/pettingzoo_aec.py --seed 3

Everybody is asked in turn, and the crowd moves when all who are inside have answered.  A pedestrian who has got out is shown
the last observation and reward once more, answers None, and is not asked again.
"""

from typing import Annotated

import numpy as np
import pettingzoo
import typer

from crowd_env import ObservationLayout

LAYOUT = ObservationLayout(
    terms=("ahead",)
)  # of the next one who is nearer the door: closeness, speed; how many there are
ROOM = {
    "scenario": {"name": "room-v0", "door_width": 0.6},
    "people": 30,
    "time_limit": 40.0,
    "observation": LAYOUT,
}


def speed(observation: np.ndarray) -> np.ndarray:
    """Return the action: along the shortest path at full speed; nothing while somebody is less than 0.3 m nearer the door."""
    closeness, _, number = observation
    return np.array([0.0 if number > 0 and closeness > 0.9 else 1.0, 0.0], dtype=np.float32)


def evacuate(seed: int) -> tuple[dict[str, int], list[str]]:
    """Return after how many turns each pedestrian was out, and who was still inside at the end."""
    env = pettingzoo.make("aec", "crowd_env/room-v0", **ROOM)
    env.reset(seed=seed)
    out_after, late = {}, []
    turns = dict.fromkeys(env.possible_agents, 0)
    for agent in env.agent_iter():
        observation, _reward, terminated, truncated, _info = env.last()
        if terminated:
            out_after[agent] = turns[agent]
        elif truncated:
            late.append(agent)
        else:
            turns[agent] += 1
        env.step(None if terminated or truncated else speed(observation))
    return out_after, late


def main(seed: Annotated[int, typer.Option(min=0)] = 0) -> None:
    """Lead one crowd out."""
    out_after, late = evacuate(seed)
    seconds = max(out_after.values(), default=0) / 10
    print(f"{len(out_after)} people got out, the last after {seconds:.1f} s; {len(late)} did not")


if __name__ == "__main__":
    typer.run(main)
