"""The algorithms, by name: each trains one policy that all people share, in the training batch of a task's preset."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from ..evaluation.entries import RULE
from ..training_config import make_env, place_of, start_of

if TYPE_CHECKING:
    from ..learned.watch import Watch


class Algorithm(NamedTuple):
    """A way to learn.

    Parameters
    ----------
    about : a line for people.
    train : takes the config of a run (`crowd_env.agents.training_config.task_config`) and the `Watch` that ends it.
    terms : of the observation beside those of the preset.
    start : what it begins at; None = as the preset has it, which may be a better rule that is cloned.
    """

    about: str
    train: Callable[[dict[str, Any], "Watch"], None]
    terms: tuple[str, ...] = ()
    start: str | None = RULE


def _ppo(config: dict[str, Any], watch: "Watch") -> None:
    from ..learned.ppo import PPOSettings
    from ..learned.watched import train_ppo

    start = None if config["start"] == RULE else start_of(config)
    train_ppo(make_env(config), PPOSettings(**config["ppo"]), config["seed"], watch, start)


def _mappo(config: dict[str, Any], watch: "Watch") -> None:
    from ..learned.actor_critic import central

    _actor_critic(config, watch, central)


def _attention(config: dict[str, Any], watch: "Watch") -> None:
    from ..learned.actor_critic import attention

    _actor_critic(config, watch, attention)


def _actor_critic(config: dict[str, Any], watch: "Watch", networks: Callable[..., Any]) -> None:
    from ..learned.actor_critic import train_actor_critic
    from ..learned.ppo import PPOSettings

    train_actor_critic(make_env(config), PPOSettings(**config["ppo"]), config["seed"], watch, networks)


def _dqn(config: dict[str, Any], watch: "Watch") -> None:
    from ..learned.dqn import DQNSettings, train_dqn

    train_dqn(make_env(config), DQNSettings(gamma=config["ppo"]["gamma"]), config["seed"], watch)


def _evolution(config: dict[str, Any], watch: "Watch") -> None:
    from ..learned.evolution import evolve

    options = {name: config[name] for name in ("scheme", "dt", "decision_dt", "strategy", "manner", "outline")}
    evolve(place_of(config), options, config["seed"], watch)


ALGORITHMS: Mapping[str, Algorithm] = MappingProxyType(
    {
        "ppo": Algorithm("PPO by stable-baselines3, begun at the rule", _ppo),
        "ppo-cloned": Algorithm(
            "the same, begun as train.py does: where the preset says so, as a clone", _ppo, start=None
        ),
        "mappo": Algorithm("PPO whose critic sees everyone's state", _mappo),
        "attention": Algorithm("PPO whose network attends to the neighbors", _attention, ("lead",)),
        "dqn": Algorithm("double DQN: independent Q-learning with shared parameters", _dqn),
        "evolution": Algorithm("CMA-ES over eight constants of a local rule", _evolution),
    }
)
