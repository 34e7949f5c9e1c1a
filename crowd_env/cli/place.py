"""Which place a command is about: a scenario by name, a scenario file, or a floor plan with its exits and people."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from crowd_env.cli.completion import complete_from
from crowd_env.cli.console import OF_PEOPLE, OF_PLACE, OF_RUNS
from crowd_env.scenarios import SCENARIOS, kind_of_place, make_scenario
from crowd_env.scenarios.floor_plan import PEOPLE, people_on, scenario_on
from crowd_env.scenarios.plans.reading import PLANS, read_plan
from crowd_env.scenarios.plans.units import unit_in_meters
from crowd_env.scenarios.population import Uniform
from crowd_env.scenarios.scenario import Scenario
from crowd_env.scenarios.starts import read_starts

# What a command line says of a place.
PLACES = f"Name of a scenario, a scenario file (.toml, .json), or a floor plan: {PLANS}."
complete_scenario = complete_from(SCENARIOS)

Exits = Annotated[
    list[str] | None,
    typer.Option(
        "--exit",
        help='Exit of a floor plan, in place of those in the file: "x1,y1,x2,y2", LINESTRING on its edge or POLYGON; may be '
        "repeated.",
        rich_help_panel=OF_PLACE,
    ),
]
Unit = Annotated[
    str | None,
    typer.Option(
        help="Unit of the coordinates of a floor plan, of --exit and of --starts: m, cm, mm, ft or in; default m, unless "
        "that cannot be and the file says another.",
        rich_help_panel=OF_PLACE,
    ),
]
Count = Annotated[
    int | None,
    typer.Option(
        "--n",
        help=f"Number of people; default the scenario's, or {PEOPLE} on a floor plan.",
        min=1,
        rich_help_panel=OF_PEOPLE,
    ),
]
Radius = Annotated[
    str | None,
    typer.Option(
        help="Body radius in m, one number or a range; default the scenario's, or 0.2,0.25.", rich_help_panel=OF_PEOPLE
    ),
]
Speed = Annotated[
    str | None,
    typer.Option(
        help="Desired speed in m/s, one number or a range; default the scenario's, or 1.2,2.", rich_help_panel=OF_PEOPLE
    ),
]
Starts = Annotated[
    Path | None, typer.Option(help="CSV file with columns x,y: recorded starting positions.", rich_help_panel=OF_PEOPLE)
]
TimeLimit = Annotated[
    float | None,
    typer.Option(help="People who are inside after this many seconds are unfinished.", rich_help_panel=OF_RUNS),
]


def read_place(
    name: str,
    *,
    exits: Sequence[str] | None = None,
    unit: str | None = None,
    people: int | None = None,
    radius: str | None = None,
    speed: str | None = None,
    starts: Path | None = None,
    time_limit: float | None = None,
) -> Scenario:
    """Return the place that a command line names, with its people changed as the options say; None = as they are.

    Parameters
    ----------
    name : a scenario that ships with crowd_env, a scenario file, or a floor plan in a file of any kind that is read.
    exits : of a floor plan, in the forms of `crowd_env.geometry.parsing.parse_exit`.
    unit : of a floor plan, of ``exits`` and of ``starts``.
    people : number of people.
    radius : m, as "0.2" or "0.2,0.25".
    speed : m/s, the desired one, in the same forms.
    starts : CSV file of starting positions.
    time_limit : s.

    Raises
    ------
    ValueError
        If there is no such place, something in its file is wrong, or an option does not suit it.
    """
    crowd = people_options(people, radius, speed, starts, unit)
    timing: dict[str, Any] = {} if time_limit is None else {"time_limit": time_limit}
    options = plan_options(name, exits, unit)
    if kind_of_place(name) == "plan":
        plan = read_plan(name, **options)
        return scenario_on(plan, people_on(plan, **crowd), **timing)
    return changed_place(name, crowd, **timing)


def changed_place(name: str, people: Mapping[str, Any], **options: Any) -> Scenario:
    """Return a scenario that ships or stands in a file, with the fields of its population that ``people`` names.

    ``options`` are those of `make_scenario`.
    """
    population = {"population": make_scenario(name).population.changed(**people)} if people else {}
    return make_scenario(name, **options, **population)


def people_options(
    people: int | None, radius: str | None, speed: str | None, starts: Path | None, unit: str | None
) -> dict[str, Any]:
    """Return the fields of a `Population` that options stand for; they are those of `read_place`.

    Raises
    ------
    ValueError
        If an option is not understood, the file of starts cannot be read, or it holds another number of people than --n says.
    """
    recorded = None if starts is None else unit_in_meters(unit) * read_starts(starts)
    if recorded is not None and people not in (None, len(recorded)):
        raise ValueError(f"--n is {people}, but {starts} holds {len(recorded)} positions")
    fields: dict[str, Any] = {} if recorded is None else {"starts": recorded, "start_region": None}
    number = people if recorded is None else len(recorded)
    if number is not None:
        fields["people"] = number
    if radius is not None:
        fields["radius"] = _range(radius, "--radius")
    if speed is not None:
        fields["desired_speed"] = _range(speed, "--speed")
    return fields


def plan_options(name: str, exits: Sequence[str] | None, unit: str | None) -> dict[str, Any]:
    """Return the options of `make_scenario` that --exit and --unit stand for.

    Raises
    ------
    ValueError
        If one is given and the place is no floor plan in a file.
    """
    if kind_of_place(name) != "plan":
        if exits:
            raise ValueError(f"{name} has its own exits; --exit is for floor plans in files")
        if unit is not None:
            raise ValueError(f"{name} is in meters; --unit is for floor plans in files")
    return {**({"exits": list(exits)} if exits else {}), **({} if unit is None else {"unit": unit})}


def _range(text: str, option: str) -> Uniform:
    """Read "0.2,0.25" or "0.2"."""
    try:
        bounds = [float(part) for part in text.split(",")]
    except ValueError:
        bounds = []
    if len(bounds) not in (1, 2):
        raise ValueError(f"{option} is {text!r}; it must be one number or two separated by a comma, such as 0.2,0.25")
    return Uniform(bounds[0], bounds[-1])
