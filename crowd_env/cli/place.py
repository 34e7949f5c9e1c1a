"""What a command is about: a place, the people there, the physics between them and the routes that they take."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from crowd_env.core.arrays.state import MOTIVATION
from crowd_env.core.checks import flag, known
from crowd_env.core.files.own import names_own, own_or_name
from crowd_env.physics import ContactScheme, make_scheme
from crowd_env.scenarios import SCENARIOS, kind_of_place, make_scenario
from crowd_env.scenarios.floor_plan import people_on, scenario_on
from crowd_env.scenarios.plans.reading import read_plan, split_level
from crowd_env.scenarios.plans.units import unit_in_meters
from crowd_env.scenarios.population import DRAWN, TABLE_4, Uniform
from crowd_env.scenarios.scenario import Scenario
from crowd_env.scenarios.starts import read_starts
from crowd_env.scenarios.titles import with_manner

if TYPE_CHECKING:
    from crowd_env.cli.led import Led

# Names of --set that change people, and what they change in a population.
_DRAWN = {"speed": "desired_speed", **{name: name for name in (*DRAWN, *MOTIVATION) if name != "desired_speed"}}
_RUNNING = 4.0  # m/s
_SWITCHES = {"yes": True, "no": False, "true": True, "false": False}


class Setting(NamedTuple):
    """What a command line asks to be run."""

    place: Scenario
    scheme: ContactScheme
    options: dict[str, Any]  # of a rollout: dt, max_drive, strategy, rules
    led: "Led | None" = None  # by a policy


def place_of(given: Mapping[str, Any]) -> Setting:
    """Return what the options of a command stand for.

    Parameters
    ----------
    given : the options by their names; those that are missing, or None, are as the place or the physics says.

    Raises
    ------
    ValueError
        If there is no such place, something in its file is wrong, or an option does not suit it.
    """
    changes = split_changes(given.get("set"))
    named = given.get("physics") or "nsm2"
    scheme = make_scheme(own_or_name("--physics", named))
    owners = {
        "the crowd": ("outline", *_DRAWN),
        f"the physics {named}": ("dt", "max_drive", *(one.name for one in fields(scheme) if one.init)),
        "the routing": ("signs",),
    }
    for name in changes:
        if not any(name in names for names in owners.values()):
            there = "; ".join(f"{who} has {', '.join(names)}" for who, names in owners.items())
            raise ValueError(f"--set {name}: nothing has this name; {there}")
    drawn, of_physics, _ = ({name: changes[name] for name in names if name in changes} for names in owners.values())
    outline, social = drawn.pop("outline", None), of_physics.pop("social", None)
    of_place = {name: given.get(name) for name in ("unit", "people", "starts", "time_limit", "crowd")}
    found = read_place(given.get("scenario") or "room-v0", exits=given.get("exit"), drawn=drawn, **of_place)
    place = with_manner(found, given.get("crowd"), outline)
    numbers = {name: _value(text) for name, text in of_physics.items()}
    options: dict[str, Any] = {"strategy": place.strategy_of_run(given.get("routing")), "dt": numbers.pop("dt", None)}
    options |= {name: numbers.pop(name) for name in ("max_drive",) if name in numbers}
    options["rules"] = flag("--set signs", _value(changes.get("signs", "yes")))
    led = None
    if given.get("policy") is not None:
        from crowd_env.cli.led import led_by

        led = led_by(given["policy"], place, given.get("crowd"))
        place = led.place
    return Setting(place, replace(make_scheme(scheme, social), **numbers), options, led)


def read_place(
    name: str,
    *,
    exits: Sequence[str] | None = None,
    unit: str | None = None,
    people: int | None = None,
    starts: str | Path | None = None,
    time_limit: float | None = None,
    drawn: Mapping[str, str] | None = None,
    crowd: str | None = None,
) -> Scenario:
    """Return the place that a command line names, with its people changed as the options say; None = as they are.

    Parameters
    ----------
    name : a scenario that ships with crowd_env, a scenario file, or a floor plan in a file of any kind that is read.
    exits : of a floor plan, in the forms of `crowd_env.geometry.parsing.parse_exit`.
    unit : of a floor plan, of ``exits`` and of ``starts``.
    people : number of people.
    starts : CSV file of starting positions.
    time_limit : s.
    drawn : radius, speed and other properties of people, each as "0.2" or "0.2,0.25".
    crowd : manner of the people; competitive ones on a floor plan are those of the papers, `TABLE_4`.

    Raises
    ------
    ValueError
        If there is no such place, something in its file is wrong, or an option does not suit it.
    """
    fields = people_options(people, starts, unit, drawn)
    timing: dict[str, Any] = {} if time_limit is None else {"time_limit": time_limit}
    options = plan_options(name, exits, unit)
    if kind_of_place(name) == "plan":
        plan = read_plan(name, **options)
        return scenario_on(plan, people_on(plan, **{**(TABLE_4 if crowd == "competitive" else {}), **fields}), **timing)
    population = {"population": make_scenario(name).population.changed(**fields)} if fields else {}
    return make_scenario(name, **timing, **population)


def people_options(
    people: int | None, starts: str | Path | None, unit: str | None, drawn: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """Return the fields of a `Population` that options stand for; they are those of `read_place`.

    Raises
    ------
    ValueError
        If an option is not understood, or the file of starts cannot be read or holds another number of people.
    """
    recorded = None if starts is None else unit_in_meters(unit) * read_starts(starts)
    if recorded is not None and people not in (None, len(recorded)):
        raise ValueError(f"--people is {people}, but {starts} holds {len(recorded)} positions")
    found: dict[str, Any] = {} if recorded is None else {"starts": recorded, "start_region": None}
    number = people if recorded is None else len(recorded)
    if number is not None:
        found["people"] = number
    for name, text in (drawn or {}).items():
        if name == "speed" and not 0.0 < _range(name, text).high <= _RUNNING:
            warnings.warn(f"--set speed={text} is in m/s: people walk at 1.34 and run at 3 to 4", stacklevel=2)
        found[_DRAWN[known("property of people", name, _DRAWN, "--set: ")]] = _range(name, text)
    return found


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


def files_of(given: Mapping[str, Any]) -> dict[str, Path]:
    """Return the files that options name, by the names of the options."""
    named = {} if given.get("scenario") in SCENARIOS else {"scenario": given["scenario"]}
    named |= {"starts": given["starts"]} if given.get("starts") is not None else {}
    named |= {"physics": given["physics"].rpartition(":")[0]} if names_own(given.get("physics", "")) else {}
    return {name: split_level(file)[0] for name, file in named.items()}


def split_changes(texts: Sequence[str] | None) -> dict[str, str]:
    """Return what --set changes, by names.

    Raises
    ------
    ValueError
        If one is no NAME=VALUE, or a name is set twice.
    """
    found: dict[str, str] = {}
    for text in texts or ():
        name, sign, value = (part.strip() for part in text.partition("="))
        if not (name and sign and value):
            raise ValueError(f"--set {text}: this must be NAME=VALUE, such as speed=1.5")
        if name in found:
            raise ValueError(f"--set {text}: {name} is set twice")
        found[name] = value
    return found


def _value(text: str) -> Any:
    """Return the number, the switch or the text that is written."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return _SWITCHES.get(text.lower(), text)


def _range(name: str, text: str) -> Uniform:
    """Read "0.2,0.25" or "0.2"."""
    try:
        bounds = [float(part) for part in text.split(",")]
    except ValueError:
        bounds = []
    if len(bounds) not in (1, 2):
        raise ValueError(f"--set {name}={text}: this must be one number or two separated by a comma, such as 0.2,0.25")
    return Uniform(bounds[0], bounds[-1])
