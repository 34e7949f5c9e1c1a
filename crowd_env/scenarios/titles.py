"""A scenario with the settings of a run: manner and outline of pedestrians, and the title that names them."""

from dataclasses import replace
from typing import Any

from crowd_env.core.behaviors import IN_WORDS
from crowd_env.core.behaviors.headway import Headway, Manner
from crowd_env.core.behaviors.outline import Outline
from crowd_env.scenarios.scenario import FULL_SPEED, Scenario


def with_manner(place: Scenario, manner: Manner | None, outline: str | None = None) -> Scenario:
    """Return a scenario in which people walk in this manner and have this outline; None = the scenario's.

    Competitive people drive as hard as in the papers.

    Raises
    ------
    ValueError
        If the manner or the outline is unknown, or people of this outline do not fit.
    """
    Headway.of(manner)
    Outline.of(outline)
    given: dict[str, Any] = {"manner": manner or place.manner, "outline": outline or place.outline}
    if manner == "competitive":
        given["max_drive"] = FULL_SPEED["max_drive"]
    return replace(place, **given)


def run_title(place: Scenario, scheme: str = "", *, people: str = "", runs: str = "") -> str:
    """Return "room-v0: 20 people, hertz, calm, torso, 5 runs": the given parts, with the people's manner and outline."""
    first = f"{place.name}: {people}" if people else place.name
    behaviors = ((IN_WORDS[name], plain) for name, plain in place.plain_behaviors().items())
    words = [plain if isinstance(plain, str) else one.brief(plain) for one, plain in behaviors if plain != one.usual]
    return ", ".join(part for part in (first, scheme, *words, runs) if part)
