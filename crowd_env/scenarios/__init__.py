"""The scenarios that ship with crowd_env, by name, and scenarios of files."""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import fields
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal

from crowd_env.core.checks import NAMES, Plain, of_another_kind, refuse
from crowd_env.core.files.foreign import require_file
from crowd_env.scenarios.file import SUFFIXES, Plan, read_scenario, scenario_of
from crowd_env.scenarios.floor_plan import scenario_from_plan
from crowd_env.scenarios.generated import draw_place
from crowd_env.scenarios.plans.reading import is_plan, split_level
from crowd_env.scenarios.scenario import COMMON, Scenario, changed_place
from crowd_env.scenarios.shipped import office, places
from crowd_env.scenarios.shipped.theatre import theatre
from crowd_env.scenarios.storeys import building_in, has_storeys

# Name -> function that makes the scenario; its keyword arguments are the scenario's options.
SCENARIOS: dict[str, Callable[..., Scenario]] = {
    "room-v0": places.room,
    "lin-room-v0": places.lin_room,
    "theatre-v0": theatre,
    "two-exit-hall-v0": places.two_exit_hall,
    "bottleneck-v0": places.bottleneck,
    "pillar-v0": places.pillar,
    "l-corridor-v0": places.l_corridor,
    "t-junction-v0": places.t_junction,
    "counter-flow-v0": places.counter_flow,
    "crossing-v0": places.crossing,
    "footbridge-v0": places.footbridge,
    "classroom-v0": places.classroom,
    "supermarket-v0": places.supermarket,
    "stadium-sector-v0": places.stadium_sector,
    "floor-v0": places.floor,
    "building-v0": office.building,
    "generated-v0": draw_place,
}
NAMES["scenario"] = SCENARIOS
# Name of a task -> its place; `crowd_env.envs.tasks`, which lies above, fills it.
PLACES_OF_TASKS: dict[str, Callable[[], Scenario]] = {}


_OF_PLAN = (
    *(scenario_from_plan.__kwdefaults__ or ()),
    *(one.name for one in fields(Scenario) if one.name not in ("geometry", "population", "time_limit")),
    "cohorts",
)


def make_scenario(scenario: str | Path | Plain | Scenario, **options: Any) -> Scenario:
    """Return a scenario by its name, or from a file, made with ``options``; or the scenario itself, perhaps with other people.

    Parameters
    ----------
    scenario : a name in ``SCENARIOS``, or of a task, for its place; a scenario file (.toml or .json); a floor plan (WKT,
        GeoJSON, DXF, the SQLite files of JuPedSim, scenarios of Vadere) with the options of
        `crowd_env.scenarios.floor_plan.scenario_from_plan`; or a table ``{"name": "room-v0", "side": 8.0}`` of a name or
        file and its options.

    Raises
    ------
    ValueError
        If the name or an option is unknown (the message lists the known ones), or the content of a file is wrong.
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
        return scenario if people is None else changed_place(scenario, {"people": people})
    if not isinstance(scenario, str | Path):
        refuse("scenario", scenario, "the name of a scenario, its file or a Scenario")
    kind = kind_of_place(scenario)
    of_kind = {"file": COMMON, "task": COMMON, "plan": _OF_PLAN}
    known = [*(of_kind[kind] if kind in of_kind else options_of(str(scenario)))]
    unknown = [option for option in options if option not in known]
    if unknown:
        near = get_close_matches(unknown[0], known, n=1)
        said = f"did you mean {near[0]!r}? known" if near else "known"
        raise ValueError(f"{scenario} has no option {unknown[0]!r}; {said}: {', '.join(known)}")
    if kind in ("file", "task"):
        place = read_scenario(Path(scenario)) if kind == "file" else PLACES_OF_TASKS[str(scenario)]()
        return changed_place(place, options)
    if kind == "plan" and options.get("level") is None and has_storeys(scenario):
        return _on_all_levels(Path(scenario), options)
    if kind == "plan" and "cohorts" in options:  # as a project has them
        path, level = split_level(scenario)
        geometry = {one.name: options.pop(one.name) for one in fields(Plan) if one.name in options}
        return scenario_of({"geometry": {"file": path.name, "level": level, **geometry}, **options}, path)
    return scenario_from_plan(scenario, **options) if kind == "plan" else SCENARIOS[str(scenario)](**options)


def _on_all_levels(path: Path, options: dict[str, Any]) -> Scenario:
    """Return the building that a floor plan of several levels is."""
    for key in ("regions", "obstacles", "thin_walls", "doors"):
        if options.get(key):
            raise ValueError(f"{path}: {key} belong to one level; crowd-env plan {path} --save writes a file for them")
    how = {key: options.pop(key) for key in ("exits", "unit", "layers", "origin") if options.get(key)}
    building = building_in(path, **how)
    for note in building.head:
        warnings.warn(note, stacklevel=3)
    crowd = {key: options.pop(key) for key in ("people", "population") if options.get(key) is not None}
    content = {key: one for key, one in building.content.items() if "cohorts" not in options or key != "population"}
    return changed_place(scenario_of({**content, **options}, path), crowd)


def kind_of_place(scenario: str | Path) -> Literal["name", "task", "file", "plan"]:
    """Return the kind of place that a text names: a shipped scenario, that of a task, a scenario file, or a floor plan.

    Raises
    ------
    ValueError
        If it is none of them; the message lists the known names.  Or if it is a pipe or a device.
    """
    if str(scenario) in SCENARIOS:
        return "name"
    if str(scenario) in PLACES_OF_TASKS:
        return "task"
    require_file(Path(scenario))
    if str(scenario) and is_plan(Path(scenario)):  # the path of no name is the folder here
        return "plan"
    if Path(scenario).suffix.lower() in SUFFIXES:
        return "file"
    near = get_close_matches(str(scenario), [*SCENARIOS, *PLACES_OF_TASKS], n=1, cutoff=0.8)
    said = f"; did you mean {near[0]!r}?" if near else of_another_kind(scenario, "scenario", "task")
    raise ValueError(
        f"unknown scenario {str(scenario)!r}; known: {', '.join(SCENARIOS)}, a task of crowd-env list, a scenario file "
        f"(.toml, .json) or a floor plan (.wkt, .geojson, .dxf, .sqlite, .scenario){said}"
    )


def options_of(name: str) -> Mapping[str, Any]:
    """Return name -> default of the options of a scenario that ships with crowd_env; None = set by the place."""
    return getattr(SCENARIOS[name], "__kwdefaults__", None) or {}
