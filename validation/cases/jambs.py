"""Narrow doors with sharp and with round jambs: how often is a door stuck for good?

Twenty people of 0.2 to 0.25 m leave a room of 5 m by a door hardly wider than two of them.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from shapely.geometry import box

from crowd_env import FULL_SPEED, TABLE_4, Geometry, Hertz, Population, Scenario, make_scheme
from crowd_env.envs.rollout import run_episodes
from crowd_env.physics import ContactScheme
from validation.cases.case import Row, Setting, row

_SIDE, _PEOPLE = 5.0, 20
_STUCK_AFTER = 30.0  # s without anyone getting out
_DOORS = (0.5, 0.6, 0.8)  # m
_RADII = (0.0, 0.05, 0.1, 0.2)  # m
_SMOOTH = "hertz, frictionless"


def narrow_door(width: float, jamb_radius: float) -> Scenario:
    """Return a room with a door of ``width`` [m] in the middle of a wall, its jambs rounded."""
    low, high = 0.5 * (_SIDE - width), 0.5 * (_SIDE + width)
    door = {"door": [(_SIDE, low), (_SIDE, high)]}
    geometry = Geometry.from_polygon(box(0.0, 0.0, _SIDE, _SIDE), exits=door, jamb_radius=jamb_radius)
    return Scenario(
        "narrow-door", geometry, Population(_PEOPLE, **TABLE_4), 600.0, blocked_after=_STUCK_AFTER, **FULL_SPEED
    )


def run(setting: Setting) -> Iterator[Row]:
    """Yield a row a door: in how many draws it is stuck with jambs of each radius; `hertz` without friction too."""
    laws: dict[str, ContactScheme] = {setting.scheme: make_scheme(setting.scheme)}
    if setting.scheme == "hertz":
        laws[_SMOOTH] = Hertz(friction=0.0, wall_friction=0.0)
    for name, scheme in laws.items():
        for door in _DOORS:
            more: dict[str, Any] = {"door, m": door, "draws": setting.draws}
            for radius in _RADII:
                setting.notify(f"{name}, {setting.manner}, door {door:g} m, jambs of {radius:g} m")
                how: dict[str, Any] = {"scheme": scheme, "manner": setting.manner, "outline": setting.outline}
                episodes = run_episodes(narrow_door(door, radius), setting.draws, seed=setting.seed, **how)
                more[f"stuck, radius {radius:g} m"] = sum(episode.metrics.unfinished > 0 for episode in episodes)
            stuck = ", ".join(f"{more[f'stuck, radius {radius:g} m']} with {radius:g} m" for radius in _RADII)
            figure = f"door of {door:g} m: stuck in {stuck} of {setting.draws}"
            yield row("jambs", replace(setting, scheme=name), None, figure, **more)
