"""CMA-ES over the weights of a rule that all pedestrians share: no gradients, no network, and nothing to start from.

All weights are 0 at first, which is full speed.  All pedestrians of an environment deviate from it together.  So the search
tries what pays only where everyone does it, such as a gap that all keep.  The noise by which PPO explores is drawn for each
pedestrian alone, and averages to nothing over the half second in which a body follows.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from crowd_env import CrowdEnv, Scenario
from crowd_env.core.arrays.state import Floats
from crowd_env.envs.settings import arguments_of

from ..evaluation.evaluation import HELD_OUT_SEED
from ..plain import Plain
from ..walking import WEIGHT, Evolved, inputs
from .callbacks import EvaluationCallback

if TYPE_CHECKING:
    from cma import CMAEvolutionStrategy

SHARE = 0.5  # of the people: the same order clears a door for half of them, and four times the candidates are tried meanwhile
_PATIENCE = 10.0  # s without anyone getting out, after which a run is given up
_SECONDS = 1.5  # s a person, which a run may take: exits of 0.7 people a second
_STEP = 1.0  # of the weights at first, and at every new beginning
_LAST = 12  # generations with everybody: what half of the people find is nearly it ...
_LAST_STEP = 0.3  # ... and their first step
_WINDOW = 10  # generations whose mean is held against that of as many before
_BETTER = 0.98  # of the cost: what is more is no gain, but the luck of a draw
_PAYS = 0.9  # of the cost of full speed: at the door of the task order costs 0.65 of it, and what luck finds 0.98


@dataclass(frozen=True)
class EvolutionSettings:
    """Budget of a search.

    Parameters
    ----------
    population : candidates of a generation, all judged on the same draws.
    draws : of a generation; the next one has others.
    endless : go on after a restart was in vain.
    """

    population: int = 12
    draws: int = 6
    endless: bool = False


def evolve(
    place: Scenario,
    options: Plain,
    seed: int,
    callback: EvaluationCallback[Evolved],
    settings: EvolutionSettings | None = None,
) -> None:
    """Search the weights of `Evolved` that let the last person out soonest, until the ``callback`` ends the search.

    The cost is the mean time of the last person over the draws of a generation.  A run in which somebody is left inside costs
    its time limit and a second for each of them.  All candidates run side by side in one batch, with half of the people.

    A search that has stalled restarts where it is with its first step size: what looks like an end is often a loose crowd that
    waits.  When that was in vain, the last generations have all the people.  If the crowd is hardly better than at full speed,
    the search restarts from zero weights with doubled step size.

    Parameters
    ----------
    place : what is trained in.
    options : of `CrowdEnv`.
    seed : of the search, and of its draws.
    callback : is given the best policy so far.

    Raises
    ------
    ModuleNotFoundError
        If the library cma is not installed.
    """
    settings = settings or EvolutionSettings()
    population, draws = settings.population, settings.draws
    everybody = place.population.people
    env = _rooms(place, options, max(1, round(SHARE * everybody)), population * draws)
    nothing, far = np.zeros(len(fields(Evolved))), _STEP
    best = former = nothing
    search = _begun(best, _STEP, population, seed)
    rng = np.random.default_rng(seed)
    steps = first = 0
    course: list[float] = []
    before = left = np.inf
    while callback.on_update(steps, partial(_rule, best)) and left > 0:
        left -= 1
        if left == np.inf and stalled(course):
            reached, step = float(np.mean(course[-_WINDOW:])), _STEP
            better = former if reached > before else best
            if reached <= _BETTER * before or settings.endless:
                best = better
            elif _pays(env, better, first + draws):
                best, left, step = better, _LAST - 1, _LAST_STEP
                env = _rooms(place, options, everybody, population * draws)
            else:
                far *= 2.0
                best, reached, before, step = nothing, np.inf, np.inf, far
            search, course = _begun(best, step, population, int(rng.integers(2**31))), []
            former, before = best, min(before, reached)
        first = int(rng.integers(0, HELD_OUT_SEED - draws))
        candidates = search.ask()
        costs, decided = _race(env, np.repeat(candidates, draws, axis=0), [*range(first, first + draws)] * population)
        means = costs.reshape(population, draws).mean(axis=1)
        search.tell(candidates, means)
        course.append(float(means.min()))
        best = np.asarray(search.result.xfavorite)
        steps += decided


def _rule(weights: Floats) -> Evolved:
    return Evolved(*np.clip(weights, WEIGHT.low, WEIGHT.high).tolist())


def _pays(env: CrowdEnv, weights: Floats, first: int) -> bool:
    """Return whether weights are clearly better than full speed, on draws that a search has not had the luck of."""
    rooms = np.arange(env.num_envs)
    seeds = min(first, HELD_OUT_SEED - env.num_envs) + rooms // 2
    costs, _ = _race(env, np.where(rooms[:, None] % 2, 0.0, weights), seeds.tolist())
    return bool(costs[::2].mean() <= _PAYS * costs[1::2].mean())


def stalled(course: Sequence[float]) -> bool:
    """Return whether a search has stopped getting better: the best of its last generations are those of the ones before.

    Parameters
    ----------
    course : the cost of the best candidate of each generation since the search began.
    """
    if len(course) < 2 * _WINDOW:
        return False
    return bool(np.mean(course[-_WINDOW:]) > _BETTER * np.mean(course[-2 * _WINDOW : -_WINDOW]))


def _rooms(place: Scenario, options: Plain, people: int, rooms: int) -> CrowdEnv:
    """Return a batch of a place with so many of its people, who are given up early."""
    crowd = place.population.changed(people=people)
    short = replace(place, population=crowd, time_limit=_SECONDS * people, blocked_after=_PATIENCE)
    return CrowdEnv(short, num_envs=rooms, **arguments_of({**options, **Evolved().env_options}))


def _begun(mean: Floats, step: float, population: int, seed: int) -> "CMAEvolutionStrategy":
    """Return a search around a mean."""
    import cma

    return cma.CMAEvolutionStrategy(
        mean, step, {"popsize": population, "seed": seed + 1, "verbose": -9}
    )  # 0 is the clock


def _race(env: CrowdEnv, weights: Floats, seeds: list[int]) -> tuple[Floats, int]:
    """Return what a run of each room costs (E,), whose people decide by a row of ``weights`` (E, 7), and all decisions made."""
    observation, _ = env.reset(seeds)
    action, decided = np.zeros((env.num_people, 2)), 0
    while not env.finished.all():
        inside = np.flatnonzero(env.active)
        seen = inputs(observation[inside], env.layout)
        share = 1.0 + np.einsum("ij,ij->i", seen, weights[env.env_of_person[inside]])
        action[inside, 0] = np.clip(share, -1.0, 1.0)
        observation = env.step(action).observation
        decided += len(inside)
    times = env.simulation.state.exit_time.reshape(env.num_envs, -1)
    out = np.isfinite(times)
    last = np.max(times, axis=1, initial=0.0, where=out)
    return np.where(out.all(axis=1), last, env.time_limit + (~out).sum(axis=1)), decided
