"""The gate of 0.5 m: 75 students leave a waiting area (Wuppertal 2018, run 040_c_56_h-).

Data: Jülich pedestrian dynamics data archive, series DOI 10.34735/ped.2018.1.  Paper: Adrian, Seyfried, Sieben 2020, "Crowds
in front of bottlenecks at entrances from the perspective of physics and social psychology", J. R. Soc. Interface 17:20190871.
"""

from typing import Any

import numpy as np

from crowd_env import Scenario, Uniform
from crowd_env.core.checks import Plain
from validation.cases.case import Row, Setting, adults, number, row, share
from validation.cases.crowds import Floats, Passages, draw_crowds, mean_of, steady_flow
from validation.cases.standards.places import PLACES, place
from validation.cases.trajectories import find_recording, read_trajectories

DATA = "bottleneck_wuppertal2018_040c56h"  # folder of the recording

FLOW = 1.13  # 1/s, slope of the recorded N(t)
EAGER = 1.255  # 1/s, of run 110_c: people who were asked to be eager; its passages were not at hand
PASSED = {10: 8.3, 20: 16.2, 40: 33.1, 60: 51.4, 75: 65.6}  # person -> s, at the line
WITHIN, MOST_VARIED = 0.15, 0.35

PLAN: list[list[float]] = PLACES["gate"]["floor"][0]  # corners [m] of waiting area, funnel and gate
_HALF, _DEPTH = PLAN[-1]  # m, half width and depth of the waiting area
_LINE = -0.5  # m, y where people are counted

RADIUS = 0.17  # m
_PATIENCE = 20.0  # s without a passage: stuck
_ROUNDS = 2000


def push_apart(starts: Floats, radius: float) -> Floats:
    """Return recorded heads (N, 2), moved apart until discs of ``radius`` [m] fit between each other and the barriers.

    Bodies with shoulders take the radius within which they can turn.

    Raises
    ------
    ValueError
        If they do not come apart.
    """
    place, least = starts.copy(), 2.0 * radius + 1e-6
    for _ in range(_ROUNDS):
        place[:, 0] = np.clip(place[:, 0], radius - _HALF, _HALF - radius)
        place[:, 1] = np.clip(place[:, 1], radius, _DEPTH - radius)
        between = place[:, None] - place[None]
        distance = np.hypot(between[..., 0], between[..., 1])
        np.fill_diagonal(distance, np.inf)
        if distance.min() >= 2.0 * radius:
            return place
        overlap = np.maximum(least - distance, 0.0)
        place += 0.5 * np.einsum("ij,ijk->ik", overlap / np.maximum(distance, 1e-9), between)
    raise ValueError(f"people who need a radius of {radius:.3g} m do not fit where they were recorded")


def gate(starts: Floats | None, room: float = 1.0) -> Scenario:
    """Return waiting area, funnel and gate with free space behind; without recorded starts people stand anywhere there.

    Recorded starts are moved apart, so that each pedestrian has ``room`` radii around.
    """
    size = Uniform(RADIUS, RADIUS)
    people = adults(75, radius=size, start_region="waiting")
    if starts is not None:
        people = adults(len(starts), radius=size, starts=push_apart(starts, room * RADIUS))
    return Scenario("gate", place("gate"), people, 300.0)


def run(setting: Setting) -> list[Row]:
    """Return the row."""
    starts, recorded = None, None
    if setting.data is not None:
        folder = setting.data / DATA
        trajectories = read_trajectories(find_recording(folder if folder.is_dir() else setting.data))
        starts, recorded = trajectories.starts, np.sort(trajectories.crossing_times(_LINE))
    crowds = draw_crowds([gate(starts, setting.room)], setting)
    began = crowds.simulation.state.position[crowds.people(0)].copy()
    passages = Passages(crowds, 1, _LINE, sign=-1)
    stuck = passages.watch(300.0, _PATIENCE)
    times = [passages.times(e) for e in range(crowds.count)]
    figures = counted([each for e, each in enumerate(times) if e not in stuck])
    figures |= {"stuck": len(stuck), "starts": "random" if starts is None else "recorded"}
    more = figures | {"position": began, "passages": times, "recorded": recorded}
    eager = setting.manner == "eager"
    said = {"criterion": f"flow {EAGER:g} /s ± 15 %; variation at most {MOST_VARIED:g}; nobody stuck"} if eager else {}
    return [row("gate", setting, met(figures, eager), told(figures, setting.draws), **said, **more)]


def counted(runs: list[Floats]) -> dict[str, Any]:
    """Return means over runs of passing times (N,): flow and its standard error, times of persons, variation of gaps."""
    gaps = [np.diff(times[np.isfinite(times)]) for times in runs]
    flows = np.array([steady_flow(times) for times in runs])
    return {
        "flow": mean_of(flows),
        "flow_error": float(flows.std(ddof=1) / np.sqrt(len(flows))) if len(flows) > 1 else float("nan"),
        "person": {k: mean_of([times[k - 1] for times in runs]) for k in PASSED},
        "variation": mean_of([float(gap.std(ddof=1) / gap.mean()) for gap in gaps]),
    }


def met(figures: Plain, eager: bool = False) -> bool:
    """Whether the criterion is met, by people who were asked to be ``eager`` that of their flow."""
    flow, person, variation = (figures[name] for name in ("flow", "person", "variation"))
    near = [eager or abs(person[k] / time - 1.0) <= WITHIN for k, time in PASSED.items()]
    return bool(
        abs(flow / (EAGER if eager else FLOW) - 1.0) <= WITHIN
        and all(near)
        and variation <= MOST_VARIED
        and not figures["stuck"]
    )


def told(figures: Plain, draws: int) -> str:
    """Return the figures as a sentence."""
    person = ", ".join(number(time, 1) for time in figures["person"].values())
    error = f" ± {number(figures['flow_error'])}" if np.isfinite(figures["flow_error"]) else ""
    where = "" if figures["starts"] == "recorded" else "; starts at random, no recording given"
    return (
        f"{number(figures['flow'])}{error} /s; {person} s; "
        f"variation {number(figures['variation'])}; "
        f"{share(figures['stuck'], draws)} stuck{where}"
    )
