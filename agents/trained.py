"""Trained networks as policies and controllers, without torch: their files hold numbers, see `crowd_env.agents.networks`."""

import copy
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import ClassVar, Self, cast

import gymnasium
import numpy as np

from crowd_env import ObservationLayout
from crowd_env.core.checks import known
from crowd_env.envs.action import FRAMES, make_action, plain_action
from crowd_env.envs.routing.batch import RoutingBatch

from .networks import Network, read_network, write_network
from .plain import Plain
from .policy import WithoutMemory

NUMBERS = ".safetensors"
# Options of `RoutingBatch` that belong to a controller; the others describe the place of its training.
_OF_CONTROLLER = ("interval", "regions", "grid", "routes", "doors", "observation", "reward", "rules", "signs")
SAMPLED = ":sampled"  # suffix to the name of a policy that draws its actions


class _Learned:
    """A trained network and its file."""

    name: str = "learned"  # in tables
    what: ClassVar[str]
    network: Network

    def facts(self) -> Plain:
        """Return the purpose of the network, as its file holds it."""
        raise NotImplementedError

    def save(self, path: str | Path) -> None:
        """Write the network and its facts to one .safetensors file, whole or not at all."""
        write_network(_checked(path), self.network, self.facts())

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a file of `save`."""
        found = load_trained(path)
        if not isinstance(found, cls):
            raise ValueError(f"{path} is a {found.what}, no {cls.what}")
        return found


class LearnedPolicy(_Learned, WithoutMemory):
    """A network that all pedestrians share.  It takes the most likely action, or draws one, see `sampled`.

    Parameters
    ----------
    network : from an observation to the mean of an action or, of discrete actions, to their logits.
    env_options : frame, action and observation layout of its training.
    trained : further facts of its training (scenario, scheme, dt, ...), for the record.
    spread : (A,) standard deviation of each component of a continuous action in training; None = unknown.

    Attributes
    ----------
    action_kind : kind of its actions; ``space`` is the space of one pedestrian's action.
    draws : whether it draws its actions.

    Raises
    ------
    ValueError
        If the network has another number of inputs or outputs than the observation and the action.
    """

    what = "policy of people's own steps"

    def __init__(
        self,
        network: Network,
        env_options: Plain,
        trained: Plain | None = None,
        spread: Sequence[float] | None = None,
    ) -> None:
        self.network, self.env_options, self.trained = network, env_options, trained or {}
        self.spread = None if spread is None else tuple(map(float, spread))
        self.draws = False
        known("frame", env_options["frame"], FRAMES)
        self.action_kind = make_action(env_options["action"])
        self.space = self.action_kind.space
        outputs = gymnasium.spaces.flatdim(self.space)
        inputs = env_options["observation"].size
        if (network.inputs, network.outputs) != (inputs, outputs):
            raise ValueError(
                f"the network turns {network.inputs} numbers into {network.outputs}; "
                f"its observation and action have {inputs} and {outputs}"
            )
        if self.spread is not None and len(self.spread) != outputs:
            raise ValueError(f"{len(self.spread)} standard deviations of {outputs} components of an action")

    def sampled(self) -> "LearnedPolicy":
        """Return the same policy as it acted in training: it draws every action from its distribution.

        Raises
        ------
        ValueError
            If the actions are continuous and their spread is unknown.
        """
        if not isinstance(self.space, gymnasium.spaces.Discrete) and self.spread is None:
            raise ValueError(
                "its file does not say how far its continuous actions scatter; it takes the most likely one alone"
            )
        found = copy.copy(self)
        found.name, found.draws = f"{self.name}{SAMPLED}", True
        return found

    @property
    def steady(self) -> bool:
        """Whether its actions follow from the observation alone, see `Policy`."""
        return not self.draws

    def act(self, observation: np.ndarray, layout: ObservationLayout, rng: np.random.Generator) -> np.ndarray | None:
        """Return actions (P, ...): the means within their bounds, or the choices with the largest logits; or drawn ones.

        Raises
        ------
        ValueError
            If the layout of the observations does not hold that of the training.
        """
        own = self.env_options["observation"]
        if layout != own:
            if not {*own.names} <= {*layout.names} or replace(layout, terms=own.terms) != own:
                raise ValueError(f"policy {self.name!r} was trained on other observations: {own}")
            observation = np.hstack([observation[:, layout[name]] for name in own.names])
        out = self.network(observation)
        if isinstance(self.space, gymnasium.spaces.Discrete):
            # The largest of logits and independent Gumbel numbers is a draw from the softmax.
            return (out + rng.gumbel(size=out.shape) if self.draws else out).argmax(axis=1)
        box = cast(gymnasium.spaces.Box, self.space)
        if self.draws:
            out = out + rng.normal(size=out.shape) * np.array(self.spread)
        return np.clip(out.reshape(-1, *box.shape), box.low, box.high)

    def facts(self) -> Plain:
        kind, observation = plain_action(replace(self.action_kind, frame="path")), self.env_options["observation"]
        spread = {} if self.spread is None else {"spread": list(self.spread)}
        action = {"kind": kind, "frame": self.env_options["frame"], **spread}
        return {"kind": "policy", "observation": observation.as_table(), "action": action, "trained": self.trained}


class LearnedController(_Learned):
    """A network that sends pedestrians to exits.  It takes the most likely choices.

    Parameters
    ----------
    network : from the observation of a `RoutingBatch` to the logits of all choices, one entry of an action after the other.
    choices : (R + D,) number of choices of each entry.
    options : of `RoutingBatch`: regions, interval and observation.
    trained : facts of its training (task, seed, ...), for the record.

    Raises
    ------
    ValueError
        If the number of outputs is not the number of choices.
    """

    what = "controller that sends people to exits"

    def __init__(self, network: Network, choices: np.ndarray, options: Plain, trained: Plain | None = None) -> None:
        self.network, self.trained = network, trained or {}
        self.options = {name: options[name] for name in _OF_CONTROLLER if name in options}
        self.choices = np.asarray(choices, dtype=np.int64)
        if self.choices.ndim != 1 or (self.choices < 1).any() or network.outputs != self.choices.sum():
            raise ValueError(f"the network has {network.outputs} outputs for choices among {self.choices.tolist()}")

    def act(self, observation: np.ndarray, batch: RoutingBatch, rng: np.random.Generator) -> np.ndarray:
        """Return the most likely choices (E, R + D) for observations (E, D)."""
        logits = np.split(self.network(observation), np.cumsum(self.choices)[:-1], axis=1)
        return np.column_stack([part.argmax(axis=1) for part in logits])

    def facts(self) -> Plain:
        facts = {"choices": self.choices.tolist(), "options": self.options, "trained": self.trained}
        return {"kind": "controller", **facts}


def load_trained(path: str | Path) -> LearnedPolicy | LearnedController:
    """Read a trained network.

    Raises
    ------
    ValueError
        If the file is missing, no such network, or its facts are incomplete or do not fit the network.
    """
    path = _checked(path)
    if not path.is_file():
        raise ValueError(f"cannot read the network {path}: no such file")
    network, facts = read_network(path)
    try:
        trained = dict(facts.get("trained", {}))
        if facts["kind"] == "controller":
            return LearnedController(network, facts["choices"], dict(facts["options"]), trained)
        if facts["kind"] != "policy":
            raise ValueError(f"its kind is {facts['kind']!r}")
        action, layout = facts["action"], ObservationLayout(**facts["observation"])
        options = {"frame": action["frame"], "action": action["kind"], "observation": layout}
        return LearnedPolicy(network, options, trained, action.get("spread"))
    except Exception as error:  # JSON can hold anything
        reason = f"{error} is missing" if isinstance(error, KeyError) else error
        raise ValueError(f"{path} does not say what its network is for: {reason}") from None


def names_file(name: str) -> bool:
    """Return whether this is the path of a network, not the name of a policy."""
    return name.endswith(NUMBERS)


def _checked(path: str | Path) -> Path:
    path = Path(path)
    if path.suffix != NUMBERS:
        raise ValueError(f"{path} is no network: its name must end in {NUMBERS}")
    return path


def columns_of(layout: ObservationLayout) -> dict[str, list[int]]:
    """Return the first column of each term, and the one after its last, as files hold them."""
    return {name: [layout[name].start, layout[name].stop] for name in layout.names}
