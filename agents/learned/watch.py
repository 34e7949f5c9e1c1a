"""What watches a training of a comparison: how much of the budget is spent, and how good the policy is by now."""

import time
from collections.abc import Callable, Mapping
from typing import Any, cast

from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from crowd_env import CrowdEnv

from ..policy import Policy
from ..trained import LearnedPolicy
from ..walking import WalkingRule
from .cloning import DECISIONS, ROUNDS, clone
from .export import network_of
from .ppo import PPOSettings, make_ppo
from .rate import FallingRate
from .training import env_options_of

_ENDLESS = 10**12  # steps: the watch ends the training


class Watch:
    """Ends a training when its budget of processor time is spent, and judges the policy on the way.

    An algorithm asks `goes_on` before every update, the first included, and stops when the answer is no.

    Parameters
    ----------
    seconds : of processor time of this process, without what `judge` takes.
    judge : takes a policy and returns figures, the smaller ``order`` the better.
    checkpoints : how often the policy is judged beside the start; the last time is at the end.

    Attributes
    ----------
    curve : a row for each time that the policy was judged: ``steps``, decision steps of people so far, ``seconds`` of
        processor time, and what ``judge`` returned.
    best : the policy of the best row, and its number.
    """

    def __init__(
        self, seconds: float, judge: Callable[[Policy], Mapping[str, Any]], checkpoints: int, decision_dt: float = 0.1
    ) -> None:
        self.seconds, self.checkpoints, self.decision_dt = seconds, checkpoints, decision_dt
        self.curve: list[dict[str, Any]] = []
        self.best: tuple[Policy, int] | None = None
        self._judge = judge
        self._begin = time.process_time()

    @property
    def spent(self) -> float:
        """Processor time so far [s]."""
        return time.process_time() - self._begin

    @property
    def share(self) -> float:
        """Share of the budget that is spent, at most 1."""
        return min(self.spent / self.seconds, 1.0)

    def goes_on(self, steps: int, policy: Callable[[], Policy]) -> bool:
        """Judge the policy if that is due, and return whether to go on training.

        Parameters
        ----------
        steps : decision steps of people that were trained on so far.
        policy : returns the policy as it is now, which later training must not change.
        """
        spent = self.spent
        if len(self.curve) <= self.checkpoints * min(spent / self.seconds, 1.0):
            found = policy()
            row = {"steps": int(steps), "seconds": round(spent, 3), **self._judge(found)}
            if self.best is None or row["order"] < self.curve[self.best[1]]["order"]:
                self.best = found, len(self.curve)
            self.curve.append(row)
            self._begin += self.spent - spent  # judging is no training
        return spent < self.seconds


def train_ppo(env: CrowdEnv, settings: PPOSettings, seed: int, watch: Watch, start: WalkingRule | None = None) -> None:
    """Train by stable-baselines3's PPO until ``watch`` says that it is enough.

    Parameters
    ----------
    env : made with ``autoreset=True``.
    start : a rule that is cloned first, which counts as training, with the decisions of everyone.
    """
    model, decided = make_ppo(env, settings, seed), 0
    if start is not None:
        clone(model, start, seed)
        decided = ROUNDS * DECISIONS * env.num_people
    watch_ppo(model, watch, lambda: LearnedPolicy(network_of(model), env_options_of(env)), decided)


def watch_ppo(model: PPO, watch: Watch, policy: Callable[[], Policy], decided: int = 0) -> None:
    """Let a model learn until ``watch`` says that it is enough of ``policy``; so many decisions were made before."""
    model.learn(_ENDLESS, callback=_Watched(watch, policy, decided))


class _Watched(BaseCallback):
    """Asks the watch after every rollout, before the update on it; counts decisions of people who are inside."""

    def __init__(self, watch: Watch, policy: Callable[[], Policy], decided: int) -> None:
        super().__init__()
        self.watch, self.policy, self.decided = watch, policy, decided
        self.enough = False

    def _on_training_start(self) -> None:
        self._ask()

    def _on_step(self) -> bool:
        return not self.enough

    def _on_rollout_end(self) -> None:
        self.decided += int(self.model.rollout_buffer.mask.sum())  # type: ignore[attr-defined]
        self._ask()
        cast(FallingRate, self.model.learning_rate).time_spent = self.watch.share

    def _ask(self) -> None:
        self.enough = not self.watch.goes_on(self.decided, self.policy)
