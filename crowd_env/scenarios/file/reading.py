"""Scenarios in files, TOML or JSON with the same keys: lengths in m, times in s, speeds in m/s, masses in kg.

================== ====================================================================================================
key                what it holds
================== ====================================================================================================
name               text; by default the name of the file
title, reference   text: a line for people, and where the numbers come from
time_limit         s, 300 by default
blocked_after      s without anyone getting out, after which the exits count as blocked; by default never
target             "path", "nearest", "centre" or "width", see `crowd_env.scenarios.scenario.Scenario`
options            name -> number, or {default, low, high, about}: what callers may set.  "{name}" stands for the number in
                   every other place, also in arithmetic: "{width / 2}", "POLYGON ((0 0, {length} 0, ...))"
geometry.walkable  area, or a list of areas that are united.  An area is WKT, a list of corners [x, y],
                   {box = [low x, low y, high x, high y]} or {circle = [x, y, radius]}; the last two may have columns, rows
                   and step = [x, y], which makes many of them
geometry.obstacles list of areas that are cut out
geometry.thin_walls list of lines (lists of points, or WKT)
geometry.exits     name -> line on the edge, or area that people walk into
geometry.regions   name -> area
geometry.doors     name -> line across a passage, or the name of an exit that can be closed
population         table: count, radius, mass, desired_speed, relaxation_time, response_time, start_region or starts, route or
                   exits, name; see `crowd_env.scenarios.population.Population`.  A distribution is a number,
                   [low, high] (uniform), {distribution = "normal", mean, sd, low, high} or
                   {distribution = "lognormal", median, sigma, high, low}; starts is a CSV file beside this one, or a list of
                   points and of grids {first = [x, y], columns, rows, step}
groups             list of such tables; what ``population`` says then goes for all of them
routes             list of {name, exits, via, strategy}, see `crowd_env.routing.spec.Route`
zones              list of {region, speed, factor}, see `crowd_env.routing.spec.SpeedZone`
rules              list of {region, at_least, route, below, hold, commits}, see `crowd_env.routing.spec.ControlRule`
closed_doors       list of names of doors that are closed at the start
door_events        list of {door, opens, at, at_least, region, exit}, see `crowd_env.routing.spec.DoorEvent`
one_way            list of {door, to}, see `crowd_env.navigation.field.OneWay`
comfort            {stairs, turn, reach}, see `crowd_env.routing.spec.Comfort`
================== ====================================================================================================

Nothing is ignored: an unknown key is an error that names the file, the place and the key that was probably meant.
"""

import json
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np

from crowd_env.files.foreign import read_text
from crowd_env.navigation.field import OneWay
from crowd_env.routing.route_set import Target
from crowd_env.routing.spec import ControlRule, DoorEvent, Route
from crowd_env.routing.speed_map import Comfort, SpeedZone
from crowd_env.scenarios.file.entry import Entry, nearest
from crowd_env.scenarios.file.parts import GROUP_KEYS, read_geometry, read_group, read_record
from crowd_env.scenarios.groups import Groups
from crowd_env.scenarios.population import check_starts
from crowd_env.scenarios.scenario import People, Scenario

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

SUFFIXES = (".toml", ".json")

_DEEPEST = 20  # tables and lists within each other

_TEXTS = ("name", "title", "reference", "target")
_TIMES = ("time_limit", "blocked_after")
_LISTS: dict[str, Any] = {
    "routes": Route,
    "zones": SpeedZone,
    "rules": ControlRule,
    "door_events": DoorEvent,
    "one_way": OneWay,
}
_KEYS = (*_TEXTS, *_TIMES, "options", "geometry", "population", "groups", *_LISTS, "closed_doors", "comfort")
# What can be set of every scenario in a file, whatever its own options are.
_COMMON = ("count", "time_limit", "blocked_after", "target", "population")


@dataclass(frozen=True)
class ScenarioFile:
    """A scenario in a file; calling it with options makes the scenario.

    Parameters
    ----------
    path : TOML or JSON, see the keys above.
    """

    path: Path

    @property
    def options(self) -> dict[str, Any]:
        """Name -> default of everything that may be set; None = as the file says."""
        return {**{name: one["default"] for name, one in self._own(self._read()).items()}, **dict.fromkeys(_COMMON)}

    def about(self) -> tuple[str, str]:
        """Return title and reference alone, without making the scenario."""
        content = self._read()
        filled = content.filled({name: one["default"] for name, one in self._own(content).items()}).table(_KEYS)
        title, reference = (filled[key].text() if key in filled else "" for key in ("title", "reference"))
        return title, reference

    def __call__(self, **options: Any) -> Scenario:
        """Return the scenario, checked: every way leads out, and the people fit.

        Parameters
        ----------
        count : number of people, shared out in proportion among groups.
        time_limit, blocked_after : s.
        target, population : see `Scenario`.
        **options : numbers that the file declares.

        Raises
        ------
        ValueError
            If the file cannot be read, something in it is wrong or unknown, or an option is unknown or out of range.
        """
        content = self._read()
        declared = self._own(content)
        for name in options:
            if name not in (*declared, *_COMMON):
                raise ValueError(f"{self.path.stem} has no option {name!r}; {nearest(name, [*declared, *_COMMON])}")
        numbers = {name: self._number(name, one, options.get(name)) for name, one in declared.items()}
        common = {name: value for name, value in options.items() if name in _COMMON and value is not None}
        count = common.pop("count", None)
        try:
            scenario = self._make(content, numbers)
            people = common.get("population", scenario.population)
            if count is not None and "population" not in common:
                people = people.changed(count=count)
            scenario = replace(scenario, **{**common, "population": people})
            _check(scenario)
        except ValueError as error:
            if str(error).startswith(content.source):
                raise
            raise content.error(str(error)) from None
        return scenario

    def _read(self) -> Entry:
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
        entry = Entry(content, str(self.path))
        entry.table(_KEYS, needed=("geometry",))
        return entry

    def _own(self, content: Entry) -> dict[str, dict[str, float]]:
        """Return default, low and high of the options that the file declares."""
        options = content.table(_KEYS).get("options")
        found: dict[str, dict[str, float]] = {}
        for name, entry in ({} if options is None else options.table()).items():
            if not name.isidentifier() or name in _COMMON:
                raise entry.error(f"the name cannot be taken: letters, digits and _, and none of {', '.join(_COMMON)}")
            bounds = {"low": -np.inf, "high": np.inf}
            if isinstance(entry.value, dict):
                table = entry.table(("default", "low", "high", "about"), needed=("default",))
                if "about" in table:
                    table["about"].text()
                bounds |= {key: one.number() for key, one in table.items() if key != "about"}
            else:
                bounds["default"] = entry.number()
            if not bounds["low"] <= bounds["default"] <= bounds["high"]:
                raise entry.error(
                    f"default {bounds['default']:g} is outside of {bounds['low']:g} to {bounds['high']:g}"
                )
            found[name] = bounds
        return found

    def _number(self, name: str, declared: Mapping[str, float], given: Any) -> float:
        if given is None:
            return declared["default"]
        number = Entry(given, self.path.stem, name).number()
        if isinstance(declared["default"], int):
            number = Entry(given, self.path.stem, name).whole()
        if not declared["low"] <= number <= declared["high"]:
            raise ValueError(
                f"{self.path.stem}: {name} is {number:g}; it must be {declared['low']:g} to {declared['high']:g}"
            )
        return number

    def _make(self, content: Entry, numbers: Mapping[str, float]) -> Scenario:
        table = content.table(_KEYS)
        table = {key: entry.filled(numbers) for key, entry in table.items() if key != "options"}
        fields: dict[str, Any] = {"name": self.path.stem, "time_limit": 300.0}
        fields |= {key: table[key].text() for key in _TEXTS if key in table}
        fields |= {key: table[key].number(infinite=key == "blocked_after") for key in _TIMES if key in table}
        for key, kind in _LISTS.items():
            if key in table:
                fields[key] = tuple(read_record(one, kind) for one in table[key].entries())
        if "target" in table:
            table["target"].one_of(get_args(Target))
        if "closed_doors" in table:
            fields["closed_doors"] = table["closed_doors"].texts()
        if "comfort" in table:
            fields["comfort"] = read_record(table["comfort"], Comfort)
        return Scenario(
            geometry=read_geometry(table["geometry"]), population=_people(content, table, self.path.parent), **fields
        )


def _people(content: Entry, table: Mapping[str, Entry], folder: Path) -> People:
    if "groups" not in table:
        if "population" not in table:
            raise content.error("key 'population' (or 'groups') is missing")
        return read_group(table["population"], {}, folder)
    shared: Mapping[str, Any] = {}
    if "population" in table:
        for key in table["population"].table(GROUP_KEYS):
            if key in ("count", "starts", "name"):
                raise table["population"].error(f"{key!r} is a matter of each group; write it there")
        shared = table["population"].value
    parts = [read_group(entry, shared, folder) for entry in table["groups"].entries()]
    with table["groups"].named():
        return Groups(tuple(parts))


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
    """Raise ValueError if a way leads nowhere, or people do not fit; recorded starts have to suit the largest bodies."""
    route_set = scenario.route_set()
    route_set.when(frozenset(scenario.closed_doors))
    for part in scenario.population.parts:
        if part.starts is not None:
            starts = np.asarray(part.starts, dtype=np.float64)
            check_starts(scenario.geometry, starts, np.full(len(starts), part.radius.high))
    scenario.population.draw(np.random.default_rng(0), scenario.geometry)
