"""Newton's cradle: one ball runs into a row of balls at rest, under every scheme.

What leaves on the far side tells the collision laws apart.  With a gap between the balls all collisions are binary, and of
restitution e: the last ball leaves at v ((1 + e) / 2)^(n - 1).  Where they touch, each law has its own answer:

* springs (dem, hertz) pass a wave on that disperses a little; Hertz's law less than a linear one;
* nsm1 has no restitution: all go on together, at v / n;
* nsm2 dissipates only where bodies approach, at the first ball of the row; what is at rest stays together.  The row acts as
  one body of mass (n - 1) m, and the ball that came is thrown back:  u = (1 + e') v / n, e' the restitution of these two.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.geometry.geometry import Geometry, box
from crowd_env.physics import DEM, NSM1, NSM2, ContactScheme, Hertz
from crowd_env.rendering.canvas import draw_bodies, name_panel, new_figure
from crowd_env.rendering.libraries import Figure
from crowd_env.reproduce.granular.grains import DIAMETER, MASS, RADIUS, passive
from crowd_env.reproduce.granular.settings import GranularSettings
from crowd_env.reproduce.result import RawTable, Result, Row

SPEED, AWAY = 1.0, 0.05  # m/s, m: of the ball that comes, and how far it starts from the row
GAPS = {"touching": 0.0, "apart": 0.05}  # m
_AFTER = 2.0  # s
_SOFT, _RIGID = 1e-4, 1e-3  # s, time steps
_EXACT = 1e-10  # m/s


def k_normal(e: float) -> float:
    """Return the K_N [kg] of nsm2 with which two of these balls bounce by ``e`` (m_e = m / 2)."""
    return np.inf if e == 1.0 else MASS * (1.0 + e) / (1.0 - e)


@dataclass(frozen=True)
class Law:
    """A collision law of the cradle."""

    name: str
    scheme: ContactScheme
    dt: float  # s
    e: float | None  # restitution of two balls; None where there is no closed form

    def last(self, balls: int, arrangement: str) -> float | None:
        """Return the closed form of the velocity of the last ball over that of the first, before."""
        if self.e == 0.0:
            return 1.0 / balls
        if arrangement == "apart":
            return None if self.e is None else ((1.0 + self.e) / 2.0) ** (balls - 1)
        if not isinstance(self.scheme, NSM2) or self.e is None:
            return None
        twice = 2.0 * MASS * (balls - 1) / balls  # 2 m_e of the ball and the row
        bounce = 1.0 if self.e == 1.0 else (k_normal(self.e) - twice) / (k_normal(self.e) + twice)
        return (1.0 + max(0.0, bounce)) / balls


def _nsm2(e: float) -> Law:
    return Law(f"nsm2, e = {e:g}", NSM2(k_normal(e), tolerance=_EXACT), _RIGID, e)


LAWS = (
    Law("dem", DEM(), _SOFT, 1.0),
    Law("hertz, undamped", Hertz(normal_damping=0.0, tangential_damping=0.0, social=None), _SOFT, 1.0),
    Law("hertz, damped", Hertz(normal_damping=0.1, damping_unit="critical", social=None), _SOFT, None),
    _nsm2(1.0),
    _nsm2(0.9),
    _nsm2(0.0),
    Law("nsm1", NSM1(trial="inertial", tolerance=_EXACT), _RIGID, 0.0),
)


def after(law: Law, balls: int, gap: float) -> tuple[Floats, Floats]:
    """Return positions along the row (n,) [m] and velocities (n,) [m/s] of the balls when all collisions are over."""
    position, velocity = np.zeros((balls, 2)), np.zeros((balls, 2))
    position[:, 0] = np.arange(balls) * (DIAMETER + gap)
    position[0, 0], velocity[0, 0] = gap - AWAY, SPEED
    room = Geometry.from_polygon(box(-10.0, -1.0, 10.0 + 2.0 * balls, 1.0))
    simulation = passive(room, np.full(balls, RADIUS), position, law.scheme, law.dt, velocity)
    simulation.advance(n_substeps=round(_AFTER * max(1.0, balls / 5) / law.dt))
    return simulation.state.position[:, 0].copy(), simulation.state.velocity[:, 0].copy()


def reproduce(settings: GranularSettings) -> Result:
    """Return the cradle under every law, with its balls touching and apart."""
    n = settings.balls
    found = {(law.name, how): after(law, n, gap) for law in LAWS for how, gap in GAPS.items()}
    sections = []
    for law in LAWS:
        of_law = []
        for how in GAPS:
            what, u, expected = f"{law.name}, {how}", found[law.name, how][1] / SPEED, law.last(n, how)
            kept = 1.0 if law.e == 1.0 else expected if law.e == 0.0 else None
            of_law += [
                Row(f"{what}: last ball", None, u[-1], "1", n, "velocity over v", expected=expected),
                Row(f"{what}: first", None, u[0], "1", n, "velocity over v"),
                Row(f"{what}: energy", None, float(u @ u), "1", n, "share kept", expected=kept),
            ]
        sections.append(of_law)
    lines = [(*key, k, x, u) for key, (xs, us) in found.items() for k, (x, u) in enumerate(zip(xs, us, strict=True))]
    table = RawTable(("law", "balls_are", "ball", "x_m", "u_m_s"), lines)
    remarks = [
        "The paper has no cradle: closed forms stand in its place. Energy of dem and undamped hertz is kept up to the step.",
        "A row in contact is no row of binary collisions: nsm2 throws the ball back, springs pass a wave on.",
    ]
    return Result(sections, {"balls": table}, lambda: draw(n, found), remarks, "1")


def draw(balls: int, found: Mapping[tuple[str, str], tuple[Floats, Floats]]) -> Figure:
    """Return a row of balls for every law, with their velocities."""
    figure = new_figure((10.4, 0.62 * len(LAWS) + 0.9))
    for axes, how in zip(figure.subplots(1, 2, sharey=True), GAPS, strict=True):
        for k, law in enumerate(LAWS):
            x, u = found[law.name, how]
            shown = np.stack([x, np.full(balls, -1.2 * k)], axis=1)
            draw_bodies(axes, shown, RADIUS, facecolor="#8ecbcd", edgecolor="#083442", linewidth=1.0)
            for (at, level), speed in zip(shown, u / SPEED, strict=True):
                axes.text(at, level + 0.36, f"{round(speed, 2) + 0.0:.2f}", ha="center", va="center", fontsize=6.5)
        name_panel(axes, f"balls {how}: {_AFTER:g} s later, velocity over v")
        ends = np.concatenate([found[law.name, how][0] for law in LAWS])
        axes.set(xlim=(ends.min() - 0.4, ends.max() + 0.4), ylim=(-1.2 * len(LAWS) + 0.6, 0.8), aspect="equal")
        axes.set_yticks([-1.2 * k for k in range(len(LAWS))], [law.name for law in LAWS], fontsize=9)
        axes.set_xticks([])
        axes.tick_params(length=0)
        for spine in axes.spines.values():
            spine.set_visible(False)
    return figure
