"""Runs of a policy as arrays, for learning from data instead of an environment: cloning, offline learning, world models.

A file is an .npz of NumPy; ``numpy.load(path)`` reads a run on access.  Run ``k`` of T decisions of N pedestrians holds

    k/observation (T + 1, N, D) float32   before each decision, and after the last one
    k/action      (T, N, ...)             the action; the neutral one where the rule of the environment decided
    k/reward      (T, N)        float32
    k/mask        (T, N)        bool      the pedestrian was inside and decided: only these rows are worth learning from
    k/terminated  (T, N)        bool      the pedestrian left in the step
    k/truncated   (T, N)        bool      the pedestrian was still inside at the end of the run

and ``facts``, JSON: task, policy, seeds, columns of the observation, kind of action, reward, interval of decisions.
Minari stores episodes of single agents: `write_minari` makes one of each pedestrian, with the numbers of both beside it.
"""

import importlib
import json
import shutil
import warnings
import zipfile
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import gymnasium
import numpy as np

from crowd_env import CrowdEnv
from crowd_env.core.checks import Range, whole
from crowd_env.core.files.atomic import check_suffix, written
from crowd_env.core.libraries import needed_for
from crowd_env.envs.action import make_action, plain_action
from crowd_env.envs.tasks.task import HELD_OUT_SEED

from .drivers import own_arguments
from .policy import Policy
from .runs import versions
from .tasks import Task
from .trained import columns_of

_FACTS = "facts"


class RunArrays(NamedTuple):
    """The arrays of a run, see the module docstring."""

    observation: np.ndarray
    action: np.ndarray
    reward: np.ndarray
    mask: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray


def runs_of(policy: Policy, task: Task, runs: int, seed: int = 0) -> Iterator[tuple[dict[str, object], RunArrays]]:
    """Yield the facts and the arrays of each run; run ``k`` is the draw ``seed + k``, and no draw is held out.

    The task gives the rewards.

    Raises
    ------
    ValueError
        If a seed is among the held-out draws.
    """
    whole("runs", runs, Range(1, HELD_OUT_SEED))
    whole("seed", seed, Range(0, HELD_OUT_SEED - runs).because("later draws are held out for evaluation"))
    reward = task.reward
    env = CrowdEnv(task.place(), **{**task.arguments(), "reward": reward, **own_arguments(policy)})
    neutral = np.asarray(env.action_kind.neutral)
    rule = np.broadcast_to(neutral, (env.num_people, *neutral.shape))
    facts = {
        "task": task.identity(),
        "policy": policy.name,
        "columns": columns_of(env.layout),
        "action": plain_action(env.action_kind),
        "reward": dict(reward or {}),
        "decision_dt": env.decision_dt,
        "versions": versions(),
    }
    for k in range(runs):
        rows: list[tuple[np.ndarray, ...]] = []
        observation, _ = env.reset([seed + k])
        policy.reset(np.ones(1, dtype=bool))
        rng = np.random.default_rng(seed + k)
        while not env.finished.all():
            seen, inside = observation.copy(), env.active.copy()
            action = policy.act(seen, env.layout, rng)
            step = env.step(action)
            observation, ended = step.observation, (step.terminated.copy(), step.truncated.copy())
            acted = rule if action is None else np.asarray(action)
            rows.append((seen, acted, step.reward.astype(np.float32), inside, *ended))
        before, *others = (np.stack(part) for part in zip(*rows, strict=True))
        yield facts, RunArrays(np.concatenate([before, observation[None]]), *others)


def write_runs(path: str | Path, policy: Policy, task: Task, runs: int, seed: int = 0) -> int:
    """Write runs of a policy to a file, one after the other, and return their number.

    The file appears when it is whole.  Ctrl-C leaves a whole file of the finished runs, if there is one.

    Raises
    ------
    ValueError
        If the name does not end in .npz, or as `runs_of`.
    """
    path = check_suffix(path, (".npz",))
    facts: dict[str, object] = {}
    stopped: KeyboardInterrupt | None = None
    with written(path) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file:
        done = 0
        try:
            for common, run in runs_of(policy, task, runs, seed):
                facts = common
                for name, array in run._asdict().items():
                    _add(file, f"{done}/{name}", array)
                done += 1
        except KeyboardInterrupt as error:
            if not done:
                raise
            stopped = error
        facts |= {"runs": done, "seeds": [seed + k for k in range(done)]}
        _add(file, _FACTS, np.array(json.dumps(facts, allow_nan=False)))
    if stopped is not None:
        raise stopped
    return done


def minari_for(dataset: str) -> ModuleType:
    """Return the library Minari for a new dataset of this id.

    Raises
    ------
    ModuleNotFoundError
        If it is not installed, or h5py, in which it stores.
    ValueError
        If the id is malformed or taken.
    """
    with needed_for("a dataset of Minari", "minari h5py"):
        minari = importlib.import_module("minari")
        importlib.import_module("h5py")
    minari.dataset.minari_dataset.parse_dataset_id(dataset)
    if dataset in minari.list_local_datasets():
        raise ValueError(f"there is a dataset {dataset!r} already; take another id, or delete it")
    return minari


def write_minari(dataset: str, path: str | Path) -> int:
    """Write a file of runs as a dataset of Minari, an episode a pedestrian, and return the number of episodes.

    Episodes follow each other run by run.  ``seed`` of one is that of its run; ``options`` are ``run`` and ``pedestrian``, the
    numbers by which the episodes of a crowd belong together.  Step t is the t-th decision of the run in all of them.

    Parameters
    ----------
    dataset : its id, such as "crowd_env/room/evolution-v0", in the folder of Minari's datasets.

    Raises
    ------
    ModuleNotFoundError, ValueError
        As `minari_for`.
    """
    minari = minari_for(dataset)
    with np.load(path) as file, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # it misses an author and an environment, which has other spaces
        facts = json.loads(str(file[_FACTS]))
        space = make_action(facts["action"]).space

        def episodes() -> Iterator[object]:
            for k, seed in enumerate(facts["seeds"]):
                run = RunArrays(*(file[f"{k}/{name}"] for name in RunArrays._fields))
                for i, count in enumerate(run.mask.sum(axis=0)):  # decisions, from the start on
                    yield minari.data_collector.EpisodeBuffer(
                        seed=seed,
                        options={"run": k, "pedestrian": i},
                        observations=run.observation[: count + 1, i],
                        actions=run.action[:count, i].astype(space.dtype),
                        rewards=run.reward[:count, i],
                        terminations=run.terminated[:count, i],
                        truncations=run.truncated[:count, i],
                    )

        try:
            made = minari.create_dataset_from_buffers(
                dataset,
                episodes(),
                observation_space=gymnasium.spaces.Box(-1.0, 1.0, file["0/observation"].shape[2:], np.float32),
                action_space=space,
                algorithm_name=facts["policy"],
                description=json.dumps(facts),
            )
        except BaseException:  # Ctrl-C too: whole or not at all
            shutil.rmtree(minari.storage.get_dataset_path(dataset), ignore_errors=True)
            raise
    return int(made.total_episodes)


def _add(file: zipfile.ZipFile, name: str, array: np.ndarray) -> None:
    with file.open(f"{name}.npy", "w", force_zip64=True) as member:
        np.lib.format.write_array(member, array, allow_pickle=False)
