"""Controllers for ``crowd_env/Routing-v0`` that need no learning, and how controllers are judged: on the same draws."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from crowd_env import CrowdEnv, EpisodeMetrics, Scenario
from crowd_env.metrics import Summary, summarise
from crowd_env.routing_batch import RoutingBatch

# What people do without a controller, by the strategy of `CrowdEnv`.
STRATEGIES = {"nearest exit": "nearest", "shortest path": "shortest", "fastest path": "fastest"}
_BATCH = 50


class Controller(Protocol):
    """Says where people go, in every evacuation of a batch at once."""

    @property
    def name(self) -> str:
        """What tables call it."""
        ...

    def act(self, observation: np.ndarray, batch: RoutingBatch, rng: np.random.Generator) -> np.ndarray:
        """Return the actions (E, R + D) for observations (E, D)."""
        ...


class RandomController:
    """Draw every choice uniformly, every time."""

    name = "random"

    def act(self, observation: np.ndarray, batch: RoutingBatch, rng: np.random.Generator) -> np.ndarray:
        """Return random choices."""
        return rng.integers(0, batch.choices, (len(observation), len(batch.choices)))


@dataclass(frozen=True)
class FixedSplit:
    """Send the regions with their centre left of ``x`` [m] to the leftmost exit, the others to the rightmost; doors open."""

    x: float

    @property
    def name(self) -> str:
        """What tables call it."""
        return f"split at {self.x:g} m"

    def act(self, observation: np.ndarray, batch: RoutingBatch, rng: np.random.Generator) -> np.ndarray:
        """Return the same choices whatever is observed."""
        geometry, routes = batch.scenario.geometry, batch.layout.routes
        middle = geometry.exits.mean(axis=1)[:, 0]
        left, right = (routes.index(geometry.exit_names[k]) for k in (middle.argmin(), middle.argmax()))
        of_region = np.where(batch.regions.centre[:, 0] < self.x, left, right)
        row = np.concatenate([of_region, np.ones(len(batch.layout.doors), dtype=np.int64)])
        return np.tile(row, (len(observation), 1))


@dataclass(frozen=True, eq=False)
class Judged:
    """Many evacuations under one controller or strategy, one a draw."""

    name: str
    episodes: list[EpisodeMetrics]
    time_limit: float  # s

    @property
    def last(self) -> np.ndarray:
        """Exit time [s] of the last person (runs,); the time limit where someone was left inside."""
        times = np.array([episode.evacuation_time for episode in self.episodes])
        return np.where(np.isfinite(times), times, self.time_limit)

    @property
    def mean(self) -> np.ndarray:
        """Mean exit time [s] over those who got out (runs,)."""
        return np.array([episode.mean_exit_time for episode in self.episodes])

    @property
    def unfinished(self) -> int:
        """People left inside, in all."""
        return sum(episode.unfinished for episode in self.episodes)


def judge(
    controller: Controller | str,
    scenario: str | Scenario,
    *,
    runs: int,
    first_seed: int,
    progress: Callable[[int], None] | None = None,
    **options: Any,
) -> Judged:
    """Run the draws ``first_seed`` ... ``first_seed + runs - 1`` under a controller or a name in ``STRATEGIES``.

    Parameters
    ----------
    progress : called with the number of evacuations that have just ended.
    options : of `crowd_env.routing_env.RoutingEnv`.
    """
    episodes: list[EpisodeMetrics] = []
    name = controller if isinstance(controller, str) else controller.name
    for begin in range(0, runs, _BATCH):
        seeds = [first_seed + k for k in range(begin, min(begin + _BATCH, runs))]
        batch = RoutingBatch(scenario, num_envs=len(seeds), **options)
        rng = np.random.default_rng(first_seed + begin)
        if isinstance(controller, str):
            env = CrowdEnv(
                batch.scenario,
                num_envs=len(seeds),
                scheme=batch.env.simulation.scheme,
                dt=batch.env.simulation.dt,
                decision_dt=batch.interval,
                strategy=STRATEGIES[controller],
                rules=bool(options.get("rules", False)),
                time_limit=batch.env.time_limit[0],
                threads=batch.env.simulation.threads,
            )
            env.reset(seeds)
        else:
            env, observation = batch.env, batch.reset(seeds)
        while not env.finished.all():
            if isinstance(controller, str):
                ended = env.step(None).info["metrics"]
            else:
                observation, *_, info = batch.step(controller.act(observation, batch, rng))
                ended = info["metrics"]
            if progress is not None:
                progress(len(ended))
        episodes += [env.metrics(e) for e in range(len(seeds))]
    return Judged(name, episodes, float(env.time_limit[0]))


def difference(one: Judged, other: Judged) -> dict[str, Summary]:
    """Return how much longer ``one`` took than ``other`` on the same draws [s], with 95 % bootstrap intervals."""
    return {"last": summarise(one.last - other.last), "mean": summarise(one.mean - other.mean)}
