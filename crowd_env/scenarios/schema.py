"""The JSON Schema of scenario files: editors complete keys and mark mistakes with it.

pydantic makes it of the dataclasses that a file becomes, with the notes of their docstrings; reading a file needs none of it.
"""

# mypy: disable-error-code="assignment,valid-type,misc"

import inspect
import re
from dataclasses import MISSING, fields
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, create_model
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import CoreSchema, core_schema

from crowd_env.core.behaviors.balance import BALANCES, Balance
from crowd_env.core.behaviors.headway import MANNERS, Headway
from crowd_env.core.behaviors.outline import OUTLINES, Disc, Outline
from crowd_env.core.behaviors.pulls import Attraction, Companionship, Pulls
from crowd_env.routing.fields.field import OneWay
from crowd_env.routing.route_set import Target
from crowd_env.routing.spec import ControlRule, DoorEvent, Route
from crowd_env.routing.speed_map import Comfort, SpeedZone
from crowd_env.routing.strategies import OF_ROUTES
from crowd_env.scenarios.distributions import LAWS, Distribution
from crowd_env.scenarios.file import CORNERS
from crowd_env.scenarios.population import Population


class Table(BaseModel):
    """A table whose keys are all known."""

    model_config = ConfigDict(extra="forbid")


def _table(kind: type, **keys: Any) -> Any:
    """Return the table of a dataclass, with the notes of its docstring; ``keys`` have another type than its fields."""
    hints, notes = get_type_hints(kind), _notes(kind)
    columns: dict[str, Any] = {name: (read_as, ...) for name, read_as in keys.items() if name not in hints}
    for field in fields(kind):
        annotation = keys.get(field.name, hints[field.name])
        if get_origin(annotation) in (Union, UnionType) and NoneType in get_args(annotation):
            (annotation,) = (one for one in get_args(annotation) if one is not NoneType)
        needed = field.default is MISSING and field.default_factory is MISSING and field.name not in keys
        default = field.default if isinstance(field.default, str | int | float) else None
        options: dict[str, Any] = {} if needed else {"default": None if default != default else default}
        columns[field.name] = (_PLAIN.get(annotation, annotation), Field(**options, description=notes.get(field.name)))
    return create_model(kind.__name__, __base__=Table, __doc__=_plain((kind.__doc__ or "").split("\n")[0]), **columns)


def _notes(of: type) -> dict[str, str]:
    """Return what the docstring of a class says of each parameter, without references to code."""
    _, _, section = (inspect.getdoc(of) or "").partition("Parameters\n----------\n")
    found: dict[str, str] = {}
    for names, note in re.findall(r"^(\w+(?:, \w+)*) : (.+(?:\n +\S.*)*)", section, re.MULTILINE):
        found |= dict.fromkeys(names.split(", "), _plain(note))
    return found


def _plain(note: str) -> str:
    return re.sub(r",? see `[\w.]+`", "", " ".join(note.replace("``", "`").split()))


def _numbers(many: int) -> Any:
    return Annotated[list[float], Field(min_length=many, max_length=many)]


_PLAIN: dict[Any, Any] = {tuple[Disc, ...]: list[_numbers(3)]}
_PLAIN[Distribution] = Union[
    (float, _numbers(2), *(_table(law, distribution=Literal[name]) for name, law in LAWS.items()))
]
Points = list[_numbers(2)]


class Box(Table):
    """A rectangle."""

    box: _numbers(4) = Field(description="[low x, low y, high x, high y] in m")


class Circle(Table):
    """A circle."""

    circle: _numbers(3) = Field(description=f"[x, y, radius] in m, of {CORNERS} corners")


AreaOrLine = str | Points | Box | Circle
Areas = AreaOrLine | list[AreaOrLine]
Manner = Literal[tuple(MANNERS)] | _table(Headway)
Balancing = Literal[tuple(BALANCES)] | _table(Balance)
Shape = Literal[tuple(OUTLINES)] | _table(Outline)
Person = _table(Population, people=int, starts=str | Points)


class Plan(Table):
    """The plan: walls, exits, regions and doors."""

    walkable: Areas = Field(description="where people can be: an area, or a list of areas that are united")
    obstacles: list[AreaOrLine] = Field([], description="areas that are cut out of the walkable area")
    thin_walls: list[str | Points] = Field([], description="walls without thickness")
    exits: dict[str, AreaOrLine] = Field(
        description="name = line on the edge of the walkable area, or area that people walk into"
    )
    regions: dict[str, Areas] = Field({}, description="name = area or list of areas, for starts, rules and zones")
    doors: dict[str, str | Points] = Field(
        {}, description="name = line across a passage, or the name of an exit that can be closed"
    )
    jamb_radius: float = Field(0.0, description="m, radius of all corners that jut into the walkable area; 0 = sharp")


class ScenarioTable(Table):
    """A scenario of crowd_env. Lengths are in m, times in s, speeds in m/s, masses in kg."""

    schema_: str = Field("", alias="$schema", description="JSON Schema of this file, for editors; not read")
    name: str = Field("", description="name of the scenario; by default that of the file")
    title: str = Field("", description="one line that says what the scenario is")
    reference: str = Field("", description="source of the numbers")
    time_limit: float = Field(
        None, description="s, when an evacuation ends at the latest; by default enough to walk out"
    )
    blocked_after: float = Field(None, description="s without anyone leaving after which exits count as blocked")
    target: Target = Field("path", description="what people walk to: the shortest path, or a point of the nearest exit")
    geometry: Plan
    population: Person = Field(None, description="the people, or what all groups have in common")
    groups: list[Person] = Field([], description="groups of people of different kinds")
    routes: list[_table(Route, strategy=Literal[OF_ROUTES])] = Field(
        [], description="routes beside those to every exit"
    )
    zones: list[_table(SpeedZone)] = Field([], description="regions where people walk slower or faster")
    rules: list[_table(ControlRule)] = Field([], description="rules that change routes while a region is crowded")
    closed_doors: list[str] = Field([], description="names of the doors that are closed at the start")
    door_events: list[_table(DoorEvent)] = Field([], description="events that open and close doors")
    one_way: list[_table(OneWay)] = Field([], description="doors that people mean to pass one way only")
    manner: Manner = Field(None, description="how people walk before they touch, unless the run says otherwise")
    outline: Shape = Field(None, description="what shape bodies have, unless the run says otherwise")
    balance: Balancing = Field(None, description="how those who stand keep upright, unless the run says otherwise")
    strategy: str = Field(None, description="how people choose their way: a strategy, or the name of a route or exit")
    pulls: _table(Pulls, companions=_table(Companionship), attractions=list[_table(Attraction)]) = Field(
        None, description="what pulls people off their way: companions and attractions"
    )
    max_drive: float = Field(300.0, description="N, the largest force with which one drives forwards")
    comfort: _table(Comfort) = Field(None, description="costs that the most comfortable route keeps low")


class _Short(GenerateJsonSchema):
    """Leaves out what says nothing: a key is its own title, and None is no default."""

    def field_title_should_be_set(self, schema: CoreSchema) -> bool:
        return False

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> dict[str, Any]:
        return (
            self.generate_inner(schema["schema"]) if schema.get("default") is None else super().default_schema(schema)
        )


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of scenario files, in draft 7, the newest that most editors of TOML read."""
    schema = ScenarioTable.model_json_schema(ref_template="#/definitions/{model}", schema_generator=_Short)
    definitions = schema.pop("$defs")
    return {"$schema": "http://json-schema.org/draft-07/schema#", **schema, "definitions": definitions}
