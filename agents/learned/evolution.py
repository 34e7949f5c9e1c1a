"""CMA-ES over the weights of a rule that all pedestrians share: no gradients, no network, and no rule to start from.

All weights are 0 at first, which is full speed.  All pedestrians of an environment deviate from it together.  So the search
tests changes that pay only if all pedestrians make them, such as a common distance.  The exploration noise of PPO is drawn for
each pedestrian alone, and averages out within the half second in which a body follows.
"""

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from crowd_env import CrowdEnv, Scenario
from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.envs.settings import arguments_of
from crowd_env.envs.tasks.task import HELD_OUT_SEED

from ..evaluation.goals import strayed
from ..plain import Plain
from ..walking import WEIGHT, Evolved, inputs
from .callbacks import EvaluationCallback

if TYPE_CHECKING:
    from cma import CMAEvolutionStrategy

SHARE = 0.5  # of the pedestrians: the same order clears a door for half of them, and allows four times the candidates
_PATIENCE = 10.0  # s without an exit, after which a run ends
_SECONDS = 1.5  # s a pedestrian, time limit of a run: exits of 0.7 pedestrians a second
_FIRST, _WALKS = 1.5, 3.0  # the longest walks at the desired speed that this time and this limit allow for at least
_STEP = 1.0  # of the weights at first, and at every restart
_LAST = 12  # generations with all pedestrians: the result with half of them is close ...
_LAST_STEP = 0.3  # ... and their first step
_WINDOW = 10  # generations whose mean is compared with that of the window before
_BETTER = 0.98  # of the cost: a smaller gain may be the luck of a draw
_PAYS = 0.9  # of the cost of full speed: at the door of the task order costs 0.65 of it, and luck reaches 0.98


def evolve(
    place: Scenario,
    options: Plain,
    seed: int,
    callback: EvaluationCallback[Evolved],
    *,
    population: int = 12,
    draws: int = 6,
    endless: bool = False,
) -> None:
    """Search the weights of `Evolved` that let the last pedestrian out soonest, until the ``callback`` ends the search.

    The cost is the mean time of the last pedestrian over the draws of a generation.  A run that leaves pedestrians inside costs
    its time limit and a second for each of them.  All candidates run side by side in one batch, with half of the pedestrians.

    A stalled search restarts at its mean with its first step size: an apparent end is often a loose crowd that waits.  If the
    restart is in vain, the last generations have all pedestrians.  If the crowd is hardly better than at full speed, the search
    restarts from zero weights with doubled step size.

    Parameters
    ----------
    place : scenario of the training.
    options : of `CrowdEnv`.
    seed : of the search, and of its draws.
    callback : receives the present best policy.
    population : candidates of a generation, on the same draws.
    draws : of a generation; the next one has others.
    endless : continue after a restart in vain.

    Raises
    ------
    ModuleNotFoundError
        If the library cma is not installed.
    """
    everybody = place.population.people
    options = {**options, **Evolved().env_options}
    env = rooms(place, options, max(1, round(SHARE * everybody)), population * draws)
    nothing, far = np.zeros(len(fields(Evolved))), _STEP
    best = former = nothing
    search = begun(best, _STEP, population, seed)
    rng = np.random.default_rng(seed)
    steps = first = 0
    course: list[float] = []
    before = left = np.inf
    while callback.on_update(steps, partial(_rule, best)) and left > 0:
        left -= 1
        if left == np.inf and stalled(course):
            reached, step = float(np.mean(course[-_WINDOW:])), _STEP
            better = former if reached > before else best
            if reached <= _BETTER * before or endless:
                best = better
            elif _pays(env, better, first + draws):
                best, left, step = better, _LAST - 1, _LAST_STEP
                env = rooms(place, options, everybody, population * draws)
            else:
                far *= 2.0
                best, reached, before, step = nothing, np.inf, np.inf, far
            search, course = begun(best, step, population, int(rng.integers(2**31))), []
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
    """Return whether weights are clearly better than full speed, on draws that the search has not used."""
    rooms = np.arange(env.num_envs)
    seeds = min(first, HELD_OUT_SEED - env.num_envs) + rooms // 2
    costs, _ = _race(env, np.where(rooms[:, None] % 2, 0.0, weights), seeds.tolist())
    return bool(costs[::2].mean() <= _PAYS * costs[1::2].mean())


def stalled(course: Sequence[float]) -> bool:
    """Return whether a search has stalled: the best costs of its last generations equal those of the window before.

    Parameters
    ----------
    course : cost of the best candidate of each generation since the last restart.
    """
    if len(course) < 2 * _WINDOW:
        return False
    return bool(np.mean(course[-_WINDOW:]) > _BETTER * np.mean(course[-2 * _WINDOW : -_WINDOW]))


def rooms(place: Scenario, options: Plain, people: int, count: int) -> CrowdEnv:
    """Return a batch of a place with this number of pedestrians, and short limits of time, which allow for the longest walk."""
    place = replace(place, population=place.population.changed(people=people))
    given = arguments_of(options)
    one = CrowdEnv(place, **given)
    one.reset(seed=0)
    walk = float(one.observer.view.travel_time.max())
    limit, patience = max(_SECONDS * people, _WALKS * walk), max(_PATIENCE, _FIRST * walk)
    return CrowdEnv(replace(place, time_limit=limit, blocked_after=patience), num_envs=count, **given)


def begun(mean: Floats, step: float, population: int, seed: int, *, diagonal: bool = False) -> "CMAEvolutionStrategy":
    """Return a search around a mean; ``diagonal`` = it adapts a variance for each weight, no covariances."""
    import cma

    options = {"popsize": population, "seed": seed + 1, "verbose": -9, "CMA_diagonal": diagonal}  # seed 0 is the clock
    return cma.CMAEvolutionStrategy(mean, step, options)


def _race(env: CrowdEnv, weights: Floats, seeds: list[int]) -> tuple[Floats, int]:
    """Return cost and decisions, see `race`, for rows of ``weights`` (E, 7)."""
    return race(env, seeds, lambda seen, room: 1.0 + np.einsum("ij,ij->i", inputs(seen, env.layout), weights[room]))


def race(env: CrowdEnv, seeds: list[int], decide: Callable[[np.ndarray, Ints], Floats]) -> tuple[Floats, int]:
    """Return the cost (E,) of a run of each room, and the number of decisions; a wrong exit leads nowhere.

    Parameters
    ----------
    decide : from observations (K, D) and their rooms (K,) to speeds (K,), or to commands (K, 2).
    """
    observation, _ = env.reset(seeds)
    action, decided = np.zeros((env.num_people, 2)), 0
    while not env.finished.all():
        inside = np.flatnonzero(env.active)
        command = decide(observation[inside], env.env_of_person[inside]).reshape(len(inside), -1)
        action[inside, : command.shape[1]] = np.clip(command, -1.0, 1.0)
        observation = env.step(action).observation
        decided += len(inside)
    times = env.simulation.state.exit_time.reshape(env.num_envs, -1)
    out = np.isfinite(times) & ~strayed(env.simulation.state.exit_index.reshape(times.shape), env.scenarios[0])
    last = np.max(times, axis=1, initial=0.0, where=out)
    return np.where(out.all(axis=1), last, env.time_limit + (~out).sum(axis=1)), decided
