"""Contact physics: ways for discs to touch, behind one list of contacts.  Knows no scenario and no learning."""

from crowd_env.physics.dem import DEM
from crowd_env.physics.nsm1 import NSM1
from crowd_env.physics.nsm2 import NSM2
from crowd_env.physics.scheme import ContactScheme

# Name -> scheme with its default parameters.
SCHEMES: dict[str, ContactScheme] = {
    "dem": DEM(),
    "nsm1": NSM1(),
    "nsm1-inertial": NSM1(trial="inertial"),
    "nsm2": NSM2(),
}


__all__ = ["DEM", "NSM1", "NSM2", "SCHEMES", "ContactScheme", "make_scheme"]


def make_scheme(scheme: str | ContactScheme) -> ContactScheme:
    """Return a scheme by name, or the scheme itself.

    Raises
    ------
    ValueError
        If the name is unknown; the message lists the known ones.
    """
    if not isinstance(scheme, str):
        return scheme
    if scheme not in SCHEMES:
        raise ValueError(f"unknown contact scheme {scheme!r}; known: {', '.join(SCHEMES)}")
    return SCHEMES[scheme]
