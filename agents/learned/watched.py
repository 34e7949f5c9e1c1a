"""PPO by stable-baselines3 under a `Watch`, as the other algorithms of a benchmark are."""

from typing import cast

from stable_baselines3.common.callbacks import BaseCallback

from crowd_env import CrowdEnv

from ..trained import LearnedPolicy
from ..walking import WalkingRule
from .cloning import DECISIONS, ROUNDS, clone
from .export import network_of
from .ppo import PPOSettings, make_ppo
from .rate import FallingRate
from .training import env_options_of
from .watch import Watch

_ENDLESS = 10**12  # steps: the watch ends the training


def train_ppo(env: CrowdEnv, settings: PPOSettings, seed: int, watch: Watch, start: WalkingRule | None = None) -> None:
    """Train until ``watch`` says that it is enough.

    Parameters
    ----------
    env : made with ``autoreset=True``.
    start : a rule that is cloned first, which counts as training, with the decisions of everyone.
    """
    model, decided = make_ppo(env, settings, seed), 0
    if start is not None:
        clone(model, start, seed)
        decided = ROUNDS * DECISIONS * env.num_people
    model.learn(_ENDLESS, callback=_Watched(env, watch, decided))


class _Watched(BaseCallback):
    """Asks the watch after every rollout, before the update on it; counts decisions of people who are inside."""

    def __init__(self, env: CrowdEnv, watch: Watch, decided: int) -> None:
        super().__init__()
        self.env, self.watch, self.decided = env, watch, decided
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
        self.enough = not self.watch.goes_on(self.decided, self._policy)

    def _policy(self) -> LearnedPolicy:
        return LearnedPolicy(network_of(self.model), env_options_of(self.env))
