"""Scenarios in files, TOML or JSON with the same keys: lengths in m, times in s, speeds in m/s, masses in kg.

The keys are the fields of `crowd_env.scenarios.file.tables.ScenarioTable`, and ``docs/scenarios.md`` lists them.  Nothing is
ignored: an unknown key is an error that names the file, the table and the key that was probably meant.
"""

import json
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crowd_env.core.arrays.outline import room_of
from crowd_env.core.files.foreign import read_text
from crowd_env.scenarios.file.errors import at, nearest, validate
from crowd_env.scenarios.file.expressions import COMMON, fill
from crowd_env.scenarios.floor_plan import read_starts
from crowd_env.scenarios.groups import Groups, People
from crowd_env.scenarios.population import Population, population_of
from crowd_env.scenarios.scenario import Scenario
from crowd_env.scenarios.starts import check_starts

if TYPE_CHECKING:  # pydantic is loaded when a file is read
    from crowd_env.scenarios.file.tables import Option, ScenarioTable

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

SUFFIXES = (".toml", ".json")

_DEEPEST = 20  # tables and lists within each other


@dataclass(frozen=True)
class ScenarioFile:
    """A scenario in a file; calling it with options makes the scenario.

    Parameters
    ----------
    path : TOML or JSON.
    """

    path: Path

    @property
    def options(self) -> dict[str, Any]:
        """Name -> default of everything that may be set; None = as the file says."""
        return {**{name: one.default for name, one in self.declared().items()}, **dict.fromkeys(COMMON)}

    def declared(self) -> dict[str, "Option"]:
        """Return the options that the file declares, with their defaults and bounds."""
        return self._options(self._read())

    def about(self) -> tuple[str, str]:
        """Return title and reference alone, without making the scenario."""
        content = self._read()
        table = self._table(content, {name: one.default for name, one in self._options(content).items()})
        return table.title, table.reference

    def __call__(self, **options: Any) -> Scenario:
        """Return the scenario, checked: every route leads out, and the people fit.

        Parameters
        ----------
        people : number of people, shared out in proportion among groups.
        time_limit, blocked_after : s.
        target, population : see `Scenario`.
        **options : numbers that the file declares.

        Raises
        ------
        ValueError
            If the file cannot be read, something in it is wrong or unknown, or an option is unknown or out of range.
        """
        content = self._read()
        declared = self._options(content)
        for name in options:
            if name not in (*declared, *COMMON):
                raise ValueError(f"{self.path.stem} has no option {name!r}; {nearest(name, [*declared, *COMMON])}")
        numbers = {name: self._number(name, one, options.get(name)) for name, one in declared.items()}
        common = {name: value for name, value in options.items() if name in COMMON and value is not None}
        people = common.pop("people", None)
        with at(str(self.path)):
            scenario = self._make(self._table(content, numbers))
            crowd = common.get("population", scenario.population)
            if people is not None and "population" not in common:
                crowd = crowd.changed(people=people)
            scenario = replace(scenario, **{**common, "population": crowd})
            _check(scenario)
        return scenario

    def _read(self) -> dict[str, Any]:
        is_json = self.path.suffix.lower() == ".json"
        form = "a scenario in this file must be JSON" if is_json else "a scenario in this file must be TOML"
        text = read_text(self.path, "the scenario", form, ("JSON", "GeoJSON"))  # or TOML that begins alike
        try:
            if is_json:
                content = json.loads(text, object_pairs_hook=_without_doubles)
            else:
                content = tomllib.loads(text)
        except RecursionError:
            raise ValueError(f"{self.path}: nested too deeply") from None
        except ValueError as error:
            raise ValueError(f"{self.path}: {error}") from None
        if _is_deeper(content, _DEEPEST):
            raise ValueError(f"{self.path}: nested too deeply")
        return content

    def _options(self, content: Any) -> dict[str, "Option"]:
        from crowd_env.scenarios.file.tables import options_adapter

        options = content.get("options", {}) if isinstance(content, dict) else {}
        return validate(options_adapter, options, str(self.path), "options")

    def _number(self, name: str, declared: "Option", given: Any) -> float:
        from crowd_env.scenarios.file.tables import number_adapters

        if given is None:
            return declared.default
        number: float = validate(number_adapters[isinstance(declared.default, int)], given, self.path.stem, name)
        if not declared.low <= number <= declared.high:
            raise ValueError(
                f"{self.path.stem}: {name} is {number:g}; it must be {declared.low:g} to {declared.high:g}"
            )
        return number

    def _table(self, content: Any, numbers: Mapping[str, float]) -> "ScenarioTable":
        """Return what the file holds, with these numbers for its options."""
        from crowd_env.scenarios.file.tables import scenario_adapter

        source = str(self.path)
        if isinstance(content, dict):
            with at(source):
                filled = fill({key: value for key, value in content.items() if key != "options"}, numbers)
            content = {key: filled.get(key, value) for key, value in content.items()}
        table: ScenarioTable = validate(scenario_adapter, content, source)
        return table

    def _make(self, table: "ScenarioTable") -> Scenario:
        given = table.given()
        for key in ("schema_", "options", "geometry", "population", "groups"):
            given.pop(key, None)
        with at("geometry"):
            geometry = table.geometry.geometry()
        given |= {"geometry": geometry, "population": _people(table, self.path.parent)}
        return Scenario(**{"name": self.path.stem, "time_limit": table.time_limit, **given})


def _people(table: "ScenarioTable", folder: Path) -> People:
    shared = table.population.given() if "population" in table.model_fields_set else {}
    if "groups" not in table.model_fields_set:
        if "population" not in table.model_fields_set:
            raise ValueError("key 'population' (or 'groups') is missing")
        return _population(shared, "population", folder)
    for key in ("people", "starts", "name"):
        if key in shared:
            raise ValueError(f"population: {key!r} is a matter of each group; write it there")
    parts = []
    for k, group in enumerate(table.groups):
        own = group.given()
        elsewhere = {"start_region"} if "starts" in own and "start_region" not in own else ()
        of_all = {name: value for name, value in shared.items() if name not in elsewhere}
        parts.append(_population({**of_all, **own}, f"groups[{k}]", folder))
    with at("groups"):
        return Groups(tuple(parts))


def _population(given: dict[str, Any], key: str, folder: Path) -> Population:
    starts = given.get("starts")
    if isinstance(starts, str):
        with at(f"{key}.starts"):
            path = (folder / starts).resolve()
            if not path.is_relative_to(folder.resolve()):
                raise ValueError(f"is {starts!r}, outside of the folder of the scenario; it must name a file in it")
            given = {**given, "starts": read_starts(path)}
    with at(key):
        if "people" not in given and starts is None:
            raise ValueError("needs 'people', or 'starts'")
        return population_of("population", given)


def _is_deeper(content: Any, levels: int) -> bool:
    """Return whether lists and tables lie in each other more than so many ``levels`` deep."""
    layer = [content]
    for _ in range(levels):
        inner = [one.values() if isinstance(one, dict) else one for one in layer if isinstance(one, dict | list)]
        layer = [value for values in inner for value in values]
    return any(isinstance(one, dict | list) for one in layer)


def _without_doubles(pairs: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for key, value in pairs:
        if key in table:
            raise ValueError(f"key {key!r} occurs twice in one object")
        table[key] = value
    return table


def _check(scenario: Scenario) -> None:
    """Raise ValueError if a route leads nowhere, or people do not fit; recorded starts have to suit the largest bodies."""
    route_set = scenario.route_set()
    route_set.when(frozenset(scenario.closed_doors))
    room = room_of(scenario.outline_of_run())
    for part in scenario.population.parts:
        if part.starts is not None:
            starts = np.asarray(part.starts, dtype=np.float64)
            check_starts(scenario.geometry, starts, np.full(len(starts), room * part.radius.high))
    scenario.population.draw(np.random.default_rng(0), scenario.geometry, room)
