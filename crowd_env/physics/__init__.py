"""Contact physics: schemes for discs in contact, behind one list of contacts.  Knows no scenario and no learning."""

from collections.abc import Mapping
from dataclasses import fields, replace

from crowd_env.core.checks import NAMES, Plain, check_keys, known, refuse
from crowd_env.physics.dem import DEM
from crowd_env.physics.helbing import Helbing
from crowd_env.physics.hertz import Hertz
from crowd_env.physics.nsm1 import NSM1, NSM1Loose
from crowd_env.physics.nsm2 import NSM2
from crowd_env.physics.scheme import ContactScheme
from crowd_env.physics.social_force import SOCIAL_FORCES, SocialForce, make_social

# Name -> scheme with its default parameters.
SCHEMES: dict[str, ContactScheme] = {
    "dem": DEM(),
    "nsm1": NSM1(),
    "nsm1-inertial": NSM1(trial="inertial"),
    "nsm1-loose": NSM1Loose(),
    "nsm2": NSM2(),
    "nsm2-printed": NSM2(reaction="printed"),
    "hertz": Hertz(),
    "hertz-literal": Hertz.literal(),
    "helbing": Helbing(),
}
NAMES["contact scheme"] = SCHEMES


__all__ = [
    "DEM",
    "NSM1",
    "NSM2",
    "SCHEMES",
    "SOCIAL_FORCES",
    "ContactScheme",
    "Helbing",
    "Hertz",
    "SocialForce",
    "make_scheme",
]


def make_scheme(scheme: str | Plain | ContactScheme, social: str | Plain | SocialForce | None = None) -> ContactScheme:
    """Return a scheme, given as such, by name or as plain data.

    Parameters
    ----------
    scheme : a scheme, a name in ``SCHEMES``, or plain data with the name and the parameters that differ:
        ``{"name": "nsm2", "tolerance": 1e-3, "social": "lin"}``.
    social : a social force, its name or its parameters, in place of the scheme's own.

    Raises
    ------
    ValueError
        If a name is unknown (the message lists the known ones), or the type is another.
    """
    if isinstance(scheme, str):
        scheme = SCHEMES[known("contact scheme", scheme, SCHEMES)]
    elif isinstance(scheme, Mapping):
        scheme = _from_table(scheme)
    elif not isinstance(scheme, ContactScheme):
        refuse("scheme", scheme, "a scheme such as NSM2(), a table {'name': ...} or one of " + ", ".join(SCHEMES))
    return scheme if social is None else replace(scheme, social=make_social(social))


def _from_table(table: Plain) -> ContactScheme:
    parameters = dict(table)
    base = SCHEMES[known("contact scheme", parameters.pop("name", None), SCHEMES)]
    check_keys(f"scheme {base.info.name}", parameters, ["name", *(field.name for field in fields(base))])
    return replace(base, **parameters)
