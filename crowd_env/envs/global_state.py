"""The whole crowd as one vector, for a centralised critic."""

from dataclasses import dataclass
from typing import NamedTuple

import gymnasium
import numpy as np

from crowd_env.envs.crowd import CrowdEnv
from crowd_env.envs.terms import columns_of

# Columns that cannot be negative, and flags.
_NOT_NEGATIVE = ("radius", "mass", "desired_speed", "relaxation_time", "response_time", "route")
_FLAGS = ("inside", "exit")
_LINE = 4  # columns of an exit: its two ends


class SplitState(NamedTuple):
    """The parts of a state, as views of it."""

    people: np.ndarray  # (N, F)  a row each; columns as in `StateLayout`
    exits: np.ndarray  # (X, 5)  x and y of both ends of each exit line [m], 1 = open
    time_left: float  # s


@dataclass(frozen=True)
class StateLayout:
    """Positions of the parts of `CrowdParallelEnv.state`.

    A state has N F + 5 X + 1 numbers for N people and X exit lines: a row of F = 11 + X columns for each person, a row of 5
    for each exit line in the order of `Geometry.exits` (both ends, x and y in turn, [m]; 1 if no closed door bars it), and the
    time left until the time limit [s].  `split` returns the three.  ``layout["mass"]`` is a slice of columns of a person:

    ===================  =======  ================================================================
    column               width    value
    ===================  =======  ================================================================
    ``inside``           1        1 = still inside
    ``position``         2        m, x and y from the lower left corner of the plan's bounding box
    ``velocity``         2        m/s, along x and y
    ``radius``           1        m
    ``mass``             1        kg
    ``desired_speed``    1        m/s
    ``relaxation_time``  1        s
    ``response_time``    1        s, stands still until then
    ``route``            1        number of the pedestrian's route
    ``exit``             X        1 for each exit line that this route may lead to
    ===================  =======  ================================================================

    For a pedestrian outside all columns are 0, but for the 1 at the exit line that was crossed.

    Parameters
    ----------
    people : N.
    exits : X, exit lines of the plan, open or not.
    """

    people: int
    exits: int

    @property
    def of_person(self) -> dict[str, int]:
        """Name -> number of columns of a person, in order."""
        body = dict.fromkeys(("radius", "mass", "desired_speed", "relaxation_time", "response_time"), 1)
        return {"inside": 1, "position": 2, "velocity": 2, **body, "route": 1, "exit": self.exits}

    @property
    def width(self) -> int:
        """Number of columns of a person, F."""
        return sum(self.of_person.values())

    @property
    def size(self) -> int:
        """Length of a state."""
        return self.people * self.width + self.exits * (_LINE + 1) + 1

    def __getitem__(self, column: str) -> slice:
        """Return where a column of a person is."""
        return columns_of("a person has no column", column, self.of_person)

    def split(self, state: np.ndarray) -> SplitState:
        """Return the parts of a state (size,)."""
        people, exits = self.people * self.width, self.exits * (_LINE + 1)
        rows = state[:people].reshape(self.people, self.width)
        return SplitState(rows, state[people : people + exits].reshape(self.exits, _LINE + 1), float(state[-1]))

    def space(self) -> gymnasium.spaces.Box:
        """Return the space of all states."""
        low, high = np.full(self.size, -np.inf, np.float32), np.full(self.size, np.inf, np.float32)
        for bound, value in ((low, 0.0), (high, 1.0)):
            people, exits, _ = self.split(bound)
            for name in _FLAGS:
                people[:, self[name]] = value
            exits[:, _LINE] = value
        people, _, _ = self.split(low)
        for name in _NOT_NEGATIVE:
            people[:, self[name]] = 0.0
        low[-1] = 0.0
        return gymnasium.spaces.Box(low, high, dtype=np.float32)


class StateReader:
    """Reads the state of a batch of one environment.

    Parameters
    ----------
    env : the batch.

    Attributes
    ----------
    layout : positions of the parts of a state.
    """

    def __init__(self, env: CrowdEnv) -> None:
        self.env = env
        geometry, route_set = env.scenarios[0].geometry, env.route_set[0]
        self.layout = StateLayout(env.num_people, len(geometry.exits))
        self._corner = np.array(geometry.bounds[:2])
        self._lines = (geometry.exits - self._corner).reshape(-1, _LINE)
        names, doors = geometry.exit_names, geometry.exits_of_door
        # (routes, X) and (doors, X); an exit of several lines is all of them
        self._leads_to = np.array([[name in (way.exits or names) for name in names] for way in route_set.routes])
        self._barred_by = np.array([[name == barred for name in names] for barred in doors]).reshape(-1, len(names))

    def read(self) -> np.ndarray:
        """Return the state (size,) float32 as it is now."""
        env, layout = self.env, self.layout
        crowd, bodies = env.simulation.state, env.simulation.bodies
        state = np.zeros(layout.size, dtype=np.float32)
        people, exits, _ = layout.split(state)
        inside = crowd.active
        columns = {"inside": inside, "position": env.simulation.laid_out - self._corner, "velocity": crowd.velocity}
        columns |= {name: getattr(bodies, name) for name in _NOT_NEGATIVE[:-1]}
        columns |= {"route": crowd.route, "exit": self._leads_to[crowd.route]}
        for name, values in columns.items():
            people[inside, layout[name]] = values[inside].reshape(-1, layout.of_person[name])
        taken = np.flatnonzero(crowd.exit_index >= 0)
        people[taken, layout["exit"].start + crowd.exit_index[taken]] = 1.0
        exits[:, :_LINE] = self._lines
        shut = ~env.simulation.history.door_open[0, : len(self._barred_by)]
        exits[:, _LINE] = ~self._barred_by[shut].any(axis=0)
        state[-1] = max(env.time_limit[0] - crowd.time[0], 0.0)
        return state
