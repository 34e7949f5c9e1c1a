"""What learning libraries pass to a reset or a step: options are checked here, actions by `crowd_env.checks.array`."""

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from crowd_env.checks import shown
from crowd_env.state import Bools

NUMBERS = "biuf"  # kinds of dtype that an action may have


def check_options(options: Any, known: Collection[str] = (), *, idle: Collection[str] = ()) -> None:
    """Raise ValueError unless ``options`` of a reset is None or a dictionary of known names; ``idle`` names do nothing."""
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
    """Return the mask (``count``,) of Gymnasium's reset option ``reset_mask``, true where to reset; None = everywhere.

    The option stays in the dictionary: wrappers around the environment read it, too.

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
