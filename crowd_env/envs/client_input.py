"""What learning libraries hand in, actions and reset options: made into arrays, or refused in a sentence."""

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from crowd_env.checks import shown
from crowd_env.state import Bools

_REAL = "biuf"  # kinds of dtype


def as_numbers(action: Any, shape: tuple[int, ...], what: str) -> np.ndarray:
    """Return an action as an array of real numbers of exactly this shape.

    Parameters
    ----------
    what : whose action it is, as the message is to call it.

    Raises
    ------
    ValueError
        If it is no array, holds anything but real numbers, or has another shape, be it as many numbers.
    """
    try:
        array = np.asarray(action)
        if array.dtype == object:  # numbers one by one, or something else altogether
            array = np.asarray(array.tolist())
    except ValueError:  # rows of different lengths
        array = np.empty(0, dtype=object)
    if array.dtype.kind not in _REAL:
        form = f"an array of real numbers of the shape {shape}" if shape else "one of the real numbers of its space"
        raise ValueError(f"{what} is {shown(action)}; it must be {form}")
    if array.shape != shape:
        raise ValueError(f"{what} has the shape {array.shape}; it must be {shape}")
    return array


def check_options(options: Any, known: Collection[str] = (), *, idle: Collection[str] = ()) -> None:
    """Raise ValueError unless ``options`` of a reset is None or a dictionary of known ones; ``idle`` ones do nothing."""
    if options is None:
        return
    if not isinstance(options, Mapping):
        raise ValueError(f"options is {shown(options)}; it must be a dictionary or None")
    for name in options:
        if name not in known and name not in idle:
            raise ValueError(
                f"unknown reset option {name!r}; known: {', '.join(known) or 'none'}; "
                "scenario, crowd and limits are given when the environment is made"
            )


def reset_mask(options: Any, count: int) -> Bools | None:
    """Return which of so many environments Gymnasium's option ``reset_mask`` (E,) bool asks to reset; None = all.

    The option stays in the dictionary: wrappers around the environment look for it, too.

    Raises
    ------
    ValueError
        If it is no boolean array of that shape or is nowhere true, or if there are other options.
    """
    check_options(options, ("reset_mask",))
    if not options or "reset_mask" not in options:
        return None
    mask = options["reset_mask"]
    if not (isinstance(mask, np.ndarray) and mask.dtype == np.bool_ and mask.shape == (count,) and mask.any()):
        raise ValueError(
            f"reset_mask is {shown(mask)}; it must be a NumPy array of {count} booleans, one an environment, "
            "with at least one True"
        )
    return mask.copy()
