"""Occupant profiles: walking speeds of kinds of people on level floor and on stairs, each with its source.

A cohort names one, ``profile = "imo-male-under-30"``; its own speed comes first.  Bodies stay as they are: no source
gives the room that people with aids need as a disc.
"""

from typing import NamedTuple

from crowd_env.core.checks import Plain, known
from crowd_env.scenarios.distributions import Distribution, Normal, Uniform

_WEIDMANN = "Weidmann 1993, Transporttechnik der Fussgänger"
_IMO = "IMO MSC.1/Circ.1533, annex 3"
_SIMULEX = "Simulex (NIST TN 1680, table A.4)"
_BOYCE = "Boyce et al. 1999, Fire Technology 35:51"


class Profile(NamedTuple):
    """A kind of people."""

    people: str
    speed: Distribution  # m/s
    source: str
    stairs: tuple[float, float] | None = None  # m/s, up and down, along the slope, in the middle of their ranges


PROFILES: dict[str, Profile] = {
    "weidmann": Profile("adults, the default", Normal(1.34, 0.26, 0.8, 1.9), _WEIDMANN),
    "imo-female-under-30": Profile("women below 30 years", Uniform(0.93, 1.55), _IMO, (0.63, 0.75)),
    "imo-female-30-to-50": Profile("women of 30 to 50 years", Uniform(0.71, 1.19), _IMO, (0.59, 0.65)),
    "imo-female-over-50": Profile("women above 50 years", Uniform(0.56, 0.94), _IMO, (0.49, 0.6)),
    "imo-female-impaired-1": Profile(
        "women above 50 years, mobility impaired (1)", Uniform(0.43, 0.71), _IMO, (0.37, 0.45)
    ),
    "imo-female-impaired-2": Profile(
        "women above 50 years, mobility impaired (2)", Uniform(0.37, 0.61), _IMO, (0.31, 0.39)
    ),
    "imo-male-under-30": Profile("men below 30 years", Uniform(1.11, 1.85), _IMO, (0.67, 1.01)),
    "imo-male-30-to-50": Profile("men of 30 to 50 years", Uniform(0.97, 1.62), _IMO, (0.63, 0.855)),
    "imo-male-over-50": Profile("men above 50 years", Uniform(0.84, 1.4), _IMO, (0.51, 0.67)),
    "imo-male-impaired-1": Profile(
        "men above 50 years, mobility impaired (1)", Uniform(0.64, 1.06), _IMO, (0.39, 0.51)
    ),
    "imo-male-impaired-2": Profile(
        "men above 50 years, mobility impaired (2)", Uniform(0.55, 0.91), _IMO, (0.33, 0.44)
    ),
    "imo-crew-female": Profile("crew, women", Uniform(0.93, 1.55), _IMO, (0.63, 0.75)),
    "imo-crew-male": Profile("crew, men", Uniform(1.11, 1.85), _IMO, (0.67, 1.01)),
    "simulex-male": Profile("men", Uniform(1.15, 1.55), _SIMULEX),
    "simulex-female": Profile("women", Uniform(0.95, 1.35), _SIMULEX),
    "simulex-child": Profile("children", Uniform(0.6, 1.2), _SIMULEX),
    "simulex-elderly": Profile("elderly people", Uniform(0.5, 1.1), _SIMULEX),
    "impaired-no-aid": Profile("locomotion impaired, without aid", Normal(0.95, 0.32, 0.24, 1.68), _BOYCE),
    "impaired-crutches": Profile("on crutches", Normal(0.94, 0.30, 0.63, 1.35), _BOYCE),
    "impaired-stick": Profile("with a walking stick", Normal(0.81, 0.38, 0.26, 1.6), _BOYCE),
    "impaired-frame": Profile("with a walking frame", Normal(0.57, 0.29, 0.1, 1.02), _BOYCE),
    "wheelchair": Profile("in a manual wheelchair, alone", Normal(0.69, 0.35, 0.13, 1.35), _BOYCE),
    "electric-wheelchair": Profile("in an electric wheelchair", Uniform(0.89, 0.89), _BOYCE),
}


def speed_words(profile: Profile) -> str:
    """Return "0.93 to 1.55" or "1.34 ± 0.26 (0.8 to 1.9)" [m/s], and the speeds on stairs."""
    speed = profile.speed
    words = f"{speed.low:g}" if speed.low == speed.high else f"{speed.low:g} to {speed.high:g}"
    if isinstance(speed, Normal):
        words = f"{speed.mean:g} ± {speed.sd:g} ({words})"
    return words if profile.stairs is None else f"{words}, stairs {profile.stairs[0]:g} up, {profile.stairs[1]:g} down"


def with_profile(table: Plain) -> Plain:
    """Return a table of a `Population` with the speeds of its profile, where it has none.

    Raises
    ------
    ValueError
        If the profile is unknown.
    """
    if not (name := table.get("profile")):
        return table
    profile = PROFILES[known("profile", name, PROFILES)]
    given: dict[str, Distribution] = {"desired_speed": profile.speed}
    if profile.stairs is not None:
        usual = 0.5 * (profile.speed.low + profile.speed.high)
        ratios = zip(("upstairs", "downstairs"), profile.stairs, strict=True)
        given |= {key: Uniform(speed / usual, speed / usual) for key, speed in ratios}
    return {**given, **table}
