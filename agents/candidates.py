"""Who can be evaluated, by name: strategies of the people, rules of the place, policies, and learned networks."""

import json
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from agents import POLICIES, make_policy
from agents.evaluation import Led, LedByPolicy
from agents.policy import Policy
from crowd_env import CrowdEnv, ObservationLayout, Scenario, Step
from crowd_env.physics import ContactScheme
from crowd_env.routing_batch import RoutingBatch
from crowd_env.scenario import Strategy

if TYPE_CHECKING:
    from agents.routing import Controller

RULES = "rules"
_DECISION = 0.1  # s  between two samples
_SIDECAR = "crowd_env.json"  # in the file of a network: what it was trained for


@dataclass(frozen=True)
class Candidate:
    """Someone to evaluate.

    Parameters
    ----------
    name : what tables and files call it.
    lead : makes a batch of so many evacuations of a scenario under a scheme, on so many threads.
    source : file that it is from.
    """

    name: str
    lead: Callable[[Scenario, str | ContactScheme, int, int], Led]
    source: Path | None = None


class WayOut:
    """Everyone walks as a strategy of the environment says.

    Parameters
    ----------
    strategy : see `Scenario.ways`.
    rules : whether the control rules of the scenario are in force.
    """

    def __init__(self, strategy: str, *, rules: bool = False) -> None:
        self.name = RULES if rules else strategy
        self.env_options: dict[str, Any] = {
            "strategy": strategy,
            "rules": rules,
            "observation": ObservationLayout(terms=("desired_speed",)),  # nobody reads it
        }

    def reset(self, env_mask: np.ndarray) -> None:
        """Nothing to forget."""

    def act(self, observation: np.ndarray, layout: ObservationLayout, rng: np.random.Generator) -> np.ndarray | None:
        """Leave everyone to the environment."""
        return None


class LedByController:
    """A batch whose people a controller of ``crowd_env/Routing-v0`` sends to exits, sampled between its decisions too."""

    def __init__(self, controller: "Controller", batch: RoutingBatch) -> None:
        self.controller, self.batch, self.env = controller, batch, batch.env
        # The batch is made to let a whole interval pass in one step; here a step is a sample.
        self._steps = round(batch.interval / _DECISION)
        self.env.decision_dt = _DECISION
        self.env.n_substeps = round(_DECISION / self.env.simulation.dt)

    def reset(self, seeds: list[int]) -> None:
        """Start new evacuations, each from its seed."""
        self._observation = self.batch.reset(seeds)
        self._rng = np.random.default_rng(seeds[0])
        self._left = np.zeros(self.env.num_people, dtype=np.bool_)
        self._count = 0

    def step(self) -> Step:
        """Tell people where to go if an interval has passed, and let them walk."""
        if self._count % self._steps == 0:
            action = self.controller.act(self._observation, self.batch, self._rng)
            self.batch._tell(self.batch._checked(action))
            self._left[:] = False
        step = self.env.step(None)
        self._count += 1
        self._left |= step.terminated
        if self._count % self._steps == 0:
            self._observation = self.batch._observe(self.env.active, self._left)
        return step


def make_candidates(names: Sequence[str], scenario: Scenario) -> list[Candidate]:
    """Return the candidates of these names for a scenario.

    Raises
    ------
    ValueError
        If a name is unknown or given twice, or a network cannot be read or belongs to something else.
    """
    if not names:
        raise ValueError("no policy; name at least one")
    twice = [name for k, name in enumerate(names) if name in names[:k]]
    if twice:
        raise ValueError(f"policy {twice[0]!r} is named twice; once is enough")
    found = [_make(name, scenario) for name in names]
    labels = [candidate.name for candidate in found]
    return [
        Candidate(given, one.lead, one.source) if one.source and labels.count(one.name) > 1 else one
        for given, one in zip(names, found, strict=True)
    ]


def _make(name: str, scenario: Scenario) -> Candidate:
    own = [route.name for route in scenario.routes]
    ways = tuple(dict.fromkeys([*get_args(Strategy), *own, *scenario.geometry.exit_names]))
    if name == RULES:
        return _of_policy(WayOut("shortest", rules=True))
    if name in ways:
        return _of_policy(WayOut(name))
    if name in POLICIES:
        return _of_policy(make_policy(name))
    if name.endswith(".zip"):
        return _learned(Path(name), scenario)
    known = ", ".join(dict.fromkeys([*ways[:4], RULES, *ways[4:], *POLICIES]))
    raise ValueError(f"unknown policy {name!r}; known: {known}, or the path of a learned network (.zip)")


def _of_policy(policy: Policy, source: Path | None = None) -> Candidate:
    def lead(scenario: Scenario, scheme: str | ContactScheme, num_envs: int, threads: int) -> Led:
        # Rules off unless the policy says otherwise: all walk in the same place.
        options = {"rules": False, "decision_dt": _DECISION, "threads": threads, **policy.env_options}
        return LedByPolicy(policy, CrowdEnv(scenario, num_envs=num_envs, scheme=scheme, **options))

    return Candidate(policy.name if source is None else source.stem, lead, source)


def _learned(path: Path, scenario: Scenario) -> Candidate:
    """Return a network of people's own steps, or a controller that sends them to exits: its file says which."""
    try:
        with zipfile.ZipFile(path) as archive:
            trained_for = json.loads(archive.read(_SIDECAR))
    except Exception as error:  # file, zip and JSON each have errors of their own
        raise ValueError(f"{path} is not a learned network: {error}") from None
    if "observation" in trained_for:
        return _of_policy(make_policy(str(path)), path)
    from agents.learned.routing import LearnedController

    controller = LearnedController.load(path)
    return of_controller(controller, scenario, controller.options, path)


def of_controller(
    controller: "Controller", scenario: Scenario, options: dict[str, Any], source: Path | None = None
) -> Candidate:
    """Return a controller as a candidate.

    Parameters
    ----------
    options : of `RoutingBatch`, as it was trained with; scenario, scheme and threads are those of the evaluation.

    Raises
    ------
    ValueError
        If it was trained in a place with other regions, exits or routes.
    """
    own = {key: value for key, value in options.items() if key not in ("scenario", "scheme", "dt", "threads")}
    if "grid" in own:
        own["grid"] = tuple(own["grid"])
    interval = own.get("interval", 2.0)
    if abs(interval / _DECISION - round(interval / _DECISION)) > 1e-6:
        raise ValueError(
            f"{source or controller.name} decides every {interval:g} s; that is no multiple of {_DECISION} s"
        )
    layout = RoutingBatch(scenario, **own).layout
    model = getattr(controller, "model", None)
    if model is not None and model.observation_space.shape != (layout.size,):
        raise ValueError(
            f"{source} was trained for {options.get('scenario', 'another place')} and observes "
            f"{model.observation_space.shape[0]} numbers; {scenario.name} has {layout.size}"
        )

    def lead(scenario: Scenario, scheme: str | ContactScheme, num_envs: int, threads: int) -> Led:
        batch = RoutingBatch(scenario, num_envs=num_envs, scheme=scheme, threads=threads, **own)
        return LedByController(controller, batch)

    return Candidate(controller.name if source is None else source.stem, lead, source)
