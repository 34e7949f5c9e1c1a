"""Contact physics: ways for discs to touch, behind one list of contacts.  Knows no scenario and no learning."""

from dataclasses import replace

from crowd_env.physics.dem import DEM
from crowd_env.physics.hertz import Hertz
from crowd_env.physics.nsm1 import NSM1
from crowd_env.physics.nsm2 import NSM2
from crowd_env.physics.scheme import ContactScheme
from crowd_env.physics.social import SOCIAL_FORCES, SocialForce

# Name -> scheme with its default parameters.
SCHEMES: dict[str, ContactScheme] = {
    "dem": DEM(),
    "nsm1": NSM1(),
    "nsm1-inertial": NSM1(trial="inertial"),
    "nsm2": NSM2(),
    "nsm2-printed": NSM2(reaction="printed"),
    "hertz": Hertz(),
    "hertz-literal": Hertz.literal(),
}


__all__ = ["DEM", "NSM1", "NSM2", "SCHEMES", "SOCIAL_FORCES", "ContactScheme", "Hertz", "SocialForce", "make_scheme"]


def make_scheme(scheme: str | ContactScheme, social: str | None = None) -> ContactScheme:
    """Return a scheme by name, or the scheme itself; ``social`` names a social force to take instead of its own.

    Raises
    ------
    ValueError
        If a name is unknown; the message lists the known ones.
    """
    if isinstance(scheme, str):
        if scheme not in SCHEMES:
            raise ValueError(f"unknown contact scheme {scheme!r}; known: {', '.join(SCHEMES)}")
        scheme = SCHEMES[scheme]
    if social is None:
        return scheme
    if social not in SOCIAL_FORCES:
        raise ValueError(f"unknown social force {social!r}; known: {', '.join(SOCIAL_FORCES)}")
    return replace(scheme, social=SOCIAL_FORCES[social])  # type: ignore[type-var]  # every scheme is a dataclass
