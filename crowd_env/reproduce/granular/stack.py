"""A stack of discs at rest in a shaft: weights add up from disc to disc, walls take the rest, and nothing drifts.

Discs of diameter d in a shaft of width w lean left and right in turn; neighbors are joined by lines that stand at an angle
theta off the vertical, sin(theta) = (w - d) / d.  Below m discs without friction a contact carries N_m = m W / cos(theta), and
the wall beside a disc takes the sum of the thrusts N sin(theta) of its two neighbors.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.geometry.geometry import Geometry, box
from crowd_env.physics import DEM, NSM1, NSM2, ContactScheme
from crowd_env.rendering.canvas import draw_bodies, draw_geometry, name_panel, new_figure, quiet_axes, series
from crowd_env.rendering.libraries import Figure
from crowd_env.reproduce.granular.grains import DIAMETER, MASS, RADIUS, passive, sand, weight
from crowd_env.reproduce.granular.settings import GranularSettings
from crowd_env.reproduce.result import RawTable, Result, Row

_STIFF = 1.2e7  # N/m, a hundred times that of people: under them ten discs sag by a radius
SHAFTS = {"straight": 1.0, "leaning": 1.5}  # width over diameter
SCHEMES: dict[str, tuple[ContactScheme, float]] = {  # and the time step [s]
    "dem": (DEM(_STIFF), 1e-3),
    "hertz": (sand(0.0), 1e-3),
    "nsm1": (NSM1(trial="inertial", tolerance=1e-10), 5e-3),
    "nsm2": (NSM2(MASS, tolerance=1e-10), 5e-3),
}
_DURATION = 8.0  # s; forces are means over the second half


class Stack(NamedTuple):
    """What became of a stack."""

    position: Floats  # (n, 2) m     at the end
    vertical: Floats  # (n,)   N     mean vertical force between a disc and what is below it
    wall: Floats  # (n,)   N     mean force of the wall beside a disc
    drift: float  # m     largest distance of a disc from where it began
    speed: float  # m/s   largest at the end
    energy: float | None  # of dem: largest change of all energy, that of springs too, over the first energy of height


def shaft(n: int, width: float) -> tuple[Geometry, Floats]:
    """Return a shaft [m] and the places (n, 2) of discs in it that just touch."""
    lean = 0.5 * (width - DIAMETER)
    rise = np.sqrt(DIAMETER**2 - (2.0 * lean) ** 2)
    place = Geometry.from_polygon(box(-0.5 * width, 0.0, 0.5 * width, (n + 2) * DIAMETER))
    sides = np.where(np.arange(n) % 2, lean, -lean)
    return place, np.stack([sides, RADIUS + rise * np.arange(n)], axis=1)


def closed_form(n: int, width: float, gravity: float) -> tuple[Floats, Floats]:
    """Return the vertical force (n,) under each disc and that of the wall beside it (n,) [N]."""
    sine = (width - DIAMETER) / DIAMETER
    above = MASS * gravity * np.arange(n, 0, -1.0)
    thrust = above * sine / np.sqrt(1.0 - sine**2)
    thrust[0] = 0.0  # the floor
    return above, thrust + np.append(thrust[1:], 0.0)


def rest(scheme: ContactScheme, dt: float, n: int, width: float, gravity: float, duration: float = _DURATION) -> Stack:
    """Return what becomes of a stack in ``duration`` [s]."""
    place, start = shaft(n, width)
    simulation = passive(place, np.full(n, RADIUS), start, scheme, dt)
    pull, state = weight(simulation.bodies, gravity), simulation.state
    vertical, wall, drift, energy = np.zeros(n), np.zeros(n), 0.0, []
    steps = round(duration / dt)
    late = steps - steps // 2
    for k in range(steps):
        motion = MASS * (gravity * state.position[:, 1].sum() + 0.5 * (state.velocity**2).sum())
        simulation.advance(external_force=pull)
        touching = simulation.contacts()  # of the start of the step, as the motion (hertz: of its end)
        if isinstance(scheme, DEM):
            energy.append(motion + 0.5 * scheme.stiffness * (touching.gap**2).sum())
        drift = max(drift, float(np.hypot(*(state.position - start).T).max()))
        if k < late:
            continue
        force = np.abs(touching.impulse[:, :1] / dt * touching.normal)
        beside = (touching.j < 0) & (np.abs(touching.normal[:, 0]) > 0.5)
        upper = np.maximum(touching.i, touching.j)[~beside]
        vertical += np.bincount(upper, force[~beside, 1], n)
        wall += np.bincount(touching.i[beside], force[beside, 0], n)
    speed = float(np.hypot(*state.velocity.T).max())
    change = float(np.ptp(energy)) / energy[0] if energy else None
    return Stack(state.position.copy(), vertical / (steps - late), wall / (steps - late), drift, speed, change)


def reproduce(settings: GranularSettings) -> Result:
    """Return the stack under every scheme in both shafts."""
    n, found, sections = 2 * settings.balls, {}, []
    for name, (scheme, dt) in SCHEMES.items():
        of_scheme = []
        for how, width in SHAFTS.items():
            stack = found[name, how] = rest(scheme, dt, n, width * DIAMETER, settings.gravity)
            above, beside = closed_form(n, width * DIAMETER, settings.gravity)
            what, steps = f"{name}, {how}", round(_DURATION / dt)
            weights, worst = stack.vertical[0] / above[-1], float(np.abs(stack.vertical / above - 1.0).max())
            off = float(np.abs(stack.wall - beside).max() / beside.max()) if beside.any() else None
            every = [
                Row(f"{what}: floor", None, weights, "1", steps, "force over one weight", expected=float(n)),
                Row(f"{what}: worst force between discs", None, worst, "1", steps, "off the weight above, share"),
                Row(f"{what}: worst force of a wall", None, off, "1", steps, "off that of rigid discs, share"),
                Row(f"{what}: displacement [mm]", None, 1e3 * stack.drift, "1", steps, "largest, of any disc"),
                Row(f"{what}: speed at the end", None, stack.speed, "m/s", 1, f"after {_DURATION:g} s"),
                Row(f"{what}: energy", None, stack.energy, "1", steps, "largest change, share"),
            ]
            of_scheme += [row for row in every if row.here is not None]
        sections.append(of_scheme)
    lines = [
        (*key, k, *stack.position[k], stack.vertical[k], stack.wall[k])
        for key, stack in found.items()
        for k in range(n)
    ]
    header = ("scheme", "shaft", "disc", "x_m", "y_m", "vertical_N", "wall_N")
    remarks = [
        "Discs start just touching, at rest. dem has no damping: it bounces in its springs for ever, and means over time are "
        "compared. hertz sags by its overlaps; in the leaning shaft it then leans more than rigid discs do, walls bear more, "
        "and it still rocks. nsm1 and nsm2 are rigid; under nsm2 discs fall for one step before they bear each other.",
    ]
    raw = {"discs": RawTable(header, lines)}
    return Result(sections, raw, lambda: draw(n, settings, found), remarks)


def draw(n: int, settings: GranularSettings, found: Mapping[tuple[str, str], Stack]) -> Figure:
    """Return the leaning stack at its end, and the forces of both beside the closed forms."""
    figure = new_figure((9.6, 4.8))
    picture, *curves = figure.subplots(1, 3, width_ratios=(0.4, 1.0, 1.0))
    place, _ = shaft(n, SHAFTS["leaning"] * DIAMETER)
    draw_geometry(picture, place, wall=2.0, exit=2.0, margin=0.02)
    stack = found["nsm2", "leaning"]
    draw_bodies(picture, stack.position, RADIUS, facecolor="#8ecbcd", edgecolor="#083442", linewidth=0.8, zorder=3)
    name_panel(picture, "leaning, nsm2")
    panels = (("vertical", "weights between discs"), ("wall", "forces of walls, leaning"))
    for axes, (what, title) in zip(curves, panels, strict=True):
        unit = MASS * settings.gravity
        exact = closed_form(n, SHAFTS["leaning"] * DIAMETER, settings.gravity)[what == "wall"] / unit
        quiet_axes(axes, "force over one weight", "disc, from below", title=title, grid=True)
        axes.plot(exact, np.arange(1, n + 1), "k-", lw=1.0, label="closed form")
        for k, name in enumerate(SCHEMES):
            force = getattr(found[name, "leaning"], what) / unit
            axes.plot(
                force, np.arange(1, n + 1), "o+x^"[k], color=series(k), markersize=6, fillstyle="none", label=name
            )
    curves[0].legend(frameon=False, fontsize=9)
    return figure
