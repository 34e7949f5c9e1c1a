"""The tables of a scenario file: every key with its type and a note, from which its JSON Schema is made too."""

from collections.abc import Iterator
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field, Tag, TypeAdapter, WithJsonSchema, WrapValidator, model_validator

from crowd_env.geometry.geometry import Geometry
from crowd_env.geometry.parsing import Shape
from crowd_env.navigation.field import OneWay
from crowd_env.routing.route_set import Target
from crowd_env.routing.spec import ControlRule, DoorEvent, Route
from crowd_env.routing.speed_map import Comfort, SpeedZone
from crowd_env.routing.strategies import OF_ROUTES
from crowd_env.scenarios.file.reading import COMMON
from crowd_env.scenarios.file.values import (
    FromFields,
    Number,
    Pair,
    PerhapsInfinite,
    Table,
    Text,
    Texts,
    Whole,
    kind_of,
    one_of_kinds,
    table_of,
)
from crowd_env.scenarios.population import Population
from crowd_env.state import Floats

_CORNERS = 32  # of a circle
_MOST_COPIES = 100_000  # of a thing in columns and rows

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
    low: _Given = Field(default_factory=lambda: -np.inf, description="the smallest that is allowed")
    high: _Given = Field(default_factory=lambda: np.inf, description="the largest that is allowed")
    about: Text = Field("", description="a line for people, such as the unit")

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

# ------------------------------------------------------------------------------------------------------------ geometry


class Grid(Table):
    """A thing, possibly many times, in columns and rows."""

    columns: Whole = Field(1, description=f"how many side by side; at most {_MOST_COPIES} things in all")
    rows: Whole = Field(1, description="how many above each other")
    step: Pair = Field(default_factory=list, description="[x, y] in m from one to the next")

    @model_validator(mode="after")
    def _check_grid(self) -> "Grid":
        found = f"has {self.columns} columns and {self.rows} rows"
        if self.columns < 1 or self.rows < 1:
            raise ValueError(f"{found}; there must be at least 1 of each")
        if self.columns * self.rows > _MOST_COPIES:
            raise ValueError(f"{found}; there can be at most {_MOST_COPIES} things in all")
        if not self.step and (self.columns, self.rows) != (1, 1):
            raise ValueError("has columns or rows; it also needs the 'step' [x, y] between them")
        return self

    def copies(self, points: Any) -> Iterator[Floats]:
        """Give the points (K, 2) [m] of each copy, row by row."""
        x, y = self.step or (0.0, 0.0)
        for row in range(self.rows):
            for column in range(self.columns):
                yield np.asarray(points, dtype=np.float64) + np.array([x * column, y * row])


def _check_box(box: list[float]) -> list[float]:
    x0, y0, x1, y1 = box
    if not (x0 < x1 and y0 < y1):
        raise ValueError(f"is [{x0:g}, {y0:g}, {x1:g}, {y1:g}]; it must be [low x, low y, high x, high y]")
    return box


def _check_circle(circle: list[float]) -> list[float]:
    if not circle[2] > 0:
        raise ValueError(f"has the radius {circle[2]:g} m; it must be > 0")
    return circle


class Area(Grid, json_schema_extra={"oneOf": [{"required": ["box"]}, {"required": ["circle"]}]}):
    """Boxes or circles."""

    box: Annotated[list[Number], Field(min_length=4, max_length=4), AfterValidator(_check_box)] = Field(
        default_factory=list, description="[low x, low y, high x, high y] in m"
    )
    circle: Annotated[list[Number], Field(min_length=3, max_length=3), AfterValidator(_check_circle)] = Field(
        default_factory=list, description=f"[x, y, radius] in m, of {_CORNERS} corners"
    )

    @model_validator(mode="after")
    def _check_shape(self) -> "Area":
        if bool(self.box) == bool(self.circle):
            raise ValueError("needs either a 'box' [x0, y0, x1, y1] or a 'circle' [x, y, radius]")
        return self

    def corners(self) -> Floats:
        """Return the corners (K, 2) [m] of the first."""
        if self.box:
            x0, y0, x1, y1 = self.box
            return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
        x, y, radius = self.circle
        angle = 2.0 * np.pi * np.arange(_CORNERS) / _CORNERS
        return np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])


class Lines(Grid):
    """A line, possibly many times."""

    line: list[Pair] = Field(description="points [x, y] in m")


class Seats(Grid):
    """Starting positions in columns and rows."""

    first: Pair = Field(description="[x, y] in m")


def _kind_of_areas(value: Any) -> str | None:
    """Tell a list of areas from a list of corners, whose entries are lists of plain numbers."""
    corners = not isinstance(value, list) or all(
        isinstance(one, list) and not any(isinstance(part, list | dict | str) for part in one) for one in value
    )
    return kind_of(value) if corners else "areas"


_WKT = Annotated[Text, Tag("text")]
_POINTS = Annotated[list[Pair], Tag("list")]
_AREA_IS = "well-known text (WKT), a list of corners [x, y] or a table with a 'box' or a 'circle'"
OneArea = Annotated[_WKT | _POINTS | Annotated[Area, Tag("table")], one_of_kinds(_AREA_IS)]
Areas = Annotated[
    _WKT | _POINTS | Annotated[Area, Tag("table")] | Annotated[list[OneArea], Tag("areas")],
    one_of_kinds(f"{_AREA_IS}, or a list of such areas", _kind_of_areas),
]
OneLine = Annotated[_WKT | _POINTS, one_of_kinds("a list of points [x, y] or well-known text (WKT)")]
SomeLines = Annotated[
    _WKT | _POINTS | Annotated[Lines, Tag("table")],
    one_of_kinds("a list of points [x, y], well-known text (WKT) or a table with a 'line'"),
]
Exit = Annotated[
    _WKT | _POINTS | Annotated[Area, Tag("table")],
    one_of_kinds("a list of points [x, y], well-known text (WKT) or a table with a 'box' or a 'circle'"),
]


def shapes(content: Any) -> list[Shape]:
    """Return the areas or lines of one entry of a file."""
    if isinstance(content, str):
        return [content]
    if isinstance(content, Area):
        return list(content.copies(content.corners()))
    if isinstance(content, Lines):
        return list(content.copies(content.line))
    if any(isinstance(one, str | Area) or (one and isinstance(one[0], list)) for one in content):
        return [shape for one in content for shape in shapes(one)]
    return [np.array(content, dtype=np.float64)]


class Plan(Table):
    """The place."""

    walkable: Areas = Field(description="where people can be: an area, or a list of areas that are united")
    obstacles: list[OneArea] = Field([], description="areas that are cut out")
    thin_walls: list[SomeLines] = Field([], description="walls without thickness")
    exits: dict[str, Exit] = Field(description="name = line on the edge, or area that people walk into")
    regions: dict[str, Areas] = Field({}, description="name = area or list of areas, for starts, rules and zones")
    doors: dict[str, OneLine] = Field(
        {}, description="name = line across a passage, or the name of an exit that can be closed"
    )

    def geometry(self) -> Geometry:
        """Return the geometry, checked."""
        return Geometry.from_polygon(
            shapes(self.walkable),
            obstacles=[shape for one in self.obstacles for shape in shapes(one)],
            thin_walls=[shape for one in self.thin_walls for shape in shapes(one)],
            exits={name: shapes(one)[0] for name, one in self.exits.items()},
            regions={name: shapes(one) for name, one in self.regions.items()},
            doors={name: shapes(one)[0] for name, one in self.doors.items()},
        )


# -------------------------------------------------------------------------------------------------------------- people


def _positions(content: list[Any]) -> Floats:
    rows = [one.copies(one.first) if isinstance(one, Seats) else [one] for one in content]
    return np.array([point for row in rows for point in row], dtype=np.float64).reshape(-1, 2)


# Positions (K, 2) [m], those of grids one by one.
Positions = Annotated[
    list[
        Annotated[
            Annotated[Pair, Tag("list")] | Annotated[Seats, Tag("table")],
            one_of_kinds("a point [x, y] or a table with the key 'first'"),
        ]
    ],
    AfterValidator(_positions),
]
positions_adapter: TypeAdapter[Any] = TypeAdapter(Positions)


class People(
    table_of(  # type: ignore[misc]  # a base that is made
        Population,
        count=Annotated[Whole, Field(description="number of people; by default as many as there are starts")],
        starts=Annotated[
            Annotated[Text, Tag("text")] | Annotated[Positions, Tag("list")],
            one_of_kinds("the name of a CSV file, or a list of points [x, y] and of tables with the key 'first'"),
            Field(
                description="CSV file beside this one with the columns x and y in m, or a list of points [x, y] and of "
                "grids; of more than count, some are drawn"
            ),
        ],
    )
):
    """People of one kind; what a group does not say is as in `population`."""


# ------------------------------------------------------------------------------------------------------------ scenario


_NOT_GIVEN: Any = dict  # looked for in ``model_fields_set``


class ScenarioTable(Table):
    """A scenario of crowd_env. Lengths are in m, times in s, speeds in m/s, masses in kg."""

    schema_: Text = Field("", alias="$schema", description="JSON Schema of this file, for editors; not read")
    name: Text = Field(default_factory=str, description="by default the name of the file")
    title: Text = Field("", description="a line for people")
    reference: Text = Field("", description="where the numbers come from")
    time_limit: Number = Field(300.0, description="s, when an evacuation ends at the latest")
    blocked_after: PerhapsInfinite = Field(
        default_factory=float,
        description="s without anyone getting out, after which the exits count as blocked; by default never",
    )
    target: Target = Field(
        "path", description="the shortest path, or straight to a point of the nearest exit, whatever stands between"
    )
    options: Options = Field(
        {}, description='name = number, or a table: what callers may set; "{name}" in any text stands for it'
    )
    geometry: Plan
    population: People = Field(default_factory=_NOT_GIVEN, description="everybody, or what all groups share")
    groups: list[People] = Field([], description="people of several kinds")
    routes: list[Annotated[Route, FromFields(strategy=Literal[OF_ROUTES])]] = Field(
        [], description="ways out beside every exit by its name"
    )
    zones: list[Annotated[SpeedZone, FromFields()]] = Field(
        [], description="regions where people walk slower or faster"
    )
    rules: list[Annotated[ControlRule, FromFields()]] = Field([], description="who takes another route when, and which")
    closed_doors: Texts = Field([], description="names of the doors that are closed at the start")
    door_events: list[Annotated[DoorEvent, FromFields()]] = Field([], description="when doors open and close")
    one_way: list[Annotated[OneWay, FromFields()]] = Field([], description="doors that people pass one way only")
    comfort: Annotated[Comfort, FromFields()] = Field(
        default_factory=_NOT_GIVEN, description="what the most comfortable way costs, in meters of plain floor"
    )


options_adapter: TypeAdapter[Any] = TypeAdapter(Options)
scenario_adapter = TypeAdapter(ScenarioTable)
number_adapters: dict[bool, TypeAdapter[Any]] = {True: TypeAdapter(Whole), False: TypeAdapter(Number)}
