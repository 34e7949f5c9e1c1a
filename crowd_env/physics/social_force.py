"""Social force: people keep their distance before they touch; available to every scheme.

    f_i = A exp(-D / B) (1 + phi cos beta_i) n        on i, along n away from the other
    cos beta_i                                         between the desired direction of i and the direction to the other

This is the form of Lin, Ma, Lo (eq 2): phi > 0 gives people in front more weight.  Helbing's form, eq 12 of
Pécol et al. 2011,
    f_i = A exp(-D / B) (Lambda + (1 - Lambda) (1 + cos beta_i) / 2) n
is this form with strength A (1 + Lambda) / 2 and phi = (1 - Lambda) / (1 + Lambda).  (The paper prints the unit vector that
attracts; here it pushes apart.)

The two pedestrians of a pair walk in different directions, so the two forces are NOT opposite.  The force acts in contact too,
for any overlap.  A pedestrian without a desired direction has no front: cos beta is 0.
"""

from dataclasses import astuple, dataclass
from typing import Any, NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import NOT_NEGATIVE, POSITIVE, SHARE, Plain, Range, check_fields, from_choice, number
from crowd_env.core.kernels.jit import index, inner_kernel, kernel
from crowd_env.physics.narrow_phase import gap_to_feature
from crowd_env.physics.workspace import Batch


class SocialParams(NamedTuple):
    """Parameters of a social force for kernels."""

    strength: float
    length: float
    anisotropy: float
    wall_strength: float
    cutoff: float


@dataclass(frozen=True)
class SocialForce:
    """Anisotropic, non-reciprocal repulsion at a distance.

    Parameters
    ----------
    strength : N, ``A``: the force at zero distance from a pedestrian at the side.
    length : m, ``B``: the distance over which it falls to 1/e.
    anisotropy : ``phi``; at zero distance the force is A (1 + phi) from the front and A (1 - phi) from behind.
    wall_strength : N, ``A`` of walls; neither paper gives walls a social force, so 0 is the literal reading.
    cutoff : m, distance beyond which the force is zero; at 8 lengths it has fallen to 1/3000.

    Raises
    ------
    ValueError
        If a value is out of range.
    """

    strength: float = 300.0
    length: float = 0.05
    anisotropy: float = 0.3
    wall_strength: float = 0.0
    cutoff: float = 0.4

    def __post_init__(self) -> None:
        repels = Range(-1.0, 1.0).because("outside, the force would attract")
        sizes = {"strength": NOT_NEGATIVE, "wall_strength": NOT_NEGATIVE, "length": POSITIVE, "cutoff": POSITIVE}
        check_fields("social force", self, anisotropy=repels, **sizes)

    @staticmethod
    def helbing(strength: float = 2000.0, length: float = 0.08, behind: float = 0.0) -> "SocialForce":
        """Return Helbing's force, eq 12 and Table 6 of Pécol et al. 2011.

        Parameters
        ----------
        strength : N, ``A_i``: the force at zero distance from a pedestrian straight ahead.
        length : m, ``B_i``.
        behind : ``Lambda_i``: share of it from a pedestrian straight behind, 0 to 1.
        """
        number("social force: length", length, POSITIVE)
        number("social force: strength", strength, NOT_NEGATIVE)
        number("social force: behind (Lambda)", behind, SHARE)
        half = 0.5 * (1.0 + behind)
        return SocialForce(strength * half, length, (1.0 - behind) / (1.0 + behind), cutoff=8.0 * length)

    def params(self) -> SocialParams:
        """Return the parameters for kernels."""
        return SocialParams(*astuple(self))


# Name -> social force.
SOCIAL_FORCES: dict[str, SocialForce | None] = {
    "none": None,
    "helbing": SocialForce.helbing(),
    "lin": SocialForce(),
}


def make_social(social: str | Plain | SocialForce | None) -> SocialForce | None:
    """Return a social force, given as such, by name, or as plain data such as ``{"strength": 300.0, "length": 0.05}``.

    Raises
    ------
    ValueError
        If the type is wrong, or a name is unknown.
    """
    return from_choice("social force", SocialForce, social, SOCIAL_FORCES)


_POWERS = 2.0 ** np.arange(-160.0, 161.0)


@inner_kernel
def _exp(x: float) -> float:
    """Return exp(x) to a relative 1e-10, for |x| < 110, in half the time of the library's, which takes half of the force.

    It is 2^k times the Taylor series of the rest, at most ln 2 / 2; terms are paired, so the processor need not wait for each.
    """
    x = min(max(x, -110.0), 110.0)
    k = np.floor(x * 1.4426950408889634 + 0.5)
    y = x - k * 0.6931471805599453
    y2 = y * y
    y4 = y2 * y2
    low = (1.0 + y) + y2 * (0.5 + y * (1.0 / 6.0))
    high = (1.0 / 24.0 + y * (1.0 / 120.0)) + y2 * (1.0 / 720.0 + y * (1.0 / 5040.0))
    return _POWERS[index(k + 160.0)] * (low + y4 * (high + y4 * (1.0 / 40320.0 + y * (1.0 / 362880.0))))


@inner_kernel
def add_social_forces(e: int, rank_stop: int, batch: Batch, params: SocialParams) -> None:
    """Add the social forces [N] on the people in `Workspace.inside` up to ``rank_stop`` to `History.force`.

    The neighbor list must be complete up to the cut-off.  Distances and sizes of all pairs come first, eight in one
    instruction; then the forces are added up in the order of the list.
    """
    near, force, heading = batch.workspace.neighbors, batch.history.force, batch.workspace.heading
    inside = batch.workspace.inside
    for rank in range(index(batch.bodies.env_start[e]), index(rank_stop)):
        _turn_heading(inside[rank], batch, params.anisotropy)
    pairs, owner, partner = batch.workspace.social_pairs, near.owner, near.partner
    entry, sizes, normal_x, normal_y = pairs.entry, pairs.size, pairs.x, pairs.y
    pair_start, pair_stop = index(near.entry_start[e]), _find_pairs(e, batch, params.cutoff)
    _repel(pair_start, pair_stop, normal_x, normal_y, sizes, params)
    for pair in range(pair_start, pair_stop):
        i, j = owner[entry[pair]], partner[entry[pair]]
        nx, ny, size = normal_x[pair], normal_y[pair], sizes[pair]
        mine = size * (1.0 - (heading[i, 0] * nx + heading[i, 1] * ny))
        other = size * (1.0 + (heading[j, 0] * nx + heading[j, 1] * ny))
        force[i, 0] += mine * nx
        force[i, 1] += mine * ny
        force[j, 0] -= other * nx
        force[j, 1] -= other * ny
    if params.wall_strength > 0.0:
        _add_forces_of_walls(e, batch, params, force)


@inner_kernel
def _turn_heading(i: int, batch: Batch, anisotropy: float) -> None:
    """Bring `Workspace.heading` of person ``i`` up to date with the desired velocity."""
    desired, heading = batch.workspace.desired_velocity, batch.workspace.heading
    x, y = desired[i, 0], desired[i, 1]
    if heading[i, 2] != x or heading[i, 3] != y:  # rare: a root and a division are slow
        speed = np.sqrt(x * x + y * y)
        share = anisotropy / speed if speed > 0.0 else 0.0
        heading[i, 0], heading[i, 1], heading[i, 2], heading[i, 3] = share * x, share * y, x, y


@inner_kernel
def _add_forces_of_walls(e: int, batch: Batch, params: SocialParams, force: Floats) -> None:
    """Add the social forces [N] of walls on the people of environment ``e`` to ``force`` (P, 2)."""
    near, boundary, g = batch.workspace.neighbors, batch.world.boundary, batch.world.geometry_of_env[e]
    owner, partner, radius, position = near.owner, near.partner, batch.bodies.radius, batch.state.position
    present, heading, per_length = batch.state.present, batch.workspace.heading, 1.0 / params.length
    for wall in range(index(near.pair_end[e]), index(near.wall_end[e])):
        i, feature = owner[wall], np.int64(partner[wall])
        gap, nx, ny = gap_to_feature(position[i, 0], position[i, 1], radius[i], boundary, g, feature, params.cutoff)
        if gap < params.cutoff and present[i]:
            size = params.wall_strength * _exp(-gap * per_length)
            size *= 1.0 - (heading[i, 0] * nx + heading[i, 1] * ny)
            force[i, 0] += size * nx
            force[i, 1] += size * ny


@kernel
def social_forces_of_walls(batch: Batch, params: SocialParams, force: Floats) -> None:
    """Add the social forces [N] of walls at the present positions to ``force`` (P, 2)."""
    for e in range(len(batch.state.time)):
        for i in range(index(batch.bodies.env_start[e]), index(batch.bodies.env_start[e + 1])):
            _turn_heading(i, batch, params.anisotropy)
        _add_forces_of_walls(e, batch, params, force)


@inner_kernel
def _find_pairs(e: int, batch: Batch, cutoff: float) -> Any:
    """Write the pairs nearer than ``cutoff`` into `Workspace.social_pairs`, without a branch; returns one past the last.

    ``x`` and ``y`` hold the displacement [m] between the two centers, ``size`` their distance [m] at the cut-off.
    """
    near, position, present = batch.workspace.neighbors, batch.state.position, batch.state.present
    owner, partner, contact_distance, pair = near.owner, near.partner, near.contact_distance, index(near.entry_start[e])
    pairs = batch.workspace.social_pairs
    entry_of, x, y, size = pairs.entry, pairs.x, pairs.y, pairs.size
    for entry in range(index(near.entry_start[e]), index(near.pair_end[e])):
        i, j = owner[entry], partner[entry]
        dx, dy = position[i, 0] - position[j, 0], position[i, 1] - position[j, 1]
        reach = contact_distance[entry] + cutoff
        entry_of[pair], x[pair], y[pair], size[pair] = entry, dx, dy, reach
        pair += index((dx * dx + dy * dy < reach * reach) & present[i] & present[j])
    return pair


@inner_kernel
def _repel(pair_start: int, pair_stop: int, x: Floats, y: Floats, size: Floats, params: SocialParams) -> None:
    """Turn displacements and reaches into unit vectors and the sizes [N] of isotropic forces."""
    strength, cutoff, per_length = params.strength, params.cutoff, 1.0 / params.length
    for pair in range(pair_start, pair_stop):
        dx, dy = x[pair], y[pair]
        distance = np.sqrt(dx * dx + dy * dy)
        per_distance = 1.0 / distance
        size[pair] = strength * _exp((size[pair] - cutoff - distance) * per_length)
        x[pair] = per_distance * dx if distance > 0.0 else 1.0
        y[pair] = per_distance * dy if distance > 0.0 else 0.0
