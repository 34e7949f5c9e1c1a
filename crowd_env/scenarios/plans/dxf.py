"""Floor plans in DXF drawings, with the layers that JuPedSim reads; ezdxf is loaded when one is read."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
import shapely
from shapely.geometry import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import counted
from crowd_env.core.libraries import needed_for
from crowd_env.scenarios.plans.floor_plan import Drawing, Layer, RoleError, listed
from crowd_env.scenarios.plans.lines import GAP, enclosed, open_line
from crowd_env.scenarios.plans.roles import LAYERS, Chosen, by_names, role_of_layer
from crowd_env.scenarios.plans.swings import openings
from crowd_env.scenarios.plans.units import judge_unit

if TYPE_CHECKING:
    from ezdxf.document import Drawing as Document

_MOST = 50_000  # entities of exploded blocks, which come at about ten thousand a second
_DEEPEST = 16  # blocks in blocks
_COARSE = 0.005  # m; curves become straight lines that are no further from them
_SHOWN, _LISTED = 6, 24  # layers in a message, and where a user has to choose
# Code in the header -> the unit, and how many meters it is if it is one that plans have.
_UNITS = {
    **{1: ("inches", 0.0254), 2: ("feet", 0.3048), 4: ("mm", 0.001), 5: ("cm", 0.01), 6: ("m", 1.0)},
    **{7: ("km", None), 10: ("yards", 0.9144), 14: ("decimeters", 0.1)},
}
# Kinds of entities that draw nothing that could be a wall.
_NO_LINES = ("TEXT", "MTEXT", "ATTDEF", "ATTRIB", "POINT", "DIMENSION", "LEADER", "MULTILEADER", "VIEWPORT", "IMAGE")


def read_dxf(path: Path, meters: float | None, chosen: Chosen = by_names) -> Drawing:
    """Read the closed lines, hatches and blocks of a drawing, layer by layer.

    Without a layer of floor it has no walkable area yet: floor is what the walls enclose together with the exits.

    Parameters
    ----------
    meters : how many meters a unit of the drawing is, as the user gave it; the unit in the drawing is then only reported.
    chosen : returns the role that a user has chosen for a layer.

    Raises
    ------
    ModuleNotFoundError
        If ezdxf is not installed.
    ValueError
        If the file is damaged or too large, or there is no layer of a walkable area nor of walls.
    """
    document = _open(path)
    drawing = Drawing()
    drawing.unit, drawing.meters = _unit(document)
    layers = _layers_with_a_role(document, partial(_role, chosen), drawing.notes)
    floor, walls = ([one for one in layers.values() if one.role == role] for role in ("walkable", "obstacle"))
    if not (floor or walls):
        used = [*(one.dxf.name for one in document.layers), *(one.dxf.layer for one in document.modelspace())]
        there = listed((name for name in dict.fromkeys(used) if name.lower() != "defpoints"), _LISTED)
        lacks = f"none of its visible layers says where people walk; its layers: {there}"
        raise RoleError(
            lacks, f"name them {LAYERS}, or choose, such as --layers walkable=NAME, or obstacles=NAME for walls"
        )
    extent = [curve for layer in floor or walls for curve in layer.curves]
    meters = meters or _taken_for(drawing, extent, layers.values())
    for drawn in layers.values():
        _add_layer(drawing, drawn, meters)
    drawing.walls = "" if floor else listed([one.layer for one in walls], _SHOWN)
    return drawing


def draw_dxf(path: Path, meters: float | None, chosen: Chosen = by_names) -> Drawing:
    """Return a drawing that holds its visible layers alone, all of them, as lines.

    Raises
    ------
    ModuleNotFoundError, ValueError
        As `read_dxf`, but for the lack of a layer with a role.
    """
    document, drawing = _open(path), Drawing()
    drawing.unit, drawing.meters = _unit(document)
    for drawn in _layers_with_a_role(document, lambda layer: ("any", ""), []).values():
        curves = [_straight(one, meters or drawing.meters or 1.0) for one in _flat(drawn.curves)]
        lines: list[BaseGeometry] = [LineString(one) for one in curves if len(one) > 1 and np.isfinite(one).all()]
        drawing.layers[drawn.layer] = Layer((_role(chosen, drawn.layer) or ("", ""))[0], lines)
    return drawing


def _role(chosen: Chosen, layer: str) -> tuple[str, str] | None:
    """Return the role of a layer and the name that it gives, or None."""
    role = chosen(layer)
    return role_of_layer(layer) if role is None else (role, "") if role else None


def _open(path: Path) -> "Document":
    with needed_for("reading a DXF drawing"):
        from ezdxf.filemanagement import readfile
        from ezdxf.lldxf.const import DXFError
    try:
        return readfile(path)
    except OSError as error:
        raise ValueError(f"cannot read the floor plan {path}: {error.strerror or error}") from None
    except (DXFError, ValueError, TypeError, KeyError, IndexError, AttributeError, StopIteration) as error:
        why = str(error) or "it ends too soon, or is something else"
        said = f"the DXF drawing is damaged or not whole ({why}); open it in a CAD program and save it anew"
        raise ValueError(said) from None


def _unit(document: "Document") -> tuple[str | None, float | None]:
    """Return the unit that the header names, and how many meters it is if it is one that plans have."""
    return _UNITS.get(int(document.header.get("$INSUNITS", 0)), (None, None))


_RoleOf: TypeAlias = Callable[[str], tuple[str, str] | None]


class _Wide(NamedTuple):
    """A polyline with a width."""

    curve: Any
    width: float


class _Layer(NamedTuple):
    """The shapes on a layer with a role; a hatch is a list of curves."""

    layer: str  # as it is written first
    role: str
    name: str  # that the layer gives, "" if none
    curves: list[Any]


def _layers_with_a_role(document: "Document", role_of: _RoleOf, notes: list[str]) -> dict[str, _Layer]:
    """Return name in small letters -> visible layer with a role; layers left out are noted."""
    from ezdxf import path as paths

    hidden = {layer.dxf.name.lower() for layer in document.layers if layer.is_off() or layer.is_frozen()}
    found: dict[str, _Layer] = {}
    others: Counter[str] = Counter()
    unread: Counter[str] = Counter()
    for layer, entity in _Exploding(document, role_of).exploded(document.modelspace()):
        kind = entity.dxftype()
        if kind in _NO_LINES:
            continue
        role = role_of(layer)
        unseen = layer.lower() in hidden or entity.dxf.get("invisible", 0)
        if kind == "INSERT" or role is None or unseen:
            others[layer + (" (hidden)" if unseen else "")] += 1
            continue
        try:
            curves: list[Any]
            if kind in ("HATCH", "MPOLYGON"):
                curves = [list(paths.from_hatch(entity))]
            elif kind == "MLINE":
                curves = [[paths.from_vertices(ring, close=True) for ring in _between(entity)]]
            elif kind == "LWPOLYLINE" and (width := entity.dxf.get("const_width", 0.0)):
                curves = [_Wide(paths.make_path(entity), width)]
            elif kind in ("SOLID", "TRACE", "3DFACE"):
                curves = [paths.from_vertices(entity.wcs_vertices(), close=True)]
            else:
                curves = [paths.make_path(entity)]
        except (TypeError, ValueError, ZeroDivisionError):
            unread[f"{kind} on {layer}"] += 1
            continue
        found.setdefault(layer.lower(), _Layer(layer, *role, [])).curves.extend(curves)
    if others:
        things, names = counted(sum(others.values()), "thing", "things"), (name for name, _ in others.most_common())
        notes.append(f"left out: {things} on layers of other names, {listed(names, _SHOWN)}")
    if unread:
        kinds = (f"{count} {kind}" for kind, count in unread.most_common())
        notes.append(f"left out, being no line or area: {listed(kinds, _SHOWN)}")
    return found


class _Exploding:
    """The entities of a drawing with its blocks exploded.

    Blocks without content on a layer with a role are not exploded, nor are blocks that are invisible or on a frozen layer:
    none of their content is visible, on any layer.
    """

    def __init__(self, document: "Document", role_of: _RoleOf) -> None:
        self._document, self._role_of = document, role_of
        self._frozen = {layer.dxf.name.lower() for layer in document.layers if layer.is_frozen()}
        self._layers: dict[str, frozenset[str]] = {}  # of all that a block holds
        self._count = 0

    def exploded(self, entities: Any, outer: str = "0", depth: int = 0) -> Iterator[tuple[str, Any]]:
        """Yield every entity with its layer; layer 0 within a block is the layer of the block, ``outer``.

        Raises
        ------
        ValueError
            If there are too many in blocks.
        """
        for entity in entities:
            self._count += depth > 0
            if self._count > _MOST:
                many = f"the DXF drawing holds more than {_MOST} things in its blocks"
                raise ValueError(f"{many}; keep only the layers {LAYERS}")
            layer = entity.dxf.get("layer", "0")
            layer = outer if layer == "0" else layer
            if entity.dxftype() != "INSERT" or depth > _DEEPEST or not self._opens(entity, layer):
                yield layer, entity
                continue
            for insert in entity.multi_insert() if entity.mcount > 1 else (entity,):
                yield from self.exploded(insert.virtual_entities(), layer, depth + 1)

    def _opens(self, insert: Any, layer: str) -> bool:
        if layer.lower() in self._frozen or insert.dxf.get("invisible", 0):
            return False
        within = self._layers_of(insert.dxf.get("name", ""), 0)
        return any(self._role_of(layer if name == "0" else name) is not None for name in within)

    def _layers_of(self, block: str, depth: int) -> frozenset[str]:
        """Return the layers of all that a block holds, blocks within it included."""
        if block not in self._layers:
            self._layers[block] = frozenset()  # a block that holds itself adds no layer
            layers = set()
            for entity in self._document.blocks.get(block) or ():
                layers.add(entity.dxf.get("layer", "0"))
                if entity.dxftype() == "INSERT" and depth <= _DEEPEST:
                    layers |= self._layers_of(entity.dxf.get("name", ""), depth + 1)
            self._layers[block] = frozenset(layers)
        return self._layers[block]


def _taken_for(drawing: Drawing, walkable: Sequence[Any], layers: Iterable[_Layer]) -> float:
    """Return the likely length of a unit [m]: gaps that are closed and the fineness of curves depend on it."""
    from ezdxf.path import bbox

    box = bbox(_flat(walkable))
    exits = _flat([curve for layer in layers if layer.role == "exit" for curve in layer.curves])
    widest = max((float(curve.start.distance(curve.end)) for curve in exits), default=0.0)
    try:
        bounds = (box.extmin.x, box.extmin.y, box.extmax.x, box.extmax.y)
        return judge_unit(bounds, widest, drawing.unit, drawing.meters)[0]
    except ValueError:  # reported where the whole plan is judged
        return 1.0


def _between(mline: Any) -> list[Floats]:
    """Return the edge (K, 2) of what lies between the outermost lines of a multiline, or both edges if it is closed."""
    lines = [one for one in mline.virtual_entities() if one.dxftype() == "LINE"]
    merged = shapely.line_merge(shapely.MultiLineString([[one.dxf.start.vec2, one.dxf.end.vec2] for one in lines]))
    chains = [shapely.get_coordinates(part) for part in shapely.get_parts(merged)]
    first, last = chains[0], chains[-1]
    if np.array_equal(first[0], first[-1]):
        return [first, last]
    ahead = np.hypot(*(first[-1] - last[0])) > np.hypot(*(first[-1] - last[-1]))
    return [np.concatenate([first, last[::-1] if ahead else last])]


def _flat(curves: Sequence[Any]) -> list[Any]:
    whole = [curve.curve if isinstance(curve, _Wide) else curve for curve in curves]
    return [one for curve in whole for one in (curve if isinstance(curve, list) else [curve])]


def _straight(curve: Any, meters: float) -> Floats:
    """Return the points (K, 2) of a curve, in units of the drawing."""
    return np.array([(point.x, point.y) for point in curve.flattening(_COARSE / meters)]).reshape(-1, 2)


def _add_layer(drawing: Drawing, drawn: _Layer, meters: float) -> None:
    """Add the shapes of a layer.

    Raises
    ------
    ValueError
        If a walkable area is not closed, or a coordinate is not finite.
    """
    layer, role, name, curves = drawn
    hatches = [[_straight(ring, meters) for ring in curve] for curve in curves if isinstance(curve, list)]
    wide = [(_straight(curve.curve, meters), curve.width) for curve in curves if isinstance(curve, _Wide)]
    lines = [_straight(curve, meters) for curve in curves if not isinstance(curve, list | _Wide)]
    if role in ("exit", "door"):  # as long as its line
        lines, wide = openings([*lines, *(line for line, _ in wide)]), []
    every = (*lines, *(line for line, _ in wide), *(ring for rings in hatches for ring in rings))
    if not all(np.isfinite(line).all() for line in every):
        raise ValueError(f"layer {layer} has a coordinate that is not finite")
    found = enclosed([line for line in lines if len(line) > 1], GAP / meters)
    if found.closed_gap > 0.0:
        gap = 1000.0 * meters * found.closed_gap
        drawing.notes.append(f"layer {layer}: gaps between the ends of lines are closed, the widest {gap:.2g} mm")
    areas: list[BaseGeometry] = [*found.areas, *(_hatched(rings) for rings in hatches)]
    areas += [
        shapely.buffer(LineString(line), 0.5 * width, cap_style="flat", join_style="mitre") for line, width in wide
    ]
    if role == "exit" and all(area.is_valid for area in areas):  # an edge and its hatch are one exit
        areas = list(shapely.get_parts(shapely.union_all(areas)))
    for area in areas:
        drawing.add(role, name, area, layer=layer)
    if not found.open:
        return
    if role in ("exit", "obstacle", "door"):
        for line in found.open:
            drawing.add(role, name, line, layer=layer)
        return
    where = open_line(max(found.open, key=lambda line: line.length), meters)
    if not areas:
        raise ValueError(f"layer {layer} encloses nothing: a line is not closed, {where}; close it")
    what = counted(len(found.open), "line that encloses nothing", "lines that enclose nothing")
    drawing.notes.append(f"layer {layer}: left out {what}; of the longest {where}")


def _hatched(rings: Sequence[Floats]) -> BaseGeometry:
    """Return the area of a hatch: the points within an odd number of its rings."""
    area: BaseGeometry = Polygon()
    for ring in rings:
        if len(ring) > 3:
            area = shapely.symmetric_difference(area, shapely.make_valid(Polygon(ring)))
    return area
