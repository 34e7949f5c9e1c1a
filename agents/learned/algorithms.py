"""The algorithms of a comparison: each trains a policy for a task until its callback ends the training."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import cast

from crowd_env.envs.protocol import WalkingBatch

from ..policy import Policy
from ..training_config import TrainingConfig, make_env
from . import network_search
from .callbacks import ComparisonCallback, EvaluationCallback
from .training import train_ppo

_SEARCHED = 0.5  # of the budget, at most


def _ppo_random(config: TrainingConfig, callback: ComparisonCallback) -> None:
    even = replace(config.ppo, rule_logit=0.0)  # every choice is as likely
    train_ppo(_rooms(config), even, config.seed, callback)


def _ppo(config: TrainingConfig, callback: ComparisonCallback) -> None:
    train_ppo(_rooms(config), config.ppo, config.seed, callback)


def _mappo(config: TrainingConfig, callback: ComparisonCallback) -> None:
    train_ppo(_rooms(config), config.ppo, config.seed, callback, central=True)


def _search_clone_ppo(config: TrainingConfig, callback: ComparisonCallback) -> None:
    search = Stage(callback, _SEARCHED)
    network_search.train(config, search)
    refine = Stage(callback, decided=search.steps)
    train_ppo(_rooms(config), config.ppo, config.seed, refine, search.best)


def _rooms(config: TrainingConfig) -> WalkingBatch:
    return cast(WalkingBatch, make_env(config))


class Stage(EvaluationCallback[Policy]):
    """A part of a training, which the callback of the whole judges.

    Parameters
    ----------
    whole : the callback of the whole training.
    share : of the whole budget at which the stage ends.
    decided : decisions before it.

    Attributes
    ----------
    best : the present policy of the stage.
    steps : decisions of the whole training so far.
    """

    best: Policy

    def __init__(self, whole: EvaluationCallback[Policy], share: float = 1.0, decided: int = 0) -> None:
        self._whole, self._share = whole, share
        self._first, self._begun, self.steps = decided, whole.progress, decided

    @property
    def progress(self) -> float:
        """Share of the budget of the stage that is spent."""
        left = self._share - self._begun
        return (self._whole.progress - self._begun) / left if left > 0.0 else 1.0

    def on_update(self, steps: int, policy: Callable[[], Policy], returns: Sequence[float] = ()) -> bool:
        """Let the whole judge the policy; return whether the stage goes on."""
        self.best, self.steps = policy(), self._first + steps
        return self._whole.on_update(self.steps, policy, returns) and self.progress < 1.0


TRAIN: Mapping[str, Callable[[TrainingConfig, ComparisonCallback], None]] = MappingProxyType(
    {
        "ppo-random": _ppo_random,
        "ppo": _ppo,
        "mappo": _mappo,
        "network-search": network_search.train,
        "search-clone-ppo": _search_clone_ppo,
    }
)
