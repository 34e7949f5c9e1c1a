"""What moves the people of an environment, in three parts: the physics, the walking, the routing.

Each part is a frozen dataclass.  An environment takes one, its first field alone, or a table of its fields.
"""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from difflib import get_close_matches
from functools import wraps
from typing import Any, Literal, ParamSpec, TypeAlias, TypedDict, TypeVar, cast

from typing_extensions import Self

from crowd_env.core.arrays.balance import Balancing
from crowd_env.core.arrays.headway import Headway, Manner, make_manner
from crowd_env.core.arrays.outline import BodyShape, make_outline
from crowd_env.core.checks import POSITIVE, Range, check_fields, from_table, number, whole
from crowd_env.envs.action import ActionKind, make_action
from crowd_env.envs.observation.layout import ObservationLayout
from crowd_env.envs.reward import RewardWeights
from crowd_env.physics import ContactScheme, check_outline, make_scheme
from crowd_env.physics.scheme import DECISION_DT
from crowd_env.physics.simulation.arguments import check_balance
from crowd_env.scenarios.groups import extreme_bodies
from crowd_env.scenarios.scenario import Scenario

Given = ParamSpec("Given")
Made = TypeVar("Made")

_THREADS = Range(1, 1024)

# An argument that no environment has -> how it is said.
_SAID = {
    "scheme": "physics='dem', or physics=Physics('dem', dt=0.005)",
    "dt": "physics=Physics('nsm2', dt=0.005)",
    "outline": "physics=Physics('hertz', outline='torso')",
    "max_drive": "physics=Physics('nsm2', max_drive=300.0)",
    "balance": "physics=Physics('nsm2', balance='stepping')",
    "threads": "physics=Physics('nsm2', threads=2)",
    "manner": "walking='calm'",
    "manner_for": "walking=Walking('calm', acts_on='scripted')",
    "acts_on": "walking=Walking('calm', acts_on='scripted')",
    "strategy": "routing='fastest'",
    "rules": "routing=Routing('shortest', signs=False)",
    "signs": "routing=Routing('shortest', signs=False)",
    "frame": "action={'name': 'continuous', 'frame': 'world'}",
    "rule": "scripted=mask",
    "num_envs": "CrowdEnv(num_envs=8), or make_vec: this is one environment",
    "autoreset": "CrowdEnv(autoreset=True), or make_vec(autoreset_mode='SameStep')",
    "count": "people=30",
    "n": "people=30",
}


def answers_unknown(like: type[Any] | None = None) -> Callable[[Callable[Given, Made]], Callable[Given, Made]]:
    """Return a decorator: what it decorates answers an argument that it does not have by a sentence.

    If the function takes ``**arguments``, these are the arguments of the class ``like``, but for those of a batch.
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
    near = [name] if name in _SAID else get_close_matches(name, [*names, *_SAID], n=1, cutoff=0.7)
    if near and near[0] in names:
        return f"did you mean {near[0]!r}?"
    if near:
        return f"say {_SAID[near[0]]}"
    option = f"an option of the scenario is given to it, scenario=make_scenario('room-v0', {name}=...)"
    return f"known: {', '.join(names)}; {option}"


class Part:
    """A part of the settings."""

    @classmethod
    def of(cls, given: Any) -> Self:
        """Return the part, given as such, as a table of its fields, or as its first field alone.

        Raises
        ------
        ValueError
            If the part refuses it.
        """
        if isinstance(given, cls):
            return given
        if isinstance(given, Mapping) and any(name in given for name in inspect.signature(cls).parameters):
            return from_table(cls.__name__.lower(), cls, given)
        return cls(given)  # type: ignore[call-arg]  # a dataclass


@dataclass(frozen=True)
class Physics(Part):
    """What bodies do when they touch, and what they are.

    Parameters
    ----------
    scheme : contact scheme: a name in ``SCHEMES``, a scheme, or a table such as ``{"name": "nsm2", "social": "lin"}``.
    dt : s, physics step; by default that of the scheme, see `ContactScheme.default_dt`.
    outline : shape of all bodies: a name in ``OUTLINES``, an `Outline`, or a table of its parameters.  By default the scenario
        decides, and if it says nothing bodies are discs.  Only schemes that turn bodies take another: `hertz`, `hertz-literal`.
    max_drive : N, the largest force with which a pedestrian drives forwards, infinite = as large as the papers make it, up to
        2 kN; by default the scenario decides.  No scheme without a driving force takes it (`nsm1`).
    balance : how those who stand keep upright: a name in ``BALANCES``, a `Balance`, or a table of its parameters; by default
        the scenario decides, and if it says nothing their drive brakes them.  No scheme without a driving force takes it.
    threads : spread environments over threads; results do not depend on it.

    Raises
    ------
    ValueError
        If one of them is unknown or out of range.
    """

    scheme: str | Mapping[str, Any] | ContactScheme = "nsm2"
    dt: float | None = None
    outline: BodyShape | None = None
    max_drive: float | None = None
    balance: Balancing | None = None
    threads: int = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "scheme", make_scheme(self.scheme))
        if self.dt is not None:
            object.__setattr__(self, "dt", number("dt", self.dt, POSITIVE, "s"))
        object.__setattr__(self, "threads", whole("threads", self.threads, _THREADS))
        check_balance(self.balance, self.law)
        if self.outline is not None:
            check_outline(make_outline(self.outline), self.law)

    @property
    def law(self) -> ContactScheme:
        """The contact scheme."""
        return cast(ContactScheme, self.scheme)

    def step(self, *places: Scenario, within: float = DECISION_DT) -> float:
        """Return the physics step [s] in places that share a batch; by default a part of ``within``, short enough for each.

        It depends on the people of the scenarios, never on those that were drawn.
        """
        if self.dt is not None:
            return self.dt
        shapes = [place.outline_of_run(self.outline) for place in places]
        return min(
            self.law.default_dt(extreme_bodies(place.population), within, shape)
            for place, shape in zip(places, shapes, strict=True)
        )


@dataclass(frozen=True)
class Walking(Part):
    """How people walk before they touch.

    Parameters
    ----------
    manner : a name in ``MANNERS``, a `Headway`, or a table of its parameters; by default the scenario decides.
    acts_on : "everyone": also those who have an action, which then says what one would do with nobody in front.  "scripted":
        only those who have no action; the others walk as their action says.

    Raises
    ------
    ValueError
        If one of them is unknown.
    """

    manner: Manner | None = None
    acts_on: Literal["everyone", "scripted"] = "everyone"

    def __post_init__(self) -> None:
        make_manner(self.manner)
        check_fields("walking", self)


@dataclass(frozen=True)
class Routing(Part):
    """Which way out people take.

    Parameters
    ----------
    strategy : a name in `crowd_env.routing.strategies.STRATEGIES`, or that of a route or exit of the scenario; by default the
        scenario decides.
    signs : whether the control rules of the scenario send people another way.

    Raises
    ------
    ValueError
        If one of them is something else; the environment looks whether its scenario has the route.
    """

    strategy: str | None = None
    signs: bool = True

    def __post_init__(self) -> None:
        check_fields("routing", self)


AsPhysics: TypeAlias = Physics | str | Mapping[str, Any] | ContactScheme
AsWalking: TypeAlias = Walking | str | Mapping[str, Any] | Headway | None
AsRouting: TypeAlias = Routing | str | Mapping[str, Any] | None


class EnvArguments(TypedDict, total=False):
    """The arguments that every environment of people shares with `CrowdEnv`."""

    people: int | None
    physics: AsPhysics
    walking: AsWalking
    routing: AsRouting
    action: str | Mapping[str, Any] | ActionKind
    observation: ObservationLayout | Mapping[str, Any] | None
    reward: RewardWeights | Mapping[Any, Any] | None
    decision_dt: float
    time_limit: float | None


_PARTS: dict[str, type[Any]] = {"physics": Physics, "walking": Walking, "routing": Routing}
_STORED = {"signs": "rules"}  # field of a part -> name in files, where it is another


def arguments_of(settings: Mapping[str, Any]) -> dict[str, Any]:
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
