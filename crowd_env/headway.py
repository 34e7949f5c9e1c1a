"""Headway: people walk as fast as the gap in front of them allows, and step aside; available to every scheme.

    V = clip(gap / T, p v_0, v_0)                              speed; T time gap, p push, v_0 desired speed
    e ~ e_0 + sum_j a (1 + w (1 - e_0 . e_j) / 2) exp(-R_j / D) s_j          direction
    R_j = max(gap_j - t_a (u_i - u_j) . n_j, 0)                the gap to j that is foreseen, t_a ahead

The gap is that to the nearest person in front whose body overlaps the strip of the own body along the direction of motion
(collision-free speed model: Tordeux, Chraibi, Seyfried 2016, doi 10.1007/978-3-319-33482-0_29).  Whoever is seen in front
makes people step aside, at right angles to their way and away from where the other will be, the more so the less the other
goes their way (anticipation velocity model: Xu, Chraibi, Seyfried 2021, doi 10.1016/j.trc.2021.103464).  On top of contact
laws that take over when bodies meet: paper 1's own school has put behavioral rules on Frémond's law in the same way (Kabalan
and Argoul, chapter 6 of doi 10.1007/978-3-662-52696-5).

Three things are ours.  Of two who would both give way to each other, and do not walk against each other, the one who is
further ahead goes first.  The push grows while someone has to stand still, so that arches of people who wait for each other
dissolve.  People whom a wall hides are not seen.

With p = 1 nobody gives way and nobody steps aside: that is the desired velocity of the papers.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple, TypeAlias

from crowd_env.checks import NOT_NEGATIVE, POSITIVE, SHARE, Range, check_fields, from_table, known, refuse


class HeadwayParams(NamedTuple):
    """A headway rule as kernels read it; lengths in m, times in s."""

    time_gap: float
    push: float
    width: float
    strength: float
    length: float
    oncoming: float
    anticipation: float
    detour: float
    patience: float
    impatience: float
    sight: float
    interval: float


@dataclass(frozen=True)
class Headway:
    """The distance that people keep, and how they step aside.

    Parameters
    ----------
    time_gap : s, ``T``: who walks at speed V leaves a gap of V T in front.  Calibrated to about 1 s for people at ease.
    push : ``p``, share of the own desired speed at which one presses on with no gap in front: 0 = never, 1 = always at full
        speed, as in the papers.
    width : of the strip in front that has to be free, as a share of the own and the other's width.
    strength : ``a``: how strongly one steps aside for someone ahead with the same way, as a share of the way itself.
    length : m, ``D``: the foreseen gap over which that falls to 1/e.
    oncoming : ``w``: someone who comes straight towards one counts 1 + w times as much.
    anticipation : s, ``t_a``: how far ahead people see each other's motion.
    detour : share of the own desired speed that a way aside has to gain to be taken; negative = never.
    patience : s that people stand still before they begin to push more.
    impatience : 1/s, by which the push grows from then on, up to 1; it falls back at the same rate when they walk again.
    sight : m, gap beyond which nobody is noticed.
    interval : s, between two decisions; in between the desired velocity stays as it is.

    Raises
    ------
    ValueError
        If a value is out of range.
    """

    time_gap: float = 1.0
    push: float = 0.0
    width: float = 0.86
    strength: float = 0.2
    length: float = 0.1
    oncoming: float = 8.0
    anticipation: float = 0.5
    detour: float = -1.0
    patience: float = 5.0
    impatience: float = 0.02
    sight: float = 2.0
    interval: float = 0.05

    def __post_init__(self) -> None:
        check_fields(
            "headway",
            self,
            time_gap=POSITIVE,
            push=SHARE,
            width=Range(0.0, 2.0, above=True),
            strength=NOT_NEGATIVE,
            length=POSITIVE,
            oncoming=NOT_NEGATIVE,
            anticipation=NOT_NEGATIVE,
            patience=NOT_NEGATIVE,
            impatience=NOT_NEGATIVE,
            sight=POSITIVE,
            interval=POSITIVE,
        )

    def params(self) -> HeadwayParams:
        """Return the rule as kernels read it."""
        return HeadwayParams(*(float(getattr(self, name)) for name in HeadwayParams._fields))


Manner: TypeAlias = str | Mapping[str, Any] | Headway
"""How callers say how people walk: a name in `MANNERS`, a table of the parameters of a `Headway`, or one."""

# Name -> how people walk, by description: chosen before any comparison, and one set of numbers for all of them.
MANNERS: dict[str, Headway | None] = {
    "competitive": None,  # full speed whatever is in front: the papers
    "hurried": Headway(time_gap=0.5),  # gate, concert entrance, lecture hall
    "calm": Headway(time_gap=0.8),  # museum, corridor
}


def make_manner(manner: Manner | None) -> Headway | None:
    """Return the headway rule of a name in `MANNERS`, of plain data such as ``{"time_gap": 0.7}``, or that is given.

    Raises
    ------
    ValueError
        If it is something else, or a name is unknown.
    """
    if isinstance(manner, str):
        return MANNERS[known("manner", manner, MANNERS)]
    if isinstance(manner, Mapping):
        return from_table("manner", Headway, manner)
    if manner is not None and not isinstance(manner, Headway):
        refuse("manner", manner, f"a Headway, a table of its parameters, None or one of {', '.join(MANNERS)}")
    return manner


def plain_manner(headway: Headway | None) -> str | dict[str, float]:
    """Return the name of a manner, or if it has none the table of its parameters; ready for JSON, and for `make_manner`."""
    for name, known_headway in MANNERS.items():
        if headway == known_headway:
            return name
    return asdict(headway)  # type: ignore[arg-type]  # None has a name
