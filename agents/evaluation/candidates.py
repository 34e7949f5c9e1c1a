"""Who can be evaluated, by name: strategies of the people, rules of the place, policies, and learned networks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from agents import POLICIES, make_policy
from agents.controllers import SAMPLE, Controller, LedByController, WayOut
from agents.evaluation.evaluation import Led, LedByPolicy
from agents.policy import Policy
from agents.trained import LearnedController, load_trained
from crowd_env import CrowdEnv, Scenario
from crowd_env.envs.routing.batch import RoutingBatch
from crowd_env.physics import ContactScheme
from crowd_env.routing.strategies import STRATEGIES

RULES = "rules"


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


def make_candidates(names: Sequence[str], scenario: Scenario, *, trust_pickle: bool = False) -> list[Candidate]:
    """Return the candidates of these names for a scenario; see `agents.trained.load_trained` for ``trust_pickle``.

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
    found = [_make(name, scenario, trust_pickle) for name in names]
    labels = [candidate.name for candidate in found]
    return [
        Candidate(given, one.lead, one.source) if one.source and labels.count(one.name) > 1 else one
        for given, one in zip(names, found, strict=True)
    ]


def _make(name: str, scenario: Scenario, trust_pickle: bool) -> Candidate:
    own = [route.name for route in scenario.routes]
    route_set = tuple(dict.fromkeys([*STRATEGIES, *own, *scenario.geometry.exit_names]))
    if name == RULES:
        return _of_policy(WayOut("shortest", rules=True, name=RULES))
    if name in route_set:
        return _of_policy(WayOut(name))
    if name in POLICIES:
        return _of_policy(make_policy(name))
    if name.endswith((".npz", ".zip")):
        return _learned(Path(name), scenario, trust_pickle)
    known = ", ".join(dict.fromkeys([*route_set[:4], RULES, *route_set[4:], *POLICIES]))
    raise ValueError(f"unknown policy {name!r}; known: {known}, or the path of a learned network (.npz)")


def _of_policy(policy: Policy, source: Path | None = None) -> Candidate:
    def lead(scenario: Scenario, scheme: str | ContactScheme, num_envs: int, threads: int) -> Led:
        # Rules off unless the policy says otherwise: all walk in the same place.
        options = {"rules": False, "decision_dt": SAMPLE, "threads": threads, **policy.env_options}
        return LedByPolicy(policy, CrowdEnv(scenario, num_envs=num_envs, scheme=scheme, **options))

    return Candidate(policy.name if source is None else source.stem, lead, source)


def _learned(path: Path, scenario: Scenario, trust_pickle: bool) -> Candidate:
    """Return a network of people's own steps, or a controller that sends them to exits: its file says which."""
    found = load_trained(path, trust_pickle=trust_pickle)
    if isinstance(found, LearnedController):
        return of_controller(found, scenario, found.options, path)
    return _of_policy(found, path)


def of_controller(
    controller: Controller, scenario: Scenario, options: dict[str, Any], source: Path | None = None
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
    try:
        batch = RoutingBatch(scenario, **own)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{source or controller.name} does not fit {scenario.name}: {error}") from None
    if abs(batch.interval / SAMPLE - round(batch.interval / SAMPLE)) > 1e-6:
        raise ValueError(
            f"{source or controller.name} decides every {batch.interval:g} s; that is no multiple of {SAMPLE} s"
        )
    if isinstance(controller, LearnedController) and (
        controller.network.inputs != batch.layout.size or controller.choices.tolist() != batch.choices.tolist()
    ):
        raise ValueError(
            f"{source} was trained for {options.get('scenario', 'another place')} and observes "
            f"{controller.network.inputs} numbers; {scenario.name} has {batch.layout.size}"
        )

    def lead(scenario: Scenario, scheme: str | ContactScheme, num_envs: int, threads: int) -> Led:
        batch = RoutingBatch(scenario, num_envs=num_envs, scheme=scheme, threads=threads, **own)
        return LedByController(controller, batch)

    return Candidate(controller.name if source is None else source.stem, lead, source)
