"""CMA-ES over the constants of a rule that all people share: no gradients, no network, one number for an evacuation."""

from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from crowd_env import Scenario
from crowd_env.envs.rollout import Episode, run_episodes

from ..drivers import clearing_times, policy_driver
from ..evaluation.evaluation import HELD_OUT_SEED
from ..walking import Evolved
from .watch import Watch


class Searched(NamedTuple):
    """Where the search for a constant begins, how far it looks at first, and its bounds."""

    start: float
    scale: float
    low: float
    high: float


# Starts at `crowd_env.agents.walking.Follow`, on round numbers.
SEARCHED = MappingProxyType(
    {
        "spacing": Searched(0.5, 0.1, 0.0, 1.5),
        "crowd": Searched(0.0, 0.15, -1.0, 2.0),
        "far": Searched(0.0, 0.15, -1.0, 1.0),
        "time": Searched(0.3, 0.1, 0.05, 2.0),
        "match": Searched(1.0, 0.15, 0.0, 2.0),
        "damping": Searched(0.0, 0.15, -1.0, 2.0),
        "side": Searched(0.0, 0.1, -0.5, 0.5),
        "back": Searched(0.3, 0.15, 0.0, 1.0),
    }
)


@dataclass(frozen=True)
class EvolutionSettings:
    """Budget of a generation."""

    population: int = 12  # candidates of a generation, all of them judged on the same draws ...
    draws: int = 12  # ... which are others in every generation


def evolve(
    place: Scenario, options: dict[str, Any], seed: int, watch: Watch, settings: EvolutionSettings | None = None
) -> None:
    """Search the constants of `Evolved` that let the last person out soonest, until ``watch`` says that it is enough.

    What is minimised is the mean time of the last person over the draws of a generation; a run in which somebody is left
    counts until its time limit.  The mean of the search distribution is what ``watch`` looks at after every generation.

    Parameters
    ----------
    place : what is trained in.
    options : of `CrowdEnv`.
    seed : of the search, and of its draws.

    Raises
    ------
    ModuleNotFoundError
        If the library cma is not installed.
    """
    import cma

    settings = settings or EvolutionSettings()
    start, scale, low, high = np.array(list(SEARCHED.values())).T
    bounds = [((bound - start) / scale).tolist() for bound in (low, high)]
    told = {"popsize": settings.population, "seed": seed + 1, "bounds": bounds, "verbose": -9}  # 0 is the clock
    search = cma.CMAEvolutionStrategy(np.zeros(len(start)), 1.0, told)
    rng, steps = np.random.default_rng(seed), 0

    def policy(point: Any) -> Evolved:
        return Evolved(**dict(zip(SEARCHED, (start + scale * np.asarray(point)).tolist(), strict=True)))

    while watch.goes_on(steps, lambda: policy(search.result.xfavorite)):
        first = int(rng.integers(0, HELD_OUT_SEED - settings.draws))
        candidates, costs = search.ask(), []
        for point in candidates:
            driver = policy_driver(policy(point), place, **options)
            episodes = run_episodes(place, settings.draws, seed=first, driver=driver)
            costs.append(float(clearing_times(episodes).mean()))
            steps += sum(decisions(episode, watch.decision_dt) for episode in episodes)
        search.tell(candidates, costs)


def decisions(episode: Episode, interval: float) -> int:
    """Return how many decisions people took, summed over all, one every ``interval`` [s]."""
    inside = np.where(np.isfinite(episode.exit_time), episode.exit_time, episode.end)
    return int(np.ceil(inside / interval - 1e-9).sum())
