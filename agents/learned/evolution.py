"""CMA-ES over the weights of a rule that all people share: no gradients, no network, and nothing to begin with.

All weights are 0 at first, which is full speed.  Everybody in a room has the same weights, so that all deviate from that
together: what pays only where everyone does it, such as a gap that all keep, is tried as one thing.  Noise on each person's own
actions, by which PPO explores, averages to nothing over the half second in which a body follows.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from crowd_env import CrowdEnv, Scenario
from crowd_env.core.arrays.state import Floats
from crowd_env.core.console import notes, progress_bar, say
from crowd_env.core.files.json_file import read_json, write_json
from crowd_env.envs.settings import arguments_of

from ..evaluation.entries import RULE
from ..evaluation.evaluation import HELD_OUT_SEED
from ..policy import Policy
from ..training_config import NOTHING, physics_of, place_of, start_of
from ..walking import Evolved, WalkingRule, inputs

FOUND = "search.json"  # weights, in the folder of a run
GENERATIONS = 60
_PATIENCE = 30.0  # s without anyone getting out, after which a run is given up
_SECONDS = 2.5  # s a person, which a run may take: exits of 0.4 people a second


# Takes the steps so far and what returns the policy as it is now; returns whether to go on.
GoesOn = Callable[[int, Callable[[], Policy]], bool]


@dataclass(frozen=True)
class EvolutionSettings:
    """Budget of a generation."""

    population: int = 12  # candidates of a generation, all of them judged on the same draws ...
    draws: int = 6  # ... which are others in every generation


def evolve(
    place: Scenario, options: dict[str, Any], seed: int, goes_on: GoesOn, settings: EvolutionSettings | None = None
) -> None:
    """Search the weights of `Evolved` that let the last person out soonest, until ``goes_on`` says that it is enough.

    What is minimised is the mean time of the last person over the draws of a generation; a run in which somebody is left
    counts as its time limit and a second for each of them.  All candidates run side by side in one batch.  ``goes_on`` looks at
    the best so far.

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
    population, draws = settings.population, settings.draws
    short = replace(place, time_limit=_SECONDS * place.population.people, blocked_after=_PATIENCE)
    arguments = arguments_of({**options, **Evolved().env_options})
    env = CrowdEnv(short, num_envs=population * draws, **arguments)
    told = {"popsize": population, "seed": seed + 1, "verbose": -9}  # 0 is the clock
    search = cma.CMAEvolutionStrategy(np.zeros(len(Evolved.__dataclass_fields__)), 1.0, told)
    rng, steps = np.random.default_rng(seed), 0
    while goes_on(steps, lambda: Evolved(*search.result.xfavorite.tolist())):
        first = int(rng.integers(0, HELD_OUT_SEED - draws))
        candidates = search.ask()
        costs, decided = _race(env, np.repeat(candidates, draws, axis=0), [*range(first, first + draws)] * population)
        search.tell(candidates, costs.reshape(population, draws).mean(axis=1))
        steps += decided


def first_rule(config: Mapping[str, Any], folder: Path | None = None, threads: int = 1) -> WalkingRule | None:
    """Return the rule whose clone a training begins at; None: it begins at full speed.

    From nothing it is what a search finds in 60 generations, a minute or two of a core.  The ``folder`` of a run keeps it, so
    that a run that is gone on with does not search again.
    """
    if config["start"] == RULE:
        return None
    if config["start"] != NOTHING:
        return start_of(config)
    kept = None if folder is None else folder / FOUND
    if kept is not None and kept.exists():
        return Evolved(**read_json(kept))
    found: list[Policy] = []
    with progress_bar("searching from nothing, generations", GENERATIONS) as progress:

        def goes_on(steps: int, policy: Callable[[], Policy]) -> bool:
            found.append(policy())
            progress(1)
            if not notes.is_terminal and len(found) % 15 == 1:
                say(f"searching from nothing: {len(found) - 1} of {GENERATIONS} generations")
            return len(found) <= GENERATIONS

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
