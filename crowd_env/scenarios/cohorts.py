"""A crowd of several kinds of people: each with its own bodies, starting positions and route."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from crowd_env.core.arrays.state import PERSONAL, Bodies, Floats, join_bodies, make_bodies
from crowd_env.core.behaviors.pulls import ALONE
from crowd_env.core.checks import at, check_fields, refuse, whole
from crowd_env.geometry.entrances import Entries, join_entries
from crowd_env.geometry.geometry import Geometry
from crowd_env.geometry.placement import sample_positions
from crowd_env.scenarios.population import CROWD, DRAWN, Population, population_of
from crowd_env.scenarios.starts import check_starts


class Bounds(NamedTuple):
    """Smallest and largest value that any of the people can have."""

    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Cohorts:
    """Several populations in one scenario; the people of the first come first, and so on.

    It has the interface of a `Population`; the bounds of its distributions include all parts.  People that start anywhere in
    the same region are placed together, so that they are mixed; recorded starts are taken first.  A part may be a table of
    the fields of a `Population`.

    Raises
    ------
    ValueError
        If there is no part, two have the same name, or they are too many.

    Examples
    --------
    >>> people = Cohorts((Population(30, start_region="west", route="east"), Population(30, start_region="east", route="west")))
    >>> people.people
    60
    """

    parts: tuple[Population, ...]
    radius: Bounds = field(init=False, repr=False)  # m
    mass: Bounds = field(init=False, repr=False)  # kg
    desired_speed: Bounds = field(init=False, repr=False)  # m/s
    relaxation_time: Bounds = field(init=False, repr=False)  # s
    response_time: Bounds = field(init=False, repr=False)  # s

    def __post_init__(self) -> None:
        if isinstance(self.parts, list | tuple):
            tables = enumerate(self.parts)
            parts = [population_of(f"cohorts[{k}]", one) if isinstance(one, Mapping) else one for k, one in tables]
            object.__setattr__(self, "parts", tuple(parts))
        check_fields("cohorts", self)
        if not self.parts:
            raise ValueError("a crowd needs at least one cohort")
        names = [part.name for part in self.parts if part.name]
        twice = [name for k, name in enumerate(names) if name in names[:k]]
        if twice:
            raise ValueError(f"two cohorts have the name {twice[0]!r}")
        whole("cohorts: people in all", self.people, CROWD)
        for name in DRAWN:
            laws = [getattr(part, name) for part in self.parts]
            object.__setattr__(self, name, Bounds(min(law.low for law in laws), max(law.high for law in laws)))

    @property
    def people(self) -> int:
        """Number of people."""
        return sum(part.people for part in self.parts)

    def changed(self, *, people: int | None = None, **options: Any) -> "Cohorts":
        """Return the cohorts with other distributions in each, and another number of people, shared out in proportion.

        Raises
        ------
        ValueError
            If an option is neither a distribution nor the number, or there are fewer people than cohorts.
        """
        common = (*DRAWN, *PERSONAL)
        other = [name for name, value in options.items() if name not in common and value is not None]
        if other:
            raise ValueError(f"cohorts cannot share {other[0]!r}; give them people or one of {', '.join(common)}")
        everyone = None if people is None else whole("cohorts: people", people, CROWD)
        counts = [part.people for part in self.parts] if everyone is None else self._shares(everyone)
        shared = {name: value for name, value in options.items() if name in common}
        return Cohorts(tuple(part.changed(people=n, **shared) for part, n in zip(self.parts, counts, strict=True)))

    def _shares(self, people: int) -> list[int]:
        """Share people out by the largest remainders, at least one a cohort."""
        if people < len(self.parts):
            whom = f"{people} {'person' if people == 1 else 'people'}"
            raise ValueError(f"{whom} for {len(self.parts)} cohorts; each needs at least 1")
        exact = np.array([part.people for part in self.parts]) * (people / self.people)
        shares = np.maximum(np.floor(exact + 1e-9), 1).astype(int)
        while shares.sum() < people:
            shares[np.argmax(exact - shares)] += 1
        while shares.sum() > people:  # small cohorts have their least number
            shares[np.argmax(np.where(shares > 1, shares - exact, -np.inf))] -= 1
        return [int(n) for n in shares]

    def draw(self, rng: np.random.Generator, geometry: Geometry, room: float = 1.0) -> tuple[Bodies, Floats]:
        """Draw one crowd: its bodies, and positions (people, 2) without overlap of discs of ``room`` radii.

        Raises
        ------
        ValueError
            If the people do not fit.
        """
        drawn = [part.draw_bodies(rng) for part in self.parts]
        bodies = join_bodies(drawn)._replace(env_start=np.array([0, self.people]))
        radius = room * bodies.radius
        owner = np.repeat(np.arange(len(self.parts)), [part.people for part in self.parts])
        position = np.zeros((self.people, 2))
        stands = np.zeros(self.people, dtype=bool)
        for k, part in enumerate(self.parts):
            if part.arrivals is not None:
                position[owner == k] = part.outside(geometry, room, radius[owner == k])
            elif part.starts is not None:
                position[owner == k] = part.draw_starts(rng, geometry, radius[owner == k])
                stands |= owner == k
        if stands.any():
            check_starts(geometry, position[stands], radius[stands])
        for region in self._regions():
            here = [k for k, part in enumerate(self.parts) if part in self._placed and part.start_region == region]
            people = np.flatnonzero(np.isin(owner, here))
            if len(here) > 1:
                people = rng.permutation(people)
            already = (position[stands], radius[stands]) if stands.any() else None
            position[people] = sample_positions(geometry, radius[people], rng, region, already)
            stands[people] = True
        motivated = [part.draw_motivation(rng, own) for part, own in zip(self.parts, drawn, strict=True)]
        given = {name: np.concatenate([getattr(own, name) for own in motivated]) for name in PERSONAL}
        groups = [part.draw_groups(rng, position[owner == k]) for k, part in enumerate(self.parts)]
        before = np.cumsum([0, *(part.people for part in self.parts[:-1])])
        group = [np.where(own == ALONE, ALONE, own + at) for own, at in zip(groups, before, strict=True)]
        return bodies._replace(**given, group=np.concatenate(group)), position

    def draw_entries(self, rng: np.random.Generator, geometry: Geometry, room: float = 1.0) -> Entries:
        """Draw when and where people come in, after all else."""
        return join_entries([part.draw_entries(rng, geometry, room) for part in self.parts])

    @property
    def _placed(self) -> list[Population]:
        """The cohorts with drawn places at the start."""
        return [part for part in self.parts if part.starts is None and part.arrivals is None]

    def _regions(self) -> list[str | None]:
        """Where people start: the named regions in the order of the cohorts, then anywhere."""
        of_parts = dict.fromkeys(part.start_region for part in self._placed)
        return sorted(of_parts, key=lambda name: name is None)


People: TypeAlias = Population | Cohorts


def people_of(parts: Sequence[Population]) -> People:
    """Return people of several kinds; of one kind they are no cohorts."""
    return parts[0] if len(parts) == 1 else Cohorts(tuple(parts))


def extreme_bodies(people: People) -> Bodies:
    """Return bodies with a stable step no longer than that of any draw.

    Of each part all bodies have the largest mass, radius and speed and the shortest relaxation time; one more has the
    smallest mass and radius.
    """
    counts = [part.people + 1 for part in people.parts]
    first, greatest = np.cumsum([0, *counts[:-1]]), greatest_bodies(people.parts, counts)
    for name in ("radius", "mass"):
        greatest[name][first] = [getattr(part, name).low for part in people.parts]
    return make_bodies(**greatest)


def greatest_bodies(parts: Sequence[Population], counts: Sequence[int]) -> dict[str, Any]:
    """Return columns of `Bodies`: of each part as many as counted, with the greatest radius, mass, speed and acceleration."""
    bounds = {"radius": "high", "mass": "high", "desired_speed": "high", "relaxation_time": "low"}
    return {
        name: np.repeat([getattr(getattr(part, name), bound) for part in parts], counts)
        for name, bound in bounds.items()
    }


def as_people(population: Any) -> People | None:
    """Return a population, or the one of plain data such as ``{"people": 30, "radius": 0.2}``; None stays.

    A list of populations or such tables makes cohorts.

    Raises
    ------
    ValueError
        If it is of a wrong type, or a key is unknown.
    """
    if isinstance(population, Mapping):
        return population_of("population", population)
    if isinstance(population, list | tuple):
        with at("population"):
            return Cohorts(tuple(population))
    if population is not None and not isinstance(population, Population | Cohorts):
        refuse(
            "population", population, "a Population, Cohorts, a table of the fields of a Population, or a list of these"
        )
    return population
