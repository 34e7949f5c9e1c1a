"""The options that commands share: what they say of a place, the people there, the physics and the routes."""

import json
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import MISSING, dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from crowd_env.analysis.results.config import require_data
from crowd_env.analysis.results.folder import CONFIG
from crowd_env.core.arrays.state import PERSONAL
from crowd_env.core.behaviors.headway import Manner
from crowd_env.core.checks import Plain, at, flag, known
from crowd_env.core.files.atomic import legible
from crowd_env.core.files.own import names_own, own_or_name
from crowd_env.envs.settings import Routing
from crowd_env.envs.tasks.task import named_task
from crowd_env.physics import make_scheme
from crowd_env.physics.settings import Physics
from crowd_env.scenarios import PLACES_OF_TASKS, SCENARIOS, kind_of_place, make_scenario, options_of
from crowd_env.scenarios.distributions import LAWS, Distribution, Uniform
from crowd_env.scenarios.file import read_content, read_scenario
from crowd_env.scenarios.floor_plan import people_on, scenario_on
from crowd_env.scenarios.plans.reading import read_plan, split_level
from crowd_env.scenarios.plans.units import unit_in_meters
from crowd_env.scenarios.population import DRAWN, TABLE_4
from crowd_env.scenarios.scenario import COMMON, Scenario, changed_place
from crowd_env.scenarios.sections import Section, parse_section
from crowd_env.scenarios.starts import read_starts
from crowd_env.scenarios.storeys import has_storeys
from crowd_env.scenarios.titles import with_manner

if TYPE_CHECKING:
    from crowd_env.agents.evaluation.entries import Entry

# Names of --set that change pedestrians, and what they change in a population.
_DRAWN = {"speed": "desired_speed", **{name: name for name in (*DRAWN, *PERSONAL) if name != "desired_speed"}}
_RUNNING = 4.0  # m/s
_SWITCHES = {"yes": True, "no": False, "true": True, "false": False}
_STORED = {"crowd": "walking", "physics": "scheme"}  # name in a config -> option, where it is another


@dataclass(frozen=True)
class CrowdOptions:
    """Options of a command by their names on the command line; None = as the place says.

    Parameters
    ----------
    scenario : a scenario that ships with crowd_env, a scenario file, or a floor plan in a file.
    exit : exits of a floor plan, in the forms of `crowd_env.geometry.parsing.parse_exit`.
    unit : of a floor plan, of ``exit`` and of ``starts``.
    layers : of a DXF drawing, each ROLE=NAME,NAME.
    section : lines at which people are counted, each x1,y1,x2,y2 or NAME=x1,y1,x2,y2.
    people : number of pedestrians.
    starts : CSV file of starting positions.
    walking : manner of walking, or a table of its parameters as JSON; competitive pedestrians on a floor plan are those of
        the papers, `TABLE_4`.
    routing : strategy, route or exit.
    policy : what decides how pedestrians walk.
    scheme : contact scheme.
    set : changes, each NAME=VALUE.
    time_limit : s.
    """

    scenario: str = "room-v0"
    exit: Sequence[str] | None = None
    unit: str | None = None
    layers: Sequence[str] | None = None
    section: Sequence[str] | None = None
    people: int | None = None
    starts: str | Path | None = None
    walking: str | None = None
    routing: str | None = None
    policy: str | None = None
    scheme: str = "nsm2"
    set: Sequence[str] | None = None
    time_limit: float | None = None

    @classmethod
    def among(cls, given: Plain, **more: Any) -> "CrowdOptions":
        """Return the options among what a command was given, by their names; a task has a scheme of its own."""
        found = {one.name: value for one in fields(cls) if (value := given.get(one.name)) is not None} | more
        task = named_task(found["scenario"])
        return cls(**found if task is None else {"scheme": task.scheme, **found})

    @classmethod
    def of_config(cls, arguments: Plain) -> "CrowdOptions":
        """Return the options that the arguments of a config hold.

        Raises
        ------
        ValueError
            If one is not what the option takes.
        """
        names = {one.name for one in fields(cls)}
        given = {name: value for name, value in named_now(arguments).items() if name in names}
        require_data(f"arguments of {CONFIG}", cls, given)
        return cls(**given)

    def files(self) -> dict[str, Path]:
        """Return the files that the options name, by the names of the options."""
        law = self.scheme.rpartition(":")[0] if names_own(self.scheme) else None
        named = {
            "scenario": None if self.scenario in (*SCENARIOS, *PLACES_OF_TASKS) else self.scenario,
            "starts": self.starts,
            "scheme": law,
        }
        return {name: split_level(file)[0] for name, file in named.items() if file is not None}

    def drawing(self) -> Path | None:
        """Return the drawing that a scenario file names, if it is one and names one."""
        file = Path(self.scenario)
        if self.scenario in (*SCENARIOS, *PLACES_OF_TASKS) or kind_of_place(file) != "file":
            return None
        with suppress(ValueError):
            geometry = read_content(file).get("geometry")
            if isinstance(geometry, Mapping) and isinstance(geometry.get("file"), str) and geometry["file"]:
                return split_level(file.parent / geometry["file"])[0]
        return None


def named_now(arguments: Plain) -> Plain:
    """Return the arguments of a config by the names of the options."""
    return {_STORED.get(name, name): value for name, value in arguments.items()}


class Setting(NamedTuple):
    """What the library takes of the options of a command."""

    place: Scenario
    physics: Physics
    routing: Routing
    led: "Entry | None" = None  # the policy that leads


def setting_of(options: CrowdOptions) -> Setting:
    """Return what the options of a command stand for.

    Raises
    ------
    ValueError
        If there is no such place, something in its file is wrong, or an option does not suit it.
    """
    changes = split_changes(options.set)
    law = make_scheme(own_or_name("--scheme", options.scheme))
    owners = {
        "the crowd": ("outline", "balance", *_DRAWN),
        f"the scheme {options.scheme}": ("dt", "max_drive", *(one.name for one in fields(law) if one.init)),
        "the routing": ("signs",),
    }
    if kind_of_place(options.scenario) == "name":
        owners[f"the place {options.scenario}"] = (*_own_options(options.scenario),)
    in_file = kind_of_place(options.scenario) == "file"
    for name in changes:
        if not (in_file and "." in name) and not any(name in names for names in owners.values()):
            there = "; ".join(f"{who} has {', '.join(names)}" for who, names in owners.items())
            raise ValueError(f"--set {name}: nothing has this name; {there}")
    _, of_law, *_ = owners.values()
    numbers = {name: value_of(changes[name]) for name in of_law if name in changes and name != "social"}
    law = make_scheme(law, changes.get("social"))
    step, drive = numbers.pop("dt", None), numbers.pop("max_drive", None)
    place, led = read_place(options), None
    task = named_task(options.scenario)
    way = task.rule if task is not None and options.routing is None else options.routing and legible(options.routing)
    routing = Routing(place.strategy_of_run(way), flag("--set signs", value_of(changes.get("signs", "yes"))))
    names = ("people", "walking", "routing", "set", "starts", "time_limit")
    others = [name for name in names if getattr(options, name) is not None]
    if task is not None and (others := others + ["scheme"] * (law.info.name != task.scheme)):
        said = f"{task.id} with another {', '.join(others)}: its figures do not stand beside those of the task"
        warnings.warn(said, stacklevel=2)
    if options.policy is not None:
        from crowd_env.agents.evaluation.entries import make_entries

        (led,) = make_entries([options.policy], place)
        place = led.suited(place) if options.walking is None else place
    return Setting(place, Physics(replace(law, **numbers), step, max_drive=drive), routing, led)


def read_place(options: CrowdOptions) -> Scenario:
    """Return the place that a command names, its people changed as the options say.

    Raises
    ------
    ValueError
        If there is no such place, something in its file is wrong, or an option does not suit it.
    """
    changes = split_changes(options.set)
    people = people_options(options, {name: changes[name] for name in _DRAWN if name in changes})
    timing: dict[str, Any] = {} if options.time_limit is None else {"time_limit": options.time_limit}
    of_plan = plan_options(options)
    if kind_of_place(options.scenario) == "plan" and has_storeys(options.scenario):
        place = make_scenario(options.scenario, **of_plan, **timing)
        place = changed_place(place, {"population": place.population.changed(**people)}) if people else place
    elif kind_of_place(options.scenario) == "plan":
        plan = read_plan(options.scenario, **of_plan)
        usual = TABLE_4 if options.walking == "competitive" else {}
        place = scenario_on(plan, people_on(plan, **{**usual, **people}), **timing)
    else:
        population = _made(options, changes).population.changed(**people) if people else None
        place = _made(options, changes, **timing, **({"population": population} if population else {}))
    place = replace(
        place,
        balance=changes.get("balance", place.balance),
        sections=place.sections + sections_of(options),
    )
    return with_manner(place, walking_of(options.walking), changes.get("outline"))


def _own_options(name: str) -> list[str]:
    """Return the numbers of a shipped place that are its alone, such as the width of its door."""
    return [key for key in options_of(name) if key not in COMMON]


def _made(options: CrowdOptions, changes: Mapping[str, str], **given: Any) -> Scenario:
    """Return a place that is no floor plan, with what changes say of its options, or of keys of its file."""
    if kind_of_place(options.scenario) == "file":
        own = {name: value_of(text) for name, text in changes.items() if "." in name}
        return changed_place(read_scenario(Path(options.scenario), own), given)
    own = {}
    if options.scenario in SCENARIOS:
        own = {name: value_of(changes[name]) for name in _own_options(options.scenario) if name in changes}
    return make_scenario(options.scenario, **own, **given)


def sections_of(options: CrowdOptions) -> tuple[Section, ...]:
    """Return the lines of --section.

    Raises
    ------
    ValueError
        If one is not understood.
    """
    texts, unit = options.section or (), unit_in_meters(options.unit)
    return tuple(parse_section(text, k, unit) for k, text in enumerate(texts, 1))


def walking_of(text: str | None) -> Manner | None:
    """Return the manner that --walking names, or the table of its parameters that it holds as JSON.

    Raises
    ------
    ValueError
        If the table cannot be read.
    """
    if text is None or not text.startswith("{"):
        return text
    with at(f'--walking {text}: this must be a name or a table such as {{"time_gap": 0.7}}'):
        return dict(json.loads(text))


def people_options(options: CrowdOptions, drawn: Mapping[str, str]) -> Plain:
    """Return the fields of a `Population` that options stand for.

    Parameters
    ----------
    drawn : radius, speed and other properties of pedestrians, each as "0.2", "0.2,0.25" or "lognormal,5,0.5,30".

    Raises
    ------
    ValueError
        If an option is not understood, or the file of starts cannot be read or holds another number of people.
    """
    found: dict[str, Any] = {} if options.people is None else {"people": options.people}
    if options.starts is not None:
        starts = unit_in_meters(options.unit) * read_starts(options.starts)
        if options.people not in (None, len(starts)):
            raise ValueError(f"--people is {options.people}, but {options.starts} holds {len(starts)} positions")
        found = {"starts": starts, "start_region": None, "people": len(starts)}
    for name, text in drawn.items():
        field = _DRAWN[known("property of people", name, _DRAWN, "--set: ")]
        found[field] = _drawn(name, text)
        if name == "speed" and not 0.0 < found[field].high <= _RUNNING:
            warnings.warn(f"--set speed={text} is in m/s: people walk at 1.34 and run at 3 to 4", stacklevel=2)
    return found


def plan_options(options: CrowdOptions) -> dict[str, Any]:
    """Return the options of `make_scenario` that --exit, --unit and --layers stand for.

    Raises
    ------
    ValueError
        If one is given and the place is no floor plan in a file.
    """
    name, exits, unit, layers = options.scenario, options.exit, options.unit, options.layers
    if kind_of_place(name) != "plan":
        if exits:
            raise ValueError(f"{name} has its own exits; --exit is for floor plans in files")
        if unit is not None:
            raise ValueError(f"{name} is in meters; --unit is for floor plans in files")
        if layers:
            raise ValueError(f"{name} has no layers; --layers is for floor plans in files")
    chosen = {role: names.split(",") for role, names in split_changes(layers, "--layers", "exits=NAME,NAME").items()}
    return {key: value for key, value in (("exits", exits), ("unit", unit), ("layers", chosen)) if value}


def split_changes(texts: Sequence[str] | None, option: str = "--set", such_as: str = "speed=1.5") -> dict[str, str]:
    """Return what the texts of an option say, by names.

    Raises
    ------
    ValueError
        If one is no NAME=VALUE, or a name is set twice.
    """
    found: dict[str, str] = {}
    for text in texts or ():
        name, sign, value = (part.strip() for part in text.partition("="))
        if not (name and sign and value):
            raise ValueError(f"{option} {text}: this must be NAME=VALUE, such as {such_as}")
        if name in found:
            raise ValueError(f"{option} {text}: {name} is set twice")
        found[name] = value
    return found


def value_of(text: str) -> Any:
    """Return the number, the switch or the text that is written."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return _SWITCHES.get(text.lower(), text)


def _drawn(name: str, text: str) -> Distribution:
    """Read "0.2", "0.2,0.25", or a distribution and its numbers in their order: "lognormal,5,0.5,30"."""
    first, *rest = text.split(",")
    kind, numbers = (LAWS[first], rest) if first in LAWS else (Uniform, [first, *(rest or [first])])
    try:
        given = [float(one) for one in numbers]
    except ValueError:
        given = []
    needed = [one.name for one in fields(kind) if one.default is MISSING]
    if not len(needed) <= len(given) <= len(fields(kind)):
        laws = "; ".join(f"{word},{','.join(one.name for one in fields(law))}" for word, law in LAWS.items())
        raise ValueError(
            f"--set {name}={text}: this must be one number, two such as 0.2,0.25, or a distribution: {laws}"
        )
    with at(f"--set {name}={text}"):
        return kind(*given)
