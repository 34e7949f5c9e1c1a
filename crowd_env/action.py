"""Actions: what an agent decides is a desired velocity, as a multiple of its pedestrian's desired speed.

In the frame "path" the first axis is the direction of the shortest path at the pedestrian's place, looked up anew every
0.01 s, and the second points to its left: (1, 0) is exactly what the rule "walk the shortest path" does.  In the frame
"world" the axes are x and y.  A vector longer than 1 is shortened to 1: nobody wants to be faster than the desired speed.
"""

from typing import Literal, get_args

import gymnasium
import numpy as np
from numpy.typing import ArrayLike

from crowd_env.state import Floats

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
    if kind == "continuous":
        return gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
    if kind == "discrete":
        return gymnasium.spaces.Discrete(len(DISCRETE))
    raise ValueError(f"unknown action kind {kind!r}; known: {', '.join(get_args(ActionKind))}")


def check_frame(frame: str) -> None:
    """Raise ValueError if the frame is unknown."""
    if frame not in get_args(Frame):
        raise ValueError(f"unknown frame {frame!r}; known: {', '.join(get_args(Frame))}")


def to_command(action: ArrayLike, kind: ActionKind, count: int) -> Floats:
    """Return the command (count, 2) of actions (count, 2) or, if discrete, (count,).

    Raises
    ------
    ValueError
        If the shape is wrong, a value is not finite, or a discrete action is unknown.
    """
    if kind == "discrete":
        choice = np.asarray(action)
        if choice.shape != (count,):
            raise ValueError(f"discrete actions must have the shape ({count},), not {choice.shape}")
        with np.errstate(invalid="ignore"):
            whole = choice.astype(np.int64)
        bad = np.flatnonzero((whole != choice) | (whole < 0) | (whole >= len(DISCRETE)))
        if len(bad):
            raise ValueError(f"action of pedestrian {bad[0]} is {choice[bad[0]]}; it must be 0 to {len(DISCRETE) - 1}")
        return DISCRETE[whole]
    command = np.array(action, dtype=np.float64)
    if command.shape != (count, 2):
        raise ValueError(f"actions must have the shape ({count}, 2), not {command.shape}")
    bad = np.flatnonzero(~np.isfinite(command).all(axis=1))
    if len(bad):
        raise ValueError(f"action of pedestrian {bad[0]} is {command[bad[0]].tolist()}; it must be finite")
    length = np.hypot(command[:, 0], command[:, 1])
    return command / np.maximum(length, 1.0)[:, None]
