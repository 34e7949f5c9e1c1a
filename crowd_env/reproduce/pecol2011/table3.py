"""Table 3: the velocity of a particle after a contact with DEM, as a function of the time step."""

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.physics import DEM
from crowd_env.rendering.canvas import hex_of, new_figure, quiet_axes, series
from crowd_env.rendering.libraries import Figure
from crowd_env.rendering.palette import QUIET
from crowd_env.reproduce.pecol2011.particle import MASS, MASS_READING, VELOCITY, particle
from crowd_env.reproduce.pecol2011.settings import PecolSettings
from crowd_env.reproduce.result import RawTable, Result, Row

STIFFNESS = 1.2e5  # N/m
# As printed, x component; the y component is printed as -1 throughout.
PRINTED = {
    1e-1: "12.14710605261293",
    1e-2: "2.03066571837719",
    1e-3: "2.00035320567159",
    1e-4: "2.00000264342070",
    1e-5: "2.0000003535854",
}
MENDED = "2.00000003535854"  # the last one with a zero put back
_STABLE = 2.0 / float(np.sqrt(STIFFNESS / MASS))  # s
_AFTER = 0.4  # s, the contact is over
_SWEEP = np.geomspace(4e-5, 3e-2, 160)  # steps between the printed ones, for the figure


def reproduce(settings: PecolSettings) -> Result:
    """Return Table 3."""
    after = np.array([_after_contact(h) for h in PRINTED])
    sweep = np.array([_after_contact(float(h))[0] for h in _SWEEP])
    h = np.array(list(PRINTED))
    error = np.abs(after[:, 0] - 2.0)
    stable = h <= _STABLE
    order, start = np.polyfit(np.log10(h[stable]), np.log10(error[stable]), 1)
    printed = list(enumerate(PRINTED.items()))
    rows = [Row(f"u_x, h = {step:g} s", text, after[k, 0], "m/s", 1, _reading(k)) for k, (step, text) in printed]
    rows.append(Row("u_x, h = 1e-05 s, mended", MENDED, after[-1, 0], "m/s", 1, "a zero put back after the point"))
    rows.append(Row("u_y, every h", "-1", float(after[:, 1].mean()), "m/s", len(h), "frictionless: exactly kept"))
    reading = "least squares in logarithms, h ≤ 0.01"
    rows.append(Row("order of |u_x - 2| in h", None, float(order), "1", int(stable.sum()), reading))
    remarks = [
        f"{MASS_READING}. k = 1.2e5 N/m; the velocity is read at t = {_AFTER:g} s.",
        "At h = 0.1 s, above the stable step, the last of 16 digits is the paper's rounding: exactly, -2 + 0.1 k h/m is "
        "12.147106052612919.",
        "At h = 1e-05 s the printed text has 13 decimals where the other rows have 14; the row mended puts a zero back.",
    ]
    raw = [(step, *map(repr, map(float, after[k])), float(error[k]), text) for k, (step, text) in printed]
    for step, u in zip(_SWEEP.tolist(), sweep.tolist(), strict=True):
        raw.append((step, repr(u), VELOCITY[1], abs(u - 2.0), ""))
    table = RawTable(("h_s", "u_x", "u_y", "error", "printed"), raw)

    def draw() -> Figure:
        figure = new_figure((6.4, 4.2))
        axes = quiet_axes(figure.add_subplot(), "time step $h$ [s]", r"$|u_x - 2|$ after the contact [m/s]", grid=True)
        theirs = np.array([abs(float(text) - 2.0) for text in PRINTED.values()])
        line = np.array([h.min(), _STABLE])
        axes.loglog(_SWEEP, np.abs(sweep - 2.0), ".", color="#bcbab5", markersize=4, label=f"{len(_SWEEP)} other steps")
        axes.loglog(line, 10 ** (start + order * np.log10(line)), color=series(0), label=f"slope {order:.2f}")
        axes.loglog(h, error, "o", color=series(0), label="here")
        axes.loglog(h, theirs, "kx", markersize=11, label="paper, as printed")
        axes.loglog(h[-1], float(MENDED) - 2.0, "k+", markersize=12, label="paper, a zero put back")
        axes.axvline(_STABLE, color=hex_of(QUIET), dashes=(4, 3), label=rf"stable up to $2/\omega$ = {_STABLE:.3f} s")
        axes.legend(frameon=False, fontsize=9.5, loc="upper left")
        return figure

    return Result([rows], {"velocities": table}, draw, remarks, unit="m/s")


def _after_contact(h: float) -> Floats:
    simulation = particle(DEM(STIFFNESS), h)
    simulation.advance(n_substeps=int(np.ceil(_AFTER / h - 1e-6)))
    return simulation.state.velocity[0].copy()


def _reading(k: int) -> str:
    if k == 0:
        return "above the stable step; last digit: rounding"
    return "as printed, one decimal short" if k == len(PRINTED) - 1 else "k = 1.2e5 N/m"
