"""Narrow doors with sharp and with round jambs: how often is a door stuck for good?

Twenty people of 0.2 to 0.25 m leave a room of 5 m by a door hardly wider than two of them.
"""

from collections.abc import Iterator

from shapely.geometry import box

from crowd_env import Geometry, Hertz, Population, Scenario, make_scheme
from crowd_env.envs.rollout import run_episodes
from crowd_env.physics import ContactScheme
from validation.cases.case import Case, Figures, Finding, Settings

_SIDE, _PEOPLE, _DRAWS = 5.0, 20, 20
_STUCK_AFTER = 30.0  # s without anyone getting out
_DOORS = (0.5, 0.6, 0.8)  # m
_RADII = (0.0, 0.05, 0.1, 0.2)  # m
_MANNERS = ("competitive", "hurried")
_SMOOTH = "hertz, frictionless"


def narrow_door(width: float, jamb_radius: float) -> Scenario:
    """Return a room with a door of ``width`` [m] in the middle of a wall, its jambs rounded."""
    low, high = 0.5 * (_SIDE - width), 0.5 * (_SIDE + width)
    door = {"door": [(_SIDE, low), (_SIDE, high)]}
    geometry = Geometry.from_polygon(box(0.0, 0.0, _SIDE, _SIDE), exits=door, jamb_radius=jamb_radius)
    return Scenario("narrow-door", geometry, Population(_PEOPLE), 600.0, blocked_after=_STUCK_AFTER)


def _measure(settings: Settings) -> Iterator[Finding]:
    draws = settings.draws or _DRAWS
    for name in settings.schemes:
        laws: dict[str, ContactScheme] = {name: make_scheme(name)}
        if name == "hertz":
            laws[_SMOOTH] = Hertz(friction=0.0, wall_friction=0.0)
        for label, scheme in laws.items():
            for manner in _MANNERS:
                for door in _DOORS:
                    figure: Figures = {"manner": manner, "door, m": door, "draws": draws}
                    for radius in _RADII:
                        settings.notify(f"{label}, {manner}, door {door:g} m, jambs of {radius:g} m")
                        episodes = run_episodes(narrow_door(door, radius), draws, scheme=scheme, manner=manner)
                        stuck = sum(episode.metrics.unfinished > 0 for episode in episodes)
                        figure[f"stuck, radius {radius:g} m"] = stuck
                    yield Finding(label, None, figure)


CASE = Case(
    title=f"{_PEOPLE} people leave by a narrow door with jambs of different radius",
    criterion=f"none: how many of the draws end with a door that nobody leaves by for {_STUCK_AFTER:g} s",
    source="no recording: an adult passes a door of 0.5 m",
    schemes=("dem", "nsm1", "nsm1-inertial", "nsm2", "hertz"),
    measure=_measure,
)
