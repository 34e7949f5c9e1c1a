"""One room of 20 alone, the size other simulators can be asked for: CPU seconds per simulated second.

Physics alone is `Simulation.advance` with everyone on the shortest path; environment is `CrowdEnv.step` with observation and
reward.  Only the time until the last person is out (or 30 s) counts as simulated.
"""

import time

from benchmarks.measuring import Effort, Row, Stopwatch, significant
from crowd_env import SCHEMES, CrowdEnv


def rows(effort: Effort) -> list[Row]:
    """Return the figures of every scheme."""
    return [row for scheme in SCHEMES for row in measure(effort, scheme)]


def measure(effort: Effort, scheme: str) -> list[Row]:
    """Return CPU seconds per simulated second."""
    env = CrowdEnv("room-v0", scheme=scheme, time_limit=30.0)
    env.reset([0])
    env.step(None)
    watches = {"physics": Stopwatch(env.simulation, "advance"), "environment": Stopwatch(env, "step")}
    best = dict.fromkeys(watches, float("inf"))
    for _ in range(effort.blocks):
        for watch in watches.values():
            watch.restart()
        begin, seed, simulated = time.process_time(), 0, 0.0
        while time.process_time() - begin < effort.seconds:
            env.reset([seed])
            while not env.finished.all():
                env.step(None)
            simulated += float(env.simulation.state.time[0])
            seed += 1
        for name, watch in watches.items():
            best[name] = min(best[name], watch.seconds / simulated)
    return [Row(f"{scheme}: {name}", significant(value, 3), "CPU s per s") for name, value in best.items()]
