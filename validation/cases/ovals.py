"""Closed ovals: how fast people walk at a density where nothing lets them out, and which way a jam travels."""

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from crowd_env import Bodies, Normal
from crowd_env.core.arrays.state import unit_vectors
from validation.cases.case import RECORDED, Row, Setting, adults, number, row
from validation.cases.crowds import Crowds, Floats, crowds_at, generator
from validation.cases.ring import along, annulus, around, turned
from validation.cases.standards.walking import WITHIN

WIDTHS = (1.0, 1.4, 1.8)  # m
RADIUS = 6.0  # m, of the middle of the oval, which is a circle
JUDGED = {float(density): float(speed) for density, speed in RECORDED["ovals"].items()}  # 1/m2 -> m/s

# m/s: where 15 of the recorded people walk around, they walk at 1.1 to 1.2; as even as the people of the open corridor.
_SPEED = Normal(1.2, 0.14, 0.8, 1.6)
_FROM, _UNTIL = 15.0, 40.0  # s, when speeds are measured
_JAM = 2.5, 0.45  # 1/m2 in all; m between people of a file in the jam, where half of them are
_FILES = 3
_FOLLOWED = 3.0, 15.0  # s


def speeds(setting: Setting, width: float, densities: Sequence[float]) -> Floats:
    """Return the mean speed [m/s] around an oval of ``width`` [m] at each density [1/m2]."""
    place = annulus(RADIUS, width)
    crowd = [adults(round(density * place.area), desired_speed=_SPEED) for density in densities]
    drawn = [each.draw(generator(setting, d), place, setting.room) for each in crowd for d in range(setting.draws)]
    crowds = crowds_at(place, drawn, setting, setting.draws)
    found = crowds.speeds(along, around, _FROM, _UNTIL)
    return np.array(crowds.means(found))


def run(setting: Setting) -> list[Row]:
    """Return the row.  There are no routes: everyone is led around."""
    densities, recorded = list(JUDGED), np.array(list(JUDGED.values()))
    found, figures = {}, []
    for width in WIDTHS:
        speed = speeds(setting, width, densities)
        off = ", ".join(f"{100.0 * share:+.0f}" for share in speed / recorded - 1.0)
        found[f"{width:g}"], said = speed, f"{width:g} m {off} %"
        figures.append(said)
    near = [bool((np.abs(speed / recorded - 1.0) <= WITHIN).all()) for speed in found.values()]
    at = ", ".join(f"{density:g}" for density in densities)
    more: dict[str, Any] = {"density": densities, "recorded": recorded, "speed": found}
    return [row("ovals", setting, all(near), f"at {at} /m2: {'; '.join(figures)}", **more)]


def jammed(setting: Setting, d: int) -> tuple[Bodies, Floats]:
    """Return the people of a draw and where they stand: half of them so close that they hardly walk."""
    density, gap = _JAM
    place, length = annulus(RADIUS, WIDTHS[-1]), 2.0 * np.pi * RADIUS
    files = 2 * round(density * place.area / (2 * _FILES))  # people in each
    packed = files // 2
    rest = packed * gap + np.arange(files - packed) * (length - packed * gap) / (files - packed)
    angle = np.repeat(np.concatenate([gap * np.arange(packed), rest]) / RADIUS, _FILES)
    off = RADIUS + np.tile((np.arange(_FILES) - 0.5 * (_FILES - 1)) * WIDTHS[-1] / _FILES, files)
    bodies = adults(len(angle)).draw_bodies(generator(setting, d))
    return bodies, off[:, None] * unit_vectors(angle)


def drift(crowds: Crowds) -> Floats:
    """Return how fast the densest part of each crowd travels around [m/s], > 0 with the people; nan if it dissolved at once."""
    center: list[Floats] = []
    for _, now in crowds.moments(_FOLLOWED[1], along):
        if now.time >= _FOLLOWED[0] - 1e-9:
            on = now.position / np.hypot(*now.position.T)[:, None]
            center.append(np.array([on[crowds.people(e)].mean(axis=0) for e in range(crowds.count)]))
    steps = np.array([turned(*pair) for pair in itertools.pairwise(center)])
    return RADIUS * steps.sum(axis=0) / (_FOLLOWED[1] - _FOLLOWED[0])


def jam(setting: Setting) -> list[Row]:
    """Return the row of the jam."""
    drawn = [jammed(setting, d) for d in range(setting.draws)]
    found = drift(crowds_at(annulus(RADIUS, WIDTHS[-1]), drawn, setting, setting.draws))
    mean, error = (
        float(found.mean()),
        float(found.std(ddof=1) / np.sqrt(len(found))) if len(found) > 1 else float("nan"),
    )
    figure = f"{number(mean)} ± {number(error)} m/s"
    return [row("jam", setting, mean < 0.0, figure, drift=found)]
