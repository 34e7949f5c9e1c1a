"""Observations: named terms of fixed width, laid side by side.

Vectors are given in the frame of the actions: along and to the left of the shortest path ("path"), or along x and y
("world"); `direction` is always along x and y.  Every value lies in [-1, 1].
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from crowd_env.checks import Range, check_fields, from_table, known, refuse
from crowd_env.envs.observation.view import (
    CRUSH,
    DENSITY,
    DESIRED_SPEED,
    DIRECTION,
    NEIGHBORS,
    PUSH,
    SIGHT,
    TRAVEL_TIME,
    VELOCITY,
    WALLS,
    Plan,
    View,
)
from crowd_env.state import Ints

__all__ = ["SIGHT", "TERMS", "ObservationLayout", "View"]

# Up to so many people in a room all pairs are looked at, above it those of neighboring cells: faster, and the same bits.
ALL_PAIRS = 96
MOST_NEIGHBORS = 32
MOST_RAYS = 360


# Name -> (law, width); "neighbors" and "walls" multiply the width by how many are asked for.  A law is a function
# `(view, out)` that writes its columns `out` (P, width), or the number of one that is compiled: see
# `crowd_env.envs.observation.perception`.
TERMS: dict[str, tuple[Callable[[View, np.ndarray], Any] | int, int]] = {
    # own velocity / 2 m/s, in the frame
    "velocity": (VELOCITY, 2),
    # own desired speed / 2 m/s
    "desired_speed": (DESIRED_SPEED, 1),
    # direction of the shortest path to an exit, along x and y
    "direction": (DIRECTION, 2),
    # time t the rest of the shortest path takes at the own desired speed, as t / (t + 5 s)
    "travel_time": (TRAVEL_TIME, 1),
    # sum of the contact impulses since the last decision / (own mass * 1 m/s), in the frame
    "push": (PUSH, 2),
    # sum of the magnitudes of these impulses / (own mass * 1 m/s): large between two who push from both sides
    "crush": (CRUSH, 1),
    # people within 1 m of the own center, oneself included, / (pi m2 * 8 /m2)
    "density": (DENSITY, 1),
    # free distance from the own surface to the nearest wall along rays / 3 m; ray k at k / n of a turn to the left
    "walls": (WALLS, 1),
    # the k nearest people within 3 m, five values each: offset / 3 m (2), relative velocity / 4 m/s (2), closeness, which is
    # 1 - gap / 3 m, 1 at contact; all five are 0 where there is nobody
    "neighbors": (NEIGHBORS, 5),
}


@dataclass(frozen=True)
class ObservationLayout:
    """Which terms an observation holds, and where: ``layout["direction"]`` is a slice of columns.

    Parameters
    ----------
    terms : names in ``TERMS``, in the order of the columns.
    neighbors : how many nearest people are seen.
    rays : how many directions walls are felt for in.

    Raises
    ------
    ValueError
        If a term is unknown or named twice, or a number is out of range.
    """

    terms: tuple[str, ...] = tuple(TERMS)
    neighbors: int = 6
    rays: int = 8

    def __post_init__(self) -> None:
        check_fields("observation", self, neighbors=Range(1, MOST_NEIGHBORS), rays=Range(1, MOST_RAYS))
        for name in self.terms:
            known("observation term", name, TERMS)
        if len(set(self.terms)) < len(self.terms) or not self.terms:
            raise ValueError("observation terms must be named at least one, and each only once")

    def width(self, term: str) -> int:
        """Return the number of columns of a term."""
        return TERMS[term][1] * {"neighbors": self.neighbors, "walls": self.rays}.get(term, 1)

    @property
    def size(self) -> int:
        """Number of columns in all."""
        return sum(self.width(term) for term in self.terms)

    def __getitem__(self, term: str) -> slice:
        """Return the columns of a term."""
        if term not in self.terms:
            raise KeyError(f"this observation has no term {term!r}; it has: {', '.join(self.terms)}")
        begin = sum(self.width(name) for name in self.terms[: self.terms.index(term)])
        return slice(begin, begin + self.width(term))

    def plan(self, largest: int, all_pairs: int = ALL_PAIRS) -> Plan:
        """Return where the compiled terms go, and scratch for one thread.

        Parameters
        ----------
        largest : how many people the largest room holds.
        all_pairs : rooms of up to so many people need no cells.
        """
        column = np.full(9, -1, dtype=np.int64)
        for term in self.terms:
            law = TERMS[term][0]
            if isinstance(law, int):
                column[law] = self[term].start
        angle = 2.0 * np.pi * np.arange(self.rays) / self.rays
        return Plan(
            column=column,
            turn=np.column_stack([np.cos(angle), np.sin(angle)]),
            beam=np.zeros((3, self.rays)),
            nearest=np.zeros(self.neighbors),
            around=np.zeros((4, largest)),
            key=np.zeros(largest),
            all_pairs=all_pairs,
        )

    @property
    def own_terms(self) -> tuple[str, ...]:
        """The terms that are not compiled."""
        return tuple(term for term in self.terms if not isinstance(TERMS[term][0], int))

    def add_own_terms(self, view: View, rooms: Ints, out: np.ndarray) -> None:
        """Write the columns of terms that are not compiled, of everyone in ``rooms``, into ``out`` (P, size)."""
        for term in self.own_terms:
            law, _ = TERMS[term]
            assert not isinstance(law, int)
            values = np.zeros((len(out), self.width(term)))
            law(view, values)
            values[~view.seen] = 0.0
            for e in rooms:
                rows = slice(view.bodies.env_start[e], view.bodies.env_start[e + 1])
                out[rows, self[term]] = np.clip(values[rows], -1.0, 1.0)


def make_layout(observation: ObservationLayout | Mapping[str, Any] | None) -> ObservationLayout:
    """Return a layout, the one of plain data such as ``{"terms": ["velocity", "walls"], "rays": 16}``, or the default.

    Raises
    ------
    ValueError
        If it is something else, or a key is unknown.
    """
    if observation is None:
        return ObservationLayout()
    if isinstance(observation, Mapping):
        return from_table("observation", ObservationLayout, observation)
    if not isinstance(observation, ObservationLayout):
        refuse("observation", observation, "an ObservationLayout, a table {'terms': [...]} or None")
    return observation
