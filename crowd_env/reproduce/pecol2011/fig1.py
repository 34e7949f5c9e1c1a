"""Figure 1: two identical pedestrians run into each other, for several relaxation times."""

from collections.abc import Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats, make_bodies, make_state
from crowd_env.geometry.geometry import Geometry, box
from crowd_env.physics import DEM, NSM2, ContactScheme
from crowd_env.physics.settings import Physics
from crowd_env.physics.simulation.simulation import Simulation
from crowd_env.rendering.canvas import hex_of, new_figure, quiet_axes, series, shade
from crowd_env.rendering.libraries import Axes, Figure
from crowd_env.rendering.palette import INK
from crowd_env.reproduce.pecol2011.settings import PecolSettings
from crowd_env.reproduce.result import RawTable, Result, Row

# The paper gives none of these; tau spans Table 4 and Helbing's 0.5 s, the speed is the mean that section 3 quotes.
TAUS = (0.1, 0.2, 0.3, 0.4, 0.5)  # s
SPEED, RADIUS, MASS = 1.34, 0.25, 80.0  # m/s, m, kg
OFFSET = 0.2  # m between the two lines they walk on
_ELASTIC = NSM2(normal_dissipation=np.inf, tolerance=1e-9, reaction="printed")
_SOFT = DEM(1.2e5)
_STEP = 1e-4  # s
_DRAWN_STEP = 1e-3  # s
_APART = 0.3  # m between the bodies at the start


class Meeting(NamedTuple):
    """Both pedestrians at every step, and what contacts there were."""

    time: Floats  # (T,) s
    position: Floats  # (T, 2, 2) m
    velocity: Floats  # (T, 2, 2) m/s
    touching: np.ndarray  # (T,) bool, in the step that ends there

    @property
    def contacts(self) -> int:
        """How often they touched."""
        return int((np.diff(self.touching.astype(int)) == 1).sum())


def recoil_distance(speed: float, desired: float, tau: float) -> float:
    """Return how far back [m] a pedestrian goes that is thrown back at ``speed`` and has the ``desired`` speed.

    From eq 11: u(t) = v_d - (v_d + v) exp(-t/tau), at rest after tau ln(1 + v/v_d).
    """
    return tau * (speed - desired * float(np.log(1.0 + speed / desired)))


def meet(scheme: ContactScheme, tau: float, *, offset: float, dt: float, duration: float) -> Meeting:
    """Let two identical pedestrians walk towards each other on lines ``offset`` apart."""
    half = RADIUS + 0.5 * _APART
    start = np.array([[-half, -0.5 * offset], [half, 0.5 * offset]])
    bodies = make_bodies(np.full(2, RADIUS), np.full(2, MASS), desired_speed=SPEED, relaxation_time=tau)
    state = make_state(start, np.array([[SPEED, 0.0], [-SPEED, 0.0]]))
    ground = Geometry.from_polygon(box(-100.0, -100.0, 100.0, 100.0))
    simulation = Simulation(ground, bodies, state, physics=Physics(scheme, dt=dt))
    ahead, relative = np.array([[1.0, 0.0], [-1.0, 0.0]]), np.zeros(2, dtype=bool)
    moments = [(state.position.copy(), state.velocity.copy(), False)]
    for _ in range(round(duration / dt)):
        simulation.advance(ahead, relative=relative)
        touching = bool(simulation.results.impulse_magnitude[0] > 0.0)
        moments.append((state.position.copy(), state.velocity.copy(), touching))
    return Meeting(dt * np.arange(len(moments), dtype=np.float64), *map(np.array, zip(*moments, strict=True)))


def recoil(meeting: Meeting) -> tuple[float, float]:
    """Return how far back [m] the first pedestrian goes, from the last touch on, and the speed [m/s] it starts back with."""
    last = int(np.argmax(np.diff(meeting.touching.astype(int)) == -1))  # the step that ends the first contact
    x = meeting.position[last:, 0, 0]
    turn = int(np.argmax(meeting.velocity[last:, 0, 0] > 0.0))
    return float(x[0] - x[turn]), -float(meeting.velocity[last, 0, 0])


def reproduce(settings: PecolSettings) -> Result:
    """Return Figure 1."""
    head_on = [_head_on(tau) for tau in TAUS]
    drawn = [meet(_ELASTIC, tau, offset=OFFSET, dt=_DRAWN_STEP, duration=2.0 + 4.0 * tau) for tau in TAUS]
    sideways = [_sideways(tau, meeting) for tau, meeting in zip(TAUS, drawn, strict=True)]
    rows, measured = [*chain(*head_on, *sideways)], [[row.here for row in both] for both in head_on]
    remarks = [
        f"nsm2-printed with K_N → ∞ and dem with k = 1.2e5 N/m. Recoil: exactly head-on, h = {_STEP:g} s, from where the "
        f"bodies part; shift: as drawn, after one contact, h = {_DRAWN_STEP:g} s.",
        "The paper prints no number for this figure: rows are compared with the closed form of eq 11 for the speed at which "
        "the contact ends.",
        f"Radius {RADIUS:g} m, mass {MASS:g} kg, desired speed {SPEED:g} m/s and a lateral offset of {OFFSET:g} m are ours.",
    ]
    table = RawTable(
        ("tau_s", "pedestrian", "time_s", "x_m", "y_m", "u_x", "u_y"),
        [
            (tau, "ij"[who], f"{at.time[k]:.3f}", *(f"{v:.6f}" for v in (*at.position[k, who], *at.velocity[k, who])))
            for tau, at in zip(TAUS, drawn, strict=True)
            for who in (0, 1)
            for k in range(0, len(at.time), 10)
        ],
    )
    return Result([rows], {"trajectories": table}, lambda: draw(drawn, measured), remarks, unit="m")


def _head_on(tau: float) -> list[Row]:
    rows = []
    for name, scheme in (("nsm2-printed", _ELASTIC), ("dem", _SOFT)):
        meeting = meet(scheme, tau, offset=0.0, dt=_STEP, duration=0.25 + 0.9 * tau)
        distance, speed = recoil(meeting)
        reading = f"thrown back at {speed:.3f} m/s"
        expected = recoil_distance(speed, SPEED, tau)
        rows.append(Row(f"recoil, tau = {tau:g} s, {name}", None, distance, "m", 1, reading, expected=expected))
    return rows


def _sideways(tau: float, meeting: Meeting) -> list[Row]:
    """Return how far one contact has shifted the first pedestrian to the side in the end; none if they touch again."""
    if meeting.contacts != 1:
        return []
    sine = OFFSET / (2 * RADIUS)
    expected = 2.0 * tau * SPEED * sine * float(np.sqrt(1.0 - sine**2))
    # What is still to come when the record ends is tau times the speed that is left.
    shift = abs(meeting.position[-1, 0, 1] - meeting.position[0, 0, 1]) + tau * abs(meeting.velocity[-1, 0, 1])
    reading = f"nsm2-printed, offset {OFFSET:g} m"
    return [Row(f"shift to the side, tau = {tau:g} s", None, float(shift), "m", 1, reading, expected=expected)]


def draw(meetings: Sequence[Meeting], recoils: Sequence[Sequence[float | None]]) -> Figure:
    """Return a drawing of the meetings, one a tau, beside their recoils [m], each under both schemes."""
    taus = np.linspace(0.0, 1.15 * TAUS[-1], 50)
    figure = new_figure((10.4, 4.4))
    left, right = figure.subplots(1, 2, width_ratios=[1.75, 1.0])
    touch = int(np.argmax(meetings[0].touching)) - 1  # until then they walk at their desired speed, for every tau
    _draw_ways(left, [meeting.position[touch:] for meeting in meetings])
    quiet_axes(right, r"relaxation time $\tau$ [s]", "recoil, exactly head-on [m]", grid=True)
    closed = [recoil_distance(SPEED, SPEED, tau) for tau in taus]
    right.plot(taus, closed, color=hex_of(INK), lw=1.3, label=r"$\tau v_d\,(1-\ln 2)$, from eq. 11")
    labels = ("NSM2, $K_N \\to \\infty$", "DEM, $k = 1.2\\times10^5$ N/m")
    for k, (label, values) in enumerate(zip(labels, np.array(recoils, dtype=np.float64).T, strict=True)):
        right.plot(TAUS, values, "os"[k], color=series(k), markersize=6.5, label=label)
    right.set(xlim=(0.0, taus[-1]), ylim=(0.0, None))
    right.legend(frameon=False, fontsize=9.5, loc="upper left")
    return figure


def _draw_ways(axes: Axes, trajectories: Sequence[Floats]) -> None:
    """Draw for each tau the positions (T, 2, 2) [m] of both from their first touch on, which is the same for all."""
    from matplotlib.patches import Circle

    for name, side, (x, y) in zip("ij", (-1.0, 1.0), trajectories[0][0], strict=True):
        axes.add_patch(Circle((x, y), RADIUS, fc="#f3f1ec", ec="#9b9890", lw=1.1, zorder=1))
        axes.plot([1.2 * side, x], [y, y], "ko-", lw=1.3, ms=4.5, markevery=[1], zorder=4)
        axes.text(1.27 * side, y, f"${name}$", ha="center", va="center", fontsize=13)
    for k, (tau, positions) in enumerate(zip(TAUS, trajectories, strict=True)):
        for who in (0, 1):
            label = None if who else rf"$\tau$ = {tau:g} s"
            axes.plot(*positions[:, who].T, color=shade(k / (len(TAUS) - 1)), lw=1.7, zorder=3, label=label)
    axes.set(aspect="equal", xlim=(-1.35, 1.35), ylim=(-0.86, 0.86))
    axes.set_xlabel("$x$ [m]", fontsize=10)
    axes.set_ylabel("$y$ [m]", fontsize=10)
    axes.legend(frameon=False, fontsize=9.5, loc="lower left", handlelength=1.6)
