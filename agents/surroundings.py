"""Observation terms of the pedestrian ahead, for rules of walking, beside those that come with the environment.

The standard term ``neighbors`` holds positions and velocities of pedestrians.  It does not hold which of them are nearer to the
exit, which rules that let others pass need.  `LEADER` is local: 3 m, like the standard terms.  `PREDECESSOR` is full state: it
compares all pedestrians in the room.  Both look through walls.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from crowd_env import ObservationLayout, ObservationTerm
from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.envs.observation.view import SIGHT, View

_SPEED_SCALE = 4.0  # m/s


class Leader(NamedTuple):
    """The pedestrian that is next nearer to the exit on the same route."""

    there: np.ndarray  # (P,)
    lead: Floats  # (P,)  m, difference of the distances to the exit, at most 3 m
    speed: Floats  # (P,)  m/s, of the leader along its way


def write_leader(view: View, out: np.ndarray) -> None:
    """Write the `Leader` of each pedestrian among those in front on the same route, within 3 m between centers."""
    way, inside, start = view.distance_to_go, view.seen & view.state.active, view.bodies.env_start
    for begin, end in pairwise(start.tolist()):
        rows = begin + np.flatnonzero(inside[begin:end])
        if not len(rows):
            continue
        (dx, dy), route = (axis - axis[:, None] for axis in view.state.position[rows].T), view.followed[rows]
        ahead = dx * view.direction[rows, :1] + dy * view.direction[rows, 1:] > 0.0
        lead = way[rows][:, None] - way[rows]
        candidate = ahead & (lead > 0.0) & (np.hypot(dx, dy) < SIGHT) & (route[:, None] == route)
        nearest = np.where(candidate, lead, np.inf).argmin(axis=1)
        _write_leader(view, rows, np.where(candidate.any(axis=1), rows[nearest], -1), way, out)


def write_predecessor(view: View, out: np.ndarray) -> None:
    """Write the `Leader` of each pedestrian among all on the same route; of equals, the lower slot is nearer."""
    way, inside = view.distance_to_go, np.flatnonzero(view.seen & view.state.active)
    env = np.searchsorted(view.bodies.env_start, inside, side="right")
    order = np.lexsort((way[inside], view.followed[inside], env))
    rows, env, route = inside[order], env[order], view.followed[inside][order]
    if len(rows):
        same = np.r_[False, (env[1:] == env[:-1]) & (route[1:] == route[:-1])]
        _write_leader(view, rows, np.where(same, np.roll(rows, 1), -1), way, out)


LEADER = ObservationTerm("leader", 3, write_leader)
PREDECESSOR = ObservationTerm("predecessor", 3, write_predecessor)


def read_leader(observation: np.ndarray, layout: ObservationLayout, term: ObservationTerm) -> Leader:
    """Return the columns of `LEADER` or `PREDECESSOR` in an observation (P, D)."""
    there, lead, speed = observation[:, layout[term.name]].astype(np.float64).T
    return Leader(there > 0.5, SIGHT * lead, _SPEED_SCALE * speed)


def _write_leader(view: View, rows: Ints, leader: Ints, way: Floats, out: np.ndarray) -> None:
    """Write the three columns of `Leader` for pedestrians ``rows`` that follow ``leader``; -1 = none."""
    rows, leader = rows[leader >= 0], leader[leader >= 0]
    speed = (view.state.velocity[leader] * view.direction[leader]).sum(axis=1)
    out[rows] = np.column_stack([np.ones(len(rows)), (way[rows] - way[leader]) / SIGHT, speed / _SPEED_SCALE])
