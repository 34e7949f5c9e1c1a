"""The contact forces in a crowd as lines from body to body, as wide as the force is large: chains and arches come to light."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowd_env.core.arrays.state import Floats
from crowd_env.core.behaviors.outline import Outline
from crowd_env.core.checks import POSITIVE, number
from crowd_env.geometry.geometry import Geometry
from crowd_env.physics.pressure import ContactForces, mean_contact_forces
from crowd_env.recording import Recording
from crowd_env.rendering.canvas import hex_of, mark, new_figure, without_formulas
from crowd_env.rendering.discs import bodies_of, put_bodies
from crowd_env.rendering.libraries import Figure, Image, drawing_library
from crowd_env.rendering.palette import BACKGROUND, EXIT, EXIT_MAT, FLOOR, INK, QUIET, RAMP, Color
from crowd_env.rendering.plan import Layout, draw_plan, round_length

_DPI = 160
_BIG = 9.0  # m, of a longer geometry only the surroundings of an exit are shown
_AROUND = 3.5  # m
_MARGIN = 0.35  # m, seen of the outside
_WIDTH = 1280  # px, of the longer side of the picture
_WALL = 0.12  # m, as drawn
_HEADER, _FOOTER = 60, 84  # px
_PERSON: Color = (241, 244, 246)
_RIM: Color = (200, 206, 213)
_RIM_WIDTH = 1.6  # px
_WIDEST = 0.45  # of the width of the bodies: the line of the largest force


def force_network(forces: ContactForces, *, around: float | None = None, title: str = "") -> Figure:
    """Draw the normal contact forces as lines between the centers of touching people, and to walls; return the figure.

    The width of a line is proportional to the force.  The one line collection is named "forces".

    Parameters
    ----------
    forces : of a recording, by `forces_of`.
    around : m, how far around the exit at which people press most is shown; inf for all of it.  Default 3.5 m, or the
        whole geometry if its longer side is at most 9 m.
    title : what is seen.

    Raises
    ------
    ValueError
        If ``around`` is not positive.
    """
    if around is not None and not around > 0:
        raise ValueError(f"around is {around!r}; it must be > 0")
    with drawing_library():
        from matplotlib.collections import LineCollection
    layout = _layout(forces.geometry, _window(forces, around))
    plan = draw_plan(forces.geometry, layout)
    size = (layout.width, _HEADER + layout.height + _FOOTER)
    figure = new_figure((size[0] / _DPI, size[1] / _DPI), dpi=_DPI, background=BACKGROUND, constrained=False)
    axes = figure.add_axes((0.0, _FOOTER / size[1], 1.0, layout.height / size[1]))
    extent = (0, layout.width, layout.height, 0)
    axes.imshow(np.asarray(_with_people(plan, forces, layout)), extent=extent, interpolation="none")
    walls = _walls_only(np.asarray(plan))
    axes.imshow(walls, extent=extent, interpolation="none", zorder=4)  # lines end where the wall begins
    axes.set_axis_off()
    pressing = np.flatnonzero(forces.force > 0.0)
    pressing = pressing[np.argsort(forces.force[pressing])]  # the largest on top
    force = forces.force[pressing]
    full = float(force.max(initial=0.0)) or 1.0
    typical = float(np.median(forces.radius)) if len(forces.radius) else 0.25
    width = 72.0 / _DPI * layout.scale * _WIDEST * 2.0 * typical  # pt, of the line of `full`
    ends = np.stack([layout.pixels(forces.position[forces.i[pressing]]), layout.pixels(forces.at[pressing])], axis=1)
    lines = LineCollection(
        list(ends),
        colors=_colors(force / full),
        linewidths=width * force / full,
        capstyle="round",
        label="forces",
        zorder=3,
    )
    axes.add_collection(lines, autolim=False)
    axes.set_xlim(0, layout.width)
    axes.set_ylim(layout.height, 0)
    text: dict[str, Any] = {"color": hex_of(INK), "fontsize": 12, "fontweight": "bold", "va": "center"}
    figure.text(0.03, 1.0 - 0.5 * _HEADER / size[1], title, **text)
    figure.text(0.97, 1.0 - 0.5 * _HEADER / size[1], f"{forces.time:.1f} s", ha="right", **text)
    unit, of_unit = ("N", 1.0) if full < 1e4 else ("kN", 1e3)
    shown = _round_forces(full) if len(force) else []
    marks = [mark("normal force" if shown else "nobody presses on anybody", linestyle="none")]
    for level in shown:
        (shade,) = _colors(np.array([level / full]))
        line, named = width * level / full, f"{level / of_unit:g} {unit}"
        marks.append(mark(named, color=shade, linewidth=line, solid_capstyle="butt"))
    figure.legend(
        handles=marks, ncols=len(marks), loc="center left", bbox_to_anchor=(-0.05, 0.5 * _FOOTER / size[1]),
        fontsize=10, labelcolor=hex_of(QUIET), frameon=False, handlelength=3.2, columnspacing=1.6,
    )  # fmt: skip
    return without_formulas(figure)


def _window(forces: ContactForces, around: float | None) -> tuple[float, float, float, float]:
    """Return the part of the geometry that is shown (min x, min y, max x, max y) [m]."""
    geometry = forces.geometry
    min_x, min_y, max_x, max_y = geometry.bounds
    if around is None:
        around = np.inf if max(max_x - min_x, max_y - min_y) <= _BIG else _AROUND
    if np.isinf(around):
        x, y = 0.5 * (min_x + max_x), 0.5 * (min_y + max_y)
    else:
        x, y = _busiest_place(forces, around)
    (left, right), (low, high) = _span(x, around, min_x, max_x), _span(y, around, min_y, max_y)
    return left, low, right, high


def _span(middle: float, around: float, low: float, high: float) -> tuple[float, float]:
    """Return 2 ``around`` about ``middle``, moved inwards to stay within the geometry, and cut where that is smaller."""
    low, high = low - _MARGIN, high + _MARGIN
    if high - low <= 2.0 * around:
        return low, high
    begin = min(max(middle - around, low), high - 2.0 * around)
    return begin, begin + 2.0 * around


def _busiest_place(forces: ContactForces, around: float) -> tuple[float, float]:
    """Return the middle of the exit with the largest forces around it; without exits, the middle of all forces."""
    pressed, force = forces.position[forces.i], forces.force.clip(0.0)
    if not len(forces.geometry.exits):
        weights = force if force.any() else None
        x, y = np.average(pressed, axis=0, weights=weights) if len(pressed) else forces.geometry.walls.mean(axis=(0, 1))
        return float(x), float(y)
    middles = forces.geometry.exits.mean(axis=1)
    near = np.linalg.norm(pressed[None] - middles[:, None], axis=2) < around
    x, y = middles[int(np.argmax((near * force).sum(axis=1)))]
    return float(x), float(y)


def _layout(geometry: Geometry, window: tuple[float, float, float, float]) -> Layout:
    min_x, min_y, max_x, max_y = window
    scale = _WIDTH / max(max_x - min_x, max_y - min_y)
    width, height = (max(round(scale * span), 480) for span in (max_x - min_x, max_y - min_y))
    origin = (
        0.5 * (width - scale * (max_x - min_x)) - scale * min_x,
        0.5 * (height - scale * (max_y - min_y)) + scale * max_y,
    )
    return Layout(width, height, scale, origin, max(_WALL * scale, 3.0), 20.0, round(0.04 * width), 0, 0)


def _with_people(plan: Image, forces: ContactForces, layout: Layout) -> Image:
    """Return the image of the geometry with the people drawn lightly."""
    image, inside = plan.copy(), np.flatnonzero(forces.active)
    bodies = bodies_of(forces, forces.position, forces.radius, angle=forces.angle).rows(inside)
    paint, rim = (np.full((len(inside), 3), color, dtype=np.uint8) for color in (_PERSON, _RIM))
    put_bodies(image, layout, bodies, paint, rim=rim, edge=_RIM_WIDTH)
    return image


def _walls_only(plan: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the image (H, W, 4) of the geometry, transparent where people can be."""
    floor = np.zeros(plan.shape[:2], dtype=bool)
    for color in (FLOOR, EXIT, EXIT_MAT):
        floor |= (plan == color).all(axis=2)
    return np.dstack([plan, np.where(floor, 0, 255).astype(np.uint8)])


def _colors(level: Floats) -> Floats:
    """Return a color (K, 4) for each force in units of the largest: the ramp of pressures without its palest part."""
    rows = np.rint((0.1 + 0.9 * np.clip(level, 0.0, 1.0)) * (len(RAMP) - 1)).astype(np.int64)
    return np.column_stack([RAMP[rows] / 255.0, np.ones(len(level))])


def _round_forces(full: float) -> list[float]:
    """Return three forces of 1, 2 or 5 times a power of ten, the largest at most ``full``."""
    largest = round_length(full)
    middle = round_length(0.99 * largest)
    return [round_length(0.99 * middle), middle, largest]


def forces_of(recording: Recording, at: float | None = None) -> ContactForces:
    """Return the mean contact forces of a recording between two frames, the second at ``at`` [s] or next after it.

    By default that is the end if the exits blocked, else the moment when people bear the largest forces in all.

    Raises
    ------
    ValueError
        If the recording holds no contacts, or ``at`` is not positive or after its end.
    """
    contacts, times = recording.contacts, recording.times
    if contacts is None:
        raise ValueError("the recording holds no contacts; record it with contacts=True, or without --no-contacts")
    if at is not None:
        if number("the moment of the forces", at, POSITIVE, "s") > recording.end + recording.frame_interval:
            raise ValueError(f"the evacuation was over after {recording.end:.1f} s; there are no forces at {at:g} s")
        frame = min(int(np.searchsorted(times, at - 1e-9)), len(times) - 1)
    elif recording.facts.get("blocked_since") is not None:
        frame = int(recording.frame[~recording.beyond].max(initial=0))
    else:
        load = recording.pressure * recording.radius[recording.person]
        frame = int(np.argmax(np.bincount(recording.frame, load, minlength=len(times))))
    rows = recording.rows_of(frame)
    person, count = recording.person[rows], len(recording.radius)
    position, active, angle = np.full((count, 2), np.nan), np.zeros(count, dtype=bool), np.zeros(count)
    position[person], active[person] = recording.position[rows], ~recording.beyond[rows]
    if recording.angle is not None:
        angle[person] = recording.angle[rows]
    start, i, j, _, _, point, force = contacts
    here = slice(start[frame], start[frame + 1])
    found = ContactForces(
        geometry=recording.geometry,
        time=float(times[frame]),
        position=position,
        radius=recording.radius,
        active=active,
        i=i[here],
        j=j[here],
        at=point[here],
        force=force[here, 0],
        angle=angle,
        outline=Outline.of(recording.outline),
    )
    return mean_contact_forces([found])  # of bodies that touch in several places the sum
