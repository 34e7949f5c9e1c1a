"""The gate experiment: 75 students leave a waiting area through a gate of 0.5 m (Wuppertal 2018, run 040_c_56_h-).

Data: Jülich pedestrian dynamics data archive, series DOI 10.34735/ped.2018.1.  Paper: Adrian, Seyfried, Sieben 2020, "Crowds
in front of bottlenecks at entrances from the perspective of physics and social psychology", J. R. Soc. Interface 17:20190871.

What is compared is N(t), how many have passed the END of the gate (y = -1.1 m), over the time since the first frame.  There is
no bar to pass: the paper's crowd is in an emergency, the students were not.
"""

import csv
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowd_env import CrowdEnv, Geometry, Population, Scenario, Uniform, make_scheme
from crowd_env.envs.metrics import flow_slope, summarise
from validation.trajectories import Trajectories

Floats = NDArray[np.float64]

REFERENCE = "Wuppertal 2018, run 040_c_56_h-, DOI 10.34735/ped.2018.1; Adrian, Seyfried, Sieben 2020"
COUNTED = (10, 20, 40, 60, 75)  # persons

# Barriers after the user guide of PedPy, which ships this run as its example: waiting area, funnel, gate.  The waiting area is
# open at the back; here it is closed there (at y = 6.7 m), which nobody notices who walks to the gate.
_HALF_WIDTH, _DEPTH = 2.8, 6.7  # m
_MOUTH, _GATE = 0.4, 0.25  # m, half widths of the funnel's mouth and of the gate
_THROAT, _END = -0.15, -1.1  # m, y where the gate begins and ends

PLAN = [
    (-_HALF_WIDTH, _DEPTH),
    (-_HALF_WIDTH, 0.0),
    (-_MOUTH, 0.0),
    (-_GATE, _THROAT),
    (-_GATE, _END),
    (_GATE, _END),
    (_GATE, _THROAT),
    (_MOUTH, 0.0),
    (_HALF_WIDTH, 0.0),
    (_HALF_WIDTH, _DEPTH),
]
EXIT = [(-_GATE, _END), (_GATE, _END)]


def gate_geometry() -> Geometry:
    """Return waiting area, funnel and gate; the exit line is the end of the gate."""
    return Geometry.from_polygon(PLAN, exits={"gate": EXIT})


def largest_radius(geometry: Geometry, starts: Floats) -> float:
    """Return the largest radius [m] of equal discs on ``starts`` that overlap neither each other nor a wall.

    Rounded down to 0.1 mm, so that the number that is printed can be used.

    Raises
    ------
    ValueError
        If a start lies outside of the plan.
    """
    outside = np.flatnonzero(~geometry.contains(starts))
    if len(outside):
        x, y = starts[outside[0]]
        raise ValueError(
            f"the first position of person {outside[0] + 1}, ({x:g}, {y:g}), is outside of the waiting area"
        )
    distance = np.hypot(*(starts[:, None] - starts[None]).transpose(2, 0, 1))
    np.fill_diagonal(distance, np.inf)
    free = min(0.5 * float(distance.min()), float(geometry.clearance(starts).min()), _GATE)
    return float(np.floor(free * 1e4 + 1e-6) / 1e4)


def gate_scenario(
    starts: Floats, radius: float | None = None, speed: Uniform | None = None, time_limit: float = 300.0
) -> Scenario:
    """Return the experiment as a scenario: everyone starts where he was first seen.

    Parameters
    ----------
    radius : m, of everyone; by default the largest at which the recorded positions do not overlap.
    speed : desired speeds [m/s]; by default those of Table 4 of Pécol et al. 2011, 1.2 to 2.
    """
    geometry = gate_geometry()
    size = largest_radius(geometry, starts) if radius is None else radius
    options: dict[str, Any] = {} if speed is None else {"desired_speed": speed}
    population = Population(len(starts), radius=Uniform(size, size), starts=starts, **options)
    return Scenario("gate", geometry, population, time_limit, "gate of 0.5 m behind a waiting area", REFERENCE)


@dataclass(frozen=True, eq=False)
class Counts:
    """When people passed the end of the gate: one row a run (1 for the recording)."""

    name: str
    times: Floats  # (runs, N) s, sorted along each row, nan last: still inside
    overlap: float = 0.0  # m, deepest
    max_speed: float = 0.0  # m/s, of anyone in any step
    escaped: int = 0  # people found outside of the plan

    def row(self) -> dict[str, Any]:
        """Return the figures, ready for JSON: times [s] of the counted persons (mean and sd over runs), flow [1/s].

        A time is None unless the person passed in every run; the flow is over the runs in which everyone passed.
        """
        runs, people = self.times.shape
        counted = [k for k in COUNTED if k < people] + [people]
        finished = np.isfinite(self.times).all(axis=1)
        # The slope of a run that got stuck says how fast it went until then: it would flatter the mean.
        flow = summarise([flow_slope(times) for times in self.times[finished]])
        return {
            "name": self.name,
            "runs": runs,
            "time_of_person": {str(k): _summary(self.times[:, k - 1]) for k in counted},
            "flow": {"mean": _number(flow.mean), "sd": _number(flow.sd)},
            "unfinished": int(np.isnan(self.times).sum()),
            "unfinished_runs": int((~finished).sum()),
            "overlap_mm": 1e3 * self.overlap,
            "max_speed": self.max_speed,
            "escaped": self.escaped,
        }


def _summary(times: Floats) -> dict[str, float | None]:
    """Return mean and sd, None unless the person passed in every run."""
    if np.isnan(times).any():
        return {"mean": None, "sd": None}
    return {"mean": float(times.mean()), "sd": float(times.std(ddof=1)) if len(times) > 1 else None}


def _number(value: float) -> float | None:
    return None if np.isnan(value) else value


def recorded(trajectories: Trajectories) -> Counts:
    """Return the experiment's own counts."""
    return Counts("recorded", np.sort(trajectories.crossing_times(_END))[None])


def recorded_speed(trajectories: Trajectories) -> float:
    """Return how fast people walked through the gate, from where it begins to where it ends: mean over people [m/s]."""
    spent = trajectories.crossing_times(_END) - trajectories.crossing_times(_THROAT)
    return float(np.nanmean((_THROAT - _END) / spent))


def simulated(
    scenario: Scenario, scheme: str, runs: int, seed: int = 0, progress: Callable[[], None] | None = None
) -> Counts:
    """Run the experiment ``runs`` times with other masses, speeds and relaxation times (draw ``seed + k``)."""
    make_scheme(scheme)
    env = CrowdEnv(scenario, num_envs=runs, scheme=scheme)
    env.reset([seed + k for k in range(runs)])
    while not env.finished.all():
        env.step(None)
        if progress is not None:
            progress()
    times = np.sort(env.simulation.state.exit_time.reshape(runs, -1), axis=1)
    sums, escaped = env.simulation.diagnostics, int(env.simulation.escaped.sum())
    return Counts(scheme, times, float(sums.max_overlap.max()), float(sums.max_speed.max()), escaped)


def export(folder: Path, starts: Floats, radius: float) -> str:
    """Write ``gate.wkt`` and ``starts.csv``; return the command that runs them."""
    folder.mkdir(parents=True, exist_ok=True)
    plan, positions = folder / "gate.wkt", folder / "starts.csv"
    corners = ", ".join(f"{x:g} {y:g}" for x, y in [*PLAN, PLAN[0]])
    plan.write_text(f"POLYGON (({corners}))\n", encoding="utf-8")
    with positions.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["x", "y"])
        writer.writerows([f"{x:.4f}", f"{y:.4f}"] for x, y in starts)
    (x1, y1), (x2, y2) = EXIT
    return (
        f"crowd-env run {shlex.quote(str(plan))} --exit {x1:g},{y1:g},{x2:g},{y2:g} "
        f"--starts {shlex.quote(str(positions))} "
        f"--radius {radius:g} --time-limit 300 --runs 10"
    )
