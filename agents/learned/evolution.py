"""CMA-ES over the weights of a rule that all people share: no gradients, no network, and nothing to begin with.

All weights are 0 at first, which is full speed.  Everybody in a room has the same weights, so that all deviate from that
together: what pays only where everyone does it, such as a gap that all keep, is tried as one thing.  Noise on each person's own
actions, by which PPO explores, averages to nothing over the half second in which a body follows.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np

from crowd_env import CrowdEnv, Scenario
from crowd_env.core.arrays.state import Floats
from crowd_env.core.console import say
from crowd_env.core.files.json_file import read_json, write_json
from crowd_env.envs.settings import arguments_of

from ..evaluation.entries import RULE
from ..evaluation.evaluation import HELD_OUT_SEED
from ..policy import Policy
from ..training_config import NOTHING, physics_of, place_of, start_of
from ..walking import WEIGHT, Evolved, WalkingRule, inputs

FOUND = "search.json"  # weights, in the folder of a run
SHARE = 0.5  # of the people: the same order clears a door for half of them, and four times the candidates are tried meanwhile
_PATIENCE = 10.0  # s without anyone getting out, after which a run is given up
_SECONDS = 1.5  # s a person, which a run may take: exits of 0.7 people a second
_STEP = 1.0  # of the weights at first, and at every new beginning
_LAST = 12  # generations with everybody: what half of the people find is nearly it ...
_LAST_STEP = 0.3  # ... and their first step
_WINDOW = 10  # generations whose mean is held against that of as many before
_BETTER = 0.98  # of the cost: what is more is no gain, but the luck of a draw
_PAYS = 0.9  # of the cost of full speed: at the door of the task order costs 0.65 of it, and what luck finds 0.98
MOST, SHOWN = 150, 20  # generations before a training, and between those that a learning curve shows

# Takes the steps so far and what returns the policy as it is now; returns whether to go on.
GoesOn = Callable[[int, Callable[[], Policy]], bool]
# Takes decisions so far, and the best policy so far.
Saw = Callable[[int, Policy], object]


@dataclass(frozen=True)
class EvolutionSettings:
    """Budget of a search."""

    population: int = 12  # candidates of a generation, all of them judged on the same draws ...
    draws: int = 6  # ... which are others in every generation
    endless: bool = False  # go on after a new beginning was in vain


def evolve(
    place: Scenario, options: dict[str, Any], seed: int, goes_on: GoesOn, settings: EvolutionSettings | None = None
) -> None:
    """Search the weights of `Evolved` that let the last person out soonest, until ``goes_on`` says that it is enough.

    What is minimised is the mean time of the last person over the draws of a generation; a run in which somebody is left
    counts as its time limit and a second for each of them.  All candidates run side by side in one batch, with half of the
    people of the place.  ``goes_on`` looks at the best so far.

    A search that gets no better begins anew where it is, with the step size it had at first: what looks like an end is often
    a loose crowd that waits, from which there is a way on.  When that was in vain, the last generations have all the people.
    Where the crowd is hardly better than at full speed it has not found order: it begins at nothing again, with twice the step.

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
    settings = settings or EvolutionSettings()
    population, draws = settings.population, settings.draws
    everybody = place.population.people
    env = _rooms(place, options, max(1, round(SHARE * everybody)), population * draws)
    nothing, far = np.zeros(len(fields(Evolved))), _STEP
    best = former = nothing
    search = _begun(best, _STEP, population, seed)
    rng, steps, first, course, before, left = np.random.default_rng(seed), 0, 0, list[float](), np.inf, np.inf
    while goes_on(steps, partial(_rule, best)) and left > 0:
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


def _rooms(place: Scenario, options: dict[str, Any], people: int, rooms: int) -> CrowdEnv:
    """Return a batch of a place with so many of its people, who are given up early."""
    crowd = place.population.changed(people=people)
    short = replace(place, population=crowd, time_limit=_SECONDS * people, blocked_after=_PATIENCE)
    return CrowdEnv(short, num_envs=rooms, **arguments_of({**options, **Evolved().env_options}))


def _begun(mean: Floats, step: float, population: int, seed: int) -> Any:
    """Return a search around a mean."""
    import cma

    told = {"popsize": population, "seed": seed + 1, "verbose": -9}  # 0 is the clock
    return cma.CMAEvolutionStrategy(mean, step, told)


def first_rule(
    config: Mapping[str, Any], folder: Path | None = None, threads: int = 1, saw: Saw | None = None
) -> WalkingRule | None:
    """Return the rule whose clone a training begins at; None: it begins at full speed.

    From nothing it is what a search finds, a minute of a core.  The ``folder`` of a run keeps it, so that a run that is gone on
    with does not search again.  ``saw`` is shown the best policy so far now and then.
    """
    if config["start"] == RULE:
        return None
    if config["start"] != NOTHING:
        return start_of(config)
    kept = None if folder is None else folder / FOUND
    if kept is not None and kept.exists():
        return Evolved(**read_json(kept))
    found: list[Policy] = []

    def goes_on(steps: int, policy: Callable[[], Policy]) -> bool:
        if len(found) % SHOWN == 0:
            say(f"searching from nothing: {len(found)} generations")
            if saw is not None:
                saw(steps, policy())
        found.append(policy())
        return len(found) <= MOST

    evolve(place_of(config), {**physics_of(config), "threads": threads}, config["seed"], goes_on)
    if kept is not None:
        write_json(kept, asdict(cast(Evolved, found[-1])))
    return cast(Evolved, found[-1])


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
