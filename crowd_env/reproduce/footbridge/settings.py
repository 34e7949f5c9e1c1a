"""What the figures of the footbridge may vary."""

from dataclasses import dataclass
from typing import Literal

from crowd_env.core.checks import COUNT, POSITIVE
from crowd_env.physics.settings import Physics
from crowd_env.reproduce.paper import Settings, option

SchemeName = Literal["dem", "nsm1", "nsm2", "hertz"]


@dataclass(frozen=True)
class FootbridgeSettings(Settings):
    """Options of the figures.

    Raises
    ------
    ValueError
        In one sentence, if an option is out of range.
    """

    runs: int = option(3, "Number of draws", COUNT)
    scheme: SchemeName = option("dem", "Contact scheme of the walkers on the deck: dem, nsm1, nsm2 or hertz")
    people: int = option(400, "Number of people in the film, and before and on the deck of the gatekeeper", COUNT)
    duration: float = option(400.0, "Length of each run, s; figures are means over its last quarter", POSITIVE)
    dt: float = option(0.01, "Time step of the crowd, s; hertz takes at most 0.005", POSITIVE)

    @property
    def physics(self) -> Physics:
        """The physics of the crowd."""
        return Physics(self.scheme, dt=self.dt)
