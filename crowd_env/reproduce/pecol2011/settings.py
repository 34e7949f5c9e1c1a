"""What the reproductions of Pécol et al. may vary: the draws, and the readings of the room of section 4.2."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Literal, get_args

from crowd_env.core.checks import COUNT, Range
from crowd_env.physics import DEM, NSM2, ContactScheme, make_scheme
from crowd_env.reproduce.evacuations import Case
from crowd_env.reproduce.paper import TARGET_HELP, Settings, flag, option
from crowd_env.routing.route_set import Target
from crowd_env.scenarios import make_scenario
from crowd_env.scenarios.scenario import Scenario

SchemeName = Literal["dem", "nsm1", "nsm1-inertial", "nsm2-printed"]  # those of Table 5; it has one NSM1, its text two

# What the options of one scheme alone act on.
_SCHEME_OF_OPTION = {"stiffness": "dem", "k_normal": "nsm2-printed", "k_tangent": "nsm2-printed"}


@dataclass(frozen=True)
class PecolSettings(Settings):
    """Options of the paper's tables and figures; the defaults are the paper's, or our reading where it gives none.

    Raises
    ------
    ValueError
        In one sentence, if an option is out of range.
    """

    runs: int = option(50, "Draws of the room or the theatre", COUNT)  # run k draws its people from seed + k
    scheme: SchemeName = option("nsm2-printed", f"Scheme that fig3 draws: {', '.join(get_args(SchemeName))}")
    door_width: float = option(0.82, "Width of the door, m")
    side: float = option(5.0, "Side of the square room, m")
    people: int = option(20, "Number of people", Range(3).because("a flow is a slope of people against time"))
    target: Target = option("path", TARGET_HELP)
    stiffness: float = option(1.2e5, "k of dem, N/m")
    k_normal: float = option(1e5, "K_N of nsm2-printed, kg", Range(infinite=True))
    k_tangent: float = option(0.0, "K_T of nsm2-printed, kg")

    @property
    def time_limit(self) -> float:
        """Time [s] at which a run ends, finished or not: 60 s, or 3 s a person if that is longer."""
        return max(60.0, 3.0 * self.people)

    def room(self) -> Scenario:
        """Return the room."""
        chosen = {name: getattr(self, name) for name in ("side", "door_width", "people", "time_limit", "target")}
        return make_scenario("room-v0", **chosen)

    def contact(self, name: str) -> ContactScheme:
        """Return a scheme by name with these parameters."""
        scheme = make_scheme(name)
        if isinstance(scheme, DEM):
            return DEM(self.stiffness)
        if isinstance(scheme, NSM2):
            return replace(scheme, normal_dissipation=self.k_normal, tangential_dissipation=self.k_tangent)
        return scheme

    def cases(self, schemes: Collection[str]) -> dict[str, Case]:
        """Return the draws of the room under every scheme.

        Raises
        ------
        ValueError
            If an option is given that none of the schemes knows.
        """
        for name, owner in _SCHEME_OF_OPTION.items():
            if name in self.changed() and owner not in schemes:
                raise ValueError(f"{flag(name)} belongs to {owner}; it changes nothing for {', '.join(schemes)}")
        room = self.room()
        return {name: Case(f"room-{name}", room, self.contact(name), self.seeds, self.dt) for name in schemes}
