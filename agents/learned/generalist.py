"""One policy for every place, from nothing: who does best in each place teaches there, and PPO goes on in all of them.

Teachers are full speed, the weights that a search found from nothing, and specialists that were trained from nothing for a
task.  Which of them is best in a place is seen in hindsight: all walk there, and fewer people left count before less time.  One
network learns from all teachers at once (DAgger; Ross, Gordon, Bagnell 2011), each in its places, and is told neither the place
nor the contact law.  PPO then trains it in generated places and those of the tasks.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from crowd_env import GeneratedCrowds, ObservationLayout, Scenario
from crowd_env.core.arrays.state import Floats
from crowd_env.core.console import progress_bar, say
from crowd_env.core.executors import Executor, Processes, Serial
from crowd_env.core.executors.executor import never
from crowd_env.core.files.json_file import read_json, write_json
from crowd_env.envs.action import make_action
from crowd_env.envs.rollout import run_episodes
from crowd_env.scenarios.generated import Conditions

from .. import make_policy
from ..drivers import policy_driver
from ..evaluation.entries import RULE
from ..evaluation.goals import at_goals
from ..evaluation.plans import BLOCK, judge_plans
from ..policy import Policy
from ..rules import StrategyPolicy
from ..tasks import TASKS
from ..tasks.presets import PRESETS, training_place

TEACHERS = (RULE, "yield-when-stuck", "evolution", "hertz-room/ppo", "narrow-door/ppo", "counter-flow/ppo")
KEPT = "teachers.json"
_DRAWS = 12  # of each place of a task, below those that are held out
_LONGEST = 150.0  # s  of a run in the place of a task


class Beside(NamedTuple):
    """A place of a task that is trained in beside the generated ones."""

    name: str
    place: Scenario
    conditions: Conditions


def places_of_tasks(people: int) -> list[Beside]:
    """Return the places of all tasks of at most so many people, and those in which their presets train."""
    found = []
    for name, task in TASKS.items():
        if task.learned_share is not None or task.selfish or task.people > people:
            continue
        conditions = Conditions(task.scheme, str(task.manner), 0.0)
        places = [task.place()]
        if name in PRESETS and (PRESETS[name].people, PRESETS[name].options) != (task.people, {}):
            preset = PRESETS[name]
            places.append(training_place(task.scenario, {**task.options, **preset.options}, preset.people))
        found += [
            Beside(name, replace(one, time_limit=min(one.time_limit, _LONGEST), strategy=task.rule), conditions)
            for one in places
        ]
    return found


def make_crowds(config: Mapping[str, Any], envs: int) -> GeneratedCrowds:
    """Return the batch in which a generalist is trained."""
    places = config["places"]
    beside = [(one.place, one.conditions) for one in places_of_tasks(places["people"])]
    options = {name: config[name] for name in ("action", "observation", "reward", "decision_dt")}
    options["observation"] = ObservationLayout(**config["observation"])
    drawn = {name: places[name] for name in ("people", "seeds", "share")}
    return GeneratedCrowds(envs, beside=beside, **drawn, **options)


class Teachers(NamedTuple):
    """Who teaches where."""

    of_seed: Mapping[int, str]  # of a generated place
    of_beside: Sequence[str]  # of the places of tasks

    def of(self, place: int) -> str:
        """Return the teacher of a place as `GeneratedCrowds.place_of_env` has it."""
        return self.of_beside[-1 - place] if place < 0 else self.of_seed[place]


def find_teachers(config: Mapping[str, Any], folder: Path | None, threads: int = 1) -> Teachers:
    """Return who is best in each place; the ``folder`` of a run keeps it, and all that was walked to find out."""
    kept = None if folder is None else folder / KEPT
    if kept is not None and kept.exists():
        found = read_json(kept)
        return Teachers({int(seed): name for seed, name in found["of_seed"].items()}, found["of_beside"])
    places = config["places"]
    executor: Executor = Processes(threads) if threads > 1 else Serial()
    of_beside = _best_beside(places_of_tasks(places["people"]), executor)
    plans = -(-places["taught"] // BLOCK) * BLOCK
    with progress_bar("finding teachers, evacuations", plans * len(TEACHERS)) as progress:
        judged = judge_plans(
            TEACHERS, plans, first=0, most=places["people"], executor=executor, progress=progress,
            folder=None if folder is None else folder / "teachers",
        )  # fmt: skip
    # The time is infinite where somebody was left or strayed.
    cost = np.array([np.where(np.isinf(one.time), 1e6 * (one.left + one.strayed), one.time) for one in judged.values()])
    walked = np.flatnonzero(~np.isnan(cost).any(axis=0))
    best = np.argmin(cost[:, walked], axis=0)
    teachers = Teachers({int(seed): TEACHERS[k] for seed, k in zip(walked, best, strict=True)}, of_beside)
    if kept is not None:
        write_json(
            kept, {"of_seed": {str(seed): name for seed, name in teachers.of_seed.items()}, "of_beside": of_beside}
        )
    return teachers


def _best_beside(places: Sequence[Beside], executor: Executor) -> list[str]:
    pieces = [(one, name) for one in places for name in TEACHERS]
    costs: dict[int, tuple[float, float]] = {}
    with progress_bar("finding teachers of tasks", len(pieces)) as progress:

        def done(k: int, cost: tuple[float, float]) -> None:
            costs[k] = cost
            progress(1)

        executor.run(_cost_beside, pieces, done)
    count = len(TEACHERS)
    every = [[costs[p * count + k] for k in range(count)] for p in range(len(places))]
    return [TEACHERS[one.index(min(one))] for one in every]


def _cost_beside(piece: tuple[Beside, str], stopped: Callable[[], bool] = never) -> tuple[float, float]:
    """Return how many people a policy leaves in some draws of a place, and the mean time of the last [s]."""
    (_, place, conditions), name = piece
    options: dict[str, Any] = {
        "scheme": conditions.law,
        "manner": conditions.manner,
        "strategy": place.strategy_of_run(),
    }
    driver = replace(policy_driver(_policy(name, place), place, **options), passes_rest=True)
    episodes = [at_goals(one, place) for one in run_episodes(place, _DRAWS, driver=driver)]
    left = float(sum(episode.metrics.unfinished for episode in episodes))
    return left, float(np.mean([episode.end for episode in episodes]))


def _policy(name: str, place: Scenario) -> Policy:
    return StrategyPolicy(place.strategy_of_run(), name=RULE) if name == RULE else make_policy(name)


class Hindsight:
    """Wants in every place what its teacher wants there, of a batch whose observation holds the terms of all teachers.

    Parameters
    ----------
    env : where people walk.
    teachers : who teaches where.
    """

    name = "the best teacher of each place"

    def __init__(self, env: GeneratedCrowds, teachers: Teachers) -> None:
        self._env, self._teachers = env, teachers
        self._acts: dict[str, Callable[[np.ndarray, np.random.Generator], Floats]] = {}

    def act(self, observation: np.ndarray, layout: ObservationLayout, rng: np.random.Generator) -> Floats:
        """Return commands (P, 2) along and to the left of the way, as multiples of the own desired speed."""
        wanted = np.tile([1.0, 0.0], (len(observation), 1))
        rooms: dict[str, list[int]] = {}
        for e, place in enumerate(self._env.place_of_env):
            rooms.setdefault(self._teachers.of(place), []).append(e)
        for name, environments in rooms.items():
            if name == RULE:
                continue
            rows = np.flatnonzero(np.isin(self._env.env_of_person, environments))
            if name not in self._acts:
                self._acts[name] = _acting(name, layout)
            wanted[rows] = self._acts[name](observation[rows], rng)
        return wanted


def _acting(name: str, layout: ObservationLayout) -> Callable[[np.ndarray, np.random.Generator], Floats]:
    """Return what turns rows of a larger observation into what a policy wants there."""
    policy = make_policy(name)
    own, kind = policy.env_options["observation"], make_action(policy.env_options["action"])
    columns = np.concatenate([np.arange(layout[term].start, layout[term].stop) for term in own.names])
    return partial(_wanted, policy, own, kind, columns)


def _wanted(policy: Policy, own: ObservationLayout, kind: Any, columns: Any, rows: np.ndarray, rng: Any) -> Floats:
    return np.asarray(kind.decoded(np.asarray(policy.act(rows[:, columns], own, rng)))[0], dtype=np.float64)


def distil(model: Any, config: Mapping[str, Any], folder: Path | None, threads: int = 1) -> None:
    """Let the policy of a new model learn from the best teacher of each place."""
    from .cloning import batch_of, clone

    teachers = find_teachers(config, folder, threads)
    counts = {name: list(teachers.of_seed.values()).count(name) for name in TEACHERS}
    said = ", ".join(f"{name} {count}" for name, count in counts.items() if count)
    say(f"learning from the best teacher of {len(teachers.of_seed)} generated places ({said}), and of the tasks ...")
    places = config["places"]
    env = batch_of(model)
    env.seeds = -(-places["taught"] // BLOCK) * BLOCK
    clone(model, Hindsight(env, teachers), config["seed"], rounds=places["rounds"], decisions=200, kept=0.1, cooled=0.4)
    env.seeds = places["seeds"]
