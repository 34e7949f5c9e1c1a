"""Which of the two starts the sway: steps that fall into time, or bodies that keep their balance."""

from collections.abc import Mapping

import numpy as np

from crowd_env.envs.footbridge.deck import Deck
from crowd_env.envs.footbridge.pendulum import Pendulum
from crowd_env.envs.footbridge.synchrony import Synchrony
from crowd_env.envs.footbridge.walkers import DECK
from crowd_env.rendering.canvas import hex_of, new_figure, quiet_axes, series
from crowd_env.rendering.libraries import Figure
from crowd_env.rendering.palette import QUIET
from crowd_env.reproduce.footbridge.onset import LARGE, THRESHOLD
from crowd_env.reproduce.footbridge.runs import Trace, step_up
from crowd_env.reproduce.footbridge.settings import FootbridgeSettings
from crowd_env.reproduce.result import RawTable, Result, Row

_OTHER_DAMPING = 0.04 * DECK.frequency * DECK.mass  # kg/s, of the program of Belykh et al.
_NUMBERS = {"synchrony": range(50, 251, 20), "pendulum": range(10, 151, 10)}
_COUPLINGS: dict[str, Synchrony | Pendulum] = {"synchrony": Synchrony(), "pendulum": Pendulum()}


def reproduce(settings: FootbridgeSettings) -> Result:
    """Return the figure; each number of walkers stays for an eighth of the duration."""
    hold, pendulum = settings.duration / 8.0, Pendulum()
    critical = {"synchrony": THRESHOLD, "pendulum": pendulum.critical_number(DECK)}
    traces = {name: step_up(_COUPLINGS[name], _NUMBERS[name], hold, settings.seed) for name in _COUPLINGS}
    sigma = pendulum.damping_per_walker(DECK.frequency)
    other = pendulum.critical_number(Deck(damping=_OTHER_DAMPING))
    rows = [
        Row("damping by one walker, pendulum", None, sigma, "kg/s", 1, "closed form, stride of 0.9 Hz"),
        Row("critical number, pendulum", None, critical["pendulum"], "people", 1, "B / -sigma, at mid-span"),
        Row("the same, B of their program", None, other, "people", 1, "B = 0.04 omega_0 M, three times that of 2005"),
        Row("critical number, synchrony", None, THRESHOLD, "people", 1, "threshold of 2005, at mid-span"),
    ]
    for name, trace in traces.items():
        k = first_large(trace)
        here = None if k is None else float(trace.people[k])
        order = None if k is None else float(trace.order[k] * np.sqrt(trace.people[k]))
        reading = f"walkers are added every {hold:g} s; the motion passes {1000 * LARGE:g} mm"
        rows.append(Row(f"walkers when it sways, {name}", None, here, "people", 1, reading))
        rows.append(Row(f"R sqrt(N) then, {name}", None, order, "1", 1, "about 1: no more in step than by chance"))
    remarks = [
        "synchrony: the motion grows with the share of steps in time, and stays without it. pendulum: the motion grows while "
        "steps keep the times they began with; nobody can fall into step, and nothing in the equations ends the growth.",
        "Equations and numbers of the pendulum: Model 1 of Belykh et al. 2021, checked against the program that goes with it. "
        "Their formula for sigma could not be opened (unchecked); the closed form here is our own.",
        "Both walk at mid-span, on the spot, without contact.",
    ]
    table = RawTable(
        ("coupling", "time_s", "people", "amplitude_m", "order"),
        [
            (name, f"{t:g}", int(n), f"{a:.6f}", f"{r:.4f}")
            for name, trace in traces.items()
            for t, n, a, r in zip(trace.time, trace.people, trace.amplitude, trace.order, strict=True)
        ],
    )
    return Result([rows], {"traces": table}, lambda: draw(traces, critical), remarks)


def first_large(trace: Trace) -> int | None:
    """Return the moment from which on the motion is larger than `LARGE`; None if it is not in the end."""
    over = trace.amplitude >= LARGE
    if not over[-1]:
        return None
    return 0 if over.all() else int(np.flatnonzero(~over)[-1]) + 1


def draw(traces: Mapping[str, Trace], critical: Mapping[str, float]) -> Figure:
    """Return a drawing: a column a coupling; amplitude, number of walkers, and R sqrt(N), over time."""
    figure = new_figure((9.0, 5.6))
    panels = figure.subplots(3, len(traces), sharex="col", height_ratios=[2, 1, 1.4])
    for k, (name, trace) in enumerate(traces.items()):
        above, middle, below = panels[:, k]
        quiet_axes(above, "", "amplitude [mm]", title=name, grid=True)
        above.semilogy(trace.time, 1000.0 * np.maximum(trace.amplitude, 1e-5), color=series(k), lw=1.4)
        quiet_axes(middle, "", "walkers")
        middle.plot(trace.time, trace.people, color=hex_of(QUIET), lw=1.2)
        middle.axhline(critical[name], color=series(k), lw=1.0, ls="--", label=f"critical: {critical[name]:.0f}")
        middle.legend(frameon=False, fontsize=9)
        quiet_axes(below, "time [s]", r"$R\sqrt{N}$ of steps", grid=True)
        below.plot(trace.time, trace.order * np.sqrt(trace.people), color=series(k), lw=1.2)
        below.axhline(1.0, color=hex_of(QUIET), lw=0.8)
        late = first_large(trace)
        for axes in (above, middle, below) if late is not None else ():
            axes.axvline(trace.time[late], color=hex_of(QUIET), lw=0.8, ls=":")
    return figure
