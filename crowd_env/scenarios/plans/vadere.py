"""Scenarios of Vadere (JSON): the bounds without obstacles are walkable; targets are exits, sources are starts."""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import shapely
from shapely.geometry import Point, Polygon, box

from crowd_env.core.checks import NOT_NEGATIVE, POSITIVE, Plain, number
from crowd_env.scenarios.buildings import RISERS, TREADS, speed_on_stairs
from crowd_env.scenarios.plans.floor_plan import Drawing, Start, listed

_MOST_COME = 1000  # people of a source over time; more than these are rarely meant to be simulated one by one
# Law of the times between groups -> the key of its mean [s], of the people per second of Poisson's.
_MEANS = {
    "constant": "updateFrequency",
    "negativeexponential": "mean",
    "normal": "mean",
    "poisson": "numberPedsPerSecond",
}
_PACE = 0.63  # m
_BOX = ("x", "y", "width", "height")
_LEFT_OUT = ("targetChangers", "absorbingAreas", "teleporter")  # changes of the walk, beside targets


def is_vadere(content: Any) -> bool:
    """Return whether this is the content of a scenario file of Vadere."""
    scenario = content.get("scenario") if isinstance(content, dict) else None
    return isinstance(scenario, dict) and "topography" in scenario


def read_vadere(content: Plain, meters: float | None) -> Drawing:
    """Read the topography of a scenario, releases 1 to 4; targets that are no way out are regions, stairs slow ones."""
    places = content["scenario"]["topography"]
    try:
        drawing, late = Drawing(unit="m", meters=1.0), []
        _add_bounds(drawing, places["attributes"])
        kinds = ("obstacles", "targets", "sources")
        obstacles, targets, sources = ([_plain(one) for one in places.get(kind, ())] for kind in kinds)
        drawing.obstacles = [_shape(one, f"obstacle {one['id']}") for one in obstacles]
        for target in targets:
            role = "exit" if _absorbs(target) else "region"
            drawing.add(role, f"target-{target['id']}", _shape(target, f"target {target['id']}"))
        for k, stairs in enumerate(map(_plain, places.get("stairs", ()))):
            name = f"stairs-{stairs['id']}"
            _add_stairs(drawing, name + f"-{k}" * (name in drawing.speeds), stairs)
        for source in sources:
            way = _way(source, targets)
            name, own = f"source-{source['id']}", Start(_people(source), way[-1:], _timetable(source), way[:-1])
            drawing.add("start", name, _shape(source, f"source {source['id']}"), own)
            law, every = _law(source)
            late += [] if _at_once(source) or own.arrivals else [f"{name} ({law or 'no law'})"]
            if len(own.arrivals) > 1 and law != "constant":
                drawing.notes.append(f"{name}: people come every {every:.3g} s, the mean of its random times ({law})")
        ways = [_way(source, targets) for source in sources if source.get("targetIds")]
        for left_out, what in (
            (not all(ways), "to which targets the people of a source walk; they choose among all exits"),
            (bool(late), f"when people of {listed(late)} come one after the other; they stand there at the start"),
        ):
            drawing.notes += [f"left out: {what}"] * left_out
    except (AttributeError, KeyError, TypeError) as error:
        raise ValueError(f"its topography lacks or has in another form than Vadere's: {error}") from None
    for what in _LEFT_OUT:
        if places.get(what):
            drawing.notes.append(f"left out: {what} of the scenario")
    if places.get("dynamicElements"):
        drawing.notes.append("left out: people who stand in the scenario (dynamicElements); --starts takes positions")
    return drawing


def _add_stairs(drawing: Drawing, name: str, stairs: Plain) -> None:
    """Add stairs as a region with the speed of the SFPE Handbook, seen from above, both ways.

    The file has no risers; two of them and a tread are a pace (Blondel, Cours d'architecture, 1675).
    """
    shape, (x, y) = _shape(stairs, name), _numbers(f"{name}: upwardDirection", stairs["upwardDirection"], "x", "y")
    deep = np.ptp(shapely.get_coordinates(shape) @ (x, y)) / (math.hypot(x, y) or 1.0)
    deep /= number(f"{name}: treadCount", stairs["treadCount"], POSITIVE)
    tread = float(np.clip(deep, TREADS.low, TREADS.high))
    riser = max(0.5 * (_PACE - tread), RISERS.low)
    drawing.add("region", name, shape)
    drawing.speeds[name] = factor = round(speed_on_stairs(riser, tread) * tread / math.hypot(riser, tread), 3)
    steps = f"treads of {deep:.3f} m, taken with risers of {riser:.3f} m"
    drawing.notes.append(f"{name}: people walk at {factor:.2f} of their speed, up and down (SFPE): {steps}")


def _add_bounds(drawing: Drawing, attributes: Plain) -> None:
    """Add the bounds; the frame along them is a wall unless the scenario excludes it."""
    left, low, width, height = _numbers("bounds", attributes["bounds"], *_BOX)
    frame = number("boundingBoxWidth", attributes.get("boundingBoxWidth", 0.5), NOT_NEGATIVE)
    frame = frame if attributes.get("bounded", True) else 0.0
    x, y, width, height = left + frame, low + frame, width - 2 * frame, height - 2 * frame
    if not (width > 0 and height > 0):
        raise ValueError("its bounds leave no place inside their frame")
    drawing.walkable.append(box(x, y, x + width, y + height))


def _plain(thing: Plain) -> Plain:
    """Return the attributes of an element, which stand in it or in a table of their own."""
    return {"id": "?", **thing.get("attributes", {}), **thing}


def _numbers(what: str, table: Plain, *keys: str) -> list[float]:
    return [number(f"{what}: {key}", table[key]) for key in keys]


def _shape(thing: Plain, what: str) -> Any:
    shape = thing["shape"]
    match shape["type"]:
        case "RECTANGLE":
            x, y, width, height = _numbers(what, shape, *_BOX)
            return box(x, y, x + width, y + height)
        case "POLYGON":
            points = [_numbers(what, point, "x", "y") for point in shape["points"]]
            if len(points) < 3:
                raise ValueError(f"{what} has {len(points)} corners; a polygon needs at least 3")
            return Polygon(points)
        case "CIRCLE":
            at = Point(_numbers(what, shape["center"], "x", "y"))
            return shapely.buffer(at, number(f"{what}: radius", shape["radius"], POSITIVE))
    raise ValueError(f"{what} has the shape {shape['type']!r}; known: RECTANGLE, POLYGON, CIRCLE")


def _absorbs(target: Plain) -> bool:
    absorber = target.get("absorber", {"enabled": target.get("absorbing", True)})
    return bool(absorber.get("enabled", True))


def _way(source: Plain, targets: Iterable[Plain]) -> tuple[str, ...]:
    """Return the targets that people of a source walk to in turn, up to the first by which people leave; () = none."""
    leave, ids = {target["id"] for target in targets if _absorbs(target)}, source.get("targetIds", ())
    last = next((k for k, one in enumerate(ids) if one in leave), -1)
    return tuple(f"target-{one}" for one in ids[: last + 1])


def _said(source: Plain, new: str, old: str, usual: Any = None) -> Any:
    """Return what stands in a source under the key of a release with spawners, or under that of an older one."""
    return source.get("spawner", {}).get(new, source.get(old, usual))


def _at_once(source: Plain) -> bool:
    begin = _said(source, "constraintsTimeStart", "startTime")
    return bool(begin == _said(source, "constraintsTimeEnd", "endTime"))


def _law(source: Plain) -> tuple[str, float]:
    """Return the law of the times between the groups of a source, and their mean [s], 0 if it is not known."""
    distribution, old = _said(source, "distribution", "", {}), source.get("distributionParameters") or [0.0]
    law = str(distribution.get("type") or source.get("interSpawnTimeDistribution", ""))
    law = law.rpartition(".")[2].removeprefix("Attributes").removesuffix("Distribution").lower()
    mean = distribution.get(_MEANS.get(law, ""), old[0]) if law in _MEANS else 0.0
    return law, 1.0 / mean if law == "poisson" and mean > 0.0 else mean


def _timetable(source: Plain) -> list[tuple[float, int]]:
    """Return (time [s], people) of the groups of a source that come later, at the mean of random intervals; or none."""
    _, every = _law(source)
    begin = _said(source, "constraintsTimeStart", "startTime", 0.0)
    end = _said(source, "constraintsTimeEnd", "endTime", begin)
    many = _said(source, "eventElementCount", "spawnNumber", 1)
    most = _said(source, "constraintsElementsMax", "maxSpawnNumberTotal", -1)
    if not end >= begin >= 0.0 or end == 0.0 or many < 1 or (end > begin and not every > 0.0):
        return []
    events = 1 + (int((end - begin) / every + 1e-9) if end > begin else 0)
    total = min(many * events, most if most > 0 else _MOST_COME + 1)
    if total > _MOST_COME:
        return []
    groups = [(begin + k * every, min(many, total - k * many)) for k in range(events)]
    return [(time, people) for time, people in groups if people > 0]


def _people(source: Plain) -> int | None:
    """Return the number of people of a source, if the file has a total."""
    most = _said(source, "constraintsElementsMax", "maxSpawnNumberTotal")
    each = _said(source, "eventElementCount", "spawnNumber")
    for count in (most, each if _at_once(source) else None):
        if isinstance(count, int) and not isinstance(count, bool) and count > 0:
            return count
    return None
