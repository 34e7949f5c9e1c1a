"""What pulls people off their way: those in whose company they walk, and attractions; as forces of every scheme.

    f_i = - beta_1 alpha_i v_i                                              gaze: to see the others, one slows down
          + beta_2 U_i             if further than (N - 1) / 2 m from the center of the company, in sight
          - sum_k beta_3 W_ik      of those nearer than d_0
          + sum_a A_a (R / R_a) exp[(1 - (R / R_a)^2) / 2 - (t - t_a) / T_a] n_a     attractions

These are forces on a person over the mass [m/s2].  N members of the company are inside; ``U`` is the unit vector to their
center, ``W_ik`` the one to member k, and ``alpha_i`` the angle [rad] by which one has to turn the head, until the center of
the others lies in a field of view of 90 degrees to either hand of the way: Moussaïd, Perozo, Garnier, Helbing, Theraulaz 2010
(PLoS ONE 5(4): e10047).  The four numbers and the field of view are those of its Figure 4.  That the threshold is (N - 1) / 2 m
and the angle in radians is unchecked: both are as in open code that follows the paper.

An attraction pulls less with time, as interest declines (Helbing, Molnár 1995, doi 10.1103/PhysRevE.51.4282, who give no
formula): it is the gradient of a well whose pull is largest, ``A_a``, at the distance ``R_a``, and falls off exponentially.

Two things are ours.  Whoever is ahead of a companion by more than ``apart``, or out of sight, waits: stands still, at most
for ``patience``, then goes on alone until they are together again.  Nobody is pulled faster than 1.3 times the own desired
speed, which is the bound of Helbing and Molnár 1995.
"""

from collections.abc import Sequence
from dataclasses import astuple, dataclass, field, replace
from typing import Annotated, Any, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Bodies, Floats, Ints, row_starts
from crowd_env.core.behaviors.behavior import Behavior
from crowd_env.core.checks import NotNegative, Positive, check_fields, refuse

ALONE = -1  # number of the company of whoever walks alone


@dataclass(frozen=True)
class Companionship:
    """How those who walk in company keep together."""

    gaze: NotNegative = 4.0
    """1/s, ``beta_1``: by how much people slow down for each radian that they have to turn the head to see the others."""
    cohesion: NotNegative = 3.0
    """m/s2, ``beta_2``: how strongly they are pulled to the center of their company."""
    repulsion: NotNegative = 1.0
    """m/s2, ``beta_3``: how strongly companions who are too near each other are pushed apart."""
    spacing: NotNegative = 0.8
    """m, ``d_0``: the distance between centers below which they are too near."""
    apart: Positive = 3.0
    """m, the distance to a companion further back beyond which people wait."""
    patience: NotNegative = 30.0
    """s, the time after which people who are held back by companions further back go on without them."""

    def __post_init__(self) -> None:
        check_fields("companions", self)


@dataclass(frozen=True)
class Attraction:
    """A point that pulls whoever sees it, less and less with time."""

    x: float
    """m, where it is."""
    y: float
    """m, where it is."""
    strength: Positive
    """m/s2, ``A``: the largest pull, which is the one at the distance ``reach``."""
    reach: Positive = 2.0
    """m, ``R``: at three times the distance the pull has fallen to a twentieth."""
    lifetime: Positive = 10.0
    """s, ``T``: the time in which the pull falls to 1/e."""
    since: NotNegative = 0.0
    """s, the time at which it begins."""

    def __post_init__(self) -> None:
        check_fields("attraction", self)


class Waiting(NamedTuple):
    """What companions remember."""

    held_since: Annotated[Floats, "P"]  # s  since when companions further back hold one back; 0 = they do not


@dataclass(frozen=True)
class Pulls(Behavior):
    """What pulls people off their way in a place."""

    companions: Companionship = field(default_factory=Companionship)
    """how those who walk in company keep together."""
    attractions: tuple[Attraction, ...] = ()
    """points that pull people, each for a while."""

    NAME = "pulls"
    ABOUT = "what pulls people off their way: companions and attractions"
    MEMORY = Waiting
    USES = ("walking", "pulls")
    PER_PLACE = True

    def __post_init__(self) -> None:
        check_fields("pulls", self)

    def moved(self, points: Floats) -> "Pulls":
        """Return the same with the attractions at ``points`` (K, 2) [m]."""
        moved = (replace(one, x=x, y=y) for one, (x, y) in zip(self.attractions, points.tolist(), strict=True))
        return replace(self, attractions=tuple(moved))

    @classmethod
    def of(cls, given: Any) -> "Pulls":
        """Return the pulls that are given, as such or as a table of their fields; by default those of nobody in company."""
        return super().of(given) or Pulls()

    @classmethod
    def params_of(cls, chosen: Sequence["Pulls"]) -> "PullArrays":
        """Return the pulls of all places as kernels read them."""
        rows = [astuple(one) for pulls in chosen for one in pulls.attractions]
        return PullArrays(
            np.array([astuple(pulls.companions) for pulls in chosen], dtype=np.float64),
            np.array(rows, dtype=np.float64).reshape(-1, 6),
            row_starts([len(pulls.attractions) for pulls in chosen]),
        )

    @classmethod
    def acts(cls, chosen: Sequence["Pulls"], bodies: Bodies) -> bool:
        """Whether anyone walks in company, or is attracted."""
        return has_companions(bodies) or any(pulls.attractions for pulls in chosen)


class PullArrays(NamedTuple):
    """The pulls of G places as kernels read them."""

    companions: Floats  # (G, 6)  fields of `Companionship`
    attraction: Floats  # (K, 6)  fields of `Attraction`
    start: Ints  # (G+1,)  attractions of place g are start[g]:start[g + 1]


def pulls_of(pulls: Any, places: int) -> list[Pulls]:
    """Return the pulls of each of some places: given for all, for each, or (None) as by default.

    Raises
    ------
    ValueError
        If it is something else.
    """
    found = [pulls or Pulls()] * places if pulls is None or isinstance(pulls, Pulls) else pulls
    if not isinstance(found, list | tuple) or len(found) != places or not all(isinstance(one, Pulls) for one in found):
        refuse("pulls", pulls, f"a Pulls, or a list of {places}, one for each geometry")
    return list(found)


def has_companions(bodies: Bodies) -> bool:
    """Whether any two walk in company."""
    env = np.repeat(np.arange(len(bodies.env_start) - 1), np.diff(bodies.env_start))
    together = bodies.company != ALONE
    if not together.any():
        return False
    _, counts = np.unique(np.stack([env, bodies.company])[:, together], axis=1, return_counts=True)
    return bool((counts > 1).any())
