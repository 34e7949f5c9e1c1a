"""What the granular figures may vary."""

from dataclasses import dataclass

from crowd_env.core.checks import COUNT, NOT_NEGATIVE, POSITIVE, Range
from crowd_env.reproduce.paper import Settings, option


@dataclass(frozen=True)
class GranularSettings(Settings):
    """Options of the granular figures.

    Raises
    ------
    ValueError
        In one sentence, if an option is out of range.
    """

    runs: int = option(2, "Fillings of each silo", COUNT)
    dt: float = option(1e-3, "Time step of the silo and the hopper, s", POSITIVE)
    gravity: float = option(9.81, "Gravity, m/s²", POSITIVE)
    balls: int = option(5, "Balls of the cradle, and discs of the stack", Range(2))
    friction: float = option(0.5, "Coulomb coefficient of grains that rub", NOT_NEGATIVE)
    grains: int = option(600, "Grains in a silo", Range(200).because("a flow is taken while the silo is still high"))
