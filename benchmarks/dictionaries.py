"""The PettingZoo `ParallelEnv` with 200 agents, in turn with an empty one that only hands out dictionaries.

The empty one returns the same observations over and over: no environment with dictionaries can be faster.
"""

import time
from typing import Any

import numpy as np
from pettingzoo import ParallelEnv

from benchmarks.measuring import Effort, Row, Sample, in_turn, significant, times_better
from crowd_env import parallel_env

_EPISODE = 50  # decision steps after which everyone is put back
_RATE = "1/CPU s"


class EmptyParallelEnv(ParallelEnv):
    """So many agents in the spaces of another environment; nothing happens."""

    metadata = {"name": "empty"}

    def __init__(self, agents: list[str], observation: np.ndarray) -> None:
        self.possible_agents = list(agents)
        self.agents: list[str] = []
        self._observation = observation

    def reset(self, seed: int | None = None, options: Any = None) -> tuple[dict[str, Any], dict[str, Any]]:
        """Put everyone back."""
        self.agents = list(self.possible_agents)
        return dict(zip(self.agents, self._observation, strict=True)), {agent: {} for agent in self.agents}

    def step(self, actions: dict[str, Any]) -> tuple[dict[str, Any], ...]:
        """Do nothing."""
        agents = self.agents
        observations = dict(zip(agents, self._observation.copy(), strict=True))
        never = dict.fromkeys(agents, False)
        return observations, dict.fromkeys(agents, 0.0), never, never.copy(), {agent: {} for agent in agents}


class Dictionaries:
    """A ParallelEnv in which everyone acts (1, 0)."""

    peer = None
    whole = 0.0

    def __init__(self, name: str, env: Any) -> None:
        self.name = name
        self._env = env
        self._action = np.array([1.0, 0.0], dtype=np.float32)
        self._left = 0

    def block(self, effort: Effort) -> Sample:
        """Step for about ``effort.seconds`` of CPU time; putting people back is not counted."""
        spent = clock = 0.0
        agents = decisions = 0
        while spent < effort.seconds:
            if self._left == 0 or not self._env.agents:
                self._env.reset(seed=0)
                self._left = _EPISODE
            actions = dict.fromkeys(self._env.agents, self._action)
            begin, tick = time.process_time(), time.perf_counter()
            self._env.step(actions)
            spent, clock = spent + time.process_time() - begin, clock + time.perf_counter() - tick
            agents, decisions, self._left = agents + len(actions), decisions + 1, self._left - 1
        return Sample(spent, clock, 0.1 * decisions, agents)


def rows(effort: Effort, agents: int = 200) -> list[Row]:
    """Return agent-steps per CPU second and the ratio to the empty environment."""
    env = parallel_env("room-v0", scheme="nsm2", count=agents, side=15.0, door_width=1.0)
    observations, _ = env.reset(seed=0)
    env.step({})
    empty = EmptyParallelEnv(env.possible_agents, np.stack([observations[agent] for agent in env.possible_agents]))
    names = f"nsm2, {agents} agents", f"empty, {agents} agents"
    mine, nothing = in_turn([Dictionaries(names[0], env), Dictionaries(names[1], empty)], effort)
    ratio = times_better(mine.rate, nothing.rate, _RATE)
    return [
        Row(f"{names[0]}: agent-steps", significant(mine.rate, 3), _RATE),
        Row(f"{names[1]}: agent-steps", significant(nothing.rate, 3), _RATE),
        Row(f"{names[0]}: agent-steps", significant(mine.rate, 3), _RATE, "empty dictionaries", ratio),
    ]
