"""The gate experiment: 75 students leave a waiting area through a gate of 0.5 m (Wuppertal 2018, run 040_c_56_h-).

Data: Jülich pedestrian dynamics data archive, series DOI 10.34735/ped.2018.1.  Paper: Adrian, Seyfried, Sieben 2020, "Crowds
in front of bottlenecks at entrances from the perspective of physics and social psychology", J. R. Soc. Interface 17:20190871.

What is compared is N(t), how many have passed the END of the gate (y = -1.1 m), over the time since the first frame.  There is
no bar to pass: the first desired speeds are those of an emergency, in which the students were not.
"""

import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from crowd_env import Geometry, Population, Scenario, Uniform
from crowd_env.envs.metrics import flow_slope, summarise
from crowd_env.envs.rollout import run_episodes
from crowd_env.files.atomic import write_text
from crowd_env.files.csv_table import write_csv
from crowd_env.files.json_file import json_number
from validation.cases.case import Case, Figures, Finding, Settings
from validation.cases.trajectories import Trajectories, find_recording, read_trajectories

Floats = NDArray[np.float64]

# Desired speeds in m/s: of an emergency (Table 4 of Pécol et al. 2011), and of a stroll.
_SPEEDS = (Uniform(1.2, 2.0), Uniform(0.6, 0.6))
_SOURCE = "Wuppertal 2018, run 040_c_56_h-, DOI 10.34735/ped.2018.1; Adrian, Seyfried, Sieben 2020"
_COUNTED = (10, 20, 40, 60)  # persons, and the last

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


def gate_scenario(starts: Floats, radius: float, speed: Uniform = _SPEEDS[0], time_limit: float = 300.0) -> Scenario:
    """Return the experiment as a scenario: everyone, of one radius [m], starts where he was first seen."""
    population = Population(len(starts), radius=Uniform(radius, radius), starts=starts, desired_speed=speed)
    return Scenario("gate", gate_geometry(), population, time_limit, "gate of 0.5 m behind a waiting area", _SOURCE)


@dataclass(frozen=True, eq=False)
class Counts:
    """When people passed the end of the gate: one row a run (1 for the recording)."""

    name: str
    times: Floats  # (runs, N) s, sorted along each row, nan last: still inside
    desired_speed: str | None  # m/s, one or a range; None for the recording
    figure: Figures  # what else was measured

    def finding(self) -> Finding:
        """Return the figures: times of the counted persons (mean over runs), flow.

        A time is None unless the person passed in every run; the flow is over the runs in which everyone passed.
        """
        runs, people = self.times.shape
        counted = [k for k in _COUNTED if k < people] + [people]
        finished = np.isfinite(self.times).all(axis=1)
        # The slope of a run that got stuck says how fast it went until then: it would flatter the mean.
        flow = summarise([flow_slope(times) for times in self.times[finished]])
        return Finding(
            self.name,
            None,
            {
                "desired speed, m/s": self.desired_speed,
                **{f"{k}th, s": json_number(float(self.times[:, k - 1].mean())) for k in counted},
                "flow, 1/s": json_number(flow.mean),
                "sd of flow": json_number(flow.sd),
                "runs": runs,
                "stuck": int((~finished).sum()),
                "left inside": int(np.isnan(self.times).sum()),
                **self.figure,
            },
        )


def recorded(trajectories: Trajectories) -> Counts:
    """Return the experiment's own counts, and how fast people walked through the gate, mean over people."""
    end, throat = trajectories.crossing_times(_END), trajectories.crossing_times(_THROAT)
    speed = json_number(float(np.nanmean((_THROAT - _END) / (end - throat))))
    return Counts("recorded", np.sort(end)[None], None, {"speed in the gate, m/s": speed})


def simulated(scenario: Scenario, scheme: str, runs: int) -> Counts:
    """Run the experiment ``runs`` times, each with other masses, speeds and relaxation times."""
    episodes = run_episodes(scenario, runs, scheme=scheme)
    speed, metrics = scenario.population.desired_speed, [episode.metrics for episode in episodes]
    desired = " to ".join(f"{bound:g}" for bound in dict.fromkeys((speed.low, speed.high)))
    figure: Figures = {
        "radius, m": scenario.population.radius.high,
        "overlap, mm": 1e3 * max(episode.max_overlap for episode in metrics),
        "fastest, m/s": max(episode.max_speed for episode in metrics),
        "outside": sum(episode.escaped for episode in metrics),
    }
    return Counts(scheme, np.sort([episode.exit_time for episode in episodes], axis=1), desired, figure)


def measure(settings: Settings) -> Iterator[Finding]:
    """Give the recording, then every scheme at every desired speed."""
    assert settings.data is not None  # of a case that needs data
    trajectories = read_trajectories(find_recording(settings.data))
    starts, counts = trajectories.starts, [recorded(trajectories)]
    radius = largest_radius(gate_geometry(), starts)
    yield counts[0].finding()
    for speed in _SPEEDS:
        for scheme in settings.schemes:
            settings.notify(f"{scheme}, desired speed up to {speed.high:g} m/s")
            counts.append(simulated(gate_scenario(starts, radius, speed), scheme, settings.draws or 10))
            yield counts[-1].finding()
    if settings.out is not None:
        from validation.cases.gate_figure import draw

        draw(settings.out / "gate.png", counts[0], counts[1 : 1 + len(settings.schemes)], starts, radius)
        settings.notify(f"the plan and the first positions: {export(settings.out, starts, radius)}")


def export(folder: Path, starts: Floats, radius: float) -> str:
    """Write ``gate.wkt`` and ``starts.csv``; return the command that runs them."""
    plan, positions = folder / "gate.wkt", folder / "starts.csv"
    corners = ", ".join(f"{x:g} {y:g}" for x, y in [*PLAN, PLAN[0]])
    write_text(plan, f"POLYGON (({corners}))\n")
    write_csv(positions, ("x", "y"), ([f"{x:.4f}", f"{y:.4f}"] for x, y in starts))
    (x1, y1), (x2, y2) = EXIT
    return (
        f"crowd-env run {shlex.quote(str(plan))} --exit {x1:g},{y1:g},{x2:g},{y2:g} "
        f"--starts {shlex.quote(str(positions))} "
        f"--radius {radius:g} --time-limit 300 --runs 10"
    )


CASE = Case(
    title="75 students leave a waiting area through a gate of 0.5 m",
    criterion="N(t), how many have passed the end of the gate: recorded and simulated, without a bar to pass",
    source=_SOURCE,
    schemes=("dem", "nsm1", "nsm2", "nsm2-printed"),
    measure=measure,
    needs_data=True,
)
