"""Learning in a dilemma: best responses to a crowd, and crowds with other rewards."""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.console import say
from crowd_env.core.files.json_file import json_number, write_json
from crowd_env.core.files.store import Store
from crowd_env.envs.protocol import WalkingBatch
from crowd_env.envs.settings import arguments_of
from crowd_env.envs.tasks.task import HELD_OUT_SEED
from crowd_env.rendering import learning_curve, save_figure

from .. import make_policy
from ..evaluation.dilemma import (
    SHARES,
    RandomSpeed,
    among,
    deterrent,
    exploitability,
    follow,
    free_walks,
    gain,
    payoffs,
    price_of_anarchy,
)
from ..evaluation.entries import RULE
from ..evaluation.folder import source_stamp
from ..mixed import MixedEnv
from ..plain import Plain
from ..policy import Policy
from ..rules import StrategyPolicy
from ..runs import versions
from ..tasks import Task, make_preset, make_task
from ..trained import NUMBERS, LearnedPolicy
from ..training_config import TrainingConfig, make_env, physics_of, place_of, task_config
from ..walking import Evolved, Follow, HeadwayRule, Overtaking, overtake
from .actor_critic import network_of, std_of
from .evolution import begun
from .ppo import make_ppo
from .starts import begin
from .training import trained_in

_DOOR, _MIXED, _RUNS, _FEW = "dilemma-door", "dilemma-mixed", 60, 24
_QUEUES = "queue: `evolution`"
# Actions of a best response by PPO, which include overtaking; it begins at random choices.
_FREE = {"name": "speeds-directions", "speeds": [0.0, 0.5, 1.0], "headings": [k * math.pi / 6 for k in range(-3, 4)]}
# Settings of narrow-door, with which PPO moves further than with the preset.
_MOVES = {name: value for name, value in make_preset("narrow-door").ppo.items() if name != "rule_logit"}
# Of a best response: share of pedestrians that learn, rooms, s in which most of them leave, steps of all slots, samples.
_SHARE, _ROOMS, _LIMIT, _STEPS, _BATCH = 0.05, 16, 15.0, 3_000_000, 512
# Of a best response by search: candidates of a generation, draws of each, generations, and the first step of the weights.
_CANDIDATES, _DRAWS, _GENERATIONS, _STEP = 12, 3, 24, 0.3
# Training of a crowd -> task, start, and changes of the reward.
_PRICES = {"progress": 0.5, "time": 1.0, "contact": 1.0, "head": 5.0}
_TRAINED: Mapping[str, tuple[str, str, Plain]] = {
    "PPO, own time": (_DOOR, "evolution", {}),
    "PPO, own time, from full speed": (_DOOR, RULE, {}),
    "PPO, own time, 20 % push": (_MIXED, "evolution", {}),
    "PPO, time of all": (_DOOR, "evolution", {"team_share": 1.0}),
    "PPO, contacts and the head of the queue cost": (_DOOR, "evolution", {"weights": _PRICES}),
}
# Beside full speed and `follow`, what is judged among others that it never trained with.
_FOCAL = (_QUEUES, "`generalist`", "PPO, own time", "PPO, own time, 20 % push")


def train_crowd(task: str, start: str, reward: Plain, seed: int = 0) -> LearnedPolicy:
    """Return the last policy of PPO with the preset of a task, from a start, with a changed ``reward``.

    From full speed it takes `_MOVES`: with the settings of the preset the likeliest action never changes.
    """
    config = task_config(task, seed, start=start)
    ppo = replace(config.ppo, **_MOVES, rule_logit=1.0) if start == RULE else config.ppo
    config = replace(config, reward={**config.reward, **reward}, ppo=ppo)
    return _trained(cast(WalkingBatch, make_env(config)), config, config.steps)


def searched_response(crowd: Policy, task: str, seed: int = 0, generations: int = _GENERATIONS) -> Overtaking:
    """Return the rule by which one of twenty pedestrians is out soonest among others that follow a policy.

    CMA-ES searches the weights from full speed, in the place of the task with the step of its preset.  The cost is the mean
    time of these pedestrians; pedestrians still inside after 15 s count with that.

    Raises
    ------
    ModuleNotFoundError
        If the library cma is not installed.
    """
    judged = make_task(task)
    config = replace(task_config(task, seed, start=RULE), people=judged.people, options=dict(judged.options))
    env = _among(crowd, config, "continuous", _CANDIDATES * _DRAWS)
    search, rng = begun(np.array(Overtaking().weights), _STEP, _CANDIDATES, seed), np.random.default_rng(seed)
    for _ in range(generations):
        first, candidates = int(rng.integers(0, HELD_OUT_SEED - _DRAWS)), search.ask()
        seeds = [*range(first, first + _DRAWS)] * _CANDIDATES
        costs = _times(env, np.repeat(candidates, _DRAWS, axis=0), seeds)
        search.tell(candidates, costs.reshape(_CANDIDATES, _DRAWS).mean(axis=1))
    return Overtaking(tuple(np.asarray(search.result.xfavorite).tolist()))


def _times(env: MixedEnv, weights: Floats, seeds: list[int]) -> Floats:
    """Return the mean time (E,) [s] of pedestrians that `Overtaking` moves, by rows of weights (E, 22); at most the limit."""
    observation, _ = env.reset(seeds)
    action = np.zeros((env.num_people, 2))
    while (moved := env.learned & env.active).any():
        rows = np.flatnonzero(moved)
        action[rows] = overtake(observation[rows], env.layout, weights[env.env_of_person[rows]])
        observation = env.step(action).observation
        if env.finished.all():
            break
    times = np.nan_to_num(env.simulation.state.exit_time, nan=_LIMIT)
    return np.bincount(env.env_of_person[env.learned], times[env.learned]) / np.bincount(env.env_of_person[env.learned])


def best_response(crowd: Policy, task: str, seed: int = 0, steps: int = _STEPS) -> LearnedPolicy:
    """Return the policy that PPO learns from random choices, for its own time alone, among others that follow a policy.

    It may turn aside.  It has the observation of the crowd or, if that is a rule, of policies of the task.  One of
    twenty pedestrians learns.  An episode ends after 15 s, when most pedestrians that push have left.

    Parameters
    ----------
    task : name of the task; its preset gives the place.
    steps : of all pedestrians, including the crowd.
    """
    config = task_config(task, seed, start=RULE)
    env = _among(crowd, config, _FREE, _ROOMS, autoreset=True)
    ppo = replace(config.ppo, **{**_MOVES, "rule_logit": 0.0, "batch_size": _BATCH})
    return _trained(env, replace(config, ppo=ppo), steps)


def _among(crowd: Policy, config: TrainingConfig, action: str | Plain, rooms: int, autoreset: bool = False) -> MixedEnv:
    """Return rooms in which actions move one of twenty pedestrians, for its own time, and a policy the others."""
    observation = crowd.env_options["observation"] if isinstance(crowd, LearnedPolicy) else config.observation
    own = {"frame": config.frame, "action": action, "observation": observation}
    arguments = arguments_of({**physics_of(config), **own, "reward": {"progress": 0.5, "time": 1.0}})
    arguments |= {"num_envs": rooms, "time_limit": _LIMIT, "autoreset": autoreset}
    return MixedEnv(place_of(config), share=_SHARE, others=crowd, **arguments)


def _trained(env: WalkingBatch, config: TrainingConfig, steps: int) -> LearnedPolicy:
    model = make_ppo(env, config.ppo, config.seed)
    begin(model, config)
    model.learn(steps)
    return cast(LearnedPolicy, trained_in(env, network_of(model), config, std_of(model)))


def measure(out: Path) -> None:
    """Measure the cost of pushing, the gain of deviators, and the effect of learning; write table and figure to a folder.

    The folder keeps what is finished, so that the same command goes on.

    Raises
    ------
    ValueError
        If the folder holds results of another task or of other code.
    """
    task, mixed, push, queue = make_task(_DOOR), make_task(_MIXED), StrategyPolicy("shortest", name=RULE), Evolved()
    identity = {"tasks": [task.identity(), mixed.identity()], "runs": _RUNS, "code": source_stamp()}
    store = Store(out, identity, owned=("results.json", f"*{NUMBERS}"))
    with store.alone():
        store.keep("versions", versions())  # first: with it the folder is this command's
        free, responses = free_walks(task, runs=_RUNS), {}
        crowds = {"full speed": push, _QUEUES: queue, "`generalist`": make_policy("generalist")}
        rows: list[Plain] = []
        for title in (*crowds, *_TRAINED):
            if title in _TRAINED:
                crowds[title] = _network(out, f"crowd {title}", train_crowd, *_TRAINED[title])
            crowd = crowds[title]
            responses[title] = _network(out, f"response to {title}", best_response, crowd, _DOOR)
            searched = Overtaking(**_kept(store, f"search against {title}", _searched, crowd))
            deviators = {"push": push, "queue": queue, "ppo": responses[title], "search": searched}
            row = _kept(store, f"gains in {title}", _gains, crowd, task, deviators, free)
            rows.append({"crowd": title, **row, "price": price_of_anarchy((rows or [row])[0], row)})
        shares = [_kept(store, f"share {share:g}", _at_share, queue, task, push, share) for share in SHARES]
        held_out = {
            "follow": Follow(),
            HeadwayRule.name: HeadwayRule(),
            "random": RandomSpeed(),
            "learned": responses["full speed"],
        }
        crowds = {"full speed": push, "`follow`": Follow(), **{title: crowds[title] for title in _FOCAL}}
        others = {"push": push, **held_out}
        beside = [
            {"crowd": title, **_kept(store, f"{title} among others", _beside, crowd, mixed, others)}
            for title, crowd in crowds.items()
        ]
    found = {"task": task.identity(), "rows": rows, "shares": shares, "backgrounds": beside, "versions": versions()}
    write_json(out / "results.json", found)
    all_alike = zip(("all push", "all follow"), rows, strict=False)
    draw(out / "dilemma.png", shares, {name: row["mean_exit"]["mean"] for name, row in all_alike})


def _gains(crowd: Policy, task: Task, deviators: Mapping[str, Policy], free: Floats) -> Plain:
    """Return the `payoffs` of a crowd, what deviators gain there, and the bracket of its exploitability."""
    some = {name: follow(crowd, task, runs=_RUNS, deviator=one) for name, one in deviators.items()}
    all_follow = follow(crowd, task, runs=_RUNS)
    return {**payoffs(all_follow), **exploitability(all_follow, some, free)}


def _searched(crowd: Policy) -> Plain:
    return {"weights": searched_response(crowd, _DOOR).weights}


def _beside(crowd: Policy, task: Task, backgrounds: Mapping[str, Policy]) -> Plain:
    """Return the `payoffs` of pedestrians that follow a policy, by what the others of a mixed crowd do."""
    return {name: payoffs(among(crowd, one, task, runs=_FEW)) for name, one in backgrounds.items()}


def _at_share(crowd: Policy, task: Task, push: Policy, share: float) -> Plain:
    """Return the `payoffs` where a share pushes, the price that deters it, and what the last of them gains by it."""
    fewer = round(share * task.people) - 1
    before = follow(crowd, task, runs=_RUNS, deviator=push if fewer else None, share=max(fewer, 1) / task.people)
    after = follow(crowd, task, runs=_RUNS, deviator=push, share=share)
    price = deterrent(crowd, task, runs=_RUNS, deviator=push, share=share)
    return {"pushers": share, **payoffs(after), "deterrent": json_number(price), "switch": gain(before, after)}


def _kept(store: Store, name: str, make: Callable[..., Plain], *of: object) -> Plain:
    """Return a piece of work: from the store if it is done."""
    piece = _plain(name)
    if store.load(piece) is None:
        say(f"{name} ...")
        store.keep(piece, make(*of))
    return cast(Plain, store.load(piece))


def _network(out: Path, name: str, train: Callable[..., LearnedPolicy], *of: object) -> LearnedPolicy:
    """Return a network: from the folder if it has been trained."""
    path = out / f"{_plain(name)}{NUMBERS}"
    if not path.exists():
        say(f"{name} ...")
        train(*of).save(path)
    return LearnedPolicy.load(path)


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")


def draw(path: Path, shares: list[Plain], reference: dict[str, float]) -> None:
    """Draw Schelling's diagram: mean exit times of pedestrians that push and that follow, over the share that pushes."""
    kinds = {"following": "mean_exit_others", "all": "mean_exit", "pushing": "mean_exit_deviators"}
    series = {name: [row[kind]["mean"] for row in shares] for name, kind in kinds.items()}
    errors = {name: [row[kind]["mean"] - row[kind]["ci95"][0] for row in shares] for name, kind in kinds.items()}
    figure = learning_curve(
        [100.0 * row["pushers"] for row in shares],
        series,
        reference=reference,
        errors=errors,
        title=f"{_DOOR}: runs that cleared, 95 % intervals",
        xlabel="share of the pedestrians that push [%]",
        ylabel="mean exit time [s]",
    )
    save_figure(figure, path)
