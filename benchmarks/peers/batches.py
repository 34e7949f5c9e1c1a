"""Environments for many agents: vmas (vectorised, torch on one thread), magent2 and mpe2 (PettingZoo, one at a time).

They do other work than ours in a step, so ratios compare what an agent-step costs, not engines.  All agents act the same all
the time; drawing actions would cost more than some of these steps.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

from benchmarks.measuring import NOTHING, Effort, Sample, timed
from benchmarks.peers import named, quiet

_EPISODE = 200  # steps after which a PettingZoo environment is reset, which is not counted


class Stepped:
    """An environment of other agents; it is stepped once when it is made."""

    whole = 0.0

    def __init__(self, name: str, package: str, step: Callable[[], Any], agents: int, reset: Callable[[], Any]) -> None:
        self.name, self._agents = f"{named(package)} {name}", agents
        self._step, self._reset, self._left = step, reset, 0
        self.block(Effort(1e-9))

    def block(self, effort: Effort) -> Sample:
        """Step for about ``effort.seconds`` of CPU time, at most for ``effort.peer_seconds`` on the clock."""
        sums = NOTHING
        with quiet():
            while sums.cpu < effort.seconds and sums.clock < effort.peer_seconds:
                if self._left == 0:
                    self._reset()
                    self._left = _EPISODE
                cpu, clock = timed(self._step)
                self._left -= 1
                sums = sums.plus(Sample(cpu, clock, 0.1, self._agents))
        return sums


def _vmas(scenario: str, rooms: int, people: int) -> Stepped:
    """Return navigation, dispersion or flocking with as many agents; spaced so that they fit into their world."""
    import torch
    import vmas

    reach = max(1.0, 0.35 * people**0.5)
    spaced: dict[str, dict[str, Any]] = {
        "navigation": {"world_spawning_x": reach, "world_spawning_y": reach},
        "flocking": {"min_dist_between_entities": 0.05},
    }
    torch.set_num_threads(1)
    options = {"num_envs": rooms, "device": "cpu", "seed": 0, "n_agents": people, **spaced.get(scenario, {})}
    env = vmas.make_env(scenario, **options)
    actions = [torch.full((rooms, 2), 0.5) for _ in env.agents]
    name = f"{scenario}, {rooms} x {people}"
    return Stepped(name, "vmas", lambda: env.step(actions), rooms * people, env.reset)


def _pettingzoo(name: str, package: str, env: Any, action: int) -> Stepped:
    env.reset(seed=0)
    step = lambda: env.step(dict.fromkeys(env.agents, action))  # noqa: E731
    return Stepped(name, package, step, len(env.agents), partial(env.reset, seed=0))


def _battle(people: int) -> Stepped:
    """Return the battle, on a map for 162 agents or, beside larger rooms, 648; everyone stands still."""
    from magent2.environments import battle_v4

    env = battle_v4.parallel_env(map_size=45 if people <= 20 else 90)
    return _pettingzoo(f"battle, {162 if people <= 20 else 648} agents", "magent2", env, 6)


def _spread(people: int) -> Stepped:
    """Return simple_spread with as many agents as one of our rooms."""
    from mpe2 import simple_spread_v3

    env = simple_spread_v3.parallel_env(N=people, max_cycles=_EPISODE + 1)
    return _pettingzoo(f"simple_spread, {people} agents", "mpe2", env, 1)


# Package -> what makes its environments, beside this number of rooms, of people in each.
BATCHES: dict[str, Callable[[int, int], list[Callable[[], Stepped]]]] = {
    "vmas": lambda rooms, people: [
        partial(_vmas, name, rooms, people) for name in ("navigation", "dispersion", "flocking")
    ],
    "magent2": lambda rooms, people: [partial(_battle, people)],
    "mpe2": lambda rooms, people: [partial(_spread, people)],
}
