"""Buildings for tests: storeys one above the other, with or without a stair, and corridors with a ramp."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from shapely.geometry import Polygon, box

from crowd_env.core.arrays.state import Bodies, CrowdState, make_state
from crowd_env.geometry.geometry import Geometry
from crowd_env.geometry.sheets import Seam, Sheet, lay_out
from crowd_env.geometry.surface import Slope
from crowd_env.physics.simulation.simulation import Simulation

FLOOR = box(0, 0, 12, 8).difference(box(5, 3, 7, 5))
DOORS = {"east": np.array([[12.0, 3.0], [12.0, 5.0]]), "north": np.array([[2.0, 8.0], [3.5, 8.0]])}
RISE, RUN = 3.0, 4.5  # m, of the stair
UP, DOWN = 0.6, 0.7


def laid(sheets: list[Sheet], seams: list[Seam], exits: Mapping[str, tuple[int, np.ndarray]], **others) -> Geometry:
    """Return a building; each exit is given with the number of its sheet, in true coordinates."""
    offsets = lay_out([sheet.area for sheet in sheets])
    sheets = [replace(sheet, offset=tuple(by)) for sheet, by in zip(sheets, offsets.tolist(), strict=True)]
    return Geometry.from_sheets(sheets, seams, exits={n: line + offsets[s] for n, (s, line) in exits.items()}, **others)


def stacked(floors: list[Polygon], height: float = 3.0) -> Geometry:
    """Return storeys without stairs; each has its own doors."""
    exits = {f"{name} {s}": (s, line) for s in range(len(floors)) for name, line in DOORS.items()}
    return laid([Sheet(f"storey {s}", floor, s * height) for s, floor in enumerate(floors)], [], exits)


def with_stair(stair: Polygon | None = None, line: np.ndarray | None = None, rise: float = RISE, **others) -> Geometry:
    """Return two storeys and a straight stair along x; the door is below.  Sheets: 0 below, 1 above, 2 the stair."""
    hole = box(4, 0, 4 + RUN, 1.25)
    floor = box(0, 0, 12, 6).difference(hole)
    slope = rise / RUN
    sheets = [
        Sheet("ground", floor, 0.0),
        Sheet("upper", floor, RISE),
        Sheet("stair", stair or hole, slopes=(Slope(stair or hole, (slope, 0.0, -4.0 * slope), UP, DOWN),)),
    ]
    foot = np.array([[4.0, 0.0], [4.0, 1.25]]) if line is None else line
    head = np.array([[4.0 + RUN, 0.0], [4.0 + RUN, 1.25]])
    return laid(
        sheets, [Seam(foot, 0, 2), Seam(head, 2, 1)], {"door": (0, np.array([[0.0, 4.5], [0.0, 2.5]]))}, **others
    )


def ramp(rise: float, run: float, ends: float, **speeds: float) -> tuple[list[Sheet], list[Seam]]:
    """Return three sheets of a corridor along x, 2 m wide: level, a ramp that begins at x = 0, level again."""
    slope = Slope(box(0, 0, run, 2), (rise / run, 0.0, 0.0), **speeds)
    sheets = [
        Sheet("low", box(-ends, 0, 0, 2), 0.0),
        Sheet("ramp", slope.area, slopes=(slope,)),
        Sheet("high", box(run, 0, run + ends, 2), rise),
    ]
    lines = (np.array([[x, 0.0], [x, 2.0]]) for x in (0.0, run))
    return sheets, [Seam(line, left, left + 1) for left, line in enumerate(lines)]


def started(
    place: Geometry, bodies: Bodies, position: np.ndarray, sheet: np.ndarray | int, law: str, **options
) -> Simulation:
    """Return a simulation of people on these sheets; nothing is shared with other ones."""
    bodies = Bodies(*(array.copy() for array in bodies))
    state: CrowdState = make_state(position, options.pop("velocity", None), sheet=sheet)
    return Simulation(place, bodies, state, physics=options.pop("physics", law), **options)


def run(simulation: Simulation, seconds: float) -> None:
    """Let so much time pass."""
    simulation.advance(n_substeps=round(seconds / simulation.dt))


def in_two_storeys(rng: np.random.Generator, above: int, below: int) -> tuple[np.ndarray, np.ndarray]:
    """Return where people stand in `with_stair`, on a lattice, and on which sheets."""
    spots = np.stack(np.meshgrid(np.arange(1.0, 11.5, 0.8), np.arange(2.0, 5.7, 0.8)), -1).reshape(-1, 2)
    chosen = [spots[rng.permutation(len(spots))[:count]] for count in (below, above)]
    return np.concatenate(chosen) + rng.uniform(-0.05, 0.05, (above + below, 2)), np.repeat([0, 1], [below, above])
