"""Outline: the shape of bodies as several discs with one mass, and the torque that turns them into their way.

    M = I (wrap(way - angle) / t^2 - 2 spin / t),   |M| <= M_max            t turning time: critically damped

All bodies have the same outline, scaled: `Bodies.radius` stays the radius of the disc of the same area, so density, headway,
social force and observations keep their meaning.  The center of mass lies in the centroid, and the moment of inertia is that of
a plate of even weight.  The angle is 0 where a body faces along +x; its left is then along +y.

"torso" has the five discs, from shoulder to shoulder, of a person of 81 kg in an example of LEMONS (Dufour, Stapelle, Nicolas,
SciPost Phys. Codebases 67, 2026; repository Crowd-Mechanics/LEMONS, push_Feldmann, Agents.xml), made from the torso of the
Visible Human and the measures of ANSUR II: bideltoid breadth 0.471 m, chest depth 0.246 m.  Its moment of inertia there is
1.48 kg m^2.  A turning time of 0.45 s damps spin at 2 / t = 4.4 /s, LEMONS does so at 4.5 /s.  The largest torque is assumed.
"""

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, NamedTuple, TypeAlias

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.core.behaviors.behavior import Behavior, Words
from crowd_env.core.checks import POSITIVE, Plain, Positive, Range, array, check_fields, plain_choice, require_all

MOST_DISCS = 16
_PERHAPS_NEVER = Range(0.0, above=True, infinite=True)
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)  # for an arc: its moments come out to the last digits


class Disc(NamedTuple):
    """One disc of an outline."""

    x: float  # m, forwards
    y: float  # m, to the left
    radius: Positive  # m


class UnitShape(NamedTuple):
    """An outline in units of the radius of the disc of the same area, about its centroid."""

    x: Floats  # (K,)  centers of the discs, forwards
    y: Floats  # (K,)  and to the left
    radius: Floats  # (K,)
    reach: float  # radius of the smallest disc around the centroid that holds all of it
    inertia: float  # moment of inertia, of mass times radius squared; 1/2 for a disc


class OutlineParams(NamedTuple):
    """Parameters of an outline for kernels; no discs where bodies are discs."""

    x: Floats  # (K,)  see `UnitShape`
    y: Floats
    radius: Floats
    reach: float
    turning_time: float  # s
    max_torque: float  # N m


def _rows(discs: Any) -> Any:
    """Return discs as rows; other input is returned unchanged, for a later check to refuse."""
    return discs if isinstance(discs, str | Mapping) or not isinstance(discs, Iterable) else list(discs)


def _moments(x: Floats, y: Floats, r: Floats) -> tuple[float, float, float, float]:
    """Return area, centroid and polar second moment about the origin of a union of discs (K,), by Green's theorem.

    The border of the union is made of arcs; what is integrated along them is smooth.
    """
    area, first_x, first_y, second = 0.0, 0.0, 0.0, 0.0
    for k in range(len(r)):
        for begin, end in _free_arcs(k, x, y, r):
            half = 0.5 * (end - begin)
            angle, weight = begin + half * (1.0 + _NODES), half * _WEIGHTS * r[k]
            nx, ny = np.cos(angle), np.sin(angle)
            px, py = x[k] + r[k] * nx, y[k] + r[k] * ny
            area += 0.5 * (weight * (px * nx + py * ny)).sum()
            first_x += 0.5 * (weight * px * px * nx).sum()
            first_y += 0.5 * (weight * py * py * ny).sum()
            second += (weight * (px**3 * nx + py**3 * ny)).sum() / 3.0
    return area, first_x / area, first_y / area, second


def _free_arcs(k: int, x: Floats, y: Floats, r: Floats) -> list[tuple[float, float]]:
    """Return the arcs [rad] of the border of disc ``k`` that lie in no other disc; of equal discs the first counts."""
    edges = np.linspace(0.0, 2.0 * np.pi, 5).tolist()  # no arc is longer than a quarter of a turn
    for other in range(len(r)):
        dx, dy = x[other] - x[k], y[other] - y[k]
        apart = np.hypot(dx, dy)
        if abs(r[other] - r[k]) < apart < r[other] + r[k]:
            half = np.arccos((apart**2 + r[k] ** 2 - r[other] ** 2) / (2.0 * apart * r[k]))
            edges += [(np.arctan2(dy, dx) + side) % (2.0 * np.pi) for side in (-half, half)]
    edges.sort()
    free = []
    for begin, end in itertools.pairwise(edges):
        middle = 0.5 * (begin + end)
        away = np.hypot(x[k] + r[k] * np.cos(middle) - x, y[k] + r[k] * np.sin(middle) - y) - r
        inside = away < -1e-12 * r[k]
        same = (np.hypot(x - x[k], y - y[k]) == 0.0) & (r == r[k]) & (np.arange(len(r)) < k)
        if end > begin and not (inside | same)[np.arange(len(r)) != k].any():
            free.append((begin, end))
    return free


@dataclass(frozen=True)
class Outline(Behavior):
    """Several discs that move and turn as one body.

    Raises
    ------
    ValueError
        If a value is out of range, or there is no disc or too many.
    """

    discs: tuple[Disc, ...]
    """a `Disc` or three numbers each, of a person of any size: they are scaled."""
    turning_time: Annotated[float, _PERHAPS_NEVER] = 0.45
    """s, ``t``, in which a body turns into its way; infinite = nothing but contacts turns it."""
    max_torque: Annotated[float, _PERHAPS_NEVER] = 20.0
    """N m, ``M_max``, of what turns a body into its way, so that contacts can turn a shoulder."""

    NAME = "outline"
    ABOUT = "what shape bodies have, unless the run says otherwise"
    NEEDS = "turns_bodies"
    LACKS = "does not turn bodies, so it cannot have {behavior}"
    USES = ("discs",)
    WORDS = Words(
        label="shape of the body",
        usual="disc",
        unsaid=frozenset({"disc"}),
        brief=lambda table: f"{len(table['discs'])} discs a body",
        limits={"disc": ""},
        limit="The rows are of people with the outline of discs; the bodies of these runs are others.",
    )

    def __post_init__(self) -> None:
        values = np.asarray(array("outline: discs", _rows(self.discs), (None, 3)), dtype=np.float64)
        if not 1 <= len(values) <= MOST_DISCS:
            raise ValueError(f"outline: discs are {len(values)}; there must be 1 to {MOST_DISCS}")
        require_all("outline: discs", values, Range())
        require_all("outline: radius of discs", values[:, 2], POSITIVE)
        object.__setattr__(self, "discs", tuple(Disc(*row) for row in values.tolist()))
        check_fields("outline", self)

    @cached_property
    def shape(self) -> UnitShape:
        """The outline in units of the nominal radius, about its centroid."""
        x, y, r = np.array(self.discs).T
        area, mean_x, mean_y, second = _moments(x, y, r)
        unit = np.sqrt(area / np.pi)
        # Rounded: a single disc is then exactly a disc.
        x, y, r = (np.round(values / unit, 12) + 0.0 for values in (x - mean_x, y - mean_y, r))
        inertia = (second / area - mean_x**2 - mean_y**2) / unit**2
        return UnitShape(x, y, r, float((np.hypot(x, y) + r).max()), round(float(inertia), 12))

    @property
    def step_share(self) -> float:
        """The stable step as a share of that of discs of the same area.

        Stiffness is at most that of all discs pressed at once, each at the longest lever: omega^2 grows by K (1 + b^2 / J)
        times the root of the largest disc, since its contact radius is that much smaller.
        """
        x, y, radius, _, inertia = self.shape
        lever = float((x * x + y * y).max())
        return float(1.0 / np.sqrt(len(radius) * (1.0 + lever / inertia) * np.sqrt(radius.max())))

    def inertia(self, mass: Floats, radius: Floats) -> Floats:
        """Return the moments of inertia (N,) [kg m^2] of bodies of this outline about the vertical axis."""
        return np.asarray(self.shape.inertia * mass * radius**2)

    def place_discs(self, position: Floats, radius: Floats, angle: Floats) -> tuple[Floats, Floats]:
        """Return centers (N, K, 2) and radii (N, K) [m] of the discs of N bodies that face ``angle`` (N,) [rad]."""
        x, y, size, _, _ = self.shape
        cosine, sine = np.cos(angle)[:, None], np.sin(angle)[:, None]
        away = np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)
        return position[:, None] + radius[:, None, None] * away, radius[:, None] * size

    @classmethod
    def plain_of(cls, chosen: Any) -> Any:
        """Return the name of an outline, or without one the table of its parameters."""
        plain = plain_choice(chosen, cls.PRESETS)
        return plain if isinstance(plain, str) else plain | {"discs": [list(disc) for disc in plain["discs"]]}

    @classmethod
    def params_of(cls, chosen: Any) -> OutlineParams:
        """Return the outline for kernels; no discs where bodies are discs."""
        if chosen is None:
            return OutlineParams(np.zeros(0), np.zeros(0), np.zeros(0), 1.0, np.inf, np.inf)
        x, y, radius, reach, _ = chosen.shape
        return OutlineParams(x, y, radius, reach, chosen.turning_time, chosen.max_torque)


_TORSO = (
    Disc(-0.014, 0.150, 0.08556),
    Disc(0.008, 0.066, 0.11766),
    Disc(0.012, 0.0, 0.12300),
    Disc(0.008, -0.066, 0.11766),
    Disc(-0.014, -0.150, 0.08556),
)

BodyShape: TypeAlias = str | Plain | Outline
"""A shape as callers give it: a name in `OUTLINES`, a table of the parameters of an `Outline`, or one."""

# Name -> shape of all bodies.
OUTLINES: dict[str, Outline | None] = {
    "disc": None,  # as in the papers
    "torso": Outline(_TORSO),
}
Outline.PRESETS = OUTLINES


def room_of(outline: Outline | None) -> float:
    """Return the radius within which a body can turn freely, as a multiple of its nominal radius."""
    return 1.0 if outline is None else outline.shape.reach
