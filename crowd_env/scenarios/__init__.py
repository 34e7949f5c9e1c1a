"""The scenarios that ship with crowd_env, by name; most are files in ``data``, written like anyone else's."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal

from crowd_env.core.checks import refuse
from crowd_env.scenarios.file.reading import SUFFIXES, ScenarioFile
from crowd_env.scenarios.floor_plan import scenario_from_plan
from crowd_env.scenarios.plans.reading import PLANS, is_plan
from crowd_env.scenarios.scenario import Scenario
from crowd_env.scenarios.shipped.rooms import lin_room, room
from crowd_env.scenarios.shipped.theatre import theatre


def _data(name: str) -> ScenarioFile:
    return ScenarioFile(Path(__file__).with_name("data") / f"{name}.toml")


# Name -> what makes the scenario: a function whose keyword arguments are the scenario's options, or a file.
SCENARIOS: dict[str, Callable[..., Scenario]] = {
    "room-v0": room,
    "lin-room-v0": lin_room,
    "theatre-v0": theatre,
    "two-exit-hall-v0": _data("two-exit-hall-v0"),
    "bottleneck-v0": _data("bottleneck-v0"),
    "pillar-v0": _data("pillar-v0"),
    "l-corridor-v0": _data("l-corridor-v0"),
    "t-junction-v0": _data("t-junction-v0"),
    "counter-flow-v0": _data("counter-flow-v0"),
    "crossing-v0": _data("crossing-v0"),
    "classroom-v0": _data("classroom-v0"),
    "supermarket-v0": _data("supermarket-v0"),
    "stadium-sector-v0": _data("stadium-sector-v0"),
    "floor-v0": _data("floor-v0"),
}


def make_scenario(scenario: str | Path | Mapping[str, Any] | Scenario, **options: Any) -> Scenario:
    """Return a scenario by its name, or from a file, made with ``options``; or the scenario itself, perhaps with other people.

    Parameters
    ----------
    scenario : a name in ``SCENARIOS``; a scenario file (.toml or .json); or a floor plan (WKT, GeoJSON, DXF, the SQLite files
        of JuPedSim, scenarios of Vadere), whose options are those of `crowd_env.scenarios.floor_plan.scenario_from_plan`; or
        a table ``{"name": "room-v0", "side": 8.0}`` of a name or file and its options.

    Raises
    ------
    ValueError
        If the name or an option is unknown (the message lists the known ones), or something in a file is wrong.
    """
    if isinstance(scenario, Mapping):
        if "name" not in scenario:
            raise ValueError(f"scenario: key 'name' is missing; known scenarios: {', '.join(SCENARIOS)}")
        options = {**{name: value for name, value in scenario.items() if name != "name"}, **options}
        scenario = scenario["name"]
    if isinstance(scenario, Scenario):
        people = options.pop("people", None)
        if options:
            raise ValueError(f"options {', '.join(options)} need a scenario name, not a finished scenario")
        if people is None:
            return scenario
        return replace(scenario, population=scenario.population.changed(people=people))
    if not isinstance(scenario, str | Path):
        refuse("scenario", scenario, "the name of a scenario, its file or a Scenario")
    kind = kind_of_place(scenario)
    if kind == "file":
        return ScenarioFile(Path(scenario))(**options)
    known = tuple(scenario_from_plan.__kwdefaults__ or ()) if kind == "plan" else tuple(options_of(str(scenario)))
    unknown = [option for option in options if option not in known]
    if unknown:
        near = get_close_matches(unknown[0], known, n=1)
        said = f"did you mean {near[0]!r}? known" if near else "known"
        raise ValueError(f"{scenario} has no option {unknown[0]!r}; {said}: {', '.join(known)}")
    return scenario_from_plan(scenario, **options) if kind == "plan" else SCENARIOS[str(scenario)](**options)


def kind_of_place(scenario: str | Path) -> Literal["name", "file", "plan"]:
    """Return what a text names: a scenario that ships with crowd_env, a scenario file, or a floor plan in a file.

    Raises
    ------
    ValueError
        If it is none of them; the message lists the known names.
    """
    if str(scenario) in SCENARIOS:
        return "name"
    if is_plan(Path(scenario)):
        return "plan"
    if Path(scenario).suffix.lower() in SUFFIXES:
        return "file"
    raise ValueError(
        f"unknown scenario {str(scenario)!r}; known: {', '.join(SCENARIOS)}, or the path of a scenario file (.toml or .json) "
        f"or of a floor plan: {PLANS}"
    )


def options_of(name: str) -> Mapping[str, Any]:
    """Return name -> default of the options of a scenario that ships with crowd_env; None = as its file says."""
    make = SCENARIOS[name]
    return make.options if isinstance(make, ScenarioFile) else getattr(make, "__kwdefaults__", None) or {}


def about(name: str) -> tuple[str, str]:
    """Return title and reference of a scenario that ships with crowd_env."""
    make = SCENARIOS[name]
    if isinstance(make, ScenarioFile):
        return make.about()
    scenario = make()
    return scenario.title, scenario.reference
