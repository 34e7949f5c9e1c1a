"""Batches of Gymnasium: python examples/clients/gymnasium_vector.py --batch native (or sync, or async)

One controller moves everybody.  Here it lets people wait while somebody is only a little nearer the door, and keeps it from
being blocked.

The native batch steps all rooms in one call.  Gymnasium's own batches, sync and async, step one environment after the other,
or each in a process of its own.  All three restart a room in the step in which its episode ends ("SameStep"), and a list of
seeds draws the same rooms in each; a single seed would not.
"""

from enum import Enum
from typing import Annotated

import gymnasium
import numpy as np
import typer
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics

from crowd_env import ObservationLayout  # the import registers the environments, make_scenario

LAYOUT = ObservationLayout(
    terms=("ahead",)
)  # of the next one who is nearer the door: closeness, speed; how many there are
ROOM = {
    "scenario": {"name": "room-v0", "door_width": 0.6},
    "people": 30,
    "time_limit": 40.0,
    "observation": LAYOUT,
}
Batch = Enum("Batch", {name: name for name in ("native", "sync", "async")})


def make_rooms(batch: Batch, rooms: int) -> VectorEnv:
    if batch is Batch.native:
        made = gymnasium.make_vec("crowd_env/room-v0", num_envs=rooms, **ROOM)
    else:
        options = {"autoreset_mode": AutoresetMode.SAME_STEP}
        if batch is Batch["async"]:
            options["context"] = "spawn"  # each process imports this file: hence the guard at its end
        made = gymnasium.make_vec(
            "crowd_env/room-v0",
            num_envs=rooms,
            vectorization_mode=batch.value,
            **ROOM,
            vector_kwargs=options,
        )
    return RecordEpisodeStatistics(made)


def speeds(observation: np.ndarray, patient: bool) -> np.ndarray:
    """Return the actions (E, N, 2): full speed along the shortest path, or standing still while somebody goes first."""
    closeness, _, number = np.moveaxis(observation, -1, 0)
    waits = patient & (number > 0) & (closeness > 0.9)  # less than 0.3 m nearer the door
    return np.stack([np.where(waits, 0.0, 1.0), np.zeros_like(closeness)], axis=-1).astype(np.float32)


def first_episodes(rooms: VectorEnv, patient: bool, seed: int) -> list[dict[str, float]]:
    """Return the figures of the first episode of each room."""
    observation, info = rooms.reset(seed=[seed + e for e in range(rooms.num_envs)])
    figures: dict[int, dict[str, float]] = {}
    while len(figures) < rooms.num_envs:
        observation, _reward, terminated, truncated, info = rooms.step(speeds(observation, patient))
        for e in np.flatnonzero(terminated | truncated):
            # `info` is already about the next episode of this room; what belongs to the last one is in "final_info".
            metrics = info["final_info"]["metrics"]
            figures.setdefault(
                int(e),
                {
                    "return": float(info["episode"]["r"][e]),
                    "steps": int(info["episode"]["l"][e]),
                    "evacuation_time": float(metrics["evacuation_time"][e]),
                    "unfinished": int(metrics["unfinished"][e]),
                },
            )
    return [figures[e] for e in range(rooms.num_envs)]


def main(
    batch: Batch = Batch.native,
    rooms: Annotated[int, typer.Option(min=1)] = 8,
    seed: Annotated[int, typer.Option(min=0)] = 0,
) -> None:
    """Compare pressing on with waiting for a turn."""
    made = make_rooms(batch, rooms)
    for name, patient in (("press on", False), ("wait for a turn", True)):
        figures = first_episodes(made, patient, seed)
        seconds = np.mean([one["steps"] for one in figures]) / 10
        stuck = sum(one["unfinished"] for one in figures)
        print(f"{name:>15}: {seconds:.1f} s, {stuck} of {30 * rooms} people still inside at the end")
    made.close()


if __name__ == "__main__":
    typer.run(main)
