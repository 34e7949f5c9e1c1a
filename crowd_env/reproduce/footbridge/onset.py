"""How far the deck sways, and how many walk in step, against the number of walkers."""

from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.envs.footbridge.synchrony import SPREAD, Synchrony, normal_density
from crowd_env.envs.footbridge.walkers import DECK, crowd
from crowd_env.rendering.canvas import hex_of, new_figure, quiet_axes, series
from crowd_env.rendering.libraries import Figure
from crowd_env.rendering.palette import QUIET
from crowd_env.reproduce.footbridge.runs import Trace, half_sine, onset, stay, walk
from crowd_env.reproduce.footbridge.settings import FootbridgeSettings
from crowd_env.reproduce.result import RawTable, Result, Row, mean_row

LARGE = 0.015  # m, a motion that is no longer that of steps by chance, and where the onset is read

THRESHOLD = Synchrony().threshold(DECK, normal_density(SPREAD))  # sum of psi squared
MID = (50, 100, 130, 150, 170, 190, 220, 250, 300, 400, 500)
FILLED = (50, 100, 150, 200, 250, 280, 310, 340, 370, 400, 450, 500)
_WALKED = (200, 300, 350, 400, 500)


class Sweep(NamedTuple):
    """One way to stand on the deck, for several numbers of people."""

    name: str
    critical: float  # number of people, by the formula
    people: Sequence[int]  # K
    amplitude: Floats  # (K, draws) m
    order: Floats  # (K, draws)

    def onset(self) -> float | None:
        """Return where the mean amplitude over draws passes `LARGE`."""
        return onset(self.people, self.amplitude.mean(axis=1).tolist(), LARGE)

    def reading(self) -> str:
        """Return how the onset is read, and where single draws have it."""
        single = [onset(self.people, draw.tolist(), LARGE) for draw in self.amplitude.T]
        found = [one for one in single if one is not None]
        apart = f"; single draws {min(found):.0f} to {max(found):.0f}" if found else ""
        return f"mean amplitude over draws passes {1000 * LARGE:g} mm{apart}"


def at_mid_span(seeds: Sequence[int], duration: float, people: Sequence[int] = MID) -> Sweep:
    """Return the sweep in which all stand at mid-span."""
    return _sweep("all at mid-span", THRESHOLD, people, lambda n: stay(np.ones(n), seeds, duration).late())


def on_filled_deck(seeds: Sequence[int], duration: float, people: Sequence[int] = FILLED) -> Sweep:
    """Return the sweep in which people fill the deck evenly and stay."""
    return _sweep("evenly filled", 2.0 * THRESHOLD, people, lambda n: stay(half_sine(n), seeds, duration).late())


def walking(settings: FootbridgeSettings) -> Sweep:
    """Return the sweep in which a crowd walks over the deck under the contact scheme."""

    def run(n: int, seed: int) -> Trace:
        return walk(crowd(n, settings.physics, seed), "synchrony", settings.duration, seed)

    def late(n: int) -> Floats:
        return np.array([run(n, seed).late() for seed in settings.seeds]).T

    return _sweep(f"walking crowd, {settings.scheme}", 2.0 * THRESHOLD, _WALKED, late)


def _sweep(name: str, critical: float, people: Sequence[int], late: Callable[[int], Iterable[Floats]]) -> Sweep:
    """Return the sweep in which ``late`` gives amplitude and order (draws,) of a number of people."""
    amplitude, order = map(np.array, zip(*map(late, people), strict=True))
    return Sweep(name, critical, people, amplitude, order)


def reproduce(settings: FootbridgeSettings) -> Result:
    """Return the figure."""
    seeds = settings.seeds
    sweeps = [
        at_mid_span(seeds, settings.duration),
        on_filled_deck(seeds, settings.duration),
        walking(settings),
    ]
    rows = [
        Row("omega_0 of the deck", "6.47", DECK.frequency, "rad/s", 1, "sqrt(K / M)"),
        Row(
            "damping ratio of the deck",
            "0.0075",
            DECK.damping_ratio,
            "1",
            1,
            "B / (2 sqrt(K M)); printed value from memory",
        ),
    ]
    for sweep in sweeps:
        found, read = sweep.onset(), sweep.reading()
        rows.append(Row(f"onset, {sweep.name}", None, found, "people", settings.runs, read, expected=sweep.critical))
        for n in (100, 250, 300, 500):
            if n in sweep.people:
                values = 1000.0 * sweep.amplitude[sweep.people.index(n)]
                rows.append(mean_row(f"A, {n} people, {sweep.name}", values, "mm", "last quarter", interval=False))
    remarks = [
        f"Threshold: sum of psi squared = (4 zeta / pi) K / (G C P(omega_0)) = {THRESHOLD:.1f}, after Strogatz et al. 2005.",
        "Walkers at mid-span and on the evenly filled deck walk on the spot and touch nobody. The crowd walks, keeps a "
        "distance (hurried), touches, and comes round to the start from the far end.",
        "Below the threshold the deck moves by a few mm, by chance, less than 1/sqrt(N) of the steps being in step.",
    ]
    table = RawTable(
        ("where", "people", "draw", "amplitude_m", "order", "critical"),
        [
            (
                sweep.name,
                n,
                settings.seed + k,
                f"{sweep.amplitude[i, k]:.6f}",
                f"{sweep.order[i, k]:.4f}",
                f"{sweep.critical:.2f}",
            )
            for sweep in sweeps
            for i, n in enumerate(sweep.people)
            for k in range(sweep.amplitude.shape[1])
        ],
    )
    return Result([rows], {"draws": table}, lambda: draw(sweeps), remarks)


def draw(sweeps: Sequence[Sweep]) -> Figure:
    """Return a drawing of the sweeps, a column each: amplitude above, order below."""
    figure = new_figure((3.4 * len(sweeps), 5.0))
    panels = figure.subplots(2, len(sweeps), sharex=True, sharey="row", squeeze=False)
    for k, sweep in enumerate(sweeps):
        above = quiet_axes(panels[0, k], "", "amplitude [mm]" if k == 0 else "", title=sweep.name, grid=True)
        below = quiet_axes(panels[1, k], "walkers", "order R" if k == 0 else "", grid=True)
        for axes, values in ((above, 1000.0 * sweep.amplitude), (below, sweep.order)):
            axes.plot(np.repeat(sweep.people, values.shape[1]), values.ravel(), "o", color=series(k), ms=3.5, alpha=0.6)
            axes.plot(sweep.people, values.mean(axis=1), color=series(k), lw=1.4)
            axes.axvline(sweep.critical, color=hex_of(QUIET), lw=1.0, ls="--")
        above.annotate(f" {sweep.critical:.0f}", (sweep.critical, 0.9), xycoords=("data", "axes fraction"), fontsize=9)
        numbers = np.linspace(50, 500, 100)
        below.plot(numbers, 1.0 / np.sqrt(numbers), color=hex_of(QUIET), lw=0.8)
        below.set(ylim=(0.0, 1.0), xlim=(0, 510))
    return figure
