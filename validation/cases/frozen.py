"""Faster is frozen: from which desired speed on does the exit of Lin, Ma, Lo block, and what sets that speed?

The social force of Lin, Ma, Lo is not reciprocal: of two in file who just touch, the one behind is pushed back by A (1 + phi)
and the one in front forward by A (1 - phi).  In a crowd in which everyone touches z others, evenly all around, the forces that
these exert add up to (z / 2) phi A backwards, sum over n of A phi n (n . e).  The drive m v_0 / tau is held by it, with no
body pressed, up to

    v_0 = (z / 4) v*,    v* = 2 phi A tau / m

and what is beyond that is left for contacts to bear, and for arches to be made of.  z is 6 in a dense packing of discs, 4 in
the loosest rigid one.
"""

import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from crowd_env.core.executors import Processes
from crowd_env.core.files.store import Store
from crowd_env.envs.metrics import share_interval
from crowd_env.reproduce.evacuations import evacuate
from crowd_env.reproduce.lin2016.settings import LinSettings
from validation.cases.case import Row, Setting, row

PEOPLE = 200
SPEEDS = (1.2, 1.4)  # times v*: below and above the onset in the paper's Figure 7, 1.6 to 1.8 m/s
_RELAXATION_TIME, _MASS = 0.5, 70.0  # s, kg: of the population of Lin, Ma, Lo, mean


class Variant(NamedTuple):
    """What is varied, one at a time; the social force of walls keeps its ratio to that of people."""

    friction: float = 0.5
    strength: float = 300.0  # N    A of the social force
    anisotropy: float = 0.3  # phi

    @property
    def characteristic_speed(self) -> float:
        """v* = 2 phi A tau / m [m/s]."""
        return 2.0 * self.anisotropy * self.strength * _RELAXATION_TIME / _MASS

    def settings(self, runs: int, seed: int) -> LinSettings:
        """Return the settings of the paper's room."""
        return LinSettings(runs, seed, friction=self.friction, anisotropy=self.anisotropy, wall_social=self.strength)


VARIANTS: tuple[Mapping[str, Any], ...] = (
    {"friction": 0.5},
    {"friction": 0.0},
    {"friction": 0.25},
    {"friction": 1.0},
    {"strength": 150.0},
    {"strength": 600.0},
    {"anisotropy": 0.15},
    {"anisotropy": 0.6},
)


def onset(speeds: tuple[float, ...], shares: list[float]) -> float | None:
    """Return the speed at which half of the draws block, linear between ``speeds``; None if that is not among them."""
    for k in range(1, len(speeds)):
        if shares[k - 1] < 0.5 <= shares[k]:
            return float(np.interp(0.5, shares[k - 1 : k + 1], speeds[k - 1 : k + 1]))
    return speeds[0] if shares[0] == 0.5 else None


def run(setting: Setting) -> Iterable[Row]:
    """Yield a row a variant: the share of blocked draws at every speed, and where it passes one half; for `hertz` alone."""
    if setting.scheme == "hertz" and setting.manner == "competitive":
        yield from _rows(setting)


def _rows(setting: Setting) -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as folder:
        store = Store(Path(folder))
        for varied in VARIANTS:
            variant = Variant(**varied)
            speed = variant.characteristic_speed
            # A band over frictions needs more draws than a scale with the force.
            draws = setting.draws if "friction" in varied else max(setting.draws // 2, 1)
            settings = variant.settings(draws, setting.seed)
            cases = {times: settings.case(PEOPLE, times * speed, variant.strength) for times in SPEEDS}
            at = ", ".join(f"{name} {value:g}" for name, value in varied.items())
            setting.notify(f"{at}: {len(SPEEDS) * draws} evacuations")
            runs = evacuate(cases, store, Processes())
            blocked = {
                times: [bool(np.isfinite(one.metrics.blocked_since)) for one in some] for times, some in runs.items()
            }
            yield finding(setting, variant, speed, blocked)


def finding(setting: Setting, variant: Variant, speed: float, blocked: Mapping[float, list[bool]]) -> Row:
    """Return the row of one variant; ``blocked`` says of every draw at every multiple of ``speed`` whether it did."""
    half = onset(tuple(blocked), [float(np.mean(draws)) for draws in blocked.values()])
    more: dict[str, Any] = {
        "friction": variant.friction,
        "A, N": variant.strength,
        "phi": variant.anisotropy,
        "v*, m/s": speed,
        "half block at, m/s": None if half is None else half * speed,
        "half block at, v*": half,
        "draws": len(next(iter(blocked.values()))),
    }
    for times, draws in blocked.items():
        low, high = share_interval(sum(draws), len(draws))
        more |= {
            f"blocked at {times:g} v*": sum(draws),
            f"blocked at {times:g} v*, least share": low,
            f"blocked at {times:g} v*, most": high,
        }
    shares = ", ".join(f"{sum(draws)} of {len(draws)} at {times:g} v*" for times, draws in blocked.items())
    figure = f"friction {variant.friction:g}, A {variant.strength:g} N, phi {variant.anisotropy:g}: blocked {shares}"
    return row("frozen", setting, half is not None, figure, **more)
