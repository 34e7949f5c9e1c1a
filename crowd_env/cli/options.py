"""Options that several commands have, and how every option is made."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any

import typer

from crowd_env.core.behaviors.headway import MANNERS
from crowd_env.physics import SCHEMES
from crowd_env.routing.strategies import STRATEGIES
from crowd_env.scenarios import SCENARIOS
from crowd_env.scenarios.floor_plan import PEOPLE
from crowd_env.scenarios.plans.reading import PLANS


def complete_from(names: Iterable[str]) -> Callable[[str], list[str]]:
    """Return what proposes names to a shell: those of ``names`` that begin as the user has begun."""
    known = tuple(names)
    return lambda incomplete: [name for name in known if name.startswith(incomplete)]


def section(panel: str | None = None) -> Callable[..., Any]:
    """Return what makes an option of a section of the help, from its text and what that says is the default.

    ``names`` are others than that of the argument, ``among`` the names that a shell completes; the rest is that of
    `typer.Option`.
    """

    def option(
        help: str, default: str | None = None, *, names: Iterable[str] = (), among: Iterable[str] = (), **more: Any
    ) -> Any:
        more |= {"show_default": default} if default else {}
        if among:
            more = {"metavar": "NAME", "autocompletion": complete_from(among), **more}
        return typer.Option(*names, help=help, rich_help_panel=panel, **more)

    return option


of_place, of_people, of_physics = map(section, ("Place", "People", "Physics"))
of_runs, of_output, plain = map(section, ("Runs", "Output", None))

AsJson = Annotated[bool, of_output("Print one JSON object instead of a table.", names=("--json",))]
Workers = Annotated[int | None, of_runs("Processes at most; default one a core. Results do not depend on it.", min=1)]
Runs = Annotated[int, of_runs("Number of evacuations, each with other people in other places.")]
_UNTIL = (
    "Stop as soon as the mean evacuation time is known to so much, such as 2% (95 % interval), after 10 runs or more; "
    "--runs is the most."
)
Until = Annotated[str | None, of_runs(_UNTIL, metavar="PERCENT%")]
Seed = Annotated[int, of_runs("Run k draws its people from seed + k.", min=0)]


def new_app() -> typer.Typer:
    """Return the application of a module, whose commands `crowd_env.cli.main` loads when they are named."""
    return typer.Typer(add_completion=False, pretty_exceptions_enable=False)


# What a command line says of a place.
PLACES = (
    f"Name of a scenario, a scenario file (.toml, .json), or a floor plan: {PLANS}; house.geojson:1 is its level 1."
)
complete_scenario = complete_from(SCENARIOS)
PlaceName = Annotated[str, typer.Argument(help=PLACES, autocompletion=complete_scenario)]
_EXITS = (
    'Exit of a floor plan, in place of those in the file: "x1,y1,x2,y2", LINESTRING on its edge or POLYGON; may be '
    "repeated."
)
Exits = Annotated[list[str] | None, of_place(_EXITS, names=("--exit",))]
_UNIT = (
    "Unit of the coordinates of a floor plan, of --exit and of --starts: m, cm, mm, ft or in; default m, unless that "
    "cannot be and the file says another."
)
_SECTIONS = "Line at which people are counted, x1,y1,x2,y2 or NAME=x1,y1,x2,y2; may be repeated."
Sections = Annotated[list[str] | None, of_place(_SECTIONS, names=("--section",))]
Unit = Annotated[str | None, of_place(_UNIT)]
_PEOPLE = f"Number of people; default the scenario's, or {PEOPLE} on a floor plan."
PeopleCount = Annotated[int | None, of_people(_PEOPLE, names=("--people",), min=1)]
Starts = Annotated[Path | None, of_people("CSV file with columns x,y: recorded starting positions.")]
_WALKING = (
    f"How people walk before they touch: {', '.join(MANNERS)}, or a table such as "
    """'{"time_gap": 0.7}'; default the scenario's."""
)
WalkingName = Annotated[str | None, of_people(_WALKING, names=("--walking",), among=MANNERS)]
_CHANGES = (
    "Change a number of the crowd (speed, radius, outline, ...), the physics (dt, social, tolerance, ...), the "
    "routing (signs), a shipped place (door_width, ...) or a file (cohorts.0.people, ...); may be repeated. "
    "speed=1.5 is the same for all, speed=1.2,2 is drawn from a range."
)
Changes = Annotated[list[str] | None, of_people(_CHANGES, names=("--set",), metavar="NAME=VALUE")]
ONE_SCHEME = f"Contact scheme: {', '.join(SCHEMES)}; or your own, my_law.py:MyLaw."
SchemeName = Annotated[str | None, of_physics(ONE_SCHEME, names=("--scheme",), among=SCHEMES)]
_ROUTING = (
    "How people choose their route: shortest, nearest, fastest, comfortable, or the name of a route or an exit; default the "
    "scenario's; where that says nothing the fastest of several exits."
)
RoutingName = Annotated[str | None, of_people(_ROUTING, names=("--routing",), among=STRATEGIES)]
_POLICY = (
    "Who decides how people walk: a policy by its name in crowd-env list, a network (.safetensors), or your own, "
    "my_policy.py:MyPolicy. Without --walking people keep the distance that it was trained with, else none."
)
PolicyName = Annotated[str | None, of_people(_POLICY, names=("--policy",))]
TimeLimit = Annotated[float | None, of_runs("People who are inside after this many seconds are unfinished.")]
