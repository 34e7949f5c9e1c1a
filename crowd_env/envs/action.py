"""Actions: an agent decides a desired velocity, as a multiple of its pedestrian's desired speed.

In the frame "path" the first axis is the direction of the shortest path at the pedestrian's position, updated every 0.01 s.
The second axis points to its left: (1, 0) is exactly the rule "walk the shortest path".  In the frame "world" the axes are x
and y.  A vector longer than 1 is shortened to 1: no pedestrian wants more than its desired speed.

Choices among a few speeds are easier to learn than a Gaussian around full speed.  That one saturates at the bound and then
never tries to slow down.  Where a place has several exits, an action may also choose among them, see `SpeedExitTable`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowd_env.core.arrays.state import Bools, Floats, Ints, unit_vectors
from crowd_env.core.checks import (
    Natural,
    NotNegative,
    Plain,
    Range,
    array,
    check_fields,
    check_keys,
    known,
    refuse,
    require_all,
    shown,
)
from crowd_env.core.kernels.jit import kernel

Frame = Literal["path", "world"]
Masks = NDArray[np.int8]  # 1 = the choice counts, as spaces of Gymnasium take it
FRAMES: tuple[Frame, ...] = ("path", "world")

RULE = (1.0, 0.0)  # the command of a pedestrian on the shortest path
KEEP = -1  # the choice that keeps the current way

_TURNS = np.arange(8) * np.pi / 4
# Discrete action k < 8: full speed at k * 45 degrees to the left of the first axis; 8: stand still.
DISCRETE = np.concatenate([unit_vectors(_TURNS), np.zeros((1, 2))])


@dataclass(frozen=True)
class ActionKind:
    """An action space with its decoder: a name in ``ACTIONS``, or a custom object, ``CrowdEnv(action=...)``.

    Parameters
    ----------
    name : name in messages.
    space : of one pedestrian's action.
    decode : turns actions (P, ...), each of the space, into commands (P, 2): desired velocities as multiples of the desired
        speed.  Commands longer than 1 are shortened afterwards.  Rows of scripted pedestrians hold the neutral action.
        None = an action is a command.  If ``routes`` is not None it returns two: commands, and choices (P,) among the ways
        out, whole numbers in the order of `Scenario.ways`; ``KEEP``, -1, keeps the current way.
    neutral : the action that is decoded as (1, 0), the rule: full speed along the way.  Learning may start from it; of a
        discrete kind it is the index of that choice.
    routes : how many exits and routes an action chooses among; None = it chooses none.  0, of a table such as that of
        "speeds-exits", is as many as the place has.
    dwell : s, a pedestrian that has changed its way keeps the new one for this time.
    frame : axes of the commands: "path", along the route, or "world", along x and y.

    Raises
    ------
    ValueError
        If a parameter is of a wrong type or out of range, or the neutral action is not decoded as the rule.
    """

    name: str
    space: gymnasium.Space[Any]
    decode: Callable[[np.ndarray], Any] | None
    neutral: ArrayLike
    routes: Natural | None = None
    dwell: NotNegative = 0.0
    frame: Frame = "path"

    def __post_init__(self) -> None:
        check_fields("action kind", self)
        if not isinstance(self.space, gymnasium.Space) or self.space.shape is None:
            refuse(f"action kind {self.name!r}: space", self.space, "a space of Gymnasium that has a shape")
        if self.decode is not None and not callable(self.decode):
            refuse(f"action kind {self.name!r}: decode", self.decode, "a function (actions)")
        neutral = np.asarray(self.neutral)
        if neutral.shape != self.space.shape:
            refuse(f"action kind {self.name!r}: neutral", self.neutral, f"an action of the shape {self.space.shape}")
        command, choice = self.decoded(neutral[None])
        found = np.asarray(command).tolist(), None if choice is None else choice.tolist()
        if found != ([list(RULE)], None if choice is None else [KEEP]):
            what = f"action kind {self.name!r}: what the neutral action {shown(self.neutral)} is decoded as"
            refuse(what, found, f"the rule, {list(RULE)}, and to keep the own way")

    def decoded(self, action: np.ndarray) -> tuple[np.ndarray, Ints | None]:
        """Return the commands of actions (P, ...), each of the space, and the ways that they choose; None if there are none.

        Raises
        ------
        ValueError
            If ``decode`` raises it, or returns no ways where it should.
        """
        if self.decode is None:
            return action, None
        found = self.decode(action)
        if self.routes is None:
            return found, None
        if not isinstance(found, tuple) or len(found) != 2:
            refuse(f"action kind {self.name!r}: what decode returns", found, "a tuple (commands, choices)")
        choice = array(f"choices of action kind {self.name!r}", found[1], (len(action),), "iu").astype(np.int64)
        bad = np.flatnonzero((choice < KEEP) | (choice >= max(self.routes, 0)))
        if len(bad):
            refuse(
                f"action kind {self.name!r}: a choice",
                choice[bad[0]],
                f"{KEEP}, to keep the own way, or below {self.routes}",
            )
        return found[0], choice


def _rows_of(commands: Floats, action: np.ndarray) -> Floats:
    """Return the rows (P, 2) of a table of commands (K, 2) that choices (P,) name."""
    with np.errstate(invalid="ignore"):
        whole = action.astype(np.int64)
    bad = np.flatnonzero((whole != action) | (whole < 0) | (whole >= len(commands)))
    if len(bad):
        refuse(f"action of pedestrian {bad[0]}", action[bad[0]], f"0 to {len(commands) - 1}")
    return commands[whole]


def _choose(action: np.ndarray) -> np.ndarray:
    """Return the rows of ``DISCRETE`` (P, 2) of choices (P,)."""
    return _rows_of(DISCRETE, action)


@dataclass(frozen=True)
class SpeedTable:
    """The choices of a kind such as "speeds": each speed in each heading.

    Choice ``k`` is the speed ``k // H`` in the heading ``k % H`` of the H headings.

    Parameters
    ----------
    speeds : (S,) as multiples of the desired speed; one below 0 is a step back.
    headings : (H,) rad, to the left of the first axis.

    Raises
    ------
    ValueError
        If they are no numbers, a speed is not in [-1, 1] or a heading not in [-pi, pi], one comes twice, or no speed is 1 or
        no heading 0: full speed along the way is the rule, which has to be among the choices.
    """

    speeds: tuple[float, ...] = (-0.5, 0.0, 0.35, 0.7, 1.0)
    headings: tuple[float, ...] = (0.0,)

    def __post_init__(self) -> None:
        for name, bound, needed in (("speeds", 1.0, 1.0), ("headings", np.pi, 0.0)):
            what, given = f"action: {name}", getattr(self, name)
            values = require_all(what, array(what, given, (None,)), Range(-bound, bound))
            found = tuple(float(value) for value in values)
            if needed not in found or len(set(found)) < len(found):
                refuse(what, given, f"different numbers, one of them {needed:g}: the rule has to be among the choices")
            object.__setattr__(self, name, found)

    @property
    def commands(self) -> Floats:
        """The command of each choice (S H, 2)."""
        return (np.array(self.speeds)[:, None, None] * unit_vectors(np.array(self.headings))).reshape(-1, 2)

    @property
    def rule(self) -> int:
        """The choice that is full speed along the way."""
        return self.speeds.index(1.0) * len(self.headings) + self.headings.index(0.0)

    def __call__(self, action: np.ndarray) -> Floats:
        """Return the commands (P, 2) of choices (P,)."""
        return _rows_of(self.commands, action)

    def kind(self, name: str) -> ActionKind:
        """Return the kind of action with these choices."""
        return ActionKind(name, gymnasium.spaces.Discrete(len(self.commands)), self, self.rule)


@dataclass(frozen=True)
class SpeedExitTable(SpeedTable):
    """The choices of "speeds-exits": each speed in each heading, along the current way or along a new one.

    Of the K choices of the `SpeedTable`, choice ``k`` walks as ``k % K``.  ``k // K`` is 0 to keep the current way, else 1 +
    the number of the exit or route to take from now on, in the order of `Scenario.ways`.

    Parameters
    ----------
    routes : number of exits and routes; 0 = as many as the place has, which an environment fills in.
    dwell : s, a pedestrian that has changed its way keeps the new one for this time, which prevents dithering.

    Raises
    ------
    ValueError
        If one of them is negative, or where `SpeedTable` raises it.
    """

    routes: Natural = 0
    dwell: NotNegative = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_fields("action", self)

    def __call__(self, action: np.ndarray) -> Any:
        """Return the commands (P, 2) of choices (P,), and the ways that they choose (P,)."""
        commands = self.commands
        return _rows_of(np.tile(commands, (1 + self.routes, 1)), action), action.astype(np.int64) // len(commands) - 1

    def kind(self, name: str) -> ActionKind:
        """Return the kind of action with these choices."""
        space = gymnasium.spaces.Discrete(len(self.commands) * (1 + self.routes))
        return ActionKind(name, space, self, self.rule, self.routes, self.dwell)


ACTIONS: Mapping[str, ActionKind] = {
    "continuous": ActionKind("continuous", gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32), None, RULE),
    "discrete": ActionKind("discrete", gymnasium.spaces.Discrete(len(DISCRETE)), _choose, 0),
    # speeds along the way, with a step back
    "speeds": SpeedTable().kind("speeds"),
    # the same speeds, straight on or half right or half left
    "speeds-directions": SpeedTable(headings=(-np.pi / 4, 0.0, np.pi / 4)).kind("speeds-directions"),
    # the speeds of "speeds", each along the current way or along that to one of the exits or routes
    "speeds-exits": SpeedExitTable().kind("speeds-exits"),
}


def make_action(kind: str | Plain | ActionKind) -> ActionKind:
    """Return a kind of action by its name in ``ACTIONS``, the one of plain data, or the kind itself.

    Plain data are a name, the ``frame`` and, of a kind with a `SpeedTable`, its parameters: ``{"name": "speeds", "speeds": [0,
    0.5, 1]}``.

    Raises
    ------
    ValueError
        If it is unknown or of a wrong type, or where `SpeedTable` raises it.
    """
    if isinstance(kind, ActionKind):
        return kind
    if not isinstance(kind, Mapping):
        return ACTIONS[known("action kind", kind, ACTIONS)]
    if "name" not in kind:
        raise ValueError(f"action: key 'name' is missing; known action kinds: {', '.join(ACTIONS)}")
    named = ACTIONS[known("action kind", kind["name"], ACTIONS)]
    table = named.decode if isinstance(named.decode, SpeedTable) else None
    check_keys("action", kind, ["name", "frame", *(asdict(table) if table else ())])
    given = {key: value for key, value in kind.items() if key not in ("name", "frame")}
    made = replace(table, **given).kind(named.name) if table and given else named
    return replace(made, frame=kind["frame"]) if "frame" in kind else made


def plain_action(kind: str | Plain | ActionKind) -> str | dict[str, Any]:
    """Return the plain data of which `make_action` makes a kind of action.

    Raises
    ------
    ValueError
        If it is a custom kind: plain data hold no functions.
    """
    kind = make_action(kind)
    named = ACTIONS.get(kind.name)
    table = (
        kind.decode if named and isinstance(named.decode, SpeedTable) and isinstance(kind.decode, SpeedTable) else None
    )
    if named is None or not (table or (kind.decode is named.decode and kind.space == named.space)):
        raise ValueError(f"action kind {kind.name!r} is one of your own, which cannot be written as plain data")
    plain: dict[str, Any] = {"name": kind.name}
    if table and table != named.decode:
        plain |= {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(table).items()}
    if kind.frame != "path":
        plain["frame"] = kind.frame
    return plain if len(plain) > 1 else kind.name


def fit_routes(kind: ActionKind, scenario: str, ways: Sequence[str]) -> ActionKind:
    """Return the kind of action for a place with these exits and routes.

    Raises
    ------
    ValueError
        If it chooses among another number of them.
    """
    if kind.routes == 0 and isinstance(kind.decode, SpeedExitTable):
        return replace(replace(kind.decode, routes=len(ways)).kind(kind.name), frame=kind.frame)
    if kind.routes not in (None, len(ways)):
        raise ValueError(
            f"action kind {kind.name!r} chooses among {kind.routes} exits and routes; {scenario} has {len(ways)}: "
            f"{', '.join(ways)}"
        )
    return kind


def way_of_action(kind: ActionKind) -> Ints | None:
    """Return the way that each of n discrete choices takes (n,), ``KEEP`` among them; None if the kind has no such choices."""
    if kind.routes is None or not isinstance(kind.space, gymnasium.spaces.Discrete):
        return None
    return kind.decoded(np.arange(kind.space.start, kind.space.start + kind.space.n))[1]


def mask_info(mask: Masks | None) -> dict[str, Masks]:
    """Return the ``action_mask`` of an info: nothing without a mask."""
    return {} if mask is None else {"action_mask": mask}


def to_command(action: ArrayLike, kind: ActionKind, controlled: Bools) -> tuple[Floats, Ints | None]:
    """Return the commands (P, 2) of actions; (1, 0) for pedestrians not ``controlled`` (P,), whatever their action.

    The second is the way that each chooses (P,), None if the kind of action chooses none.

    Raises
    ------
    ValueError
        If the shape is wrong, or an action of a controlled pedestrian is no real number, not finite or unknown.
    """
    count, shape = len(controlled), kind.space.shape or ()
    given = array(f"{kind.name} actions", action, (count, *shape))
    if kind.decode is not None and not controlled.all():
        given = np.where(controlled.reshape(count, *(1 for _ in shape)), given, kind.neutral)
    decoded, choice = kind.decoded(given)
    command = np.array(decoded, dtype=np.float64, order="C")
    if command.shape != (count, 2):
        raise ValueError(f"action kind {kind.name!r} decodes into the shape {command.shape}; it must be {(count, 2)}")
    bad = shorten(command, controlled)
    if bad >= 0:
        raise ValueError(f"action of pedestrian {bad} is {shown(given[bad].tolist())}; it must be finite")
    return command, choice


@kernel
def shorten(command: Floats, controlled: Bools) -> int:
    """Shorten commands (P, 2) longer than 1 to 1, in place; (1, 0), the rule, for pedestrians not controlled (P,).

    Returns the first controlled row that is not finite, -1 if there is none.
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
            if length == np.inf:  # of components near the largest number
                x, y = 0.25 * x, 0.25 * y
                length = np.hypot(x, y)
            command[i, 0], command[i, 1] = x / length, y / length
    return -1
