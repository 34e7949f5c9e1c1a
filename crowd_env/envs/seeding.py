"""Seeds of the random generators of a batch."""

from collections.abc import Sequence
from typing import Any

import numpy as np


def seed_words(seed: int | Sequence[int] | None, num_envs: int) -> list[list[int] | None]:
    """Return the words that seed each environment's generator; None = go on drawing from the present one.

    Parameters
    ----------
    seed : an int gives environment ``e`` the words (seed, e); a sequence gives each (its own, 0).

    Raises
    ------
    ValueError
        If a seed is no whole number >= 0, or there are not as many as environments.
    """
    if seed is None:
        return [None] * num_envs
    words: list[list[int] | None]
    if isinstance(seed, list | tuple | np.ndarray):
        words = [[_seed(word), 0] for word in seed]
    else:
        words = [[_seed(seed), e] for e in range(num_envs)]
    if len(words) != num_envs:
        raise ValueError(f"{len(words)} seeds for {num_envs} environments; give one each, or a single int")
    return words


def _seed(word: Any) -> int:
    if isinstance(word, bool) or not isinstance(word, int | np.integer) or word < 0:
        raise ValueError(f"seed {word!r} is not a whole number >= 0")
    return int(word)
