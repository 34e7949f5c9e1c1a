"""Optional behaviors of pedestrians in words: what titles, tables and reports write of each."""

from collections.abc import Callable
from typing import Any, NamedTuple

from crowd_env.core.behaviors.headway import Headway
from crowd_env.core.behaviors.outline import Outline, room_of
from crowd_env.scenarios.scenario import Scenario


class Words(NamedTuple):
    """The words of an optional behavior, whose *plain* form is the name of a preset, or a table of parameters."""

    of: Callable[[Scenario], Any]  # in a run of a scenario, plain
    usual: str  # preset that the title of a run leaves out
    unsaid: frozenset[str]  # presets that the title of a recording leaves out
    label: str  # of its row in a report
    brief: Callable[[Any], str]  # a table of parameters in a few words
    judged: bool  # whether the validation map has rows for each preset
    limit: Callable[[Any], str]  # what a report has to say of validity, "" = nothing


def _limit_of_manner(manner: Any) -> str:
    return (
        "Competitive people walk at full speed whatever is in front of them, as in the papers; people who do not press keep a "
        "distance and leave more slowly (docs/walking.md)."
        if manner == "competitive"
        else ""
    )


def _limit_of_outline(outline: Any) -> str:
    said = "The rows are of people with the outline of discs; the bodies of these runs are others."
    return "" if outline == "disc" else said


# Name, as in `crowd_env.core.behaviors.BEHAVIORS` -> words.  Every text about pedestrians iterates over this table.
IN_WORDS: dict[str, Words] = {
    "manner": Words(
        of=lambda place: Headway.plain_of(place.manner_of_run()),
        usual="competitive",
        unsaid=frozenset(),
        label="how they walk before they touch",
        brief=lambda table: f"time gap {table['time_gap']:g} s",
        judged=True,
        limit=_limit_of_manner,
    ),
    "outline": Words(
        of=lambda place: Outline.plain_of(place.outline_of_run()),
        usual="disc",
        unsaid=frozenset({"disc"}),
        label="shape of the body",
        brief=lambda table: f"{len(table['discs'])} discs a body",
        judged=False,
        limit=_limit_of_outline,
    ),
}


def plain_behaviors(place: Scenario) -> dict[str, Any]:
    """Return name -> plain form of every behavior in a run of a scenario."""
    return {name: behavior.of(place) for name, behavior in IN_WORDS.items()}


def room_of_run(place: Scenario) -> float:
    """Return the radius within which a body can turn freely in a run of a scenario, as a multiple of its nominal radius."""
    return room_of(place.outline_of_run())
