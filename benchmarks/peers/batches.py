"""Environments for many agents: vmas (vectorised, torch on one thread), magent2 and mpe2 (PettingZoo, one at a time).

They do other work than ours in a step, so ratios compare what an agent-step costs, not engines.  All agents act the same all
the time; drawing actions would cost more than some of these steps.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

from benchmarks.measuring import Stepped
from benchmarks.peers import named

_EPISODE = 200  # steps after which a PettingZoo environment is reset, which is not counted


class Peer(Stepped):
    """An environment of another program."""

    is_peer = True


def _vmas(scenario: str, rooms: int, people: int) -> Peer:
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
    name = f"{named('vmas')} {scenario}, {rooms} x {people}"
    return Peer(name, lambda: env.step(actions), lambda: rooms * people, env.reset, _EPISODE)


def _pettingzoo(name: str, package: str, env: Any, action: int) -> Peer:
    env.reset(seed=0)
    step = lambda: env.step(dict.fromkeys(env.agents, action))  # noqa: E731
    name = f"{named(package)} {name}"
    return Peer(name, step, lambda: len(env.agents), partial(env.reset, seed=0), _EPISODE)


def _battle(people: int) -> Peer:
    """Return the battle, on a map for 162 agents or, beside larger rooms, 648; everyone stands still."""
    from magent2.environments import battle_v4

    env = battle_v4.parallel_env(map_size=45 if people <= 20 else 90)
    return _pettingzoo(f"battle, {162 if people <= 20 else 648} agents", "magent2", env, 6)


def _spread(people: int) -> Peer:
    """Return simple_spread with as many agents as one of our rooms."""
    from mpe2 import simple_spread_v3

    env = simple_spread_v3.parallel_env(N=people, max_cycles=_EPISODE + 1)
    return _pettingzoo(f"simple_spread, {people} agents", "mpe2", env, 1)


# Package -> what makes its environments, beside this number of rooms, of people in each.
BATCHES: dict[str, Callable[[int, int], list[Callable[[], Peer]]]] = {
    "vmas": lambda rooms, people: [
        partial(_vmas, name, rooms, people) for name in ("navigation", "dispersion", "flocking")
    ],
    "magent2": lambda rooms, people: [partial(_battle, people)],
    "mpe2": lambda rooms, people: [partial(_spread, people)],
}
