"""The plan in a scenario file: areas and lines in their forms, and things in columns and rows."""

from collections.abc import Iterator
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field, Tag, TypeAdapter, model_validator

from crowd_env.core.arrays.state import Floats
from crowd_env.geometry.geometry import Geometry
from crowd_env.geometry.parsing import Shape
from crowd_env.scenarios.file.values import Number, Pair, Table, Text, Whole, kind_of, one_of_kinds

_CORNERS = 32  # of a circle
_MOST_COPIES = 100_000  # of a thing in columns and rows


class Grid(Table):
    """A thing, possibly many times, in columns and rows."""

    columns: Whole = Field(1, description=f"number of copies side by side; at most {_MOST_COPIES} things in all")
    rows: Whole = Field(1, description="number of copies above each other")
    step: Pair = Field(default_factory=list, description="[x, y] in m from one copy to the next")

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
    """A box or a circle, possibly many times."""

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


def _kind_of_areas(value: Any) -> str | None:
    """Tell a list of areas from a list of corners, whose entries are lists of plain numbers."""
    corners = not isinstance(value, list) or all(
        isinstance(one, list) and not any(isinstance(part, list | dict | str) for part in one) for one in value
    )
    return kind_of(value) if corners else "areas"


_WKT = Annotated[Text, Tag("text")]
_POINTS = Annotated[list[Pair], Tag("list")]
_TABLE = Annotated[Area, Tag("table")]
_AREA_IS = "well-known text (WKT), a list of points [x, y] or a table with a 'box' or a 'circle'"
AreaOrLine = Annotated[_WKT | _POINTS | _TABLE, one_of_kinds(_AREA_IS)]
Areas = Annotated[
    _WKT | _POINTS | _TABLE | Annotated[list[AreaOrLine], Tag("areas")],
    one_of_kinds(f"{_AREA_IS}, or a list of such areas", _kind_of_areas),
]
OneLine = Annotated[_WKT | _POINTS, one_of_kinds("well-known text (WKT) or a list of points [x, y]")]
SomeLines = Annotated[
    _WKT | _POINTS | Annotated[Lines, Tag("table")],
    one_of_kinds("well-known text (WKT), a list of points [x, y] or a table with a 'line'"),
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
    """The plan: walls, exits, regions and doors."""

    walkable: Areas = Field(description="where people can be: an area, or a list of areas that are united")
    obstacles: list[AreaOrLine] = Field([], description="areas that are cut out of the walkable area")
    thin_walls: list[SomeLines] = Field([], description="walls without thickness")
    exits: dict[str, AreaOrLine] = Field(
        description="name = line on the edge of the walkable area, or area that people walk into"
    )
    regions: dict[str, Areas] = Field({}, description="name = area or list of areas, for starts, rules and zones")
    doors: dict[str, OneLine] = Field(
        {}, description="name = line across a passage, or the name of an exit that can be closed"
    )
    jamb_radius: Number = Field(
        0.0, description="radius in m of door jambs and all other corners that jut into the walkable area; 0 = sharp"
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
            jamb_radius=self.jamb_radius,
        )


class Seats(Grid):
    """Starting positions in columns and rows."""

    first: Pair = Field(description="[x, y] in m of the first position")


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
