"""Learning in a dilemma: best responses to a crowd, and crowds with other rewards."""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import cast

from crowd_env.core.console import say
from crowd_env.core.files.json_file import json_number, write_json
from crowd_env.envs.protocol import WalkingBatch
from crowd_env.envs.settings import arguments_of
from crowd_env.rendering import learning_curve, save_figure

from .. import make_policy
from ..evaluation.dilemma import SHARES, deterrent, follow, gain, payoffs, price_of_anarchy
from ..evaluation.entries import RULE
from ..mixed import MixedEnv
from ..plain import Plain
from ..policy import Policy
from ..rules import StrategyPolicy
from ..runs import versions
from ..tasks import make_task
from ..trained import LearnedPolicy
from ..training_config import TrainingConfig, make_env, physics_of, place_of, task_config
from .actor_critic import network_of, std_of
from .ppo import make_ppo
from .starts import begin
from .training import trained_in

_DOOR, _MIXED, _RUNS = "dilemma-door", "dilemma-mixed", 100
_QUEUES = "queue: `evolution`"
# Actions of a best response, which include overtaking.
_FREE = {"name": "speeds-directions", "speeds": [0.0, 0.5, 1.0], "headings": [k * math.pi / 6 for k in range(-3, 4)]}
# Of a best response: share of pedestrians that learn, rooms, s in which most of them leave, and training steps of all slots.
_SHARE, _ROOMS, _LIMIT, _STEPS = 0.05, 16, 15.0, 6_000_000
# Training of a crowd -> task, start, and changes of the reward.
_PRICES = {"progress": 0.5, "time": 1.0, "contact": 1.0, "head": 5.0}
_TRAINED: Mapping[str, tuple[str, str, Plain]] = {
    "PPO, own time": (_DOOR, "evolution", {}),
    "PPO, own time, from full speed": (_DOOR, RULE, {}),
    "PPO, own time, 20 % push": (_MIXED, "evolution", {}),
    "PPO, time of all": (_DOOR, "evolution", {"team_share": 1.0}),
    "PPO, contacts and the head of the queue cost": (_DOOR, "evolution", {"weights": _PRICES}),
}


def train_crowd(task: str, start: str, reward: Mapping[str, object], seed: int = 0) -> LearnedPolicy:
    """Return the last policy of PPO with the preset of a task, from a start, with a changed ``reward``."""
    config = task_config(task, seed, start=start)
    config = replace(config, reward={**config.reward, **reward})
    return _trained(cast(WalkingBatch, make_env(config)), config, config.steps)


def best_response(crowd: Policy, task: str, seed: int = 0, steps: int = _STEPS) -> LearnedPolicy:
    """Return the policy that PPO learns from full speed, for its own time alone, among pedestrians that follow a policy.

    It may turn aside.  It has the observation of the crowd or, if that is a rule, of policies of the task.  One of
    twenty pedestrians learns.  An episode ends after 15 s, when most pedestrians that push have left.  More steps may find a
    better response.

    Parameters
    ----------
    task : name of the task; its preset gives the place and the settings.
    steps : of all pedestrians, including the crowd.
    """
    config = task_config(task, seed, start=RULE)
    observation = crowd.env_options["observation"] if isinstance(crowd, LearnedPolicy) else config.observation
    own = {"frame": config.frame, "action": _FREE, "observation": observation}
    arguments = arguments_of({**physics_of(config), **own, "reward": {"progress": 0.5, "time": 1.0}})
    arguments |= {"num_envs": _ROOMS, "time_limit": _LIMIT, "autoreset": True}
    env = MixedEnv(place_of(config), share=_SHARE, others=crowd, **arguments)
    # A rollout is a whole episode of every environment: pedestrians learn in each.
    config = replace(config, ppo=replace(config.ppo, n_steps=round(_LIMIT / env.decision_dt), batch_size=1024))
    return _trained(env, config, steps)


def _trained(env: WalkingBatch, config: TrainingConfig, steps: int) -> LearnedPolicy:
    model = make_ppo(env, config.ppo, config.seed)
    begin(model, config)
    model.learn(steps)
    return cast(LearnedPolicy, trained_in(env, network_of(model), config, std_of(model)))


def measure(out: Path) -> None:
    """Measure the cost of pushing, the gain of deviators, and the effect of learning; write table and figure to a folder."""
    task, push, queue = make_task(_DOOR), StrategyPolicy("shortest", name=RULE), make_policy("evolution")
    out.mkdir(parents=True, exist_ok=True)
    crowds = {"full speed": push, _QUEUES: queue, "`generalist`": make_policy("generalist")}
    for name, how in _TRAINED.items():
        say(f"training a crowd: {name} ...")
        crowds[name] = train_crowd(*how)
    rows: list[Plain] = []
    shares: list[Plain] = []
    all_push = follow(push, task, runs=_RUNS)
    for title, crowd in crowds.items():
        say(f"looking for deviators that gain: {title} ...")
        deviators = {"push": push, "queue": queue, "learned": best_response(crowd, _DOOR)}
        all_follow = follow(crowd, task, runs=_RUNS)
        gains = {
            name: gain(all_follow, follow(crowd, task, runs=_RUNS, deviator=one)) for name, one in deviators.items()
        }
        price = price_of_anarchy(all_push, all_follow)
        rows.append({"crowd": title, **payoffs(all_follow), "price": price, "gain": gains})
        for share in SHARES if title == _QUEUES else ():
            some_push = follow(crowd, task, runs=_RUNS, deviator=push, share=share)
            price_of = deterrent(crowd, task, runs=_RUNS, deviator=push, share=share)
            shares.append({"pushers": share, **payoffs(some_push), "deterrent": json_number(price_of)})
    found = {"task": task.identity(), "rows": rows, "shares": shares, "versions": versions()}
    write_json(out / "results.json", found)
    all_alike = zip(("all push", "all follow"), rows, strict=False)
    draw(out / "dilemma.png", shares, {name: row["mean_exit"]["mean"] for name, row in all_alike})


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
