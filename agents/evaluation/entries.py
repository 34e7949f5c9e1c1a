"""What can be evaluated, by name: strategies of the people, rules of the scenario, policies, and learned networks."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from typing_extensions import Unpack

from crowd_env import Routing, Scenario, Walking
from crowd_env.core.checks import of_another_kind
from crowd_env.core.files.atomic import legible
from crowd_env.core.files.own import load_own, names_own
from crowd_env.envs.routing.batch import RoutingBatch, routing_arguments
from crowd_env.envs.settings import EnvArguments
from crowd_env.envs.tasks.task import Task
from crowd_env.routing.strategies import STRATEGIES

from .. import POLICIES, PRETRAINED, make_policy
from ..controllers import Controller
from ..drivers import SAMPLE, UNHINDERED, DrivenCrowd, Hindrance, own_arguments
from ..networks import network_digest
from ..policy import Policy
from ..rules import ShortestPath, StrategyPolicy
from ..trained import SAMPLED, LearnedPolicy, load_trained, names_file

RULES = "rules"
RULE = "rule"  # the strategy of a task, at full speed


@dataclass(frozen=True, eq=False)
class Entry:
    """A policy or controller of an evaluation.

    Parameters
    ----------
    name : what tables and files call it.
    policy : that drives.
    source : file of the network; None for a policy without one.
    task : whose rule, interval of decisions and physics step it walks under; None = those of the scenario.
    learned_share, hindrance : see `crowd_env.agents.drivers.DrivenCrowd`.
    """

    name: str
    policy: Policy | Controller
    source: Path | None = None
    task: Task | None = None
    learned_share: float | None = None
    hindrance: Hindrance = UNHINDERED

    @property
    def digest(self) -> str | None:
        """Hash of the network; None for a policy without one."""
        return None if self.source is None else network_digest(self.source)

    @property
    def leads(self) -> bool:
        """Whether it decides how people walk, and not only which way."""
        return isinstance(self.policy, Policy) and not isinstance(self.policy, StrategyPolicy | ShortestPath)

    def suited(self, place: Scenario) -> Scenario:
        """Return a place with people that keep the distance that the policy was trained with, if it leads them."""
        if not self.leads:
            return place
        return replace(place, manner=None if self.source is None else load_trained(self.source).trained.get("manner"))

    def driver(self, scenario: Scenario, **arguments: Unpack[EnvArguments]) -> DrivenCrowd:
        """Return the crowd that it drives; ``arguments`` of `CrowdEnv` override those of the task.

        The control rules of the scenario are off unless the policy or the arguments say otherwise.
        """
        physics = arguments.pop("physics", None)
        if self.task is None:
            usual = EnvArguments(physics=physics or "nsm2", routing=Routing(signs=False), decision_dt=SAMPLE)
        else:
            usual = self.task.arguments(physics)
        usual.update(arguments)
        return DrivenCrowd(self.policy, scenario, usual, self.name, self.learned_share, hindrance=self.hindrance)


def make_entries(
    names: Sequence[str], scenario: Scenario, task: Task | None = None, *, learned_share: float | None = None
) -> list[Entry]:
    """Return the entries of these names for a scenario.

    Under a task all walk along the ways of its rule, which is a policy too, and decide as often as it says.

    Parameters
    ----------
    learned_share : of the people whom a policy moves, see `crowd_env.agents.drivers.PolicyBatches`; None = as the task says.

    Raises
    ------
    ValueError
        If a name is unknown or given twice, a network cannot be read or belongs to something else, or a policy cannot move
        some of the people alone.
    """
    if not names:
        raise ValueError("no policy; name at least one")
    twice = [name for k, name in enumerate(names) if name in names[:k]]
    if twice:
        raise ValueError(f"policy {twice[0]!r} is named twice; once is enough")
    if learned_share is None and task is not None:
        learned_share = task.learned_share
    found = []
    for name in names:
        try:
            found.append(_make(name, scenario, task, learned_share))
        except Unsuited as error:
            error.policy = name
            raise
    labels = [entry.name for entry in found]
    return [
        replace(one, name=given) if one.source and labels.count(one.name) > 1 else one
        for given, one in zip(names, found, strict=True)
    ]


_PARTS = ("name", "env_options", "reset", "act")  # of a `Policy`


class Unsuited(ValueError):
    """A policy that cannot move some of the people while the others follow the rule, or a controller of another place.

    Attributes
    ----------
    policy : as it was named.
    """

    policy = ""


def _make(name: str, scenario: Scenario, task: Task | None, learned_share: float | None) -> Entry:
    own = [route.name for route in scenario.routes]
    route_set = tuple(dict.fromkeys([*STRATEGIES, *own, *scenario.geometry.exit_names]))
    plain, sampled = name.removesuffix(SAMPLED), name.endswith(SAMPLED)
    if name == RULE and task is not None:
        policy: Policy = StrategyPolicy(task.rule, name=RULE)
    elif name == RULES:
        policy = StrategyPolicy("shortest", rules=True, name=RULES)
    elif (way := legible(name)) in route_set:
        policy = StrategyPolicy(way)
    elif name in POLICIES:
        policy = make_policy(name)
    elif names_own(name):
        policy = load_own("--policies", name)
        if lacks := [part for part in _PARTS if not hasattr(policy, part)]:
            raise ValueError(f"{name} is no policy: it has no {lacks[0]}; a policy has {', '.join(_PARTS)}")
    elif plain in PRETRAINED:
        entry = _learned_entry(PRETRAINED[plain], scenario, task, learned_share, sampled)
        return replace(entry, name=name)
    elif names_file(plain):
        return _learned_entry(Path(plain), scenario, task, learned_share, sampled)
    elif name == RULE:
        raise ValueError(
            "policy 'rule' is the strategy of a task; give --task NAME, or name a strategy such as shortest"
        )
    else:
        of_task = [] if task is None else [RULE]
        known = ", ".join(dict.fromkeys([*of_task, *route_set[:4], RULES, *route_set[4:], *POLICIES, *PRETRAINED]))
        raise ValueError(
            f"unknown policy {name!r}; known: {known}, or the path of a learned network (.safetensors)"
            f"{of_another_kind(name, 'policy')}"
        )
    return policy_entry(policy, task, learned_share)


def policy_entry(
    policy: Policy, task: Task | None, learned_share: float | None = None, source: Path | None = None
) -> Entry:
    """Return the entry of a policy, whose network lies in the file ``source``; see `make_entries`."""
    if learned_share is not None:
        _check_mixed(policy, "shortest" if task is None else task.rule)
    return Entry(policy.name if source is None else legible(source.stem), policy, source, task, learned_share)


def _check_mixed(policy: Policy, rule: str) -> None:
    """Raise Unsuited if a policy cannot move some of the people while the others follow the rule."""
    if isinstance(policy, StrategyPolicy) and policy.routing != Routing(rule, signs=False):
        why = f"it chooses everyone's way, and the others of a mixed crowd follow the rule, which is {rule}"
    elif Walking.of(own_arguments(policy).get("walking")).manner is not None:
        why = "it sets the walking of all; in a mixed crowd --walking is that of the people who follow the rule"
    else:
        return
    why = f"policy {policy.name!r} cannot move a part of the people: {why}; leave out --set learned, or it"
    raise Unsuited(why)


def _learned_entry(
    path: Path, scenario: Scenario, task: Task | None, learned_share: float | None, sampled: bool
) -> Entry:
    """Return the entry of a network: its file says whether it is a policy or a controller; ``sampled``: it draws its actions.

    Raises
    ------
    ValueError
        If it cannot be read, or was trained in a scenario with other regions, exits or routes.
    """
    found = load_trained(path)
    if isinstance(found, LearnedPolicy):
        if not sampled:
            return policy_entry(found, task, learned_share, path)
        try:
            entry = policy_entry(found.sampled(), task, learned_share, path)
        except ValueError as error:
            raise ValueError(f"{path}{SAMPLED}: {error}") from None
        return replace(entry, name=entry.name + SAMPLED)
    if sampled:
        raise ValueError(f"{path}{SAMPLED}: a controller takes the most likely choices alone")
    if learned_share is not None:
        raise Unsuited(f"{path} sends everyone of a region to an exit; leave out --set learned, or it")
    try:
        batch = RoutingBatch(**routing_arguments(scenario, **found.options))
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path} does not fit {scenario.name}: {error}") from None
    if found.network.inputs != batch.layout.size or found.choices.tolist() != batch.choices.tolist():
        raise Unsuited(
            f"{path} was trained for {found.trained.get('scenario', 'another place')} and observes "
            f"{found.network.inputs} numbers; {scenario.name} has {batch.layout.size}"
        )
    return Entry(legible(path.stem), found, path, task)
