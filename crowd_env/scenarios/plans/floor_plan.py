"""A floor plan as read from a file, in the file's units, and the plan in meters made from it."""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import shapely
from shapely.geometry.base import BaseGeometry

from crowd_env.core.files.atomic import legible
from crowd_env.geometry.parsing import Area
from crowd_env.routing.spec import Route

ON_ONE_LEVEL = "stairs are "  # begins a note that is untrue of a building
AS_FLOOR = f"{ON_ONE_LEVEL}floor like any other"


class RoleError(ValueError):
    """A drawing lacks something that its layers, a level or a unit give.

    Parameters
    ----------
    lacks : what it lacks.
    how : options of commands that give it.
    """

    def __init__(self, lacks: str, how: str) -> None:
        super().__init__(f"{lacks}; {how}")
        self.lacks, self.how = lacks, how


@dataclass(frozen=True)
class Door:
    """A way through a wall.

    Attributes
    ----------
    shape : point, line or area, in units of the drawing.
    name : of the exit that it may be, "" without one.
    width : m; None = as long as the shape is.
    leads_out : whether it is an exit on the outer edge.
    """

    shape: BaseGeometry
    name: str = ""
    width: float | None = None
    leads_out: bool = False


class DrawnStair(NamedTuple):
    """A stair or ramp as drawn on a level, a part of its floor."""

    shape: BaseGeometry  # an area, or the line from its foot to its head
    name: str = ""
    kind: str = "stair"  # or ramp
    width: float | None = None  # m, of a line


class Start(NamedTuple):
    """The people that start in a region, as far as the file knows them."""

    people: int | None = None  # None if it does not say how many
    exits: tuple[str, ...] = ()  # that they take; all if there are none here
    arrivals: Sequence[
        tuple[float, int]
    ] = ()  # (time [s], people) of groups that come; all are there at the start without
    via: tuple[str, ...] = ()  # regions that they walk to before, in turn

    @property
    def route(self) -> Route | None:
        """Their route, if it leads to regions."""
        return Route(" then ".join((*self.via, *self.exits)), self.exits, self.via) if self.via else None


@dataclass
class Layer:
    """What a file draws in one layer, or as features of one kind.

    Attributes
    ----------
    role : "" = none.
    shapes : in units of the drawing; lines of a DXF drawing are not closed yet.
    """

    role: str
    shapes: list[BaseGeometry] = field(default_factory=list)


@dataclass
class Drawing:
    """The shapes of a file, in its own units and as found: nothing is checked, united or cut yet.

    Attributes
    ----------
    walkable : areas that people walk on.
    walls : names of the layers of obstacles, if floor is what these enclose.
    rooms : rows of ``walkable`` that may have walls along the edges that they share.
    doors : in these walls, in others, or exits.
    obstacles : areas that people do not walk on.
    exits : name -> lines on the edge of the walkable area, or areas that people walk into.
    closing : exits of the file that others have replaced: they close the openings of walls all the same.
    regions : name -> area.
    starts : name of a region in which people start -> these people, as far as the file knows them.
    speeds : name of a region, such as stairs -> factor of the speed there.
    stairs : stairs and ramps of a file with levels.
    unit : the file's, as a word for messages, if it names one.
    meters : how many meters that unit is, if it is known.
    on_ground : whether the coordinates are meters for sure, projected from degrees.
    storey : number of the level, of one with levels; nan without one.
    levels : the drawing of each level, by its name, if the file names levels; then the rest is empty if there are several.
    notes : shapes that the reader dropped, or read in another way than may be meant.
    layers : name -> what is drawn there and its role.
    layer_of : name of an exit or a region -> the layer that it is drawn on.
    """

    walkable: list[BaseGeometry] = field(default_factory=list)
    walls: str = ""
    rooms: set[int] = field(default_factory=set)
    doors: list[Door] = field(default_factory=list)
    obstacles: list[BaseGeometry] = field(default_factory=list)
    exits: dict[str, BaseGeometry] = field(default_factory=dict)
    closing: list[BaseGeometry] = field(default_factory=list)
    regions: dict[str, BaseGeometry] = field(default_factory=dict)
    starts: dict[str, Start] = field(default_factory=dict)
    speeds: dict[str, float] = field(default_factory=dict)
    stairs: list[DrawnStair] = field(default_factory=list)
    unit: str | None = None
    meters: float | None = None
    on_ground: bool = False
    storey: float = math.nan
    levels: dict[str, "Drawing"] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    layers: dict[str, "Layer"] = field(default_factory=dict)
    layer_of: dict[str, str] = field(default_factory=dict)

    def add(self, role: str, name: str, shape: BaseGeometry, start: Start | None = None, layer: str = "") -> None:
        """Add a shape in a role of `crowd_env.scenarios.plans.roles`: shapes of one name make one exit or region, shapes
        without a name are numbered.
        """
        if role in ("exit", "start", "region"):
            name = name or _numbered(role, self.exits if role == "exit" else self.regions)
            self.layer_of |= {name: layer} if layer else {}
        match role:
            case "room":
                self.rooms.add(len(self.walkable))
                self.walkable.append(shape)
            case "walkable" | "stairs" | "ramp":
                self.walkable.append(shape)
            case "obstacle":
                self.obstacles.append(shape)
            case "exit":
                _join(self.exits, name, shape)
            case "door":
                self.doors.append(Door(shape, name))
            case "start" | "region":
                _join(self.regions, name, shape)
                if role == "start":
                    self.starts[name] = start or Start()


@dataclass(frozen=True, eq=False)
class FloorPlan:
    """A floor plan as it was understood; for the repair of its walls see `Geometry`.

    Attributes
    ----------
    path : of the file.
    walkable : walkable area [m]; obstacles are cut out.
    exits : name -> line on the edge of the walkable area, or area that people walk into [m].
    regions : name -> area [m].
    starts : name of a region in which people start -> these people, as far as the file knows them.
    speeds : name of a region, such as stairs -> factor of the speed there.
    notes : a sentence on each shape that was dropped, or read in another way than may be meant.
    level : of the file, if one was chosen.
    meters : how many meters a unit of the file was taken for.
    layer_of : name of an exit or a region -> the layer of the file that it is drawn on.
    stairs : stairs and ramps on this level [m].
    """

    path: Path
    walkable: Area
    exits: Mapping[str, BaseGeometry]
    regions: Mapping[str, Area] = field(default_factory=dict)
    starts: Mapping[str, Start] = field(default_factory=dict)
    speeds: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    level: str | None = None
    meters: float = 1.0
    layer_of: Mapping[str, str] = field(default_factory=dict)
    stairs: tuple[DrawnStair, ...] = ()

    @property
    def name(self) -> str:
        """Name in tables."""
        return legible(self.path.stem if self.level is None else f"{self.path.stem}-{self.level}")

    @property
    def title(self) -> str:
        """A line for readers."""
        return legible(f"floor plan {self.path.name}" + ("" if self.level is None else f", level {self.level}"))


def _join(shapes: dict[str, BaseGeometry], name: str, shape: BaseGeometry) -> None:
    shapes[name] = shapely.union_all([shapes[name], shape]) if name in shapes else shape


def _numbered(word: str, taken: Mapping[str, object]) -> str:
    return next(name for name in (f"{word}-{number}" for number in itertools.count()) if name not in taken)


def listed(names: Iterable[str], most: int = 4) -> str:
    """Return names for a message: the first ones, and how many more there are."""
    names = list(names)
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
