"""Headway: people walk as fast as the room in front of them allows, step aside and overtake; available to every scheme.

    V = clip(min_j V_j, p v_0, v_0)                                     speed; p push, v_0 desired speed
    V_j = (gap_j - c_j s + c_j t_a max(u_j . e, 0)) / (T + c_j t_a)     T time gap, t_a anticipation, s standing gap
    c_j = max(e_0 . e_j, 0)                                             how far j goes the same way
    e ~ e_0 + [c + sum_j a (1 + w max(-e_0 . e_j, 0)) exp(-R_j / D) s_j] (1 - p) n_0          direction
    R_j = max(gap_j - t_a (u_i - u_j) . n_j, 0)                         the gap to j that is foreseen, t_a ahead
    V_k = max(V_k as above, d_k / (c_k T_y), k max(u_k . e, 0))         for k beside: T_y = beside (T / 0.5 s)^2, k keep_up

``e_0`` is the way, ``n_0`` its normal, ``u`` a velocity.  People in front limit the speed if their bodies overlap the strip of
the body along its direction of motion.  Followers at one speed V are ``s + T V`` apart, as in the collision-free speed model
(Tordeux, Chraibi, Seyfried 2016, doi 10.1007/978-3-319-33482-0_29).  Since they foresee motion, people in a queue set out
together with the pedestrian in front.  Each pedestrian seen in front causes a side step ``s_j`` = 1 or -1, away from its
foreseen place, to the right if that is straight ahead, and larger if it is oncoming (anticipation velocity model: Xu, Chraibi,
Seyfried 2021, doi 10.1016/j.trc.2021.103464; preference of one side: Moussaïd et al. 2009, doi 10.1098/rspb.2009.0405).
``c`` is the side of overtaking, the fastest of a few, as in the heuristics of Moussaïd, Helbing, Theraulaz 2011
(doi 10.1073/pnas.1016507108).  A queue, people below 0.8 of their desired speed, is overtaken only where others come towards
it, and then above half of that speed.  Contact laws take over when bodies meet, as in the work of paper 1's own school with
behavioral rules on Frémond's law (Kabalan and Argoul, chapter 6 of doi 10.1007/978-3-662-52696-5).

Three things are ours.  Of two people in front of each other that do not walk in opposite directions, the one further ahead goes
first.  The push of a pedestrian grows while it has to stand still, up to a fifth, so that arches of mutually waiting people
dissolve; with more push people no longer step aside, and crossing streams lock.  It grows 1 + w times as fast while the
obstructing pedestrian is oncoming, else streams that meet in a corridor lock; the same growth at once for all people would
wedge them in front of doors.  Walls hide people from each other.

People ``k`` ahead but beside the strip count too: ``d_k`` is the gap between the strip and their bodies.  Without them, files
of people walk side by side as if alone, twice as fast at 2 /m2 as recorded crowds.  People beside do not count for a
pedestrian that overtakes: slow walkers are passed where there is room, and crowds below 0.5 /m2 lose little speed.  That T_y
grows as the square of T is a guess, and fits flows through doors and speeds in closed corridors.

With p = 1 no pedestrian gives way or steps aside: that is the desired velocity of the papers.

The numbers are fitted: times, widths and side steps were chosen under ``dem`` on the gate, the doors, the open corridor, the
ring, the ovals and the streams of ``python -m validation``, one set for all but the time gap (and the standing gap of
``eager`` and ``pushing``, and the push of the latter, which is fitted to no recording): see docs/walking.md.
"""

from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple, TypeAlias

from crowd_env.core.arrays.state import Floats
from crowd_env.core.behaviors.behavior import Behavior, Words
from crowd_env.core.checks import NAMES, Checked, NotNegative, Plain, Positive, Range, Share


class Patience(NamedTuple):
    """The memory of decisions."""

    waited: Annotated[Floats, "P"]  # s  stood still


@dataclass(frozen=True)
class Headway(Checked, Behavior):
    """The distance that people keep, and how they step aside.

    Raises
    ------
    ValueError
        If a value is out of range.
    """

    time_gap: Positive = 0.5
    """s, ``T``: a follower at speed V leaves a gap of s + V T."""
    push: Share = 0.0
    """``p``, share of the desired speed that is kept with no gap in front: 0 = none, 1 = always full speed, as in the
    papers."""
    standing: NotNegative = 0.15
    """m, ``s``: the gap that people leave to standing people in front on the same way."""
    width: Annotated[float, Range(0.0, 2.0, above=True)] = 0.8
    """of the strip in front that has to be free, as a share of the widths of both bodies."""
    strength: NotNegative = 0.12
    """``a``: the side step for a pedestrian ahead, as a share of the way itself."""
    length: Positive = 0.2
    """m, ``D``: the foreseen gap over which that falls to 1/e."""
    oncoming: NotNegative = 8.0
    """``w``: a straight oncoming pedestrian counts 1 + w times as much, for side steps and for patience."""
    keep_right: Annotated[float, Range(-1.0, 1.0)] = 0.2
    """m: an oncoming pedestrian is passed on the right, unless it is this far or further on that side; negative = on the
    left.  Where both sides are as good a slower one is overtaken there too."""
    anticipation: NotNegative = 0.4
    """s, ``t_a``: how far ahead people foresee each other's motion."""
    overtaking: NotNegative = 0.8
    """share of the desired speed: a pedestrian below it is held up, and is overtaken only where somebody in sight comes from
    the other side, and above half of it."""
    gain: NotNegative = 0.1
    """of speed that overtaking has to bring, over the desired speed."""
    berth: Positive = 1.0
    """width of the strip that has to be free to overtake, as ``width``."""
    patience: NotNegative = 5.0
    """s that people stand still before they begin to push more."""
    impatience: NotNegative = 0.02
    """1/s, by which the push grows from then on, up to a fifth; it falls back at the same rate when they walk again, at a
    quarter of the desired speed or faster."""
    beside: NotNegative = 0.12
    """s, ``T_y`` of people with a time gap of 0.5 s, for others by its square: a pedestrian ahead on the same way, but beside
    the strip, allows the speed of its distance from the strip over T_y; 0 = people beside do not matter."""
    keep_up: Share = 0.8
    """share of the speed of a pedestrian beside that is allowed in any case."""
    off_walls: NotNegative = 0.1
    """m: nearer to a wall than this people bend their way off it; 0 = they ignore walls."""
    shyness: NotNegative = 0.1
    """the bend at the wall itself, as a share of the way."""
    sight: Positive = 2.0
    """m, gap beyond which people do not notice each other."""
    interval: Positive = 0.05
    """s, between two decisions; in between the desired velocity stays as it is."""

    NAME = "manner"
    ABOUT = "how people walk before they touch, unless the run says otherwise"
    MEMORY = Patience
    USES = ("walking",)
    WORDS = Words(
        label="how they walk before they touch",
        usual="competitive",
        brief=lambda table: f"time gap {table['time_gap']:g} s",
        judged=True,
        limits={
            "competitive": "Competitive people walk at full speed whatever is in front of them, as in the papers; people who "
            "do not press keep a distance and leave more slowly (docs/walking.md)."
        },
    )

    @classmethod
    def params_of(cls, chosen: Any) -> Any:
        """Return the parameters for kernels; people without a headway decide at every step."""
        params = super().params_of(chosen)
        return params if chosen is not None else params._replace(interval=0.0)


CALM = 0.5  # s, the time gap to which `Headway.beside` belongs

Manner: TypeAlias = str | Plain | Headway
"""A manner as callers give it: a name in `MANNERS`, a table of the parameters of a `Headway`, or one."""

# Name -> manner, chosen by description of the crowd before any comparison; one set of numbers serves all.
MANNERS: dict[str, Headway | None] = {
    "competitive": None,  # the crowd of the papers: full speed whatever is in front
    "pushing": Headway(time_gap=0.2, standing=0.05, push=0.3),  # an alarm: people press on
    "eager": Headway(time_gap=0.2, standing=0.1),  # a gate where all want to be first
    "hurried": Headway(time_gap=0.3),  # gate, concert entrance, lecture hall
    "calm": Headway(),  # museum, corridor
}
NAMES["manner"] = MANNERS

Headway.PRESETS = MANNERS
