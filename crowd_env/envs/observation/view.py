"""What an observation is made from and where it goes: all that the compiled laws read and write."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowd_env.geometry.geometry import Boundary
from crowd_env.navigation.lookup import FieldArrays
from crowd_env.physics.neighbors.lists import NeighborList
from crowd_env.state import Bodies, Bools, CrowdState, Floats, Ints

Rows = NDArray[np.float32]
Cells = NDArray[np.int32]

SIGHT = 3.0  # m     how far neighbors and walls are seen
SPEED_SCALE = 2.0  # m/s

# Numbers of the compiled terms, rows of `Plan.column`.
VELOCITY, DESIRED_SPEED, DIRECTION, TRAVEL_TIME, PUSH, CRUSH, DENSITY, WALLS, NEIGHBORS = range(9)


class View(NamedTuple):
    """What an observation is made from; kernels get a reference to it."""

    boundary: Boundary
    door_open: Bools  # (E, D)
    geometry_of_env: Ints  # (E,)
    field: FieldArrays
    field_of_route: Ints  # (E, R)  row of `field`
    potential_of_route: Ints  # (E, R)  row of `field` by which progress is counted
    followed: Ints  # (P,)    route that one follows
    bodies: Bodies
    state: CrowdState
    near: NeighborList  # only its cells, as scratch
    push: Floats  # (P, 2)  N s  contact impulse since the last decision
    crush: Floats  # (P,)    N s  sum of its magnitudes
    seen: Bools  # (P,)    whose observation is wanted, all who are inside among them; the rest stays zero
    who: Cells  # (P,)    scratch: they, room by room
    axis: Floats  # (P, 2)  first axis of the frame
    direction: Floats  # (P, 2)  of the shortest path
    travel_time: Floats  # (P,)    s, at the own desired speed; 0 for those who are out
    potential: Floats  # (P,)    s, travel time by which progress is counted; see `look_ahead`


class Plan(NamedTuple):
    """Where the compiled terms of a layout go, and scratch for one thread."""

    column: Ints  # (9,)    first column of each term; -1 = not wanted
    turn: Floats  # (R, 2)  cosine and sine of the angle of each ray to the axis
    beam: Floats  # (3, R)  scratch: direction of each ray of one person, and how far it is free
    nearest: Floats  # (K,)    scratch: the nearest of one person
    around: Floats  # (4, N)  scratch: place, radius and slot in the room of those who may be seen from one cell
    key: Floats  # (N,)    scratch: how near they are to one person
    all_pairs: int  # up to so many people in a room are one cell
