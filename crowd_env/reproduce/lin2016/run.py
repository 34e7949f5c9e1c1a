"""One evacuation of the room of Lin, Ma, Lo: the unit of work of all their figures."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Floats, make_state
from crowd_env.physics import Hertz, SocialForce
from crowd_env.physics.hertz import DampingUnit
from crowd_env.physics.simulation.arguments import check_step
from crowd_env.physics.simulation.simulation import Simulation
from crowd_env.reproduce.lin2016.record import Record, Snapshot
from crowd_env.reproduce.sound import require_none_escaped
from crowd_env.routing.fields.field import NavigationField
from crowd_env.routing.route_set import Target
from crowd_env.scenarios import make_scenario
from crowd_env.scenarios.groups import extreme_bodies
from crowd_env.scenarios.scenario import Scenario

_CHECK_INTERVAL = 1.0  # s, between looks at whether it is over; the result does not depend on it


class Stopped(Exception):
    """A run was given up half way."""


@dataclass(frozen=True)
class Run:
    """Everything that decides what happens in one evacuation; the defaults are the preset "calibrated".

    Two runs are equal if they are the same evacuation, whatever ``moments`` are kept of it.

    Raises
    ------
    ValueError
        From `check`, if the room, the people or the scheme cannot be made, or the step is too long.
    """

    count: int  # people
    desired_speed: float  # m/s
    seed: int = 0  # the draw of `crowd-env run` with this seed
    strength: float = 300.0  # N    A of the social force
    rotation: bool = True
    friction: float = 0.5  # of people on people
    wall_friction: float = 0.1
    wall_social: float = 300.0  # N    A of the social force of walls
    anisotropy: float = 0.3  # phi
    damping: DampingUnit = "rate per length"  # reading of gamma
    cutoff: float = 0.4  # m    beyond it there is no social force
    target: Target = "centre"
    exit_depth: float = 0.0  # m    how far behind the wall people count as out
    dt: float = 1e-3  # s
    time_limit: float = 1000.0  # s
    blocked_after: float = 120.0  # s    without anyone getting out
    moments: tuple[float, ...] = field(default=(), compare=False)  # s    when positions are kept

    def scenario(self) -> Scenario:
        """Return the room and its people."""
        return make_scenario(
            "lin-room-v0",
            people=self.count,
            desired_speed=self.desired_speed,
            exit_depth=self.exit_depth,
            target=self.target,
            time_limit=self.time_limit,
            blocked_after=self.blocked_after,
        )

    def scheme(self) -> Hertz:
        """Return how people touch."""
        social = SocialForce(
            strength=self.strength,
            anisotropy=self.anisotropy,
            wall_strength=self.wall_social,
            cutoff=self.cutoff,
        )
        return Hertz(
            friction=self.friction,
            wall_friction=self.wall_friction,
            rotation=self.rotation,
            damping_unit=self.damping,
            social=social,
        )

    def check(self) -> None:
        """Raise ValueError if this run, or another draw of it, cannot be made."""
        scenario, scheme = self.scenario(), self.scheme()
        people = scenario.population
        people.draw(np.random.default_rng([self.seed, 0]), scenario.geometry)
        check_step(scheme, extreme_bodies(people), self.dt)

    def simulate(self, stopped: Callable[[], bool] | None = None) -> Record:
        """Return what comes of a run: it ends when all are out, the exit has blocked, or the time is over.

        Parameters
        ----------
        stopped : called after every simulated second; True gives up.

        Raises
        ------
        Stopped
            If ``stopped`` says so.
        FloatingPointError
            If someone goes too far in a step or is found outside of the room.
        """
        scenario = self.scenario()
        bodies, position = scenario.population.draw(np.random.default_rng([self.seed, 0]), scenario.geometry)
        simulation = Simulation(
            scenario.geometry,
            bodies,
            make_state(position),
            scheme=self.scheme(),
            dt=self.dt,
            fields=[_field(self.target, self.exit_depth)],
        )
        kept = sorted({round(moment / self.dt) for moment in self.moments})
        limit, interval = round(self.time_limit / self.dt), max(1, round(_CHECK_INTERVAL / self.dt))
        done, snapshots = 0, []
        while True:
            if kept and done == kept[0]:
                snapshots.append(_snapshot(simulation, kept.pop(0) * self.dt))
            exits = np.sort(simulation.state.exit_time[~simulation.state.active])
            exits, blocked_since = until_blocked(exits, done * self.dt, self.count, self.blocked_after)
            left = self.count - len(exits)
            if not kept and (left == 0 or blocked_since is not None or done >= limit):
                return Record(tuple(exits.tolist()), left, blocked_since, tuple(snapshots))
            if stopped is not None and stopped():
                raise Stopped
            ahead = min([interval - done % interval, *(step - done for step in kept[:1])])
            simulation.advance(n_substeps=ahead)
            require_none_escaped(simulation.scheme.info.name, int(simulation.escaped.sum()))
            done += ahead

    def merge(self, other: "Run") -> "Run":
        """Return this run with the moments of an equal one too."""
        return replace(self, moments=tuple(sorted({*self.moments, *other.moments})))

    def smallest(self) -> "Run":
        """Return two people for one step."""
        return replace(self, count=2, time_limit=self.dt, moments=())

    def cost(self) -> float:
        """Return about people squared times simulated seconds times steps a second."""
        return self.count**2 / min(max(self.desired_speed, 0.1), 1.4) / self.dt

    def label(self) -> str:
        """Return the beginning of the name of its file."""
        return f"{self.count}-people-{self.desired_speed:g}-mps-seed-{self.seed}"

    def identity(self) -> dict[str, Any]:
        """Return the parameters, and the scheme, people and room that they stand for, ready for JSON."""
        scenario, parameters = self.scenario(), asdict(self)
        del parameters["moments"]
        return {
            "run": parameters,
            "scheme": repr(self.scheme()),
            "people": repr(scenario.population),
            "walls": scenario.geometry.walls.tolist(),
            "exits": scenario.geometry.exits.tolist(),
        }

    def encode(self, record: Record) -> dict[str, Any]:
        """Return the record, ready for JSON."""
        return record.as_json()

    def decode(self, content: dict[str, Any]) -> Record:
        """Return the record that was encoded.

        Raises
        ------
        ValueError, KeyError, TypeError
            If it cannot be a record of this run, or one of its moments is missing.
        """
        record = Record.from_json(content)
        if len(record.exit_times) + record.left != self.count:
            raise ValueError(f"the record has {len(record.exit_times) + record.left} people, the run {self.count}")
        if not {round(moment / self.dt) * self.dt for moment in self.moments} <= {s.time for s in record.snapshots}:
            raise ValueError("the record lacks a moment that the run asks for")
        return record


def until_blocked(exits: Floats, now: float, count: int, patience: float) -> tuple[Floats, float | None]:
    """Return the exit times (K,) up to the first pause longer than ``patience`` [s], and when that began; None if never.

    ``exits`` are ascending, of ``count`` people; the time before the first exit is a pause, that since the last one until
    ``now`` too if someone is inside.
    """
    marks = np.concatenate([[0.0], exits, [now] if len(exits) < count else []])
    long = np.flatnonzero(np.diff(marks) > patience)
    if len(long) == 0:
        return exits, None
    return exits[: long[0]], float(marks[long[0]])


def _snapshot(simulation: Simulation, time: float) -> Snapshot:
    inside = simulation.state.active
    position, radius = simulation.state.position[inside], simulation.bodies.radius[inside]
    columns = (position[:, 0], position[:, 1], radius, simulation.state.angle[inside])
    x, y, radii, angle = (tuple(column.tolist()) for column in columns)
    return Snapshot(time, x, y, radii, angle)


@lru_cache(maxsize=8)
def _field(target: Target, exit_depth: float) -> NavigationField:
    """Return the travel times to the exit, which do not depend on the size of the crowd."""
    return Run(1, 1.0, target=target, exit_depth=exit_depth).scenario().field()
