"""One policy for every place, from nothing: cloning of the best expert policy of each place, then PPO in all of them.

Expert policies are full speed, the weights from a search from nothing, and specialists that were trained from nothing for a
task.  All of them walk in each place.  The best one leaves the fewest pedestrians inside, then takes the least time.  One
network learns from all experts at once (DAgger; Ross, Gordon, Bagnell 2011), each in its places.  It observes neither the place
nor the contact law.  PPO then trains it in generated places and in places of tasks.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from stable_baselines3 import PPO

from crowd_env import GeneratedCrowds, ObservationLayout, Scenario
from crowd_env.core.arrays.state import Floats
from crowd_env.core.console import progress_bar, say
from crowd_env.core.executors import Executor, Processes, Serial
from crowd_env.core.files.json_file import read_json, write_json
from crowd_env.envs.action import make_action
from crowd_env.scenarios.generated import Conditions

from .. import make_policy
from ..drivers import DrivenCrowd
from ..evaluation.entries import RULE
from ..evaluation.evaluation import Evaluation, evaluate_crowds
from ..evaluation.plans import BLOCK, judge_plans
from ..policy import Policy
from ..rules import StrategyPolicy
from ..training_config import GeneratedPlaces, places_of_tasks
from .cloning import batch_of, clone

EXPERTS = (RULE, "yield-when-stuck", "evolution", "hertz-room/ppo", "narrow-door/ppo", "counter-flow/ppo")
KEPT = "teachers.json"
_DRAWS = 12  # of each place of a task, below the held-out ones
_expert = cache(make_policy)


class BestExperts(NamedTuple):
    """The best expert policy of each place, as ``teachers.json`` holds it."""

    of_seed: Mapping[str, str]  # seed of a generated place -> name
    of_beside: Sequence[str]  # of the places of tasks

    def of(self, place: int) -> str:
        """Return the best expert of a place, numbered as in `GeneratedCrowds.place_of_env`."""
        return self.of_beside[-1 - place] if place < 0 else self.of_seed[str(place)]


def find_experts(places: GeneratedPlaces, folder: Path | None, threads: int = 1) -> BestExperts:
    """Return the best expert of each place; the ``folder`` of a run keeps it with all compared evacuations."""
    kept = folder and folder / KEPT
    if kept and kept.exists():
        return BestExperts(**read_json(kept))
    executor: Executor = Processes(threads) if threads > 1 else Serial()
    of_beside = _best_beside(places_of_tasks(places.people), executor)
    plans = _taught(places)
    with progress_bar("finding experts, evacuations", plans * len(EXPERTS)) as progress:
        judged = judge_plans(
            EXPERTS, plans, first=0, most=places.people, executor=executor, progress=progress,
            folder=folder and folder / "teachers",
        )  # fmt: skip
    # The time is infinite where a pedestrian was left inside or strayed.
    cost = np.array([np.where(np.isinf(one.time), 1e6 * (one.left + one.strayed), one.time) for one in judged.values()])
    walked = np.flatnonzero(~np.isnan(cost).any(axis=0))
    best = np.argmin(cost[:, walked], axis=0)
    experts = BestExperts({str(seed): EXPERTS[k] for seed, k in zip(walked, best, strict=True)}, of_beside)
    if kept:
        write_json(kept, experts._asdict())
    return experts


def _taught(places: GeneratedPlaces) -> int:
    """Return the number of generated places with an expert: whole blocks."""
    return -(-places.taught // BLOCK) * BLOCK


def _best_beside(places: Sequence[tuple[Scenario, Conditions]], executor: Executor) -> list[str]:
    """Return the best expert of each place of a task, over some draws."""
    pairs = [(p, name) for p in range(len(places)) for name in EXPERTS]
    crowds, found = [_crowd(name, *places[p]) for p, name in pairs], dict[int, Evaluation]()
    with progress_bar("finding experts of tasks, evacuations", _DRAWS * len(crowds)) as progress:
        evaluate_crowds(
            crowds, runs=_DRAWS, first_seed=0, executor=executor, finished=found.__setitem__, progress=progress
        )
    cost = {pair: (found[k].column("unfinished").sum(), found[k].ended.mean()) for k, pair in enumerate(pairs)}
    return [min(EXPERTS, key=lambda name: cost[p, name]) for p in range(len(places))]


def _crowd(name: str, place: Scenario, conditions: Conditions) -> DrivenCrowd:
    way = place.strategy_of_run()
    return DrivenCrowd(
        _policy(name, way), place, {"physics": conditions.law, "walking": conditions.manner, "routing": way}
    )


def _policy(name: str, strategy: str) -> Policy:
    return StrategyPolicy(strategy, name=RULE) if name == RULE else make_policy(name)


class ExpertOfEachPlace:
    """Acts in every place as the best expert there, in a batch whose observation holds the terms of all experts.

    Parameters
    ----------
    env : the batch of places.
    experts : the best expert of each place.
    """

    name = "the best expert of each place"

    def __init__(self, env: GeneratedCrowds, experts: BestExperts) -> None:
        self._env, self._experts = env, experts

    def act(self, observation: np.ndarray, layout: ObservationLayout, rng: np.random.Generator) -> Floats:
        """Return commands (P, 2) along and to the left of the path, as multiples of each desired speed."""
        wanted = np.tile([1.0, 0.0], (len(observation), 1))
        names = np.array([self._experts.of(place) for place in self._env.place_of_env])
        for name in dict.fromkeys(names.tolist()):
            if name == RULE:
                continue
            options = _expert(name).env_options
            rows, own = np.flatnonzero((names == name)[self._env.env_of_person]), options["observation"]
            seen = observation[rows][:, np.r_[tuple(layout[term] for term in own.names)]]
            action = np.asarray(_expert(name).act(seen, own, rng))
            wanted[rows] = make_action(options["action"]).decoded(action)[0]
        return wanted


def distill(model: PPO, places: GeneratedPlaces, seed: int, folder: Path | None, threads: int = 1) -> None:
    """Let the policy of a new model learn from the best expert of each place."""
    experts = find_experts(places, folder, threads)
    shares = ", ".join(f"{name} {count}" for name, count in Counter(experts.of_seed.values()).most_common())
    say(f"learning from the best expert of {len(experts.of_seed)} generated places ({shares}), and of the tasks ...")
    env = batch_of(model)
    assert isinstance(env, GeneratedCrowds)
    env.seeds = _taught(places)
    clone(model, ExpertOfEachPlace(env, experts), seed, rounds=places.rounds, decisions=200, kept=0.1, cooled=0.4)
    env.seeds = places.seeds
