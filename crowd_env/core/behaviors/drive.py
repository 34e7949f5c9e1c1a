"""Drive limit: the largest driving force of a pedestrian; available to every scheme with a driving force.

The drive of the papers, m v_d / tau, reaches 2 kN.  With a limit F it keeps its direction and is no larger than F.
"""

from dataclasses import dataclass
from typing import Any

from crowd_env.core.behaviors.behavior import Behavior
from crowd_env.core.checks import Positive, Range, check_fields, number

_PERHAPS_NONE = Range(0.0, above=True, infinite=True)


@dataclass(frozen=True)
class DriveLimit(Behavior):
    """The largest driving force.

    Parameters
    ----------
    force : N.

    Raises
    ------
    ValueError
        If it is not positive.
    """

    force: Positive

    NAME = "max_drive"
    ABOUT = "largest driving force of a pedestrian [N]; infinite, as in the papers, is no limit"
    NEEDS = "drives"
    LACKS = "has no driving force that max_drive could limit"
    YIELDS = True

    def __post_init__(self) -> None:
        check_fields(self.NAME, self)

    @classmethod
    def of(cls, given: Any) -> "DriveLimit | None":
        """Return the limit of a number [N]; None for none or an infinite one.

        Raises
        ------
        ValueError
            If it is no number, or not positive.
        """
        if given is None or isinstance(given, DriveLimit):
            return given
        force = number(cls.NAME, given, _PERHAPS_NONE, "N")
        return None if force == _PERHAPS_NONE.high else DriveLimit(force)

    @classmethod
    def stored(cls, given: Any) -> Any:
        """Return the number [N]."""
        return cls.plain_of(cls.of(given))

    @classmethod
    def plain_of(cls, chosen: Any) -> Any:
        """Return the number [N]."""
        return _PERHAPS_NONE.high if chosen is None else chosen.force

    @classmethod
    def params_of(cls, chosen: Any) -> Any:
        """Return the number [N] as kernels read it."""
        return cls.plain_of(chosen)
