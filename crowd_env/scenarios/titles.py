"""A scenario as a run takes it: how pedestrians walk and are shaped, and the title that says so."""

from dataclasses import replace
from typing import Any

from crowd_env.core.arrays.headway import make_manner, plain_manner
from crowd_env.core.arrays.outline import make_outline, plain_outline
from crowd_env.scenarios.scenario import FULL_SPEED, Scenario


def with_manner(place: Scenario, manner: str | None, outline: str | None = None) -> Scenario:
    """Return a scenario in which people walk in this manner and have this outline; None = as it says.

    Competitive people drive as hard as in the papers.

    Raises
    ------
    ValueError
        If the manner or the outline is unknown, or people of this outline do not fit.
    """
    make_manner(manner)
    make_outline(outline)
    given: dict[str, Any] = {"manner": manner or place.manner, "outline": outline or place.outline}
    if manner == "competitive":
        given["max_drive"] = FULL_SPEED["max_drive"]
    return replace(place, **given)


def run_title(place: Scenario, scheme: str = "", *, people: str = "", runs: str = "") -> str:
    """Return "room-v0: 20 people, hertz, calm, torso, 5 runs": what is given, and how people walk and are shaped."""
    headway = place.manner_of_run()
    manner = plain_manner(headway)
    walk = manner if isinstance(manner, str) else f"time gap {manner['time_gap']:g} s"
    first = f"{place.name}: {people}" if people else place.name
    outline = place.outline_of_run()
    shape = plain_outline(outline)
    body = shape if isinstance(shape, str) else f"{len(shape['discs'])} discs a body"
    parts = (first, scheme, walk if headway else "", body if outline else "", runs)
    return ", ".join(part for part in parts if part)
