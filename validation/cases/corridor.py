"""The open corridor: nine runs through 1.8 m, held up at the entrance or at the exit (Hermes, Düsseldorf 2009)."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from crowd_env import Geometry, Normal, Scenario
from crowd_env.core.checks import Plain
from crowd_env.geometry.geometry import box
from validation.cases import voronoi
from validation.cases.case import RECORDED, Row, Setting, adults, number, row
from validation.cases.crowds import Floats, Passages, draw_crowds
from validation.cases.trajectories import Trajectories, read_trajectories
from validation.cases.voronoi import Look, fundamental_diagram, looks_at, mean_figures

DATA = "corridor_hermes2009_uo"  # folder of the recordings
DENSITY_WITHIN, FLOW_WITHIN, ENOUGH = 0.25, 0.15, 7


class Run(NamedTuple):
    """What was done and measured: density, speed in the field, and flow at its line, while the flow was steady."""

    entrance: float  # m
    exit: float  # m
    people: int
    first: int  # the steady part: between the passages of these two persons
    last: int
    density: float  # 1/m2
    speed: float  # m/s
    flow: float  # 1/s


RUNS = tuple(Run(*run) for run in RECORDED["corridor"]["runs"])

_LEFT, _RIGHT, _MIDDLE = 0.0, 1.8, 0.9  # m, x of the corridor's walls and middle
_TOP, _BOTTOM = 4.0, -4.0  # m, y of the corridor's ends
_PASSAGE, _END = 8.0, -6.5  # m, y where the passage in front of it begins, and the opening behind ends
_NECK, _HALF, _DENSITY = 0.2, 4.0, 3.0  # m, m, 1/m2: length of entrance and exit; half width of the waiting area; in it
LINE = 0.0  # m, y of the counting line
FIELD = box(_LEFT, -2.0, _RIGHT, 0.0)
_FLOOR = box(_LEFT, _BOTTOM, _RIGHT, _TOP)
_NEAR = (-4.0, 2.0)  # m, y of those whose cells can matter
_SPEED = Normal(1.55, 0.18, 1.0, 2.1)  # m/s, free speed of 42 of the participants as the paper gives it
_PATIENCE, _LIMIT = 20.0, 300.0  # s
_FRAMES = 16.0  # 1/s, of the recordings


def corridor(run: Run) -> Scenario:
    """Return waiting area, entrance, passage, corridor, exit and the opening behind; everyone walks towards smaller y."""
    depth = run.people / (_DENSITY * 2.0 * _HALF) + 0.5
    front = _PASSAGE + _NECK
    floor = [
        box(_MIDDLE - _HALF, front, _MIDDLE + _HALF, front + depth),
        box(_MIDDLE - 0.5 * run.entrance, _PASSAGE - 0.01, _MIDDLE + 0.5 * run.entrance, front + 0.01),
        box(_LEFT - 1.0, _TOP, _RIGHT + 1.0, _PASSAGE),
        _FLOOR,
        box(_MIDDLE - 0.5 * run.exit, _BOTTOM - _NECK - 0.01, _MIDDLE + 0.5 * run.exit, _BOTTOM + 0.01),
        box(_LEFT - 1.0, _END, _RIGHT + 1.0, _BOTTOM - _NECK),
    ]
    place = Geometry.from_polygon(
        floor,
        exits={"out": [(_LEFT - 1.0, _END), (_RIGHT + 1.0, _END)]},
        regions={"waiting": box(_MIDDLE - _HALF, front + 0.5, _MIDDLE + _HALF, front + depth)},
    )
    people = adults(run.people, start_region="waiting", desired_speed=_SPEED)
    return Scenario(f"corridor-{run.entrance:g}-{run.exit:g}", place, people, _LIMIT)


def measure(setting: Setting, runs: tuple[Run, ...] = RUNS) -> list[dict[str, Any]]:
    """Return density, speed, flow and the number of stuck draws of each run, and densities and speeds at all looks (K, 2)."""
    crowds = draw_crowds([corridor(run) for run in runs], setting)
    passages = Passages(crowds, 1, LINE, sign=-1)
    looks = looks_at(crowds, passages.moments(_LIMIT, _PATIENCE), lambda x, y: (y > _NEAR[0]) & (y < _NEAR[1]))
    found: list[dict[str, Any]] = []
    for k, run in enumerate(runs):
        parts = [steady(run, passages.times(e), [one for one in looks if one.crowd == e]) for e in crowds.of(k)]
        samples = np.concatenate([each for each, _ in parts])
        found.append({**mean_figures(parts), "stuck": passages.count_stuck(k), "samples": samples})
    return found


def steady(run: Run, times: Floats, looks: list[Look]) -> tuple[Floats, float]:
    """Return densities and speeds (K, 2) and the flow of the steady part of a run; nan if its last person did not pass."""
    return voronoi.steady(run.first, run.last, times, looks, _FLOOR, FIELD)


def recorded_diagram(folder: Path) -> dict[float, float] | None:
    """Return the mean speed [m/s] in bins of density [1/m2] of the recorded runs; None if the folder does not hold them.

    Measured as those of the simulated people, twice a second; speeds are those over 10 frames, 0.6 s, so that heads that
    sway walk no faster.
    """
    if not folder.is_dir():
        return None
    samples = []
    for run in RUNS:
        name = f"uo-{100 * run.entrance:03.0f}-180-{100 * run.exit:03.0f}.txt"
        path = folder / name if (folder / name).exists() else folder / f"{name}.gz"
        recorded = read_trajectories(path, frame_rate=_FRAMES, unit=0.01)
        times = np.sort(recorded.crossing_times(LINE))
        samples.append(steady(run, times, recorded_looks(recorded, _FRAMES))[0])
    return fundamental_diagram(np.concatenate(samples))


def recorded_looks(recorded: Trajectories, frame_rate: float) -> list[Look]:
    """Return the recorded people in the corridor twice a second, and their speeds."""
    looks, half = [], 5
    frame = np.round(recorded.time * frame_rate).astype(int)
    same = np.zeros(len(frame), dtype=bool)
    same[half:-half] = recorded.person[2 * half :] == recorded.person[: -2 * half]
    speed = np.zeros(len(frame))
    step = recorded.position[2 * half :] - recorded.position[: -2 * half]
    speed[half:-half] = np.hypot(*step.T) * frame_rate / (2 * half)
    y = recorded.position[:, 1]
    here = same & (y > _BOTTOM) & (y < _TOP)
    for at in range(int(frame.min()), int(frame.max()) + 1, round(0.5 * frame_rate)):
        now = here & (frame == at)
        looks.append(Look(0, at / frame_rate, recorded.position[now], speed[now]))
    return looks


def near(found: Plain, run: Run) -> tuple[bool, bool]:
    """Return whether density and flow are near the recorded ones."""
    density, flow = found["density"] / run.density - 1.0, found["flow"] / run.flow - 1.0
    return abs(density) <= DENSITY_WITHIN, abs(flow) <= FLOW_WITHIN


def run(setting: Setting) -> list[Row]:
    """Return the row."""
    found = measure(setting)
    diagram = fundamental_diagram(np.concatenate([one.pop("samples") for one in found]))
    recorded = None if setting.data is None else recorded_diagram(setting.data / DATA)
    judged = np.array([near(one, r) for one, r in zip(found, RUNS, strict=True)])
    density, flow = judged.sum(axis=0)
    both, stuck = int(judged.all(axis=1).sum()), int(sum(one["stuck"] for one in found))
    pairs = zip(found, RUNS, strict=True)
    figures = ", ".join(
        f"{number(one['density'])} ({r.density:.2f}) {number(one['flow'])} ({r.flow:.2f})" for one, r in pairs
    )
    figure = f"both in {both} of 9, density in {density}, flow in {flow}; density and flow (recorded): {figures}"
    figure += f"; {stuck} of {len(RUNS) * setting.draws} stuck" if stuck else ""
    more: dict[str, Any] = {"runs": found, "recorded": [one._asdict() for one in RUNS], "both": both}
    more |= {"diagram": diagram, "recorded_diagram": recorded}
    return [row("corridor", setting, both >= ENOUGH, figure, **more)]
