"""The tables of a scenario file: every key with its type and a note, from which its JSON Schema is made too."""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field, Tag, TypeAdapter, WithJsonSchema, WrapValidator, model_validator

from crowd_env.core.arrays.headway import MANNERS, Headway
from crowd_env.core.arrays.outline import OUTLINES, Outline
from crowd_env.core.checks import known
from crowd_env.routing.fields.field import OneWay
from crowd_env.routing.route_set import Target
from crowd_env.routing.spec import ControlRule, DoorEvent, Route
from crowd_env.routing.speed_map import Comfort, SpeedZone
from crowd_env.routing.strategies import OF_ROUTES
from crowd_env.scenarios.file.expressions import COMMON
from crowd_env.scenarios.file.plan import Plan, Positions
from crowd_env.scenarios.file.values import (
    FromFields,
    Number,
    PerhapsInfinite,
    Table,
    Text,
    Texts,
    Whole,
    one_of_kinds,
    table_of,
)
from crowd_env.scenarios.population import Population

# ------------------------------------------------------------------------------------------------------------- options


def _option_name(name: str) -> str:
    if not name.isidentifier() or name in COMMON:
        raise ValueError(f"the name cannot be taken: letters, digits and _, and none of {', '.join(COMMON)}")
    return name


def _as_written(value: Any, check: Any) -> Any:
    check(value)
    return value


# Whole numbers stay whole; an option cannot hold braces.
_Given = Annotated[Number, WrapValidator(_as_written), WithJsonSchema({"type": "number"})]


class Option(Table):
    """A number that callers may set."""

    default: _Given
    low: _Given = Field(default_factory=lambda: -np.inf, description="the smallest value that is allowed")
    high: _Given = Field(default_factory=lambda: np.inf, description="the largest value that is allowed")
    about: Text = Field("", description="one line that explains the option, such as its unit")

    @model_validator(mode="after")
    def _check(self) -> "Option":
        if not self.low <= self.default <= self.high:
            raise ValueError(f"default {self.default:g} is outside of {self.low:g} to {self.high:g}")
        return self


Options = dict[
    Annotated[Text, AfterValidator(_option_name)],
    Annotated[
        Annotated[_Given, AfterValidator(lambda value: Option(default=value)), Tag("number")]
        | Annotated[Option, Tag("table")],
        one_of_kinds("a number or a table with the key 'default'"),
    ],
]

# -------------------------------------------------------------------------------------------------------------- people


class People(
    table_of(  # type: ignore[misc]  # a base that is made
        Population,
        people=Annotated[Whole, Field(description="number of people; by default as many as there are starts")],
        starts=Annotated[
            Annotated[Text, Tag("text")] | Annotated[Positions, Tag("list")],
            one_of_kinds("the name of a CSV file, or a list of points [x, y] and of tables with the key 'first'"),
            Field(
                description="CSV file beside this one with the columns x and y in m, or a list of points [x, y] and of "
                "grids; of more than people, some are drawn"
            ),
        ],
    )
):
    """People of one kind; what a group does not say is as in `population`."""


# ------------------------------------------------------------------------------------------------------------ scenario


_NOT_GIVEN: Any = dict  # looked for in ``model_fields_set``

Manner = Annotated[
    Annotated[
        Text,
        AfterValidator(lambda name: known("name", name, MANNERS)),
        WithJsonSchema({"type": "string", "enum": list(MANNERS)}),
        Tag("text"),
    ]
    | Annotated[Headway, FromFields(), Tag("table")],
    one_of_kinds(f"the name of a manner ({', '.join(MANNERS)}) or a table of the parameters of a headway"),
]


BodyShape = Annotated[
    Annotated[
        Text,
        AfterValidator(lambda name: known("name", name, OUTLINES)),
        WithJsonSchema({"type": "string", "enum": list(OUTLINES)}),
        Tag("text"),
    ]
    | Annotated[Outline, FromFields(), Tag("table")],
    one_of_kinds(f"the name of an outline ({', '.join(OUTLINES)}) or a table of the parameters of one"),
]


class ScenarioTable(Table):
    """A scenario of crowd_env. Lengths are in m, times in s, speeds in m/s, masses in kg."""

    schema_: Text = Field("", alias="$schema", description="JSON Schema of this file, for editors; not read")
    name: Text = Field(default_factory=str, description="name of the scenario; by default that of the file")
    title: Text = Field("", description="one line that says what the scenario is")
    reference: Text = Field("", description="source of the numbers")
    time_limit: Number = Field(300.0, description="s, the time at which an evacuation ends at the latest")
    blocked_after: PerhapsInfinite = Field(
        default_factory=float,
        description="s, the time without anyone leaving after which the exits count as blocked; by default never",
    )
    target: Target = Field(
        "path",
        description="what people walk to: on the shortest path to an exit, or straight to a point of the nearest exit, "
        "whatever stands between",
    )
    options: Options = Field(
        {}, description='name = number, or a table: what callers may set; "{name}" in any text stands for it'
    )
    geometry: Plan
    population: People = Field(default_factory=_NOT_GIVEN, description="the people, or what all groups have in common")
    groups: list[People] = Field([], description="groups of people of different kinds")
    routes: list[Annotated[Route, FromFields(strategy=Literal[OF_ROUTES])]] = Field(
        [], description="routes in addition to those to every exit"
    )
    zones: list[Annotated[SpeedZone, FromFields()]] = Field(
        [], description="regions where people walk slower or faster"
    )
    rules: list[Annotated[ControlRule, FromFields()]] = Field(
        [], description="rules that change routes while a region is crowded"
    )
    closed_doors: Texts = Field([], description="names of the doors that are closed at the start")
    door_events: list[Annotated[DoorEvent, FromFields()]] = Field([], description="events that open and close doors")
    one_way: list[Annotated[OneWay, FromFields()]] = Field(
        [], description="doors that people mean to pass one way only"
    )
    manner: Manner = Field(
        default_factory=_NOT_GIVEN,
        description="how people walk before they touch, unless the run says otherwise; by default at full speed, whatever "
        "is in front of them",
    )
    outline: BodyShape = Field(
        default_factory=_NOT_GIVEN,
        description="what shape bodies have, unless the run says otherwise; by default they are discs. Only the schemes hertz "
        "and hertz-literal take another",
    )
    comfort: Annotated[Comfort, FromFields()] = Field(
        default_factory=_NOT_GIVEN, description="costs that the most comfortable route keeps low"
    )


options_adapter: TypeAdapter[Any] = TypeAdapter(Options)
scenario_adapter = TypeAdapter(ScenarioTable)
number_adapters: dict[bool, TypeAdapter[Any]] = {True: TypeAdapter(Whole), False: TypeAdapter(Number)}
