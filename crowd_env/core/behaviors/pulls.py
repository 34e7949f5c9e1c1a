"""Pulls off the way: groups and attractions, as forces of every scheme.

    f_i = - beta_1 alpha_i v_i                                              gaze: slowing down to see the others
          + beta_2 U_i             if further than (N - 1) / 2 m from the center of the group, in sight
          - sum_k beta_3 W_ik      of members nearer than d_0
          + sum_a A_a (R / R_a) exp[(1 - (R / R_a)^2) / 2 - (t - t_a) / T_a] n_a     attractions

These are forces on a pedestrian over its mass [m/s2].  N members of the group are inside; ``U`` is the unit vector to their
center, ``W_ik`` the one to member k, and ``alpha_i`` the angle [rad] by which the head must turn, until the center of the
others lies in a field of view of 90 degrees to either side of the way: Moussaïd, Perozo, Garnier, Helbing, Theraulaz 2010
(PLoS ONE 5(4): e10047).  The four numbers and the field of view are from its Figure 4.  That the threshold is (N - 1) / 2 m
and the angle in radians is unchecked: both are as in open code that follows the paper.

An attraction pulls less with time, as interest declines (Helbing, Molnár 1995, doi 10.1103/PhysRevE.51.4282, without a
formula).  It is the gradient of a well: the pull is largest, ``A_a``, at the distance ``R_a``, and falls off exponentially.

Two things are ours.  A pedestrian ahead of another member by more than ``apart``, or out of its sight, waits.  It stands
still at most for ``patience``, then goes on alone until they are together again.  Pulled speeds are at most 1.3 times the
desired speed, which is the bound of Helbing and Molnár 1995.
"""

from collections.abc import Sequence
from dataclasses import astuple, dataclass, field, replace
from typing import Annotated, Any, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Bodies, Floats, Ints, row_starts
from crowd_env.core.behaviors.behavior import Behavior
from crowd_env.core.checks import Checked, NotNegative, Positive, check_fields, refuse

MOST = 1000  # attractions of a place
ALONE = -1  # group number of a pedestrian that walks alone


@dataclass(frozen=True)
class GroupCohesion:
    """How the members of a group keep together."""

    gaze: NotNegative = 4.0
    """1/s, ``beta_1``: by how much people slow down for each radian of turning the head to see the others."""
    cohesion: NotNegative = 3.0
    """m/s2, ``beta_2``: how strongly they are pulled to the center of their group."""
    repulsion: NotNegative = 1.0
    """m/s2, ``beta_3``: how strongly members too near each other are pushed apart."""
    spacing: NotNegative = 0.8
    """m, ``d_0``: the distance between centers below which they are too near."""
    apart: Positive = 3.0
    """m, the distance to a member further back beyond which people wait."""
    patience: NotNegative = 30.0
    """s, the time after which people stop waiting for members further back and go on alone."""

    def __post_init__(self) -> None:
        check_fields("groups", self)


@dataclass(frozen=True)
class Attraction(Checked):
    """A point that pulls the people that see it, less and less with time."""

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


class Waiting(NamedTuple):
    """The memory of groups."""

    held_since: Annotated[
        Floats, "P"
    ]  # s  time since which members further back hold the pedestrian back; 0 = they do not
    lost: Annotated[Floats, "P"]  # recent mean of the share of the desired speed that members further back cost
    seen_at: Annotated[Floats, "E"]  # s  time of the last look at the group


@dataclass(frozen=True)
class Pulls(Behavior):
    """Pulls off the way in a place: groups and attractions."""

    groups: GroupCohesion = field(default_factory=GroupCohesion)
    """how the members of a group keep together."""
    attractions: tuple[Attraction, ...] = ()
    """points that pull people, each for a while."""

    NAME = "pulls"
    ABOUT = "what pulls pedestrians off their way: their group, and attractions"
    MEMORY = Waiting
    USES = ("walking", "pulls")
    PER_PLACE = True

    def __post_init__(self) -> None:
        check_fields("pulls", self)
        if len(self.attractions) > MOST:
            raise ValueError(f"pulls: there are {len(self.attractions)} attractions; at most {MOST} are allowed")

    def moved(self, points: Floats) -> "Pulls":
        """Return these pulls with the attractions at ``points`` (K, 2) [m]."""
        moved = (replace(one, x=x, y=y) for one, (x, y) in zip(self.attractions, points.tolist(), strict=True))
        return replace(self, attractions=tuple(moved))

    @classmethod
    def of(cls, given: Any) -> "Pulls":
        """Return pulls, given as such or as a table of their fields; by default ``Pulls()``, without attractions."""
        return super().of(given) or Pulls()

    @classmethod
    def params_of(cls, chosen: Sequence["Pulls"]) -> "PullArrays":
        """Return the pulls of all places for kernels."""
        rows = [astuple(one) for pulls in chosen for one in pulls.attractions]
        return PullArrays(
            np.array([astuple(pulls.groups) for pulls in chosen], dtype=np.float64),
            np.array(rows, dtype=np.float64).reshape(-1, 6),
            row_starts([len(pulls.attractions) for pulls in chosen]),
        )

    @classmethod
    def acts(cls, chosen: Sequence["Pulls"], bodies: Bodies) -> bool:
        """Whether there are groups or attractions."""
        return has_groups(bodies) or any(pulls.attractions for pulls in chosen)


class PullArrays(NamedTuple):
    """The pulls of G places for kernels."""

    groups: Floats  # (G, 6)  fields of `GroupCohesion`
    attraction: Floats  # (K, 6)  fields of `Attraction`
    start: Ints  # (G+1,)  attractions of place g are start[g]:start[g + 1]


def pulls_of(pulls: Any, places: int) -> list[Pulls]:
    """Return the pulls of each of ``places`` places, given for all, for each, or as None: the default.

    Raises
    ------
    ValueError
        If the type or the number is another.
    """
    found = [pulls or Pulls()] * places if pulls is None or isinstance(pulls, Pulls) else pulls
    if not isinstance(found, list | tuple) or len(found) != places or not all(isinstance(one, Pulls) for one in found):
        refuse("pulls", pulls, f"a Pulls, or a list of {places}, one for each geometry")
    return list(found)


def has_groups(bodies: Bodies) -> bool:
    """Whether any group has two members."""
    env = np.repeat(np.arange(len(bodies.env_start) - 1), np.diff(bodies.env_start))
    together = bodies.group != ALONE
    if not together.any():
        return False
    _, counts = np.unique(np.stack([env, bodies.group])[:, together], axis=1, return_counts=True)
    return bool((counts > 1).any())
