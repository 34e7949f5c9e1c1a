"""Films of several ways to lead the same people out, side by side under one clock."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from crowd_env import Scenario
from crowd_env.envs.rollout import Driver
from crowd_env.recording import Recording, record
from crowd_env.rendering import write_film

RULE_AHEAD = "rule: full speed ahead"  # what stands above the rule
_SECONDS = 12.0  # that a film of any evacuation lasts, by and large
_BEYOND = 1.3  # of the time that the last takes: so long are the others shown, which may be stuck until the time limit
_WIDTH = 640  # px
_GIF_FPS = 10.0  # 1/s

# From a scenario to a maker of batches.
Way = Callable[[Scenario], Callable[[int], Driver]]


def record_beside(
    ways: Mapping[str, Way], place: Scenario, seed: int, progress: Callable[[int], object] | None = None
) -> list[Recording]:
    """Return one evacuation of each of the ways, from the same people in the same places, called as films show them.

    The last tells how long all are worth looking at.

    Parameters
    ----------
    progress : called with 1 after each.
    """
    films: dict[str, Recording] = {}
    shown = place
    for title, way in reversed(list(ways.items())):
        films[title] = record(shown, seed=seed, facts={"shown_as": title}, driver=way(shown))
        if shown is place:
            shown = replace(place, time_limit=min(place.time_limit, _BEYOND * films[title].end))
        if progress is not None:
            progress(1)
    return [films[title] for title in ways]


def write_beside(
    path: Path,
    films: list[Recording],
    *,
    width: int | None = None,
    fps: float | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> Path:
    """Write a film of about twelve seconds and return the path; the options are those of `write_film`."""
    if fps is None and path.suffix.lower() == ".gif":
        fps = _GIF_FPS
    speed = max(1.0, round(max(film.end for film in films) / _SECONDS))
    titles = [film.facts["shown_as"] for film in films]
    return write_film(
        path, films, titles=titles, fps=fps, width=_WIDTH if width is None else width, speed=speed, progress=progress
    )
