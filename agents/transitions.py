"""Runs of a policy as arrays, for learners that take data instead of an environment: cloning, offline learning, world models.

A file is an .npz of NumPy: ``numpy.load(path)`` reads a run when it is asked for.  Run ``k`` of T decisions of N people holds

    k/observation (T + 1, N, D) float32   what was seen before each decision, and after the last one
    k/action      (T, N, ...)             what was done; the neutral action where the rule decided
    k/reward      (T, N)        float32
    k/mask        (T, N)        bool      who was inside and decided: only these rows are worth learning from
    k/terminated  (T, N)        bool      got out in the step
    k/truncated   (T, N)        bool      was still inside when the run ended

and ``facts``, JSON: task, policy, seeds, columns of the observation, kind of action, reward, interval of decisions.
Minari keeps episodes of one agent, hence not who acted beside whom; these arrays turn into its episodes person by person.
"""

import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crowd_env import ObservationLayout
from crowd_env.core.checks import Range, whole
from crowd_env.core.files.atomic import check_suffix, written
from crowd_env.envs.action import plain_action

from .drivers import DrivenCrowd
from .evaluation.evaluation import HELD_OUT_SEED
from .policy import Policy
from .runs import versions
from .tasks import PRESETS, Task

_FACTS = "facts"


class _Noted:
    """A policy that remembers what it saw and did last."""

    def __init__(self, policy: Policy) -> None:
        self.policy, self.name, self.env_options = policy, policy.name, policy.env_options
        self.observation, self.action = np.zeros(0), np.zeros(0)

    def reset(self, env_mask: np.ndarray) -> None:
        self.policy.reset(env_mask)

    def act(self, observation: np.ndarray, layout: ObservationLayout, rng: np.random.Generator) -> np.ndarray | None:
        action = self.policy.act(observation, layout, rng)
        self.observation, self.action = observation, np.zeros(0) if action is None else np.asarray(action)
        return action


class RunArrays(NamedTuple):
    """The arrays of a run; see above."""

    observation: np.ndarray
    action: np.ndarray
    reward: np.ndarray
    mask: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray


def runs_of(policy: Policy, task: Task, runs: int, seed: int = 0) -> Iterator[tuple[dict[str, object], RunArrays]]:
    """Yield the facts and the arrays of one run after the other; run ``k`` is the draw ``seed + k``, none of which is held out.

    Rewards are those of the task's preset, if there is one.

    Raises
    ------
    ValueError
        If the seeds reach into the held-out draws.
    """
    whole("runs", runs, Range(1, HELD_OUT_SEED))
    whole("seed", seed, Range(0, HELD_OUT_SEED - runs).because("later draws are held out for evaluation"))
    noted, reward = _Noted(policy), PRESETS[task.name].reward if task.name in PRESETS else None
    driver = DrivenCrowd(noted, task.place(), {**task.arguments(), "reward": reward})(1)
    env = driver.env
    neutral = np.asarray(env.action_kind.neutral)
    facts = {
        "task": task.identity(),
        "policy": policy.name,
        "columns": {name: [env.layout[name].start, env.layout[name].stop] for name in env.layout.names},
        "action": plain_action(env.action_kind),
        "reward": dict(reward or {}),
        "decision_dt": env.decision_dt,
        "versions": versions(),
    }
    for k in range(runs):
        driver.reset([seed + k])
        rows: list[tuple[np.ndarray, ...]] = []
        last = np.zeros((env.num_people, env.layout.size), np.float32)
        while not env.finished.all():
            inside = env.active.copy()
            step = driver.step()
            action = noted.action if noted.action.size else np.broadcast_to(neutral, (env.num_people, *neutral.shape))
            done = step.terminated.copy(), step.truncated.copy()
            rows.append((noted.observation.copy(), action, step.reward.astype(np.float32), inside, *done))
            last = step.observation.copy()
        observation, *others = (np.stack(part) for part in zip(*rows, strict=True))
        yield facts, RunArrays(np.concatenate([observation, last[None]]), *others)


def write_runs(path: str | Path, policy: Policy, task: Task, runs: int, seed: int = 0) -> int:
    """Write runs of a policy to a file, one after the other, and return how many.

    The file appears when it is whole.  At Ctrl-C it is whole with the runs that have ended, if there is one.

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
            for told, run in runs_of(policy, task, runs, seed):
                facts = told
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


def _add(file: zipfile.ZipFile, name: str, array: np.ndarray) -> None:
    with file.open(f"{name}.npy", "w", force_zip64=True) as member:
        np.lib.format.write_array(member, array, allow_pickle=False)
