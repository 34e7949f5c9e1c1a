"""A hopper that arches: how often a narrow outlet jams, with friction and without."""

from collections.abc import Mapping

import numpy as np

from crowd_env.envs.metrics import share_interval
from crowd_env.physics.simulation.simulation import Simulation
from crowd_env.rendering.canvas import name_panel, new_figure, quiet_axes, series
from crowd_env.rendering.libraries import Figure
from crowd_env.reproduce.granular.grains import sand
from crowd_env.reproduce.granular.settings import GranularSettings
from crowd_env.reproduce.granular.silo import JAMMED, discharge, draw_silo
from crowd_env.reproduce.result import RawTable, Result, Row

OUTLETS = (1.5, 2.0, 2.5, 3.0)  # D / d
_GRAINS, _WIDTH, _SLOPE = 100, 12.0, 1.0  # width over d; floors at 45 degrees
DRAWS = 4


def reproduce(settings: GranularSettings) -> Result:
    """Return the share of fillings that jam before the hopper is empty."""
    seeds, rows, lines = settings.seeds, [], []
    shares: dict[str, list[float]] = {}
    arch: tuple[Simulation, int, str] | None = None
    for friction in (settings.friction, 0.0):
        name = f"friction {friction:g}"
        for outlet in OUTLETS:
            scheme = sand(friction)
            done = discharge(scheme, settings.dt, seeds, _GRAINS, _WIDTH, outlet, settings.gravity, _SLOPE)
            out, jams = np.isfinite(done.exit_time).sum(axis=1), sum(done.jammed)
            reading = f"{JAMMED:g} s without a grain; out before: {out.mean():.0f} of {_GRAINS}"
            ci95 = share_interval(jams, len(seeds))
            rows.append(Row(f"{name}, D = {outlet:g} d: jammed", None, jams, "runs", len(seeds), reading, ci95=ci95))
            lines += [(name, outlet, seed, k, jam) for seed, k, jam in zip(seeds, out, done.jammed, strict=True)]
            shares.setdefault(name, []).append(jams / len(seeds))
            if friction and jams:  # the widest that arches
                arch = done.simulation, done.jammed.index(True), f"an arch over D = {outlet:g} d, {name}"
    table = RawTable(("grains", "outlet_over_d", "seed", "out", "jammed"), lines)
    remarks = [
        "An arch is grains that bear each other over the outlet. Friction lets it be of any shape; without, it must be convex."
    ]
    return Result([rows], {"fillings": table}, lambda: draw(shares, arch), remarks)


def draw(shares: Mapping[str, list[float]], arch: tuple[Simulation, int, str] | None) -> Figure:
    """Return an arch with its forces, and the share of fillings that jam against the outlet."""
    figure = new_figure((9.6, 4.4))
    picture, axes = figure.subplots(1, 2)
    picture.set_axis_off()
    if arch is not None:
        draw_silo(picture, arch[0], arch[1])
        name_panel(picture, arch[2])
    quiet_axes(axes, "outlet over grain, $D/d$", "share of fillings that jam", grid=True)
    for k, (name, share) in enumerate(shares.items()):
        axes.plot(OUTLETS, share, "o-", color=series(k), label=name)
    axes.set(ylim=(-0.03, 1.03))
    axes.legend(frameon=False, fontsize=9)
    return figure
