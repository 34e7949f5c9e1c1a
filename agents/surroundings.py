"""What rules of walking know of the people ahead: observation terms beside those that come with the environment.

The standard term ``neighbors`` says where people are and how they move.  It does not say where they want to go, nor who is
nearer to the exit: rules that let one another pass need both.  `PEOPLE_AHEAD` and `LEADER` are local (3 m, as far as the
standard terms see), `PREDECESSOR` is full state: it compares everyone in the room.  All three look through walls.
"""

from typing import NamedTuple

import numpy as np

from crowd_env import ObservationLayout, ObservationTerm
from crowd_env.envs.observation.perception import SLOWEST
from crowd_env.envs.observation.view import SIGHT, View
from crowd_env.state import Floats, Ints

MOST_AHEAD = 16  # people; bodies of 0.2 m that fill half a circle of 1 m
_COLUMNS = 8  # of each person ahead
_SPEED_SCALE = 4.0  # m/s


class PeopleAhead(NamedTuple):
    """The nearest people in front of everyone, by the gap between bodies; K of them, in axes along and left of the own way."""

    there: np.ndarray  # (P, K)     whether there is somebody; all else is 0 where there is nobody
    offset: Floats  # (P, K, 2)  m
    velocity: Floats  # (P, K, 2)  m/s, of the other
    reach: Floats  # (P, K)     m, sum of both radii
    way: Floats  # (P, K, 2)  unit vector along the other's way

    @property
    def gap(self) -> Floats:
        """Return the distance between bodies (P, K) [m], negative where they overlap; infinite where there is nobody."""
        return np.where(self.there, np.hypot(self.offset[..., 0], self.offset[..., 1]) - self.reach, np.inf)


class Leader(NamedTuple):
    """Whoever is next nearer to the exit on the same route."""

    there: np.ndarray  # (P,)
    lead: Floats  # (P,)  m, by which the rest of that way is shorter, at most 3 m
    speed: Floats  # (P,)  m/s, of the leader along the leader's own way


def remaining_way(view: View) -> Floats:
    """Return the length (P,) [m] of the rest of everyone's route."""
    return np.asarray(view.travel_time * np.maximum(view.bodies.desired_speed, SLOWEST))


def write_people_ahead(view: View, out: np.ndarray) -> None:
    """Write the `PeopleAhead` of everyone within 3 m between centers."""
    for rows, dx, dy in _pairs(view):
        (ex, ey), (u, v), radius = view.direction[rows].T, view.state.velocity[rows].T, view.bodies.radius[rows]
        along, distance = dx * ex[:, None] + dy * ey[:, None], np.hypot(dx, dy)
        gap = np.where((along > 0.0) & (distance < SIGHT), distance - radius[:, None] - radius, np.inf)
        count, n = min(MOST_AHEAD, len(rows)), np.arange(len(rows))[:, None]
        nearest = np.sort(np.argpartition(gap, count - 1, axis=1)[:, :count], axis=1)
        nearest = nearest[n, np.argsort(gap[n, nearest], axis=1, kind="stable")]
        there = np.isfinite(gap[n, nearest])
        columns = np.zeros((len(rows), MOST_AHEAD, _COLUMNS), dtype=np.float64)
        shown = columns[:, :count]
        shown[..., 0] = there
        shown[..., 1], shown[..., 2] = _turned(dx[n, nearest] / SIGHT, dy[n, nearest] / SIGHT, ex, ey)
        shown[..., 3], shown[..., 4] = _turned(u[nearest] / _SPEED_SCALE, v[nearest] / _SPEED_SCALE, ex, ey)
        shown[..., 5] = (radius[:, None] + radius[nearest]) / SIGHT
        shown[..., 6], shown[..., 7] = _turned(ex[nearest], ey[nearest], ex, ey)
        shown[~there] = 0.0
        out[rows] = columns.reshape(len(rows), -1)


def write_leader(view: View, out: np.ndarray) -> None:
    """Write the `Leader` of everyone among those in front on the same route, within 3 m between centers."""
    way = remaining_way(view)
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
    way, inside = remaining_way(view), np.flatnonzero(view.seen & view.state.active)
    env = np.searchsorted(view.bodies.env_start, inside, side="right")
    order = np.lexsort((way[inside], view.followed[inside], env))
    rows, env, route = inside[order], env[order], view.followed[inside][order]
    if len(rows):
        same = np.r_[False, (env[1:] == env[:-1]) & (route[1:] == route[:-1])]
        _write_leader(view, rows, np.where(same, np.roll(rows, 1), -1), way, out)


PEOPLE_AHEAD = ObservationTerm("people_ahead", MOST_AHEAD * _COLUMNS, write_people_ahead)
LEADER = ObservationTerm("leader", 3, write_leader)
PREDECESSOR = ObservationTerm("predecessor", 3, write_predecessor)


def read_people_ahead(observation: np.ndarray, layout: ObservationLayout) -> PeopleAhead:
    """Return what `write_people_ahead` wrote into an observation (P, D)."""
    columns = observation[:, layout[PEOPLE_AHEAD.name]].astype(np.float64).reshape(len(observation), MOST_AHEAD, -1)
    offset, velocity, way = SIGHT * columns[..., 1:3], _SPEED_SCALE * columns[..., 3:5], columns[..., 6:8]
    return PeopleAhead(columns[..., 0] > 0.5, offset, velocity, SIGHT * columns[..., 5], way)


def read_leader(observation: np.ndarray, layout: ObservationLayout, term: ObservationTerm) -> Leader:
    """Return what `LEADER` or `PREDECESSOR` wrote into an observation (P, D)."""
    there, lead, speed = observation[:, layout[term.name]].astype(np.float64).T
    return Leader(there > 0.5, SIGHT * lead, _SPEED_SCALE * speed)


def _pairs(view: View) -> list[tuple[Ints, Floats, Floats]]:
    """Return for each environment who is inside (n,), and the offsets (n, n) [m] from each to all of them."""
    found, start = [], view.bodies.env_start
    inside = view.seen & view.state.active
    for e in range(len(start) - 1):
        rows = start[e] + np.flatnonzero(inside[start[e] : start[e + 1]])
        if len(rows):
            x, y = view.state.position[rows].T
            found.append((rows, x - x[:, None], y - y[:, None]))
    return found


def _turned(x: Floats, y: Floats, ex: Floats, ey: Floats) -> tuple[Floats, Floats]:
    """Return vectors (n, K) along the ways (n,) and to their left."""
    return x * ex[:, None] + y * ey[:, None], y * ex[:, None] - x * ey[:, None]


def _write_leader(view: View, rows: Ints, leader: Ints, way: Floats, out: np.ndarray) -> None:
    """Write the three columns of `Leader`, of people ``rows`` who follow ``leader``; -1 = nobody."""
    rows, leader = rows[leader >= 0], leader[leader >= 0]
    speed = (view.state.velocity[leader] * view.direction[leader]).sum(axis=1)
    out[rows] = np.column_stack([np.ones(len(rows)), (way[rows] - way[leader]) / SIGHT, speed / _SPEED_SCALE])
