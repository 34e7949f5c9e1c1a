"""What a reproduction may vary: the draws, and the readings of the room of section 4.2."""

import math
from collections.abc import Collection
from dataclasses import dataclass, fields, replace
from typing import get_args

import numpy as np

from crowd_env.physics import DEM, NSM1, NSM2, ContactScheme, make_scheme
from crowd_env.routing.route_set import Target
from crowd_env.scenarios import make_scenario
from crowd_env.scenarios.scenario import Scenario
from crowd_env.state import make_bodies

# What the options of one scheme alone act on.
_SCHEME_OF_OPTION = {"stiffness": "dem", "k_normal": "nsm2-printed", "k_tangent": "nsm2-printed"}
_FEWEST = 3  # people: a slope


@dataclass(frozen=True)
class Settings:
    """Options of a reproduction; the defaults are the paper's, or our reading where it gives none.

    Raises
    ------
    ValueError
        In one sentence, if an option is out of range.
    """

    runs: int = 50
    seed: int = 0  # run k draws its people from seed + k
    scheme: str = "nsm2-printed"  # that fig3 draws
    door_width: float = 0.82  # m
    side: float = 5.0  # m
    n: int = 20  # people
    target: Target = "path"
    exit_line: float = 0.0  # m beyond the door
    dt: float = 0.01  # s
    stiffness: float = 1.2e5  # N/m  k of dem
    k_normal: float = 1e5  # kg  K_N of nsm2-printed
    k_tangent: float = 0.0  # kg  K_T of nsm2-printed

    def __post_init__(self) -> None:
        if self.runs < 1:
            raise ValueError(f"--runs is {self.runs}; it must be at least 1")
        if self.seed < 0:
            raise ValueError(f"--seed is {self.seed}; it must be >= 0")
        if self.n < _FEWEST:
            raise ValueError(f"--n is {self.n}; a flow is a slope and needs at least {_FEWEST} people")
        if self.target not in get_args(Target):
            raise ValueError(f"unknown --target {self.target!r}; known: {', '.join(get_args(Target))}")
        for name in ("door_width", "side", "exit_line", "dt", "stiffness", "k_tangent"):
            if not math.isfinite(getattr(self, name)):
                raise ValueError(f"{flag(name)} is {getattr(self, name)}; it must be a finite number")
        if not self.dt > 0:
            raise ValueError(f"--dt is {self.dt:g} s; it must be > 0")

    def changed(self) -> dict[str, object]:
        """Return the options that differ from the defaults, without how many draws are made."""
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("runs", "seed", "scheme")}
        return {name: value for name, value in values.items() if value != getattr(Settings, name)}

    @property
    def time_limit(self) -> float:
        """Whoever is inside after so many seconds is unfinished: 60 s, or 3 s a person if that is longer."""
        return max(60.0, 3.0 * self.n)

    def place(self) -> Scenario:
        """Return the room."""
        return make_scenario(
            "room-v0",
            side=self.side,
            door_width=self.door_width,
            count=self.n,
            time_limit=self.time_limit,
            target=self.target,
            exit_line=self.exit_line,
        )

    def contact(self, name: str) -> ContactScheme:
        """Return a scheme by name with these parameters."""
        scheme = make_scheme(name)
        if isinstance(scheme, DEM):
            return DEM(self.stiffness)
        if isinstance(scheme, NSM2):
            return replace(scheme, normal_dissipation=self.k_normal, tangential_dissipation=self.k_tangent)
        assert isinstance(scheme, NSM1)
        return scheme

    def check(self, schemes: Collection[str]) -> None:
        """Raise ValueError, before anything runs, if the room, the crowd or the step cannot be used with the schemes.

        An option that none of the schemes knows is refused too.
        """
        for option, owner in _SCHEME_OF_OPTION.items():
            if option in self.changed() and owner not in schemes:
                raise ValueError(f"{flag(option)} belongs to {owner}; it changes nothing for {', '.join(schemes)}")
        place = self.place()
        place.field()
        place.population.draw(np.random.default_rng([self.seed, 0]), place.geometry)
        worst = place.population
        bodies = make_bodies(
            np.array([worst.radius.low]), np.array([worst.mass.low]), relaxation_time=worst.relaxation_time.low
        )
        for name in schemes:
            scheme = self.contact(name)
            limit = scheme.stable_dt(bodies)
            if self.dt > limit:
                raise ValueError(
                    f"--dt {self.dt:g} s is above the stable step of {name}, {limit:.4g} s: {scheme.info.stable_step}"
                )


def flag(name: str) -> str:
    """Return the option of the command line for a setting."""
    return "--" + name.replace("_", "-")
