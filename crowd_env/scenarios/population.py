"""The people of a scenario: number, distributions of their bodies, and starting positions."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Annotated, Any

import numpy as np
import shapely

from crowd_env.core.arrays.state import MAX_SPEED, PERSONAL, Bodies, Floats, Ints, make_bodies
from crowd_env.core.behaviors.pulls import ALONE
from crowd_env.core.checks import (
    COUNT,
    POSITIVE,
    Plain,
    Range,
    at,
    check_fields,
    counted,
    from_table,
    known,
    plain_name,
)
from crowd_env.core.files.fingerprint import UNSAID
from crowd_env.geometry.entrances import Entries, at_the_start, spots_along, spots_in
from crowd_env.geometry.geometry import Geometry
from crowd_env.geometry.parsing import ROUNDED
from crowd_env.geometry.placement import CLOSEST_PACKING, sample_positions
from crowd_env.scenarios.arrivals import Arrivals
from crowd_env.scenarios.distributions import Distribution, LogNormal, Normal, Uniform, as_distribution
from crowd_env.scenarios.groups import draw_groups
from crowd_env.scenarios.profiles import PROFILES, with_profile
from crowd_env.scenarios.starts import as_positions, check_starts

__all__ = ["TABLE_4", "Distribution", "LogNormal", "Normal", "Population", "Uniform"]

# Of one environment: a neighbor's number has 19 bits.
CROWD = Range(1, 500_000).because("more people do not fit into one environment")
# The drawn values of each person, in this order, and their allowed ranges.
DRAWN = {
    "radius": POSITIVE,
    "mass": Range(0.0, 1000.0, above=True),  # kg
    "desired_speed": Range(0.0, MAX_SPEED),
    "relaxation_time": POSITIVE,
    "response_time": Range(0.0, 86_400.0),  # s
}
BOUNDS = DRAWN | PERSONAL | {"group_size": COUNT, "wait": Range(0.0, 86_400.0)}

# People of Pécol et al. 2011, Table 4, uniform within the ranges: `Population(20, **TABLE_4)`.
TABLE_4: Mapping[str, Any] = {"radius": Uniform(0.2, 0.25), "desired_speed": Uniform(1.2, 2.0)}

# Their draws need no check: the bounds have been checked.
_KEEP_THEIR_BOUNDS = (Uniform, Normal, LogNormal)


@dataclass(frozen=True, eq=False)
class Population:
    """How many people, of which kind, starting where and going where.

    By default they are adults on plain floor: shoulders of 0.30 to 0.38 m, since people turn them where it is narrow, and the
    speeds of Weidmann 1993, within two standard deviations.  All respond at once, and take the route of the run's strategy.
    With `Arrivals`, ``people`` is how many can come in any draw.
    Mass and relaxation time are Table 4 of Pécol et al. 2011; ``**TABLE_4`` is all of it.  Crowds of several kinds are
    `crowd_env.scenarios.cohorts.Cohorts`.

    A distribution may be given as in a scenario file: a number, a pair (low, high), or a table such as
    ``{"distribution": "normal", "mean": 0.22, "sd": 0.01, "low": 0.2, "high": 0.25}``.

    Raises
    ------
    ValueError
        If a field is of a wrong type or out of range, or two contradict each other.
    """

    people: Annotated[int, CROWD]
    """number of people."""
    radius: Distribution = field(default_factory=lambda: Uniform(0.15, 0.19))
    """m, the radius of a body; uniform from 0.15 to 0.19 by default."""
    mass: Distribution = field(default_factory=lambda: Uniform(60.0, 100.0))
    """kg, the mass of a person; uniform from 60 to 100 by default."""
    desired_speed: Distribution = field(default_factory=lambda: Normal(1.34, 0.26, 0.8, 1.9))
    """m/s, the speed at which a person wants to walk; normal, 1.34 ± 0.26 within 0.8 to 1.9, by default."""
    relaxation_time: Distribution = field(default_factory=lambda: Uniform(0.1, 0.5))
    """s, the time in which a person gets to the desired speed; uniform from 0.1 to 0.5 by default."""
    response_time: Distribution = field(default_factory=lambda: Uniform(0.0, 0.0))
    """s, the time until a person begins to walk; 0 by default."""
    time_gap: Distribution | None = None
    """s, the time gap that a person keeps to the people in front; by default that of the manner of the run."""
    push: Distribution | None = None
    """share of the desired speed at which a person presses on with no gap in front, 0 to 1; by default that of the manner of
    the run.  A run without a manner, in which everyone walks at full speed, makes no use of time gap and push."""
    upstairs: Distribution | None = field(default=None, metadata={UNSAID: None})
    """speed up stairs, along the slope, relative to the desired speed; by default that of the stair."""
    downstairs: Distribution | None = field(default=None, metadata={UNSAID: None})
    """speed down stairs, likewise."""
    group_size: Distribution | None = None
    """number of people who walk together, oneself included, rounded; by default everyone walks alone."""
    start_region: str | None = None
    """name of the region in which people start; anywhere by default."""
    starts: Floats | None = None
    """(K, 2) m, recorded positions or seats, copied; of more than ``people``, some are drawn."""
    route: str | None = None
    """name of the route or exit that people take, whatever the strategy of the run."""
    exits: tuple[str, ...] = ()
    """names of the exits that people know, of which they take the best; all exits by default."""
    name: str = ""
    """name of these people in messages and pictures."""
    profile: str = field(default="", metadata={UNSAID: ""})
    """name of the profile that gives the ``desired_speed`` of a table without one."""
    wait: Distribution | None = field(default=None, metadata={UNSAID: None})
    """s, how long people wait in the region that their route is via; by default they walk on."""
    arrivals: Arrivals | None = field(default=None, metadata={UNSAID: None})
    """when they come in; by default all are there at the start."""

    def __post_init__(self) -> None:
        check_fields("population", self)
        if self.profile:
            known("profile", self.profile, PROFILES)
        object.__setattr__(self, "name", self.name and plain_name("population: name", self.name))
        for name, allowed in BOUNDS.items():
            if getattr(self, name) is None and name not in DRAWN:
                continue
            law = as_distribution(f"population: {name}", getattr(self, name))
            object.__setattr__(self, name, law)
            for bound, extreme in ((law.low, "low"), (law.high, "high")):
                if bound not in allowed:
                    must = str(allowed).removesuffix(" and finite")
                    raise ValueError(f"population: {name} must be {must}, but can be as {extreme} as {bound:g}")
        if self.group_size is not None and round(self.group_size.low) > self.people > 1:
            least = self.group_size.low
            raise ValueError(
                f"population: group_size must be at most the {self.people} people, but is at least {least:g}"
            )
        if self.starts is not None:
            object.__setattr__(self, "starts", as_positions(self.starts, self.people))
            if self.start_region is not None:
                raise ValueError(f"people have recorded starts or the start region {self.start_region!r}, not both")
        if self.arrivals is not None:
            self._check_arrivals(self.arrivals)
        if self.route is not None and self.exits:
            raise ValueError(f"people take the route {self.route!r} or the best of some exits, not both")

    def _check_arrivals(self, arrivals: Arrivals) -> None:
        if arrivals.rate is None and self.people != arrivals.people:
            listed = f"{arrivals.people} arrivals are listed"
            raise ValueError(f"population: people is {self.people}, but {listed}; leave people out")
        if self.starts is not None and (arrivals.line is not None or len(self.starts) != self.people):
            raise ValueError("arriving people come in along a line, or each at a recorded start of their own")
        if self.starts is None and self.start_region is None and arrivals.line is None:
            raise ValueError("arriving people need an entrance: a line of the arrivals, a start_region or starts")
        if arrivals.line is not None and self.start_region is not None:
            raise ValueError(f"people come in along a line or in the start region {self.start_region!r}, not both")
        if self.walks_together:
            raise ValueError("arriving people walk alone: leave out group_size")

    @property
    def parts(self) -> tuple["Population", ...]:
        """Its parts, one kind of people each: itself alone."""
        return (self,)

    def changed(self, **options: Any) -> "Population":
        """Return the population with other ``options``."""
        return replace(self, **options)

    def moved(self, move: Callable[[Floats], Floats]) -> "Population":
        """Return the population with its places moved by a function of points (K, 2) [m]."""
        arrivals, starts = self.arrivals, self.starts
        if arrivals is not None and arrivals.line is not None:
            arrivals = replace(arrivals, line=move(arrivals.line))
        if starts is not None:
            starts = move(starts)
        return self if starts is None and arrivals is self.arrivals else self.changed(starts=starts, arrivals=arrivals)

    def draw(self, rng: np.random.Generator, geometry: Geometry, room: float = 1.0) -> tuple[Bodies, Floats]:
        """Draw one crowd: its bodies, and positions (people, 2) without overlap of discs of ``room`` radii.

        Raises
        ------
        ValueError
            If the people do not fit.
        """
        bodies = self.draw_bodies(rng)
        if self.arrivals is not None:
            position = self.outside(geometry, room, room * bodies.radius)
        elif self.starts is not None:
            position = self.draw_starts(rng, geometry, room * bodies.radius)
        else:
            position = sample_positions(geometry, room * bodies.radius, rng, self.start_region)
        motivated = self.draw_motivation(rng, bodies)
        return motivated._replace(group=self.draw_groups(rng, position)), position

    def outside(self, geometry: Geometry, room: float, radius: Floats) -> Floats:
        """Return places (people, 2) at which arriving people may come in, for as long as they are not there."""
        if self.starts is not None:
            check_starts(geometry, self.starts, radius, at_once=False)
            return self.starts.copy()
        return np.repeat(self.spots(geometry, room)[:1], self.people, axis=0)

    def spots(self, geometry: Geometry, room: float = 1.0) -> Floats:
        """Return where (K, 2) arriving people may come in, as discs of ``room`` radii.

        Raises
        ------
        ValueError
            If they fit nowhere.
        """
        return self.starts if self.starts is not None else _spots_of(self, geometry, room)

    def draw_entries(self, rng: np.random.Generator, geometry: Geometry, room: float = 1.0) -> Entries:
        """Draw when and where people come in, after all else; nothing is drawn of people that are there at the start."""
        if self.arrivals is None:
            return at_the_start(self.people)
        due, spots, own = self.arrivals.draw(rng, self.people), self.spots(geometry, room), np.arange(self.people)
        if self.starts is not None:
            return Entries(due, own, own + 1, own.copy(), spots.copy(), np.zeros(len(spots), dtype=np.int64))
        start, stop = np.zeros_like(own), np.full_like(own, len(spots))
        first = rng.integers(len(spots), size=self.people)
        return Entries(due, start, stop, first, spots.copy(), np.zeros(len(spots), dtype=np.int64))

    def draw_bodies(self, rng: np.random.Generator) -> Bodies:
        """Draw the bodies alone, with the motivation of the run's manner."""
        laws = {name: getattr(self, name) for name in DRAWN}
        drawn: dict[str, Any] = {name: law.sample(rng, self.people) for name, law in laws.items()}
        if not all(type(law) in _KEEP_THEIR_BOUNDS for law in laws.values()):
            return make_bodies(**drawn)
        inertia = 0.5 * drawn["mass"] * drawn["radius"] ** 2
        not_given = {name: np.full(self.people, np.nan) for name in PERSONAL}
        alone = np.full(self.people, ALONE)
        return Bodies(inertia=inertia, group=alone, env_start=np.array([0, self.people]), **drawn, **not_given)

    def draw_motivation(self, rng: np.random.Generator, bodies: Bodies) -> Bodies:
        """Return these bodies with the values of `PERSONAL` that are drawn for them, where these are given.

        Bodies and positions are drawn before, so that they are the same with and without.
        """
        laws: dict[str, Distribution | None] = {name: getattr(self, name) for name in PERSONAL}
        drawn: dict[str, Any] = {name: law.sample(rng, self.people) for name, law in laws.items() if law is not None}
        return bodies._replace(**drawn)

    @property
    def walks_together(self) -> bool:
        """Whether people may walk in groups."""
        return self.group_size is not None and self.people > 1 and self.group_size.high > 1.5

    def draw_groups(self, rng: np.random.Generator, position: Floats) -> Ints:
        """Return the group (people,) of people at ``position`` (people, 2), from 0; drawn last, to change no earlier draw."""
        if self.group_size is None or not self.walks_together:
            return np.full(self.people, ALONE)
        return draw_groups(rng, self.group_size, position)

    def draw_starts(self, rng: np.random.Generator, geometry: Geometry, radius: Floats) -> Floats:
        """Return the recorded positions (people, 2), or some drawn from them, checked for bodies of ``radius`` (people,)."""
        assert self.starts is not None  # the callers have looked
        starts = self.starts.copy()
        if len(starts) > self.people:
            starts = starts[rng.permutation(len(starts))[: self.people]]
        check_starts(geometry, starts, radius)
        return starts


@lru_cache(maxsize=64)
def _spots_of(part: Population, geometry: Geometry, room: float) -> Floats:
    widest = room * part.radius.high
    line = None if part.arrivals is None else part.arrivals.line
    found = spots_in(geometry, widest, part.start_region) if line is None else spots_along(geometry, widest, line)
    found.flags.writeable = False
    return found


def population_of(where: str, table: Plain) -> Population:
    """Return the population of a table of its fields; the number of people is that of starts or arrivals if it is left out.

    Raises
    ------
    ValueError
        If a key is unknown, or a value is wrong.
    """
    if table.get("starts") is not None:
        starts = as_positions(table["starts"])
        table = {"people": len(starts), **table, "starts": starts}
    if (given := table.get("arrivals")) is not None and "people" not in table:
        with at("arrivals"):
            arrivals = from_table("arrivals", Arrivals, given) if isinstance(given, Mapping) else given
            if getattr(arrivals, "people", None) is None:
                raise ValueError("people come at a rate without an end: give until, or the number of people")
        table = {**table, "people": arrivals.people, "arrivals": arrivals}
    return from_table(where, Population, with_profile(table))


def require_names(kind: str, names: Iterable[str | None], allowed: Iterable[str]) -> None:
    """Raise ValueError, listing the known ones, if a name is not known; None is."""
    allowed = list(allowed)
    for name in names:
        if name is not None:
            known(kind, name, allowed)


def require_room(geometry: Geometry, parts: Iterable[Population], room: float = 1.0) -> None:
    """Raise ValueError if there are more people than even the closest packing has room for, before any of them is drawn.

    They are placed as discs of ``room`` radii.
    """
    waiting: dict[str | None, tuple[int, float, float]] = {}
    for part in parts:
        if part.starts is None and part.arrivals is None:
            count, cover, widest = waiting.get(part.start_region, (0, 0.0, 0.0))
            cover += part.people * np.pi * (room * part.radius.low) ** 2
            waiting[part.start_region] = count + part.people, cover, max(widest, room * part.radius.high)
    for region, (count, cover, widest) in waiting.items():
        area = reached = geometry.area_of(region)
        if region is not None and cover > CLOSEST_PACKING * area:  # centers lie in it, bodies may reach out
            around = shapely.buffer(geometry.regions[region], widest)
            reached = float(shapely.intersection(geometry.walkable, around, grid_size=ROUNDED).area)
        if cover > CLOSEST_PACKING * reached:
            where = f"{area:.1f} m2" + ("" if region is None else f" of {region!r}")
            most = int(count * CLOSEST_PACKING * reached / cover)
            raise ValueError(
                f"{counted(count, 'person does', 'people do')} not fit without overlap into {where}: "
                f"even the closest packing of the smallest bodies leaves room for at most {most}"
            )
