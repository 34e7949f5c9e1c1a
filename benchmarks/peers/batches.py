"""Environments for many agents: vmas (vectorised, torch on one thread), magent2 and mpe2 (PettingZoo, one at a time).

They do other work than ours in a step, so ratios compare what an agent-step costs, not engines.  All agents act the same all
the time; drawing actions would cost more than some of these steps.
"""

import time
from collections.abc import Callable, Iterator
from typing import Any

from benchmarks.measuring import Contender, Effort, Sample
from benchmarks.peers import named, quiet
from benchmarks.peers.walking import limit
from crowd_env import make_scenario

_PATIENCE = 3.0  # times the longest block: to set up and to make a first step
_EPISODE = 200  # steps after which a PettingZoo environment is reset, which is not counted

Maker = tuple[str, Callable[[], Contender]]


class Stepped:
    """An environment of so many agents whose step is a function; it is stepped once when it is made."""

    whole = 0.0

    def __init__(self, name: str, package: str, effort: Effort, make: Callable[[], Any]) -> None:
        self.name = name
        self.peer: str | None = named(package)
        with quiet(), limit(_PATIENCE * effort.peer_seconds, "making it and its first step"):
            self._step: Callable[[], tuple[float, float, int]] = make()
            self._step()

    def block(self, effort: Effort) -> Sample:
        """Step for about ``effort.seconds`` of CPU time, at most for ``effort.peer_seconds`` on the clock."""
        cpu = clock = 0.0
        agents = steps = 0
        with quiet():
            while cpu < effort.seconds and clock < effort.peer_seconds:
                spent, ticks, acted = self._step()
                cpu, clock, agents, steps = cpu + spent, clock + ticks, agents + acted, steps + 1
        return Sample(cpu, clock, 0.1 * steps, float(agents))


def _timed(call: Callable[[], Any], agents: int) -> tuple[float, float, int]:
    clock, begin = time.perf_counter(), time.process_time()
    call()
    return time.process_time() - begin, time.perf_counter() - clock, agents


def _vmas(scenario: str, rooms: int, people: int, options: dict[str, Any]) -> Callable[[], Any]:
    def make() -> Callable[[], tuple[float, float, int]]:
        import torch
        import vmas

        torch.set_num_threads(1)
        env = vmas.make_env(scenario, num_envs=rooms, device="cpu", seed=0, n_agents=people, **options)
        env.reset()
        actions = [torch.full((rooms, 2), 0.5) for _ in env.agents]
        return lambda: _timed(lambda: env.step(actions), rooms * people)

    return make


def _pettingzoo(build: Callable[[], Any], action: int) -> Callable[[], Any]:
    def make() -> Callable[[], tuple[float, float, int]]:
        env = build()
        left = 0

        def step() -> tuple[float, float, int]:
            nonlocal left
            if left == 0 or not env.agents:
                env.reset(seed=0)
                left = _EPISODE
            left -= 1
            actions = dict.fromkeys(env.agents, action)
            return _timed(lambda: env.step(actions), len(actions))

        return step

    return make


def vmas_batches(rooms: int, people: int, effort: Effort) -> Iterator[Maker]:
    """Yield navigation, dispersion and flocking with as many agents; spaced so that they fit into their world."""
    reach = max(1.0, 0.35 * people**0.5)
    scenarios: dict[str, dict[str, Any]] = {
        "navigation": {"world_spawning_x": reach, "world_spawning_y": reach},
        "dispersion": {},
        "flocking": {"min_dist_between_entities": 0.05},
    }
    for scenario, options in scenarios.items():
        name = f"vmas {scenario}, {rooms} x {people}"
        make = _vmas(scenario, rooms, people, options)
        yield name, lambda name=name, make=make: Stepped(name, "vmas", effort, make)  # type: ignore[misc]


def magent2_batches(rooms: int, people: int, effort: Effort) -> Iterator[Maker]:
    """Yield the battle, on a map for 162 agents or, beside larger rooms, 648; everyone stands still."""

    def build() -> Any:
        from magent2.environments import battle_v4

        return battle_v4.parallel_env(make_scenario("room-v0", map_size=45 if people <= 20 else 90))

    name = f"magent2 battle, {162 if people <= 20 else 648} agents"
    yield name, lambda: Stepped(name, "magent2", effort, _pettingzoo(build, 6))


def mpe2_batches(rooms: int, people: int, effort: Effort) -> Iterator[Maker]:
    """Yield simple_spread with as many agents as one of our rooms."""

    def build() -> Any:
        from mpe2 import simple_spread_v3

        return simple_spread_v3.parallel_env(make_scenario("room-v0", N=people), max_cycles=_EPISODE + 1)

    name = f"mpe2 simple_spread, {people} agents"
    yield name, lambda: Stepped(name, "mpe2", effort, _pettingzoo(build, 1))


BATCHES: dict[str, Callable[[int, int, Effort], Iterator[Maker]]] = {
    "vmas": vmas_batches,
    "magent2": magent2_batches,
    "mpe2": mpe2_batches,
}
