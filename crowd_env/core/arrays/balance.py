"""Balance: the body of someone who stands leans over the feet, which follow by stepping; available to every scheme.

    x'' = (g / h) (x - p) + F / m          linear inverted pendulum: h height of the center of mass, F contact and other forces
    c = x + v sqrt(h / g)                  capture point: above a foot placed there the body comes to rest
    p = q + (1 + k) (c - q)                center of pressure, q the middle of the feet, brought back into the support

The support is all within b of the line from foot to foot: an ankle cannot do more than m g b / h.  Inside of it c obeys
c' = -k sqrt(g / h) (c - q), so the body comes upright over the middle of its feet.  Where c leaves the support for the reaction
time, the foot that is further from it is lifted; until it lands, a swing later, the other one alone carries.  It lands at c,
at most a step away from the other.  Then the feet are apart, and bear more in that direction.

Pendulum and capture point: Hof, Gazendam, Sinke 2005 (J Biomech 38:1), Koolen et al. 2012 (Int J Robotics Research 31:1094),
both unchecked.  Two feet, with the body upright over their middle after a step, are ours; so is one radius b in all directions.

Who wants to walk is not balanced by this: feet of walkers follow at every step, and the drive of the papers is the sum of it.
Nobody falls; feet mind neither walls nor each other.  The numbers are fitted on one recorded push, under `nsm2`
(docs/validation.md).
"""

from collections import namedtuple
from collections.abc import Mapping
from dataclasses import astuple, dataclass, fields
from typing import Any, TypeAlias, cast

from crowd_env.core.checks import NotNegative, Positive, check_fields, from_choice, plain_choice


@dataclass(frozen=True)
class Balance:
    """How someone who stands keeps upright.

    Parameters
    ----------
    height : m, ``h``, of the center of mass; about 0.55 of an adult's.
    base : m, ``b``: how far from the line between the feet the center of pressure can be; half a foot is 0.12, the rest is the
        stance.  Fitted.
    gain : ``k``, by which the center of pressure is ahead of the capture point.  Fitted.
    reaction : s that the capture point is outside of the support before a foot is lifted.  Fitted.
    swing : s that a foot is in the air.  Fitted.
    step : m, longest step; no step of that push is so long.
    grip : share of the weight that the ground can give sideways, friction of shoes on a floor.
    head : times as far as the center of mass a leaning body moves its head: 1.7 m over 1 m.
    walks_from : m/s: who wants to be faster than this walks, and does not stand.

    Raises
    ------
    ValueError
        If a value is out of range.
    """

    height: Positive = 1.0
    base: Positive = 0.215
    gain: Positive = 0.2
    reaction: NotNegative = 0.11
    swing: Positive = 0.35
    step: Positive = 0.75
    grip: Positive = 0.4
    head: Positive = 1.7
    walks_from: NotNegative = 0.1

    def __post_init__(self) -> None:
        check_fields("balance", self)

    def params(self) -> "Balance":
        """Return the numbers as kernels read them: a NamedTuple of the fields."""
        return cast(Balance, _Params(*(float(value) for value in astuple(self))))


_Params: Any = namedtuple("_Params", [field.name for field in fields(Balance)])  # type: ignore[misc]  # names alone

Balancing: TypeAlias = str | Mapping[str, Any] | Balance
"""How callers say how people keep upright: a name in `BALANCES`, a table of the parameters of a `Balance`, or one."""

BALANCES: dict[str, Balance | None] = {
    "none": None,  # as in the papers: a disc that stands is braked by its drive
    "stepping": Balance(),
}


def make_balance(balance: Balancing | None) -> Balance | None:
    """Return the balance of a name in `BALANCES`, of plain data such as ``{"base": 0.12}``, or that is given.

    Raises
    ------
    ValueError
        If it is something else, or a name is unknown.
    """
    return from_choice("balance", Balance, balance, BALANCES)


def plain_balance(balance: Balance | None) -> str | dict[str, float]:
    """Return the name of a balance, or if it has none the table of its parameters; ready for JSON, and for `make_balance`."""
    return plain_choice(balance, BALANCES)
