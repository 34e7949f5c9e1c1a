"""The settings of a simulation, in two parts that are passed on whole: the physics and the walking.

Each part is a frozen dataclass.  A function that takes one also takes its first field alone, or a table of its fields.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from difflib import get_close_matches
from keyword import iskeyword
from typing import Annotated, Any, Literal, Self, TypeAlias

from crowd_env.core.behaviors import BEHAVIORS
from crowd_env.core.behaviors.balance import Balancing
from crowd_env.core.behaviors.behavior import Behavior
from crowd_env.core.behaviors.headway import Headway, Manner
from crowd_env.core.behaviors.outline import BodyShape
from crowd_env.core.behaviors.pulls import Pulls
from crowd_env.core.checks import (
    POSITIVE,
    Checked,
    Plain,
    Range,
    check_fields,
    flag,
    from_table,
    number,
    refuse,
    shown,
    whole,
)
from crowd_env.core.kernels.jit import is_kernel
from crowd_env.physics import SCHEMES, ContactScheme, make_scheme
from crowd_env.physics.allocation import shapes_of

_THREADS = Range(1, 1024)
_CLOSE = 0.8  # of two names, so that a table with a misspelled field of a part is none of its first field
_NEEDS = ("drives", "turns_bodies")  # facts of a scheme that a behavior may need
_OR_NEEDS = " or ".join(map(repr, _NEEDS))


class Part(Checked):
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
        names = [field.name for field in fields(cls)]  # type: ignore[arg-type]  # a dataclass
        if isinstance(given, Mapping) and any(get_close_matches(str(key), names, cutoff=_CLOSE) for key in given):
            return from_table(cls.__name__.lower(), cls, given)
        return cls(given)  # type: ignore[call-arg]  # a dataclass


@dataclass(frozen=True)
class Physics(Part):
    """Contact scheme, time step and bodies.

    Parameters
    ----------
    scheme : contact scheme: a name in ``SCHEMES``, a scheme, or a table such as ``{"name": "nsm2", "social": "lin"}``.
    dt : s, physics step; by default that of the scheme, see `ContactScheme.default_dt`.
    outline : shape of all bodies: a name in ``OUTLINES``, an `Outline`, or a table of its parameters.  By default that of
        the scenario, or discs.  Only schemes that turn bodies take another: `hertz`, `hertz-literal`.
    max_drive : N, the largest driving force of a pedestrian, infinite = that of the papers, up to 2 kN; by default that of
        the scenario.  No scheme without a driving force takes it (`nsm1`).
    balance : how standing pedestrians keep upright: a name in ``BALANCES``, a `Balance`, or a table of its parameters; by
        default that of the scenario, or none: the drive brakes them.  No scheme without a driving force takes it.
    threads : spread environments, or with `dem` the parts of one large crowd, over threads; results do not depend on it.
    allow_unstable : accept a ``dt`` above the stable step of the scheme, and switch off `crowd_env.physics.bounds`, so that
        the contact law alone limits speeds, paths and crossing of walls (for demonstrations).

    Raises
    ------
    ValueError
        If a value is unknown or out of range, or the scheme cannot have it.
    """

    scheme: str | Plain | ContactScheme = "nsm2"
    dt: float | None = None
    outline: BodyShape | None = None
    max_drive: float | None = None
    balance: Balancing | None = None
    threads: int = 1
    allow_unstable: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "scheme", make_scheme(self.scheme))
        if self.dt is not None:
            object.__setattr__(self, "dt", number("dt", self.dt, POSITIVE, "s"))
        object.__setattr__(self, "threads", whole("threads", self.threads, _THREADS))
        flag("allow_unstable", self.allow_unstable)
        check_behaviors(behaviors_of(self), self.law)

    @property
    def law(self) -> ContactScheme:
        """The contact scheme."""
        assert isinstance(self.scheme, ContactScheme)  # made at construction
        return self.scheme


@dataclass(frozen=True)
class Walking(Part):
    """How pedestrians walk before they touch.

    Parameters
    ----------
    manner : a name in ``MANNERS``, a `Headway`, or a table of its parameters; by default that of the scenario.
    acts_on : "everyone": pedestrians with an action too, which is then the desired motion on a free way.  "scripted": only
        pedestrians without an action; the others walk exactly by their action.
    share : of the people in each environment, others in every episode, that actions move; all others are scripted, and
        ``acts_on`` them alone.
    pulls : groups and attractions that pull people off their way, of all places or of each, as `Pulls` or tables of its
        fields; by default as in the scenario.
    others : behaviors that are not in ``BEHAVIORS``: objects of user classes derived from `Behavior`.

    Raises
    ------
    ValueError
        If a value is unknown.
    """

    manner: Manner | None = None
    acts_on: Literal["everyone", "scripted"] = "everyone"
    pulls: Pulls | Plain | Sequence[Pulls | Plain] | None = None
    others: tuple[Behavior, ...] = ()
    share: Annotated[float, Range(0.0, 1.0, above=True)] | None = None

    def __post_init__(self) -> None:
        Headway.of(self.manner)
        check_fields("walking", self)
        if self.share is not None:
            object.__setattr__(self, "acts_on", "scripted")
        if isinstance(self.pulls, Mapping):
            object.__setattr__(self, "pulls", Pulls.of(self.pulls))
        elif isinstance(self.pulls, list | tuple):
            object.__setattr__(self, "pulls", [Pulls.of(one) for one in self.pulls])
        check_others(self.others)


def check_others(others: Sequence[Behavior]) -> None:
    """Raise ValueError unless behaviors that are not in ``BEHAVIORS`` declare themselves without a clash.

    Raises
    ------
    ValueError
        If a name is none or taken, ``desire`` is no kernel, an array of the memory has no shape, a need is unknown or without
        ``LACKS``, or recordings cannot hold what one records.
    """
    names, recorded = list(BEHAVIORS), [name for kind in BEHAVIORS.values() for name in kind.RECORDED]
    for one in others:
        name = getattr(one, "NAME", None)
        where = f"walking: behavior {shown(name)}"
        if not isinstance(one, Behavior) or not str(name).isidentifier() or iskeyword(str(name)):
            refuse(
                "walking: others",
                one,
                "objects of classes derived from Behavior, each with a NAME that is an identifier",
            )
        if name in names:
            raise ValueError(f"{where}: the name is taken; taken are {', '.join(names)}")
        if one.NEEDS is not None and (one.NEEDS not in _NEEDS or not one.LACKS):
            raise ValueError(
                f"{where}: NEEDS is {shown(one.NEEDS)}; it must be None, or {_OR_NEEDS}, with a text in LACKS"
            )
        if (desire := type(one).desire) is not None and not is_kernel(desire):
            raise ValueError(f"{where}: desire is {shown(desire)}; it must be a function under @inner_kernel")
        kept = shapes_of(one.MEMORY) if one.MEMORY else {}
        for array, shape in kept.items():
            if shape[:1] not in (["P"], ["E"]) or not all(part.isdigit() for part in shape[1:]):
                raise ValueError(
                    f"{where}: array {array!r} of its MEMORY has the shape {' '.join(shape) or 'none'!r}; write such as "
                    "Annotated[Floats, 'P 2'], of P pedestrians or E environments, and numbers"
                )
        for array in one.RECORDED if isinstance(one.RECORDED, tuple) else [one.RECORDED]:
            if array not in kept or array in recorded:
                why = (
                    "is recorded already" if array in recorded else f"is not in its memory: {', '.join(kept) or 'none'}"
                )
                raise ValueError(f"{where}: RECORDED names {shown(array)}, which {why}")
            recorded.append(array)
        names.append(str(name))


AsPhysics: TypeAlias = Physics | str | Plain | ContactScheme
AsWalking: TypeAlias = Walking | str | Plain | Headway | None


def behaviors_of(*parts: Part) -> dict[str, Any]:
    """Return the behaviors that the parts of the settings choose, by name; None where one is absent or unset."""
    return {
        name: kind.of(getattr(part, name))
        for name, kind in BEHAVIORS.items()
        for part in parts
        if hasattr(part, name) and not kind.PER_PLACE
    }


def check_behaviors(chosen: Mapping[str, Any], scheme: ContactScheme, driving: bool = True) -> None:
    """Raise ValueError unless a scheme supports all chosen behaviors; the message lists the schemes that do.

    Passive grains (not ``driving``) have no driving force under any scheme.
    """
    for behavior in chosen.values():
        needs = getattr(behavior, "NEEDS", None)
        if needs is None or (getattr(scheme, needs) and (driving or needs != "drives")):
            continue
        able = [name for name, known in SCHEMES.items() if getattr(known, needs)]
        switched = needs == "turns_bodies" and any(type(scheme) is type(SCHEMES[name]) for name in able)
        subject = scheme.info.name if driving or needs != "drives" else "passive grains (driving=False)"
        lacks = behavior.LACKS.format(behavior=f"the {behavior.NAME} {shown(behavior.plain_of(behavior))}")
        raise ValueError(
            f"{subject}{' with rotation=False' if switched else ''} {lacks}; schemes that can: {', '.join(able)}"
        )


def kinds_of(walking: Walking) -> dict[str, type[Behavior]]:
    """Return the class of each behavior of a simulation, by name."""
    return BEHAVIORS | {one.NAME: type(one) for one in walking.others}
