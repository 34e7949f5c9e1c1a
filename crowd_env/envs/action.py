"""Actions: what an agent decides is a desired velocity, as a multiple of its pedestrian's desired speed.

In the frame "path" the first axis is the direction of the shortest path at the pedestrian's place, looked up anew every
0.01 s, and the second points to its left: (1, 0) is exactly what the rule "walk the shortest path" does.  In the frame
"world" the axes are x and y.  A vector longer than 1 is shortened to 1: nobody wants to be faster than the desired speed.
"""

from typing import Literal, get_args

import gymnasium
import numpy as np
from numpy.typing import ArrayLike

from crowd_env._kernels.jit import kernel
from crowd_env.checks import array, known, shown
from crowd_env.state import Bools, Floats

Frame = Literal["path", "world"]
ActionKind = Literal["continuous", "discrete"]

_TURNS = np.arange(8) * np.pi / 4
# Discrete action k < 8: full speed at k * 45 degrees to the left of the first axis; 8: stand still.
DISCRETE = np.concatenate([np.column_stack([np.cos(_TURNS), np.sin(_TURNS)]), np.zeros((1, 2))])


def action_space(kind: ActionKind) -> gymnasium.spaces.Box | gymnasium.spaces.Discrete:
    """Return the space of one pedestrian's action.

    Raises
    ------
    ValueError
        If the kind is unknown.
    """
    if known("action kind", kind, get_args(ActionKind)) == "continuous":
        return gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
    return gymnasium.spaces.Discrete(len(DISCRETE))


def check_frame(frame: str) -> None:
    """Raise ValueError if the frame is unknown."""
    known("frame", frame, get_args(Frame))


def to_command(action: ArrayLike, kind: ActionKind, count: int, asked: Bools | None = None) -> Floats:
    """Return the command (count, 2) of actions (count, 2) or, if discrete, (count,).

    Whatever the action of those who are not ``asked`` (count,), their command is (1, 0).

    Raises
    ------
    ValueError
        If the shape is wrong, a value is no real number or not finite, or a discrete action is unknown.
    """
    if kind == "discrete":
        choice = array("discrete actions", action, (count,))
        if asked is not None:
            choice = np.where(asked, choice, 0)
        with np.errstate(invalid="ignore"):
            whole = choice.astype(np.int64)
        bad = np.flatnonzero((whole != choice) | (whole < 0) | (whole >= len(DISCRETE)))
        if len(bad):
            raise ValueError(
                f"action of pedestrian {bad[0]} is {shown(choice[bad[0]])}; it must be 0 to {len(DISCRETE) - 1}"
            )
        command = DISCRETE[whole]
        if asked is not None:
            command[~asked] = (1.0, 0.0)
        return command
    command = np.array(array("actions", action, (count, 2)), dtype=np.float64, order="C")
    bad = shorten(command, np.ones(count, dtype=np.bool_) if asked is None else asked)
    if bad >= 0:
        raise ValueError(f"action of pedestrian {bad} is {command[bad].tolist()}; it must be finite")
    return command


@kernel
def shorten(command: Floats, asked: Bools) -> int:
    """Shorten commands (P, 2) longer than 1 to 1, in place; (1, 0) for those who are not asked (P,).

    Returns who is asked and has one that is not finite, -1 if nobody.
    """
    for i in range(len(command)):
        if not asked[i]:
            command[i, 0], command[i, 1] = 1.0, 0.0
            continue
        x, y = command[i, 0], command[i, 1]
        if not (abs(x) < np.inf and abs(y) < np.inf):  # nan too
            return i
        if x * x + y * y > 1.0:
            length = np.hypot(x, y)
            command[i, 0], command[i, 1] = x / length, y / length
    return -1
