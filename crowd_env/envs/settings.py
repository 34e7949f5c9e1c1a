"""Settings of the people of an environment: the routing beside physics and walking, and answers to unknown arguments."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from difflib import get_close_matches
from functools import wraps
from typing import Any, ParamSpec, TypeAlias, TypedDict, TypeVar

from crowd_env.core.behaviors.outline import Outline
from crowd_env.core.checks import Plain
from crowd_env.envs.action import ActionKind, make_action
from crowd_env.envs.observation.layout import ObservationLayout
from crowd_env.envs.reward import RewardWeights
from crowd_env.physics.scheme import DECISION_DT
from crowd_env.physics.settings import AsPhysics, AsWalking, Part, Physics, Walking
from crowd_env.scenarios.cohorts import extreme_bodies
from crowd_env.scenarios.scenario import Scenario

Given = ParamSpec("Given")
Made = TypeVar("Made")


def answers_unknown(like: type[Any] | None = None) -> Callable[[Callable[Given, Made]], Callable[Given, Made]]:
    """Return a decorator that answers an unknown argument with a sentence.

    If the function takes ``**arguments``, these are the arguments of the class ``like``, without the ones of a batch.
    """

    def decorate(function: Callable[Given, Made]) -> Callable[Given, Made]:
        own = inspect.signature(function)
        known = {name: one for name, one in own.parameters.items() if one.kind is not inspect.Parameter.VAR_KEYWORD}
        if like is not None:
            theirs = inspect.signature(like).parameters
            known |= {name: one for name, one in theirs.items() if name not in (*known, "num_envs", "autoreset")}
        names = [name for name in known if name != "self"]
        who = function.__qualname__.removesuffix(".__init__")

        @wraps(function)
        def call(*args: Given.args, **arguments: Given.kwargs) -> Made:
            for name in arguments:
                if name not in names:
                    raise TypeError(f"{who} has no argument {name!r}; {_answer(name, names)}")
            return function(*args, **arguments)

        call.__signature__ = own.replace(parameters=list(known.values()))  # type: ignore[attr-defined]  # what editors show
        return call

    return decorate


def _answer(name: str, names: list[str]) -> str:
    for part, kind in _PARTS.items():
        if name in {field.name for field in fields(kind)}:
            return f"say {part}={kind.__name__}({name}=...)"
    if name in ("num_envs", "autoreset"):
        return "it belongs to a batch, CrowdEnv or make_vec: this is one environment"
    near = get_close_matches(name, names, n=1, cutoff=0.7)
    if near:
        return f"did you mean {near[0]!r}?"
    option = f"an option of the scenario is given to it, scenario=make_scenario('room-v0', {name}=...)"
    return f"known: {', '.join(names)}; {option}"


def physics_step(physics: Physics, *places: Scenario, within: float = DECISION_DT) -> float:
    """Return the physics step [s] in places that share a batch; by default a part of ``within``, short enough for each.

    It depends on the populations of the scenarios, never on the drawn people.
    """
    if physics.dt is not None:
        return physics.dt
    return min(
        physics.law.default_dt(extreme_bodies(place.population), within, place.behavior(Outline, physics.outline))
        for place in places
    )


@dataclass(frozen=True)
class Routing(Part):
    """The people's choice of the way out.

    Parameters
    ----------
    strategy : a name in `crowd_env.routing.strategies.STRATEGIES`, or that of a route or exit of the scenario; by default the
        scenario decides.
    signs : whether the control rules of the scenario send people another way.

    Raises
    ------
    ValueError
        If one of them is of a wrong type; the environment checks that its scenario has the route.
    """

    strategy: str | None = None
    signs: bool = True


AsRouting: TypeAlias = Routing | str | Plain | None


class EnvArguments(TypedDict, total=False):
    """The arguments that every environment of people shares with `CrowdEnv`."""

    people: int | None
    physics: AsPhysics | None
    walking: AsWalking
    routing: AsRouting
    action: str | Plain | ActionKind | None
    observation: ObservationLayout | Plain | None
    reward: RewardWeights | Mapping[Any, Any] | None
    decision_dt: float | None
    time_limit: float | None


_PARTS: dict[str, type[Any]] = {"physics": Physics, "walking": Walking, "routing": Routing}
_STORED = {"signs": "rules"}  # field of a part -> name in files, where it is another


def arguments_of(settings: Plain) -> dict[str, Any]:
    """Return the arguments of an environment for flat settings, as the files of runs and policies hold them.

    ``scheme``, ``dt``, ``outline``, ``max_drive``, ``balance`` and ``threads`` make the physics, ``manner`` and ``acts_on``
    the walking, ``strategy`` and ``rules`` the routing; ``frame`` goes to the action; all else stays as it is.  A part that
    is given as such goes before its flat words.
    """
    found = dict(settings)
    for name, kind in _PARTS.items():
        words = {_STORED.get(field.name, field.name): field.name for field in fields(kind)}
        own = {field: found.pop(word) for word, field in words.items() if word in found}
        if own and name not in found:
            found[name] = kind(**own)
    if "frame" in found:
        found["action"] = replace(make_action(found.get("action", "continuous")), frame=found.pop("frame"))
    return found
