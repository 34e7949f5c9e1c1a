"""The batch environment over arrays: observation, reward and automatic restart included.

Everyone acts (1, 0), straight to the exit, through the same door as a policy's actions.  Before anything is measured the batch
runs for 30 simulated seconds, so that rooms are in all phases of an evacuation.  An agent-step is one decision (0.1 s, ten
physics steps) of someone who is inside; slots of people who are out are not counted.
"""

import time

import numpy as np

from benchmarks.measuring import Effort, Row, Stopwatch, significant
from crowd_env import SCHEMES, CrowdEnv

SIZES = (256, 32)  # rooms of 20
_SETTLE = 300  # decision steps


def rows(effort: Effort, sizes: tuple[int, ...] = SIZES, settle: int = _SETTLE) -> list[Row]:
    """Return the figures of every scheme and size."""
    return [row for rooms in sizes for scheme in SCHEMES for row in measure(effort, scheme, rooms, settle)]


def measure(effort: Effort, scheme: str, rooms: int, settle: int) -> list[Row]:
    """Return agent-steps per CPU second and the share of the physics."""
    env = CrowdEnv("room-v0", num_envs=rooms, scheme=scheme, autoreset=True)
    env.reset(seed=0)
    forward = np.tile(np.array([1.0, 0.0], dtype=np.float32), (env.num_people, 1))
    for _ in range(settle):
        env.step(forward)
    physics = Stopwatch(env.simulation, "advance")
    best, share, inside = 0.0, 0.0, 0.0
    for _ in range(effort.blocks):
        physics.restart()
        begin, steps, active = time.process_time(), 0, 0
        while time.process_time() - begin < effort.seconds:
            active += int(env.active.sum())
            env.step(forward)
            steps += 1
        spent = time.process_time() - begin
        if active / spent > best:
            best, share, inside = active / spent, physics.seconds / spent, active / (steps * env.num_people)
    name = f"{scheme}, {rooms} x 20"
    return [
        Row(f"{name}: agent-steps", significant(best, 3), "1/CPU s"),
        Row(f"{name}: of that in the physics", significant(share, 2), "1"),
        Row(f"{name}: slots with someone inside", significant(inside, 2), "1"),
    ]
