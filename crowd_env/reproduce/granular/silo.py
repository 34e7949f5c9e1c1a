"""A silo that empties: the flow against the width of its outlet, beside Beverloo's law in two dimensions.

    W = C rho sqrt(g) (D - k d)^(3/2)        D: width of the outlet, d: diameter of a grain

Beverloo, Leniger, van de Velde 1961 have 5/2 for a round hole in space.  In units of sqrt(g / d) the flow of grains is
q = C (D / d - k)^n.  After Mankoc et al. 2007 (arXiv 0707.4550) it does not depend on the height where the silo is higher than
1.2 widths and wider than 2.5 outlets (and D + 30 d, which is not met here).
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats, slots_of
from crowd_env.envs.metrics import t_quantile
from crowd_env.physics import ContactScheme
from crowd_env.physics.simulation.simulation import Simulation
from crowd_env.rendering.canvas import draw_bodies, draw_lines, name_panel, new_figure, quiet_axes, series
from crowd_env.rendering.libraries import Axes, Figure
from crowd_env.rendering.palette import SERIES, WALL
from crowd_env.reproduce.granular.grains import (
    DIAMETER,
    GATE,
    INELASTIC,
    RIGID,
    fill,
    passive,
    sand,
    silo,
    weight,
)
from crowd_env.reproduce.granular.settings import GranularSettings
from crowd_env.reproduce.result import RawTable, Result, Row

WIDTHS = (3.0, 4.0, 5.0, 6.0, 8.0)  # D / d
_SILO = 20.0  # its width over d
_SETTLE, JAMMED = 3.0, 5.0  # s; 25 times sqrt(d / g) without a grain: it is jammed
_LONGEST = 60.0  # s
_SKIP, _COUNT = 0.05, 0.3  # shares of the grains: the flow is that of the exits between
_LARGEST_STEP = 5e-3  # s, of the rigid schemes


class Discharge(NamedTuple):
    """What came out of some fillings of one silo."""

    exit_time: Floats  # (draws, K) s     since the gate was opened, ascending; nan for grains that stay
    jammed: list[bool]  # of each filling, whether grains stayed that should have come
    simulation: Simulation  # as it is at the end


def models(settings: GranularSettings) -> dict[str, tuple[ContactScheme, float]]:
    """Return the grains that are compared, with their time step [s]; all but the first are without friction."""
    coarse = max(settings.dt, _LARGEST_STEP)
    return {
        f"hertz, friction {settings.friction:g}": (sand(settings.friction), settings.dt),
        "hertz, no friction": (sand(0.0), settings.dt),
        "nsm2, inelastic": (INELASTIC, coarse),
        "nsm1": (RIGID, coarse),
    }


def discharge(
    scheme: ContactScheme,
    dt: float,
    seeds: Sequence[int],
    grains: int,
    width: float,
    outlet: float,
    gravity: float,
    slope: float = 0.0,
    count: int | None = None,
) -> Discharge:
    """Let silos of ``width`` and ``outlet`` [d] settle behind a gate, open it, and wait for ``count`` grains or a jam."""
    wanted = grains if count is None else count
    parts = [
        fill(grains, width * DIAMETER, outlet * DIAMETER, slope, np.random.default_rng([seed, 0])) for seed in seeds
    ]
    radius, position = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    place = silo(width * DIAMETER, outlet * DIAMETER, float(position[:, 1].max()) + DIAMETER, slope)
    simulation = passive(place, radius, position, scheme, dt, environments=len(seeds))
    pull = weight(simulation.bodies, gravity)
    for e in range(len(seeds)):
        simulation.close_doors(e, [GATE])
    simulation.advance(n_substeps=round(_SETTLE / dt), external_force=pull)
    for e in range(len(seeds)):
        simulation.close_doors(e, [])
    opened = float(simulation.state.time[0])
    while True:
        simulation.advance(n_substeps=round(1.0 / dt), external_force=pull)
        since = simulation.state.time.max() - opened  # the clock of an empty silo stands still
        exit_time = np.sort(simulation.state.exit_time.reshape(len(seeds), -1) - opened, axis=1)
        out = np.isfinite(exit_time).sum(axis=1)
        last = np.nan_to_num(np.nanmax(np.pad(exit_time, ((0, 0), (1, 0))), axis=1))
        jammed = (out < wanted) & (since - last >= JAMMED)
        if ((out >= wanted) | jammed).all() or since >= _LONGEST:
            return Discharge(exit_time, jammed.tolist(), simulation)


def flows(exit_time: Floats, first: int, last: int) -> Floats:
    """Return the flow [1/s] of each filling between its exits ``first`` and ``last``; nan if fewer came."""
    return (last - first) / (exit_time[:, last] - exit_time[:, first])


class Fit(NamedTuple):
    """Beverloo's law through flows."""

    exponent: float  # with k free
    ci95: tuple[float, float] | None
    offset: float  # k with the exponent 3/2
    factor: float  # C with the exponent 3/2
    at_one: float  # exponent with k = 1


def beverloo(width: Floats, flow: Floats) -> Fit:
    """Fit q = C (D / d - k)^n to flows (N,) in sqrt(g / d), by least squares of their logarithms.

    The interval of n holds what fits with some k and C no worse than F allows: t^2 = F(1, N - 3) of the sum of squares.
    """
    powers, offsets = np.linspace(0.5, 3.0, 501), np.linspace(-2.0, width.min() - 0.05, 400)
    log_flow, log_width = np.log(flow), np.log(width - offsets[:, None])
    rest = log_flow - powers[:, None, None] * log_width
    squares = ((rest - rest.mean(axis=2, keepdims=True)) ** 2).sum(axis=2)
    profile, free = squares.min(axis=1), len(flow) - 3
    limit = profile.min() * (1.0 + t_quantile(free) ** 2 / free) if free > 0 else np.nan
    inside = powers[profile <= limit]
    slope, start = np.polyfit(width, flow ** (2.0 / 3.0), 1)
    at_one = np.polyfit(np.log(width - 1.0), log_flow, 1)[0]
    ci95 = (float(inside[0]), float(inside[-1])) if len(inside) else None
    return Fit(float(powers[profile.argmin()]), ci95, float(-start / slope), float(slope**1.5), float(at_one))


def reproduce(settings: GranularSettings) -> Result:
    """Return flows against outlets, with Beverloo's law through them."""
    seeds = settings.seeds
    first, last = (round(share * settings.grains) for share in (_SKIP, _SKIP + _COUNT))
    middle, unit = (first + last) // 2, np.sqrt(settings.gravity / DIAMETER)
    fillings = len(WIDTHS) * len(seeds)
    sections, lines, points = [], [], {}
    shown: list[Simulation] = []
    for name, (scheme, dt) in models(settings).items():
        jams, ratios, found = 0, [], []
        for width in WIDTHS:
            done = discharge(scheme, dt, seeds, settings.grains, _SILO, width, settings.gravity, count=last + 1)
            shown.append(done.simulation)
            flow = flows(done.exit_time, first, last) / unit
            jams += sum(done.jammed)
            ratios += (flows(done.exit_time, middle, last) / flows(done.exit_time, first, middle)).tolist()
            lines += [(name, width, seed, q, jam) for seed, q, jam in zip(seeds, flow, done.jammed, strict=True)]
            found += [(width, q) for q in flow if np.isfinite(q)]
        wide, flow = np.reshape(found, (-1, 2)).T
        points[name] = wide, flow
        fit, n, late = beverloo(wide, flow), len(found), float(np.nanmean(ratios))
        reading = "least squares of logarithms, k free"
        sections.append(
            [
                Row(f"{name}: exponent", None, fit.exponent, "1", n, reading, expected=1.5, ci95=fit.ci95),
                Row(
                    f"{name}: exponent, k = 1",
                    None,
                    fit.at_one,
                    "1",
                    n,
                    "k = 1: what lets one grain pass",
                    expected=1.5,
                ),
                Row(f"{name}: k", None, fit.offset, "1", n, "with the exponent 3/2"),
                Row(f"{name}: C", None, fit.factor, "1", n, "with the exponent 3/2, grains in sqrt(g/d)"),
                Row(f"{name}: late over early", None, late, "1", n, "flow of two halves", expected=1.0),
                Row(f"{name}: jams", None, jams, "runs", fillings, f"{JAMMED:g} s without a grain"),
            ]
        )
    table = RawTable(("grains", "outlet_over_d", "seed", "flow_over_sqrt_g_d", "jammed"), lines)
    remarks = [
        f"{settings.draws_are} fillings of {settings.grains} grains, {_SILO:g} d wide; the flow is that of the exits {first} "
        f"to {last}. The paper has no silo: 3/2 is Beverloo's law in two dimensions.",
    ]
    raw = {"flows": table}
    return Result(sections, raw, lambda: draw(points, shown[0]), remarks, "1")


def draw(points: Mapping[str, tuple[Floats, Floats]], simulation: Simulation) -> Figure:
    """Return a silo with its narrowest outlet, and flows to the power 2/3, which Beverloo's law makes a line."""
    figure = new_figure((10.4, 4.8))
    picture, axes = figure.subplots(1, 2, width_ratios=(0.8, 1.0))
    draw_silo(picture, simulation, 0)
    name_panel(picture, next(iter(points)))
    quiet_axes(axes, "outlet over grain, $D/d$", r"$(Q / \sqrt{g/d})^{2/3}$", title="flow", grid=True)
    for k, (name, (width, flow)) in enumerate(points.items()):
        fit = beverloo(width, flow)
        line = np.array([max(0.0, fit.offset), max(WIDTHS)])
        axes.plot(line, fit.factor ** (2 / 3) * (line - fit.offset), color=series(k), lw=1.0)
        axes.plot(width, flow ** (2 / 3), "o+x^"[k], color=series(k), fillstyle="none", label=name)
    axes.set(xlim=(0.0, None), ylim=(0.0, None))
    axes.legend(frameon=False, fontsize=9)
    return figure


def draw_silo(axes: Axes, simulation: Simulation, e: int) -> None:
    """Draw the silo of environment ``e``, its grains, and the forces between them as lines."""
    place, bodies, state = simulation.geometries[0], simulation.bodies, simulation.state
    people = slots_of(bodies, e)
    inside, position, radius = state.active[people], state.position[people], bodies.radius[people]
    x0, y0, x1, _ = place.bounds
    axes.set(xlim=(x0 - 0.1, x1 + 0.1), ylim=(y0 - 0.1, position[inside, 1].max(initial=1.0) + 0.5), aspect="equal")
    axes.set_axis_off()
    standing, _ = place.walls_when()
    draw_lines(axes, standing, WALL, 2.0, 4.0)
    look = {"facecolor": "#d5ecec", "edgecolor": "#8ecbcd", "linewidth": 0.5, "zorder": 2}
    draw_bodies(axes, position[inside], radius[inside], **look)
    touching = simulation.contacts(e)
    start = position[touching.i]
    ends = start - radius[touching.i, None] * touching.normal
    pair = touching.j >= 0
    ends[pair] = position[touching.j[pair]]
    force = touching.impulse[:, 0] / simulation.dt
    widths = 3.0 * np.minimum(1.0, force / max(1e-9, float(np.percentile(force, 99)) if len(force) else 1.0))
    draw_lines(axes, np.stack([start, ends], axis=1), SERIES[1], widths, 3.0)
