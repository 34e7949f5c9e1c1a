"""Actions: what an agent decides is a desired velocity, as a multiple of its pedestrian's desired speed.

In the frame "path" the first axis is the direction of the shortest path at the pedestrian's position, looked up anew every
0.01 s, and the second points to its left: (1, 0) is exactly what the rule "walk the shortest path" does.  In the frame
"world" the axes are x and y.  A vector longer than 1 is shortened to 1: nobody wants to be faster than the desired speed.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal

import gymnasium
import numpy as np
from numpy.typing import ArrayLike

from crowd_env._kernels.jit import kernel
from crowd_env.checks import array, check_fields, known, refuse, shown
from crowd_env.state import Bools, Floats

Frame = Literal["path", "world"]
FRAMES: tuple[Frame, ...] = ("path", "world")

RULE = (1.0, 0.0)  # the command of those who walk the shortest path

_TURNS = np.arange(8) * np.pi / 4
# Discrete action k < 8: full speed at k * 45 degrees to the left of the first axis; 8: stand still.
DISCRETE = np.concatenate([np.column_stack([np.cos(_TURNS), np.sin(_TURNS)]), np.zeros((1, 2))])


@dataclass(frozen=True)
class ActionKind:
    """One way to say what a pedestrian is to do: a name in ``ACTIONS``, or an object of one's own, ``CrowdEnv(action=...)``.

    Parameters
    ----------
    name : what messages call it.
    space : of one pedestrian's action.
    decode : turns actions (P, *shape of the space) into commands (P, 2), desired velocities as multiples of the own desired
        speed.  Commands longer than 1 are shortened afterwards.  Rows of those who follow the rule hold the neutral action.
        None = an action is a command.
    neutral : the action that is decoded as (1, 0), the rule.

    Raises
    ------
    ValueError
        If one of them is something else, or the neutral action is not decoded as the rule.
    """

    name: str
    space: gymnasium.Space[Any]
    decode: Callable[[np.ndarray], np.ndarray] | None
    neutral: ArrayLike

    def __post_init__(self) -> None:
        check_fields("action kind", self)
        if not isinstance(self.space, gymnasium.Space) or self.space.shape is None:
            refuse(f"action kind {self.name!r}: space", self.space, "a space of Gymnasium that has a shape")
        if self.decode is not None and not callable(self.decode):
            refuse(f"action kind {self.name!r}: decode", self.decode, "a function (actions)")
        neutral = np.asarray(self.neutral)
        if neutral.shape != self.space.shape:
            refuse(f"action kind {self.name!r}: neutral", self.neutral, f"an action of the shape {self.space.shape}")
        command = np.asarray(neutral[None] if self.decode is None else self.decode(neutral[None])).tolist()
        if command != [list(RULE)]:
            raise ValueError(
                f"action kind {self.name!r}: the neutral action {shown(self.neutral)} is decoded as {shown(command)}; it must "
                f"be decoded as {[list(RULE)]}, the rule"
            )


def _choose(action: np.ndarray) -> np.ndarray:
    """Return the rows of ``DISCRETE`` (P, 2) of choices (P,)."""
    with np.errstate(invalid="ignore"):
        whole = action.astype(np.int64)
    bad = np.flatnonzero((whole != action) | (whole < 0) | (whole >= len(DISCRETE)))
    if len(bad):
        raise ValueError(
            f"action of pedestrian {bad[0]} is {shown(action[bad[0]])}; it must be 0 to {len(DISCRETE) - 1}"
        )
    return np.asarray(DISCRETE[whole])


ACTIONS: Mapping[str, ActionKind] = MappingProxyType(
    {
        "continuous": ActionKind("continuous", gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32), None, RULE),
        "discrete": ActionKind("discrete", gymnasium.spaces.Discrete(len(DISCRETE)), _choose, 0),
    }
)


def make_action(kind: str | ActionKind) -> ActionKind:
    """Return a kind of action by its name in ``ACTIONS``, or the kind itself.

    Raises
    ------
    ValueError
        If it is unknown or something else.
    """
    return kind if isinstance(kind, ActionKind) else ACTIONS[known("action kind", kind, ACTIONS)]


def plain_name(kind: str | ActionKind) -> str:
    """Return the name by which `make_action` finds a kind of action.

    Raises
    ------
    ValueError
        If it is one of the user's own: plain data hold no functions.
    """
    kind = make_action(kind)
    if ACTIONS.get(kind.name) is not kind:
        raise ValueError(f"action kind {kind.name!r} is one of your own, which cannot be written as plain data")
    return kind.name


def to_command(action: ArrayLike, kind: ActionKind, controlled: Bools) -> Floats:
    """Return the commands (P, 2) of actions; (1, 0) for those who are not ``controlled`` (P,), whatever their action.

    Raises
    ------
    ValueError
        If the shape is wrong, or an action of somebody controlled is no real number, not finite or unknown.
    """
    count, shape = len(controlled), kind.space.shape or ()
    given = array(f"{kind.name} actions", action, (count, *shape))
    if kind.decode is not None and not controlled.all():
        given = np.where(controlled.reshape(count, *(1 for _ in shape)), given, kind.neutral)
    command = np.array(given if kind.decode is None else kind.decode(given), dtype=np.float64, order="C")
    if command.shape != (count, 2):
        raise ValueError(f"action kind {kind.name!r} decodes into the shape {command.shape}; it must be {(count, 2)}")
    bad = shorten(command, controlled)
    if bad >= 0:
        raise ValueError(f"action of pedestrian {bad} is {shown(given[bad].tolist())}; it must be finite")
    return command


@kernel
def shorten(command: Floats, controlled: Bools) -> int:
    """Shorten commands (P, 2) longer than 1 to 1, in place; (1, 0), the rule, for those who are not controlled (P,).

    Returns the first row of somebody controlled that is not finite, -1 if there is none.
    """
    for i in range(len(command)):
        if not controlled[i]:
            command[i, 0], command[i, 1] = 1.0, 0.0
            continue
        x, y = command[i, 0], command[i, 1]
        if not (abs(x) < np.inf and abs(y) < np.inf):  # nan too
            return i
        if x * x + y * y > 1.0:
            length = np.hypot(x, y)
            command[i, 0], command[i, 1] = x / length, y / length
    return -1
