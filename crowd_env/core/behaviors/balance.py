"""Balance: a standing body leans over its feet, which follow by stepping; available to every scheme.

    x'' = (g / h) (x - p) + F / m          linear inverted pendulum: h height of the center of mass, F contact and other forces
    c = x + v sqrt(h / g)                  capture point: above a foot placed there the body comes to rest
    p = q + (1 + k) (c - q)                center of pressure, q the middle of the feet, brought back into the support

The support is all within b of the line from foot to foot: an ankle exerts m g b / h at most.  Inside of it c obeys
c' = -k sqrt(g / h) (c - q), so the body comes upright over the middle of its feet.  If c leaves the support for the reaction
time, the foot further from c is lifted; until it lands, a swing later, the other foot alone carries.  It lands at c, at most a
step away from the other.  Then the feet are apart, and bear more in that direction.

    F = m_e w^2 / l                        between two standing people within reach of arms, while they close at w > 0

m_e is the reduced mass of the two.  So w falls by 1/e on every l of the way that the gap closes, in a trunk contact too: arms
only brake: they push no pedestrian at rest, and give nothing back.  Nothing like it was recorded; the form is ours, since
forces that grow as w, or with the depth, fit worse (docs/validation.md).

Pendulum and capture point: Hof, Gazendam, Sinke 2005 (J Biomech 38:1), Koolen et al. 2012 (Int J Robotics Research 31:1094),
both unchecked.  Two feet, with the body upright over their middle after a step, are ours; so is one radius b in all directions.

Walking pedestrians use the driving force instead, since their feet follow at every step.  No pedestrian falls; feet ignore
walls and each other, arms ignore walls.  The numbers are fitted on one recorded push (docs/validation.md).
"""

from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple, TypeAlias

import numpy as np

from crowd_env.core.arrays.state import Bools, Floats
from crowd_env.core.behaviors.behavior import Behavior
from crowd_env.core.checks import Checked, NotNegative, Plain, Positive

GRAVITY = 9.81  # m/s2


class Feet(NamedTuple):
    """Standing pedestrians: both feet, and the landing time of the second; the first carries meanwhile."""

    feet: Annotated[Floats, "P 4"]  # m
    lands_at: Annotated[Floats, "P"]  # s    infinite = both are on the ground, and none is to be lifted
    stands: Annotated[Bools, "P"]


@dataclass(frozen=True)
class Balance(Checked, Behavior):
    """How a standing pedestrian keeps upright.

    Raises
    ------
    ValueError
        If a value is out of range.
    """

    height: Positive = 1.0
    """m, ``h``, of the center of mass; about 0.55 of an adult's."""
    base: Positive = 0.114
    """m, ``b``: how far from the line between the feet the center of pressure can be; half a foot is 0.12.  Fitted."""
    gain: Positive = 0.155
    """``k``, by which the center of pressure is ahead of the capture point.  Fitted."""
    reaction: NotNegative = 0.064
    """s that the capture point is outside of the support before a foot is lifted.  Fitted."""
    swing: Positive = 0.43
    """s that a foot is in the air.  Fitted."""
    step: Positive = 0.75
    """m, longest step; no step of that push is so long."""
    grip: Positive = 0.4
    """share of the weight that the ground can give sideways, friction of shoes on a floor."""
    head: Positive = 1.7
    """times as far as the center of mass a leaning body moves its head: 1.7 m over 1 m."""
    arms: NotNegative = 0.19
    """m between two bodies from which on arms brake; 0 = never.  Fitted."""
    give: Positive = 0.0255
    """m, ``l``, by which arms give while the closing speed falls by 1/e.  Fitted."""
    walks_from: NotNegative = 0.1
    """m/s: a pedestrian with a larger desired speed walks, and does not stand."""

    NAME = "balance"
    ABOUT = "how standing pedestrians keep their balance, unless the run says otherwise"
    NEEDS = "drives"
    LACKS = "has no force of the ground, so pedestrians cannot keep their balance"
    MEMORY = Feet
    USES = ("desired_velocity", "force")
    RECORDED = ("feet",)

    @classmethod
    def rows(cls, simulation: Any) -> dict[str, Floats]:
        """Return the places of both feet of all people (P, 4) [m]."""
        return {"feet": places_of_feet(simulation).reshape(-1, 4)}


Balancing: TypeAlias = str | Plain | Balance
"""A balance as callers give it: a name in `BALANCES`, a table of the parameters of a `Balance`, or one."""

BALANCES: dict[str, Balance | None] = {
    "none": None,  # as in the papers: a disc that stands is braked by its drive
    "stepping": Balance(),
}
Balance.PRESETS = BALANCES


def places_of_feet(simulation: Any) -> Floats:
    """Return the places of both feet of all people (P, 2, 2) [m], in the air too; under the body while walking.

    Raises
    ------
    ValueError
        If people of the simulation have no feet: it has no balance.
    """
    params, state, bodies = simulation.behaviors[Balance.NAME], simulation.state, simulation.bodies
    if params is None:
        raise ValueError("people have no feet here: a simulation needs balance='stepping'")
    feet, lands_at, stands = (simulation.in_slots(array) for array in simulation.history.memory.balance)
    feet = np.where(stands[:, None], feet, np.tile(state.position, 2)).reshape(-1, 2, 2)
    time = np.repeat(state.time, np.diff(bodies.env_start))
    done = np.clip(1.0 - (np.where(stands, lands_at, np.inf) - time) / params.swing, 0.0, 1.0)[:, None]
    ahead = state.position + np.sqrt(params.height / GRAVITY) * state.velocity - feet[:, 0]
    ahead *= np.minimum(1.0, params.step / np.maximum(np.hypot(*ahead.T), 1e-9))[:, None]
    feet[:, 1] += done * (feet[:, 0] + ahead - feet[:, 1])
    return feet


def places_of_heads(simulation: Any) -> Floats:
    """Return the places of all heads (P, 2) [m]: further from the middle of the feet than the leaning body."""
    body, params = simulation.state.position, simulation.behaviors[Balance.NAME]
    return (
        body.copy() if params is None else body + (params.head - 1.0) * (body - places_of_feet(simulation).mean(axis=1))
    )
