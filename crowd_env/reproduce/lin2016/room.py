"""Figure 6 of Lin, Ma, Lo: the room at four moments of one evacuation."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from crowd_env.core.arrays.state import Floats, unit_vectors
from crowd_env.envs.crowd import CrowdEnv, Step
from crowd_env.geometry.geometry import Geometry
from crowd_env.rendering.canvas import draw_bodies, draw_geometry, draw_lines, hex_of, name_panel, new_figure
from crowd_env.rendering.libraries import Figure
from crowd_env.reproduce.evacuations import Case
from crowd_env.reproduce.lin2016.sample import Samples, foot
from crowd_env.reproduce.lin2016.settings import LinSettings
from crowd_env.reproduce.result import RawTable, Result, Row

PEOPLE, SPEED = 200, 1.0  # m/s, Table 1
_RIM = (79, 111, 136)
MOMENTS = (0.0, 30.0, 60.0, 120.0)  # s


class _Moments:
    """Keeps where the people inside are at the moments: rows of x, y, radius [m] and the angle turned [rad]."""

    def begin(self, env: CrowdEnv, runs: Sequence[int]) -> None:
        self._kept: list[list[list[list[float]]]] = [[] for _ in runs]
        self._look(env)

    def add(self, env: CrowdEnv, step: Step) -> None:
        self._look(env)

    def record(self, env: CrowdEnv, e: int) -> list[list[list[float]]]:
        # A run ends before the last moment only when everybody is out.
        return self._kept[e] + [[]] * (len(MOMENTS) - len(self._kept[e]))

    def _look(self, env: CrowdEnv) -> None:
        state, bodies = env.simulation.state, env.simulation.bodies
        columns = np.column_stack([state.position, bodies.radius, state.angle])
        for e, kept in enumerate(self._kept):
            people = env.people(e)
            if len(kept) < len(MOMENTS) and abs(state.time[e] - MOMENTS[len(kept)]) < 0.5 * env.decision_dt:
                kept.append(columns[people][state.active[people]].tolist())


def cases(settings: LinSettings) -> dict[str, Case]:
    """Return the run that the figure shows: the first draw."""
    return {"shown": replace(settings.case(PEOPLE, SPEED), recorder=_Moments())}


def reproduce(settings: LinSettings, found: Samples) -> Result:
    """Return the figure, made of its run."""
    shown = found["shown"]
    (episode,) = shown.episodes
    moments = {moment: np.array(rows).reshape(-1, 4) for moment, rows in zip(MOMENTS, episode.record, strict=True)}
    rows = [
        Row(f"inside, t = {moment:g} s", None, len(people), "people", 1, "one draw; the paper shows it only")
        for moment, people in moments.items()
    ]
    raw = RawTable(
        ("time_s", "x_m", "y_m", "radius_m", "angle_rad"),
        [(f"{moment:g}", *(f"{one:.6f}" for one in row)) for moment, people in moments.items() for row in people],
    )
    readings = settings.readings().partition("; ")[2]
    remarks = [f"Draw {episode.seed} at {SPEED:g} m/s, the speed of Table 1. {readings}"]

    def draw() -> Figure:
        figure = draw_rooms(moments, shown.case.place.geometry)
        return foot(figure, f"{SPEED:g} m/s, draw {episode.seed}; {readings}")

    return Result([rows], {"positions": raw}, draw, remarks, "people")


def draw_rooms(moments: Mapping[float, Floats], geometry: Geometry) -> Figure:
    """Return the room at four moments [s], two by two; of each person (K, 4) x, y and radius [m] and angle [rad]."""
    figure = new_figure((8.6, 9.0))
    for letter, axes, (time, people) in zip("abcd", figure.subplots(2, 2).flat, moments.items(), strict=True):
        middle, radius, angle = people[:, :2], people[:, 2:3], people[:, 3]
        draw_geometry(axes, geometry, wall=2.4, exit=2.4, margin=0.03)
        draw_bodies(axes, middle, radius[:, 0], facecolor="#c3d4e0", edgecolor=hex_of(_RIM), linewidth=0.8, zorder=2)
        rim = middle + radius * unit_vectors(angle)
        draw_lines(axes, np.stack([middle, rim], axis=1), _RIM, 0.8, 3)
        name_panel(axes, f"{letter}. t = {time:g} s, {len(people)} inside")
    return figure
