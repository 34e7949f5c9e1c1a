"""The inputs and outputs of an observation: all that the terms read and write."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowd_env.core.arrays.state import Bodies, Bools, CrowdState, Floats, Ints
from crowd_env.geometry.geometry import Boundary
from crowd_env.geometry.surface import Surface
from crowd_env.physics.neighbors.lists import NeighborList
from crowd_env.routing.fields.bottlenecks import Bottlenecks
from crowd_env.routing.fields.lookup import FieldArrays

Rows = NDArray[np.float32]
Cells = NDArray[np.int32]

SIGHT = 3.0  # m     how far neighbors and walls are seen
SPEED_SCALE = 2.0  # m/s
TIME_SCALE = 5.0  # s     a travel time of 5 s is observed as 1/2
# Lower bound on speed, so that travel time stays finite.
SLOWEST = 0.1  # m/s
# s: the gain that counts as progress, and the loss that marks the start of another way, such as after a door has closed.
GAIN, LOSS = 0.1, 5.0


class Ways(NamedTuple):
    """The C exits and routes that pedestrians may choose among, in the order of `Scenario.ways`; none without a choice."""

    route: Ints  # (E, C)  number of the route
    then: Ints  # (E, C)  route that takes over at the region that it leads to; -1 = none


class View(NamedTuple):
    """The input of an observation; kernels get a reference to it."""

    boundary: Boundary
    surface: Surface
    door_open: Bools  # (E, D)
    geometry_of_env: Ints  # (E,)
    field: FieldArrays
    field_of_route: Ints  # (E, R)  row of `field`
    potential_of_route: Ints  # (E, R)  row of `field` by which progress is counted
    followed: Ints  # (P,)    route that is followed
    bodies: Bodies
    state: CrowdState
    near: NeighborList  # only its cells, as scratch: no list of the physics
    impulse: Floats  # (P, 2)  N s  sum of the contact impulses since the last decision
    impulse_magnitude: Floats  # (P,)    N s  sum of their magnitudes
    seen: Bools  # (P,)    to observe: all pedestrians inside, and perhaps others; the rest stays zero
    listed: Cells  # (P,)    scratch: their slots, one environment after the other
    axis: Floats  # (P, 2)  first axis of the frame
    # The rest of each route as it was when the crowd was last observed, whatever the terms; the reward reads its potential.
    direction: Floats  # (P, 2)  of the shortest path, along x and y
    travel_time: Floats  # (P,)    s, at the desired speed; 0 outside
    potential: Floats  # (P,)    s, travel time by which progress is counted: that of the `RouteField.potential`
    reached: Floats  # (P, 2)  s, least potential so far, and when; kept where it is observed
    distance_to_go: Floats  # (P,)    m   scratch: the rest of the route of seen pedestrians
    ways: Ways
    openings: Bottlenecks  # a reference; of no field unless a term needs them
    length_of_way: Floats  # (P, C)  m   scratch: rest of each way from the pedestrian's position, as `distance_to_go`
    group_sums: Floats  # (P, 3)  scratch: of each group inside the positions [m] and the number of members
    heads_for: Ints  # (P,)    scratch: the way that each goes, or that looks most like it


class Columns(NamedTuple):
    """First column of each compiled term; -1 = not wanted."""

    velocity: int
    desired_speed: int
    direction: int
    travel_time: int
    opening: int
    slope: int
    stood: int
    push: int
    crush: int
    density: int
    walls: int
    neighbors: int
    lead: int
    ahead: int
    routes: int
    queues_seen: int
    queues_shown: int
    group: int


class Plan(NamedTuple):
    """Where the compiled terms of a layout go, and scratch for one thread."""

    column: Columns
    turn: Floats  # (R, 2)  cosine and sine of the angle of each ray to the axis
    beam: Floats  # (3, R)  scratch: direction of each ray of one pedestrian, and how far it is free
    nearest: Floats  # (K,)    scratch: the smallest keys of one pedestrian
    around: Floats  # (4, N)  scratch: position, radius and slot of pedestrians in sight of one cell
    key: Floats  # (N,)    scratch: how near they are to one pedestrian
    all_pairs: int  # up to this number of pedestrians an environment is one cell
