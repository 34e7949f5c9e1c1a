"""One policy for every place, from nothing: the best expert policy of each place is cloned, and PPO goes on in all of them.

Experts are full speed, the weights that a search found from nothing, and specialists that were trained from nothing for a
task.  All of them walk in each place; the best leaves the fewest people, then takes the least time.  One network learns from
all experts at once (DAgger; Ross, Gordon, Bagnell 2011), each in its places, and sees neither the place nor the contact law.
PPO then trains it in generated places and those of the tasks.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from stable_baselines3 import PPO

from crowd_env import GeneratedCrowds, ObservationLayout, Scenario
from crowd_env.core.arrays.state import Floats
from crowd_env.core.console import progress_bar, say
from crowd_env.core.executors import Executor, Processes, Serial
from crowd_env.core.executors.executor import never
from crowd_env.core.files.json_file import read_json, write_json
from crowd_env.envs.action import make_action
from crowd_env.envs.rollout import run_episodes

from .. import make_policy
from ..drivers import drive
from ..evaluation.entries import RULE
from ..evaluation.goals import at_goals
from ..evaluation.plans import BLOCK, judge_plans
from ..policy import Policy
from ..rules import StrategyPolicy
from ..training_config import GeneratedPlaces
from ..training_places import TaskPlace, places_of_tasks
from .cloning import batch_of, clone

EXPERTS = (RULE, "yield-when-stuck", "evolution", "hertz-room/ppo", "narrow-door/ppo", "counter-flow/ppo")
KEPT = "teachers.json"
_DRAWS = 12  # of each place of a task, below those that are held out


class BestExperts(NamedTuple):
    """The best expert of each place."""

    of_seed: Mapping[int, str]  # of a generated place
    of_beside: Sequence[str]  # of the places of tasks

    def of(self, place: int) -> str:
        """Return the best expert of a place as `GeneratedCrowds.place_of_env` has it."""
        return self.of_beside[-1 - place] if place < 0 else self.of_seed[place]


def find_experts(places: GeneratedPlaces, folder: Path | None, threads: int = 1) -> BestExperts:
    """Return the best expert of each place; the ``folder`` of a run keeps it, with all evacuations that were compared."""
    kept = None if folder is None else folder / KEPT
    if kept is not None and kept.exists():
        found = read_json(kept)
        return BestExperts({int(seed): name for seed, name in found["of_seed"].items()}, found["of_beside"])
    executor: Executor = Processes(threads) if threads > 1 else Serial()
    of_beside = _best_beside(places_of_tasks(places.people), executor)
    plans = _taught(places)
    with progress_bar("finding experts, evacuations", plans * len(EXPERTS)) as progress:
        judged = judge_plans(
            EXPERTS, plans, first=0, most=places.people, executor=executor, progress=progress,
            folder=None if folder is None else folder / "teachers",
        )  # fmt: skip
    # The time is infinite where somebody was left or strayed.
    cost = np.array([np.where(np.isinf(one.time), 1e6 * (one.left + one.strayed), one.time) for one in judged.values()])
    walked = np.flatnonzero(~np.isnan(cost).any(axis=0))
    best = np.argmin(cost[:, walked], axis=0)
    experts = BestExperts({int(seed): EXPERTS[k] for seed, k in zip(walked, best, strict=True)}, of_beside)
    if kept is not None:
        write_json(
            kept, {"of_seed": {str(seed): name for seed, name in experts.of_seed.items()}, "of_beside": of_beside}
        )
    return experts


def _taught(places: GeneratedPlaces) -> int:
    """Return how many generated places have an expert: whole blocks."""
    return -(-places.taught // BLOCK) * BLOCK


def _best_beside(places: Sequence[TaskPlace], executor: Executor) -> list[str]:
    pieces = [(one, name) for one in places for name in EXPERTS]
    costs: dict[int, tuple[float, float]] = {}
    with progress_bar("finding experts of tasks", len(pieces)) as progress:

        def done(k: int, cost: tuple[float, float]) -> None:
            costs[k] = cost
            progress(1)

        executor.run(_cost_beside, pieces, done)
    count = len(EXPERTS)
    every = [[costs[p * count + k] for k in range(count)] for p in range(len(places))]
    return [EXPERTS[one.index(min(one))] for one in every]


def _cost_beside(piece: tuple[TaskPlace, str], stopped: Callable[[], bool] = never) -> tuple[float, float]:
    """Return how many people a policy leaves in some draws of a place, and the mean time of the last [s]."""
    (_, place, conditions), name = piece
    way, law, walking = place.strategy_of_run(), conditions.law, conditions.manner
    driver = drive(_policy(name, place), place, physics=law, walking=walking, routing=way)
    driver = replace(driver, passes_rest=True)
    episodes = [at_goals(one, place) for one in run_episodes(place, _DRAWS, driver=driver)]
    left = float(sum(episode.metrics.unfinished for episode in episodes))
    return left, float(np.mean([episode.end for episode in episodes]))


def _policy(name: str, place: Scenario) -> Policy:
    return StrategyPolicy(place.strategy_of_run(), name=RULE) if name == RULE else make_policy(name)


class ExpertOfEachPlace:
    """Acts in every place as the best expert there, in a batch whose observation holds the terms of all experts.

    Parameters
    ----------
    env : where people walk.
    experts : the best of each place.
    """

    name = "the best expert of each place"

    def __init__(self, env: GeneratedCrowds, experts: BestExperts) -> None:
        self._env, self._experts = env, experts
        self._acts: dict[str, _Acting] = {}

    def act(self, observation: np.ndarray, layout: ObservationLayout, rng: np.random.Generator) -> Floats:
        """Return commands (P, 2) along and to the left of the path, as multiples of each desired speed."""
        wanted = np.tile([1.0, 0.0], (len(observation), 1))
        names = np.array([self._experts.of(place) for place in self._env.place_of_env])
        for name in dict.fromkeys(names.tolist()):
            if name == RULE:
                continue
            rows = np.flatnonzero((names == name)[self._env.env_of_person])
            if name not in self._acts:
                self._acts[name] = _acting(name, layout)
            wanted[rows] = self._acts[name](observation[rows], rng)
        return wanted


_Acting = Callable[[np.ndarray, np.random.Generator], Floats]


def _acting(name: str, layout: ObservationLayout) -> _Acting:
    """Return what turns rows of a larger observation into the commands of a policy."""
    policy = make_policy(name)
    own, kind = policy.env_options["observation"], make_action(policy.env_options["action"])
    columns = np.concatenate([np.arange(layout[term].start, layout[term].stop) for term in own.names])

    def commands(rows: np.ndarray, rng: np.random.Generator) -> Floats:
        return np.asarray(kind.decoded(np.asarray(policy.act(rows[:, columns], own, rng)))[0], dtype=np.float64)

    return commands


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
