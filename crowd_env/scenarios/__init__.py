"""The scenarios that ship with crowd_env, by name; most are files in ``data``, written like anyone else's."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from crowd_env.checks import refuse
from crowd_env.scenarios.file.reading import SUFFIXES, ScenarioFile
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


def make_scenario(scenario: str | Path | Scenario, **options: Any) -> Scenario:
    """Return a scenario by its name, or from a file (.toml or .json), made with ``options``; or the scenario itself.

    Raises
    ------
    ValueError
        If the name or an option is unknown (the message lists the known ones), or something in a file is wrong.
    """
    if isinstance(scenario, Scenario):
        if options:
            raise ValueError(f"options {', '.join(options)} need a scenario name, not a finished scenario")
        return scenario
    if not isinstance(scenario, str | Path):
        refuse("scenario", scenario, "the name of a scenario, its file or a Scenario")
    if is_file(scenario):
        return ScenarioFile(Path(scenario))(**options)
    name = str(scenario)
    if name not in SCENARIOS:
        raise ValueError(f"unknown scenario {name!r}; known: {', '.join(SCENARIOS)}, or a file (.toml or .json)")
    known = options_of(name)
    unknown = [option for option in options if option not in known]
    if unknown:
        raise ValueError(f"{name} has no option {unknown[0]!r}; known: {', '.join(known)}")
    return SCENARIOS[name](**options)


def is_file(scenario: str | Path) -> bool:
    """Return whether this is the path of a scenario file, not the name of a scenario."""
    return Path(scenario).suffix.lower() in SUFFIXES


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
