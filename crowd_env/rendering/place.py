"""A place on axes in meters: floor, what no exit reaches, regions, walls, doors, exits, people and narrow passages."""

import textwrap
from itertools import cycle
from typing import Any, NamedTuple

import numpy as np

from crowd_env.analysis.passages import Gap
from crowd_env.analysis.plan_check import PlanCheck
from crowd_env.core.checks import counted
from crowd_env.rendering.canvas import draw_bodies, draw_floor, draw_lines, fill_rings, hex_of, mark
from crowd_env.rendering.libraries import Axes, Line2D, PathPatch
from crowd_env.rendering.palette import EXIT, EXIT_MAT, INK, OBSTACLE, QUIET, SEAM, SERIES, WALL, Color
from crowd_env.rendering.plan import exit_areas, exit_places, holes_of, label_seams, label_sheets, shells_of
from crowd_env.scenarios.plans.floor_plan import listed

DOOR: Color = (196, 120, 32)
NARROW: Color = (200, 30, 45)
SECTION: Color = (98, 60, 160)
EDGE: Color = (240, 238, 233)  # where the center of no body can be
_COHORTS = (0, 1, 2, 4)  # of SERIES
# Of regions without a start; the others have the color of the cohort that starts there.
_REGIONS: tuple[Color, ...] = (
    (74, 92, 160),
    (180, 70, 110),
    (100, 130, 40),
    (50, 140, 200),
    (170, 110, 60),
    (90, 80, 120),
)
_PASSAGE: dict[str, Any] = {"color": hex_of(NARROW), "linewidth": 1.8, "marker": "o", "markersize": 3.5}
_MOST_NODES = 3e5  # of the contour of where bodies fit
_WIDEST = 46  # letters of a line in a legend
_SEEN = 60.0  # m; in larger plans bodies are drawn larger than they are
_NAMED = 24  # exits that have their names beside them


class Layers(NamedTuple):
    """What has been drawn, as entries of a legend."""

    exits: list[Line2D]
    regions: list[Line2D]
    people: list[Line2D]
    others: list[Line2D]


def draw_place(axes: Axes, check: PlanCheck, *, widths: bool, edge: bool = True, size: float = 8.0) -> Layers:
    """Draw a place and one crowd on axes, and return what a legend says of it.

    Parameters
    ----------
    widths : whether exits and narrow passages tell how wide they are.
    edge : whether the strip along the walls is tinted where the center of no body can be.
    size : points, of names.
    """
    geometry = check.geometry
    floor = draw_floor(axes, geometry)
    fill_rings(axes, holes_of(geometry.walkable), OBSTACLE, 1.25)
    for hole in exit_areas(geometry):
        fill_rings(axes, [hole], EXIT_MAT, 1.26)
    others: list[Line2D] = []
    if edge and _draw_edge(axes, check, floor):
        near = f"nearer to a wall than a body's radius, {0.5 * check.body[0]:.2f} m"
        others.append(_square(near, EDGE, edge=(200, 196, 188)))
    regions = _draw_regions(axes, check)
    if check.unreached:
        others.append(_draw_unreached(axes, check))
    fixed, thin = geometry.walls_when(())
    draw_lines(axes, fixed[~thin], WALL, 1.6, 4, capstyle="projecting")
    draw_lines(axes, fixed[thin], WALL, 1.0, 4)
    leaves = geometry.walls[geometry.door_of_wall >= 0]
    draw_lines(axes, leaves, DOOR, 2.4, 5)
    if len(leaves):
        names = textwrap.fill(f"doors: {', '.join(geometry.doors)}", _WIDEST)
        others.append(mark(names, color=hex_of(DOOR), linewidth=2.4))
    draw_lines(axes, geometry.exits, EXIT, 4.5, 5, capstyle="butt")
    for one in check.sections:
        points = np.array(one.line)
        axes.plot(*points.T, color=hex_of(SECTION), linewidth=1.6, dashes=(5, 2), zorder=7)
        _label(axes, one.name, 0.7 * points[0] + 0.3 * points[1], (0, 0), SECTION, size)
    if check.sections:
        names = textwrap.fill(f"people are counted: {', '.join(one.name for one in check.sections)}", _WIDEST)
        others.append(mark(names, color=hex_of(SECTION), linewidth=1.6, dashes=(5, 2)))
    if geometry.building is not None:
        draw_lines(axes, geometry.building.lines, SEAM, 4.5, 5, capstyle="butt")
        for name, corner, _ in label_sheets(geometry.building):
            axes.annotate(name, tuple(corner), (0, -11), textcoords="offset points", fontsize=size, color=hex_of(QUIET))
        for letter, middle, outward in label_seams(geometry.building):
            _label(axes, letter, middle, (size + 1) * outward, INK, size, boxed=False)
        others.append(mark("to the sheet with the same letter", color=hex_of(SEAM), linewidth=4.5))
    exits = _name_exits(axes, check, widths, size)
    people = _draw_people(axes, check)
    return Layers(exits, regions, people, others)


def _square(label: str, color: Color, alpha: float = 1.0, edge: Color | None = None) -> Line2D:
    fill = (hex_of(color), alpha)
    return mark(label, linestyle="none", marker="s", markersize=9, mfc=fill, mec=hex_of(edge or color))


def _draw_edge(axes: Axes, check: PlanCheck, floor: PathPatch) -> bool:
    """Tint the floor nearer to a wall than the smallest body's radius; return whether that can be seen."""
    terrain, radius = check.terrain, 0.5 * check.body[0]
    step = max(1, int(np.ceil(np.sqrt(terrain.clearance.size / _MOST_NODES))))
    if step * terrain.spacing > 0.6 * radius:
        return False
    clearance = terrain.clearance[::step, ::step]
    y, x = (terrain.origin[k] + step * terrain.spacing * np.arange(clearance.shape[1 - k]) for k in (1, 0))
    tint = axes.contourf(x, y, clearance, levels=[-1.0, radius], colors=[hex_of(EDGE)], zorder=1.2)
    tint.set_clip_path(floor)
    return True


def _draw_regions(axes: Axes, check: PlanCheck) -> list[Line2D]:
    """Tint and frame each region in its own color, the smaller above the larger, and return their entries."""
    geometry, others = check.geometry, cycle(_REGIONS)
    starts = {part.start_region: _of_cohort(k) for k, part in reversed(list(enumerate(check.people.parts)))}
    colors = {name: starts[name] if name in starts else next(others) for name in geometry.regions}
    for name in sorted(geometry.regions, key=geometry.area_of, reverse=True):
        area: Any = geometry.regions[name].intersection(geometry.walkable)
        rings = [*shells_of(area), *holes_of(area)]
        fill_rings(axes, rings, colors[name], 1.3, alpha=0.15)
        for ring in rings:
            axes.plot(*ring.T, color=hex_of(colors[name]), linewidth=0.8, alpha=0.75, dashes=(4, 2), zorder=3)
    return [_square(f"{name}  {geometry.area_of(name):.1f} m²", color, 0.2, color) for name, color in colors.items()]


def _draw_unreached(axes: Axes, check: PlanCheck) -> Line2D:
    """Hatch what no exit reaches, and write how large each part is."""
    for part, area in check.unreached:
        patch = fill_rings(axes, [*shells_of(part), *holes_of(part)], (248, 218, 214), 2.6)
        patch.set(hatch="///", edgecolor=hex_of(NARROW), linewidth=0.8)
        at = part.representative_point()
        _label(axes, f"{area:.3g} m²", (at.x, at.y), (0, 0), NARROW, 7.5)
    total = sum(area for _, area in check.unreached)
    return _square(f"no exit reaches it: {total:.3g} m²", (248, 218, 214), 1.0, NARROW)


def _label(
    axes: Axes, text: str, at: Any, off: Any, color: Color, size: float, *, turn: float = 0.0, boxed: bool = True
) -> None:
    axes.annotate(
        text, at, off, textcoords="offset points", annotation_clip=False, color=hex_of(color), fontsize=size,
        fontweight="bold", ha="center", va="center", rotation=turn, zorder=9,
        bbox={"facecolor": "white", "alpha": 0.85, "edgecolor": "none", "pad": 0.8} if boxed else None,
    )  # fmt: skip


def _name_exits(axes: Axes, check: PlanCheck, widths: bool, size: float) -> list[Line2D]:
    """Write the names of exits outside of them, along the wall, and return their entries."""
    places, entries = exit_places(check.geometry), []
    for k, (name, width) in enumerate(check.widths.items()):
        text = f"{name}  {width:.2f} m" if widths else name
        entries.append(mark(text, color=hex_of(EXIT), linewidth=4))
        if k >= _NAMED:
            continue
        middle, outward = places[name]
        turn = 90.0 if abs(outward[0]) > abs(outward[1]) else 0.0
        _label(axes, text, middle, (1.25 * size + 1) * outward, EXIT, size, turn=turn, boxed=False)
    return entries


def _of_cohort(k: int) -> Color:
    return SERIES[_COHORTS[k % len(_COHORTS)]]


def _draw_people(axes: Axes, check: PlanCheck) -> list[Line2D]:
    entries = []
    x0, y0, x1, y1 = check.bounds
    wide = max(x1 - x0, y1 - y0) > _SEEN
    for k, part in enumerate(check.people.parts):
        here, color = check.cohort == k, hex_of(_of_cohort(k))
        rim, width = (color, 1.5) if wide else ("white", 0.3)
        center, radius = check.position[here], check.radius[here]
        draw_bodies(axes, center, radius, facecolor=color, edgecolor=rim, linewidth=width, zorder=6)
        text = counted(part.people, "person", "people") + (f", {part.name}" if part.name else "")
        entries.append(mark(text, color=color, linestyle="none", marker="o", markersize=7, markeredgecolor="white"))
    return entries if len(check.position) else []


def draw_passages(axes: Axes, check: PlanCheck, size: float = 8.0) -> list[Line2D]:
    """Draw the narrowest passage on the way to each exit as a line with its width, and return their entries."""
    found = [passage for passage in check.passages.values() if passage is not None]
    inside: dict[tuple[float, ...], tuple[Gap, list[str]]] = {}
    for passage in found:
        gap = passage.gap
        axes.plot(*gap.line.T, **_PASSAGE, zorder=8)
        if not passage.is_exit:
            key = tuple(np.round(np.sort(gap.line, axis=0).ravel(), 3).tolist())
            inside.setdefault(key, (gap, []))[1].append(passage.exit)
    texts = []
    for gap, names in inside.values():
        a, b = gap.line
        along = (b - a) / max(float(np.hypot(*(b - a))), 1e-9)
        off = size * np.array([2.6 * abs(along[1]), 1.2 * abs(along[0])]) * _emptier_side(check, gap)
        _label(axes, f"{gap.width:.2f} m", gap.line.mean(axis=0), off, NARROW, size)
        texts.append(f"narrowest to {listed(names)}: {gap.width:.2f} m, {gap.width / check.body[1]:.1f} bodies")
    own = [passage.exit for passage in found if passage.is_exit]
    if own:
        texts.append(f"nothing narrower than the exit itself on the way to {listed(own)}")
    return [mark(textwrap.fill(text, _WIDEST), **_PASSAGE) for text in texts]


def _emptier_side(check: PlanCheck, gap: Gap) -> float:
    """Return on which side of a gap fewer people stand near: 1.0 = right of it or above, -1.0 = left or below."""
    a, b = gap.line
    normal = np.array([abs(b[1] - a[1]), abs(b[0] - a[0])])
    away = check.position - 0.5 * (a + b)
    near = np.hypot(*away.T) < 1.5 * gap.width
    return 1.0 if float(np.sign(away[near] @ normal).sum()) <= 0 else -1.0
