"""The PettingZoo `ParallelEnv` with 200 agents, in turn with an empty one that only hands out dictionaries.

The empty one reads no action and returns the same observations over and over: an environment with dictionaries that does
anything at all is slower.

"Interface alone" is ours without physics: `CrowdParallelEnv.step` around a `CrowdEnv.step` that returns what one step did,
recorded before.  It reads 200 actions and hands out five dictionaries, of observations that are a copy, as those of the empty
one are.  Like the empty one it has the caches for itself; among physics the same work takes longer.  "Infos read" means that
every agent's info is looked at as well, for which it has to be written.
"""

import time
from functools import partial
from typing import Any

import numpy as np
from pettingzoo import ParallelEnv

from benchmarks.measuring import Effort, Row, Sample, in_turn, significant, times_better
from crowd_env import make_scenario, parallel_env
from crowd_env.envs.crowd import Step
from crowd_env.envs.parallel import CrowdParallelEnv

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


def without_physics(env: CrowdParallelEnv) -> CrowdParallelEnv:
    """Let every step of the crowd be the first one of an episode, recorded."""
    env.reset(seed=0)
    recorded = env.env.step()

    def step(action: Any = None, scripted: Any = None) -> Step:
        return recorded._replace(observation=recorded.observation.copy())

    env.env.step = step  # type: ignore[method-assign]
    return env


class Dictionaries:
    """A ParallelEnv in which everyone acts (1, 0), each with an array of his own.

    Parameters
    ----------
    name, env : what the rows say, and of whom.
    read : look at everyone's info after each step.
    """

    peer = None
    whole = 0.0

    def __init__(self, name: str, env: Any, *, read: bool = False) -> None:
        self.name = name
        self._env = env
        self._read = read
        self._actions = {agent: np.array([1.0, 0.0], dtype=np.float32) for agent in env.possible_agents}
        self._left = 0

    def block(self, effort: Effort) -> Sample:
        """Step for about ``effort.seconds`` of CPU time; putting people back is not counted."""
        spent = clock = 0.0
        agents = decisions = 0
        while spent < effort.seconds:
            if self._left == 0 or not self._env.agents:
                self._env.reset(seed=0)
                self._left = _EPISODE
            actions = {agent: self._actions[agent] for agent in self._env.agents}
            begin, tick = time.process_time(), time.perf_counter()
            infos = self._env.step(actions)[-1]
            if self._read:
                for info in infos.values():
                    info.get("reward/exit")
            spent, clock = spent + time.process_time() - begin, clock + time.perf_counter() - tick
            agents, decisions, self._left = agents + len(actions), decisions + 1, self._left - 1
        return Sample(spent, clock, 0.1 * decisions, agents)


def rows(effort: Effort, agents: int = 200) -> list[Row]:
    """Return agent-steps per CPU second and their ratios to those of the empty environment."""
    make = partial(parallel_env, make_scenario("room-v0", side=15.0, door_width=1.0), physics="nsm2", people=agents)
    env, interface = make(), without_physics(make())
    observations, _ = env.reset(seed=0)
    env.step({})
    empty = EmptyParallelEnv(env.possible_agents, np.stack([observations[agent] for agent in env.possible_agents]))
    contenders = [
        Dictionaries(f"nsm2, {agents} agents", env),
        Dictionaries(f"nsm2, interface alone, {agents} agents", interface),
        Dictionaries(f"nsm2, interface alone, infos read, {agents} agents", interface, read=True),
        Dictionaries(f"empty, {agents} agents", empty),
    ]
    rates = [sample.rate for sample in in_turn(contenders, effort)]
    whats = [f"{contender.name}: agent-steps" for contender in contenders]
    found = [Row(what, significant(rate, 3), _RATE) for what, rate in zip(whats, rates, strict=True)]
    for what, rate in zip(whats[:-1], rates, strict=False):
        ratio = times_better(rate, rates[-1], _RATE)
        found.append(Row(what, significant(rate, 3), _RATE, "empty dictionaries", ratio))
    return found
