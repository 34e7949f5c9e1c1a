"""Figure 2: a particle against a rigid wall under the three schemes."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from crowd_env.physics import DEM, NSM1, NSM2, ContactScheme
from crowd_env.rendering.canvas import mark, name_panel, new_figure
from crowd_env.rendering.libraries import Figure
from crowd_env.reproduce.pecol2011.particle import MASS, MASS_READING, RADIUS, STEP, VELOCITY, Instant, instants
from crowd_env.reproduce.pecol2011.settings import PecolSettings
from crowd_env.reproduce.result import RawTable, Result, Row

_STEPS = 7
_DURATION = _STEPS * STEP
_DRAWN = 6  # instants of a trace that are drawn
# The paper's words: "the situation before contact is black, during the contact light-grey, after contact dark-grey".
_PHASES = {"before": "#000000", "during": "#b9b9b9", "after": "#5f5f5f"}
_INERTIAL = NSM1(trial="inertial", tolerance=1e-12, max_iterations=1_000_000)
_FINE = (1e-1, 1e-2, 1e-3)  # s


@dataclass(frozen=True)
class Case:
    """One panel, or a variant of it."""

    panel: str
    name: str
    scheme: ContactScheme
    x: tuple[float, ...]  # m     closed form at t = 0.1, 0.2 ... s
    u_x: float  # m/s   closed form after the contact
    printed: str  # by the paper
    title: str = ""  # of its panel


def elastic_stiffness(steps: int) -> float:
    """Return the k [N/m] of DEM with which this contact lasts ``steps`` time steps and is exactly elastic.

    The first overlap found is half a step of travel, and symplectic Euler turns it by the angle acos(1 - κ/2) a step,
    κ = h² k / m; so a contact of n steps is symmetric for κ = 2 (1 - cos(π/n)).
    """
    return 2.0 * (1.0 - np.cos(np.pi / steps)) * MASS / STEP**2


def _dem(steps: int, kappa: str) -> Case:
    # Overlap 0.1 sin((2j + 1) π/2n) / sin(π/2n) at the j-th step of the contact; then away at 0.2 m a step from -0.1.
    angle = np.pi / (2 * steps)
    inside = tuple(RADIUS - 0.1 * float(np.sin((2 * j + 1) * angle) / np.sin(angle)) for j in range(steps))
    after = tuple(RADIUS + 0.1 + 0.2 * j for j in range(_STEPS - 1 - steps))
    k = elastic_stiffness(steps)
    title = f"DEM, $k = {kappa}\\,m/h^2$ = {k:.0f} N/m"
    return Case("a", f"DEM, k = {kappa}m/h²", DEM(k), (0.4, *inside, *after), 2.0, "2", title)


def _nsm2(panel: str, label: str, k_normal: float, tex: str = "") -> Case:
    e = 1.0 if k_normal == np.inf else max(0.0, (k_normal - 2 * MASS) / (k_normal + 2 * MASS))
    u = 2.0 * e
    # The step in which the velocity turns moves by the mean of both.
    turned = 0.2 + 0.5 * STEP * (-2.0 + u)
    x = (0.4, 0.2, *(turned + STEP * u * j for j in range(_STEPS - 2)))
    scheme, printed = NSM2(k_normal, tolerance=1e-13, reaction="printed"), "2" if panel == "c" else "0"
    return Case(panel, f"NSM2, K_N {label}", scheme, x, u, printed, f"NSM2, $K_N {tex}$")


# The first of a panel is the one that is drawn.
CASES = (
    _dem(1, "4"),
    _dem(2, "2"),
    _dem(3, "1"),
    _dem(4, "(2 - √2)"),
    Case("b", "NSM1", _INERTIAL, (0.4, *[RADIUS] * (_STEPS - 1)), 0.0, "0", "NSM1"),
    _nsm2("c", "→ ∞", np.inf, r"\to \infty"),
    _nsm2("c", "= 1e5 kg", 1e5),
    _nsm2("c", "= 1e4 kg", 1e4),
    _nsm2("d", "= 2m", 2 * MASS, "= 2m"),
)


def reproduce(settings: PecolSettings) -> Result:
    """Return the four panels."""
    traces, rows = [], []
    for case in CASES:
        traces.append(instants(case.scheme, STEP, _DURATION))
        rows += _rows(case, traces[-1])
    along = max((at.u_y for trace in traces for at in trace), key=lambda u: abs(u - VELOCITY[1]))
    rows.append(Row("a-d: u_y, every case and step", "-1", along, "m/s", len(CASES) * _STEPS, "frictionless"))
    rows += _finer()
    remarks = [
        f"{MASS_READING}. h = {STEP:g} s. The paper prints velocities only: positions are compared with closed forms. It "
        "gives no k for panel a and no K_N for panels c and d: these are ours.",
        "Panel c needs the approach gate (a contact dissipates only while it approaches): under the strict reading of eq 9 "
        "the particle would stop, against the printed velocity.",
    ]
    table = RawTable(
        ("panel", "case", "time_s", "x_m", "y_m", "u_x", "u_y", "phase"),
        [
            (case.panel, case.name, *(f"{value:.12g}" for value in at), phase)
            for case, trace in zip(CASES, traces, strict=True)
            for at, phase in zip(trace, phases(trace), strict=True)
        ],
    )
    return Result([rows], {"trajectories": table}, lambda: draw(traces), remarks)


def phases(trace: Sequence[Instant]) -> list[str]:
    """Return "before", "during" or "after" for every instant: during contact it touches and its velocity is not final."""
    final, touched, found = trace[-1].u_x, False, []
    for at in trace:
        touched = touched or at.x <= RADIUS + 1e-9
        turned = touched and abs(at.u_x - final) < 1e-9
        found.append("after" if turned else "during" if touched else "before")
    return found


def avoided(trace: Sequence[Instant]) -> tuple[float, float]:
    """Return where the particle would have gone in the step in which the wall first slowed it (panel b)."""
    at = next(a for a, b in pairwise(trace) if b.u_x != a.u_x)
    return at.x + STEP * at.u_x, at.y + STEP * at.u_y


def _rows(case: Case, trace: Sequence[Instant]) -> list[Row]:
    name = f"{case.panel}: {case.name}"
    end = trace[4 if case.panel == "b" else -1]
    largest = max(abs(at.x - x) for at, x in zip(trace[1:], case.x, strict=True))
    reading = f"t = {end.time:g} s" + ("" if case.panel == "b" else ", after the contact")
    rows = [Row(f"{name}: u_x", case.printed, end.u_x, "m/s", 1, reading, expected=case.u_x)]
    reading = f"t = 0.3 s; all steps to {largest:.0e} m"
    rows.append(Row(f"{name}: x", None, trace[3].x, "m", _STEPS, reading, expected=case.x[2]))
    if case.panel == "b":
        rows.append(Row(f"{name}: u_x, first touch", None, trace[2].u_x, "m/s", 1, "t = 0.2 s", expected=-1.0))
        reading = "the circle with markers, t = 0.2 s"
        rows.append(Row(f"{name}: x avoided", None, avoided(trace)[0], "m", 1, reading, expected=0.2))
    return rows


def _finer() -> list[Row]:
    """Return what becomes of the position errors of panels c and d with the step: two claims of the paper."""
    exact = RADIUS + 2.0 * (_DURATION - 0.15)  # rebound at t = 0.15 s
    elastic, inelastic = (next(case for case in CASES if case.panel == panel) for panel in "cd")
    late, overlap = [], []
    for h in _FINE:
        behind = exact - instants(elastic.scheme, h, _DURATION)[-1].x
        late.append(Row(f"c: x behind exact, h = {h:g} s", None, behind, "m", 1, "the paper: smaller with h"))
        deep = RADIUS - instants(inelastic.scheme, h, _DURATION)[-1].x
        reading = "the paper: with smaller h the place of NSM1"
        overlap.append(Row(f"d: overlap that stays, h = {h:g} s", None, deep, "m", 1, reading))
    return late + overlap


def draw(traces: Sequence[Sequence[Instant]]) -> Figure:
    """Return the disc that runs into the wall x = 0, in four panels; ``traces`` belong to `CASES`."""
    from matplotlib.patches import Circle

    figure = new_figure((9.6, 8.4))
    grid = figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, panel in zip(grid.flat, "abcd", strict=True):
        trace = next(trace for case, trace in zip(CASES, traces, strict=True) if case.panel == panel)
        title = next(case.title for case in CASES if case.panel == panel)
        axes.axvline(0.0, color="black", lw=2.2, zorder=1)
        axes.axvspan(-0.28, 0.0, facecolor="none", edgecolor="#d8d6d0", hatch="///", linewidth=0.0, zorder=0)
        if panel == "b":
            axes.add_patch(Circle(avoided(trace), RADIUS, fill=False, ec=_PHASES["during"], ls=":", lw=1.5))
        for k, (at, phase) in enumerate(zip(trace[:_DRAWN], phases(trace), strict=False)):
            color = _PHASES[phase]
            axes.add_patch(Circle((at.x, at.y), RADIUS, fill=False, ec=color, lw=1.6, zorder=3 + 0.01 * k))
            axes.plot(at.x, at.y, "o", color=color, markersize=4.5, zorder=5)
            if k in (0, _DRAWN - 1):
                axes.text(at.x + 0.05, at.y, f"$t$ = {0.1 * k:.1g} s", fontsize=8.5, color=color, zorder=7)
        name_panel(axes, f"{panel}. {title}")
        axes.set(aspect="equal", xlim=(-0.28, 1.2), ylim=(-0.88, 0.36))
        axes.set_xlabel("$x$ [m]", fontsize=10)
        axes.set_ylabel("$y$ [m]", fontsize=10)
        axes.label_outer()
    marks = [mark(f"{phase} contact", color=color, lw=2) for phase, color in _PHASES.items()]
    marks.append(mark("avoided position (b)", color=_PHASES["during"], ls=":"))
    figure.legend(handles=marks, loc="outside lower center", ncols=4, frameon=False, fontsize=10)
    return figure
