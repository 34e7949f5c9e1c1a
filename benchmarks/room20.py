"""One room of 20, the size that other simulators can be asked for: CPU seconds per simulated second, until it is empty.

Physics alone is `Simulation.advance` with everyone on the shortest path; the environment is `CrowdEnv.step`, a decision each
0.1 s, with observation and reward.
"""

import time

from benchmarks.crowds import COST, DEFAULT_PAIRS, measure
from benchmarks.measuring import Effort, Row, significant
from benchmarks.peers import rivals
from benchmarks.scenes import room20
from crowd_env import SCHEMES, CrowdEnv


def rows(effort: Effort) -> list[Row]:
    """Return the figures of every scheme."""
    scene = room20()
    found = measure(scene, effort, DEFAULT_PAIRS, rivals("room20", scene, effort))
    return found + [row for scheme in SCHEMES if scheme != "hertz-literal" for row in environment(effort, scheme)]


def environment(effort: Effort, scheme: str) -> list[Row]:
    """Return CPU seconds per simulated second of the environment, of many draws one after the other."""
    effort.tell(f"{scheme}: environment")
    env = CrowdEnv("room-v0", physics=scheme, time_limit=30.0)
    env.reset([0])
    env.step(None)
    best = float("inf")
    for _ in range(effort.blocks):
        spent, seed, simulated = 0.0, 0, 0.0
        while spent < effort.seconds:
            env.reset([seed])
            begin = time.process_time()
            while not env.finished.all():
                env.step(None)
            spent += time.process_time() - begin
            simulated += float(env.simulation.state.time[0])
            seed += 1
        best = min(best, spent / simulated)
    return [Row(f"{scheme} environment, 20 people: CPU time", significant(best, 3), COST)]
