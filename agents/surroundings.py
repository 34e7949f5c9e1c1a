"""What rules of walking know of the pedestrians ahead: observation terms beside those that come with the environment.

The standard term ``neighbors`` holds where pedestrians are and how they move.  It does not hold which of them are nearer to
the exit: rules that let one another pass need that.
`LEADER` is local (3 m, as far as the standard terms see), `PREDECESSOR` is full state: it
compares everyone in the room.  Both look through walls.
"""

from typing import NamedTuple

import numpy as np

from crowd_env import ObservationLayout, ObservationTerm
from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.envs.observation.view import SIGHT, View

_SPEED_SCALE = 4.0  # m/s


class Leader(NamedTuple):
    """The pedestrian that is next nearer to the exit on the same route."""

    there: np.ndarray  # (P,)
    lead: Floats  # (P,)  m, by which the rest of that way is shorter, at most 3 m
    speed: Floats  # (P,)  m/s, of the leader along the leader's own way


def write_leader(view: View, out: np.ndarray) -> None:
    """Write the `Leader` of everyone among those in front on the same route, within 3 m between centers."""
    way = view.distance_to_go
    for rows, dx, dy in _pairs(view):
        ahead = dx * view.direction[rows, :1] + dy * view.direction[rows, 1:] > 0.0
        route = view.followed[rows]
        lead = way[rows][:, None] - way[rows]
        candidate = ahead & (lead > 0.0) & (np.hypot(dx, dy) < SIGHT) & (route[:, None] == route)
        lead = np.where(candidate, lead, np.inf)
        nearest = lead.argmin(axis=1)
        _write_leader(view, rows, np.where(candidate.any(axis=1), rows[nearest], -1), way, out)


def write_predecessor(view: View, out: np.ndarray) -> None:
    """Write the `Leader` of everyone among all on the same route, wherever they are; of equals, the lower slot is nearer."""
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
    """Return what `LEADER` or `PREDECESSOR` wrote into an observation (P, D)."""
    there, lead, speed = observation[:, layout[term.name]].astype(np.float64).T
    return Leader(there > 0.5, SIGHT * lead, _SPEED_SCALE * speed)


def _pairs(view: View) -> list[tuple[Ints, Floats, Floats]]:
    """Return for each environment the slots inside (n,), and the offsets (n, n) [m] from each to all of them."""
    found, start = [], view.bodies.env_start
    inside = view.seen & view.state.active
    for e in range(len(start) - 1):
        rows = start[e] + np.flatnonzero(inside[start[e] : start[e + 1]])
        if len(rows):
            x, y = view.state.position[rows].T
            found.append((rows, x - x[:, None], y - y[:, None]))
    return found


def _write_leader(view: View, rows: Ints, leader: Ints, way: Floats, out: np.ndarray) -> None:
    """Write the three columns of `Leader`, of pedestrians ``rows`` that follow ``leader``; -1 = none."""
    rows, leader = rows[leader >= 0], leader[leader >= 0]
    speed = (view.state.velocity[leader] * view.direction[leader]).sum(axis=1)
    out[rows] = np.column_stack([np.ones(len(rows)), (way[rows] - way[leader]) / SIGHT, speed / _SPEED_SCALE])
