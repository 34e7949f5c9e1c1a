"""A recorded stair drill: 274 people of an office of six storeys leave by one stair and one door.

When each of them came through which door of the stairwell, its lengths, and how many were out when, are measured: Hostikka
et al. 2007, Evacuation experiments in offices and public buildings, VTT Working Papers 85.  The times of exit are read off a
curve, +- 1 s and +- 1 person; 281 were counted out and 274 in.

People walk by the defaults of the package, with published speeds on stairs; nothing is fitted.
"""

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np
import shapely
from shapely.geometry import box

from crowd_env.analysis.by_hand import BOUNDARY, FLOW, SPEED
from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import COUNT
from crowd_env.envs.crowd import CrowdEnv, Step
from crowd_env.envs.rollout import Episode
from crowd_env.physics import SCHEMES
from crowd_env.rendering.canvas import new_figure, quiet_axes, series
from crowd_env.rendering.libraries import Figure
from crowd_env.reproduce.evacuations import Case
from crowd_env.reproduce.paper import Settings, option
from crowd_env.reproduce.result import RawTable, Result, Row, mean_row
from crowd_env.scenarios.arrivals import Arrivals
from crowd_env.scenarios.buildings import Level, Stair, building, speed_on_stairs
from crowd_env.scenarios.cohorts import Cohorts, extreme_bodies
from crowd_env.scenarios.population import Population
from crowd_env.scenarios.scenario import Scenario

HEIGHTS = (0.0, 4.0, 7.5, 11.0, 14.5, 18.0)  # m, of the storeys
RISER, TREAD, WIDTH, DOOR = 0.135, 0.262, 1.25, (1.715, 2.785)  # m
OUT = {
    25: "127", 50: "146", 75: "167", 100: "187", 125: "203", 150: "221",
    175: "239", 200: "258.5", 225: "279", 250: "300", 268: "314.5",
}  # fmt: skip  # person -> s
NEAR = 0.05  # of the observed time
JUDGED = 250  # the last person with a time that is to be near
STEADY = (145.0, 300.0)  # s, in which the flow at the street door was ...
STEADY_FLOW = "1.34"  # 1/s
LAWS = ("dem", "nsm2", "hertz")
# Downwards, relative to 1.34 m/s on level floor.  Fruin 1971 as in the RiMEA guideline: inside and outside, people of less
# than 30 years (.76, .81 m/s) and of 30 to 50 (.65, .78).
SPEEDS = {"SFPE": None, "Fruin": float(np.mean([0.76, 0.81, 0.65, 0.78])) / 1.34}
_SIDES = {"left": box(-0.25, 0.75, 0.25, 1.75), "right": box(3.0, 0.75, 3.5, 1.75)}  # floor behind the doors


@dataclass(frozen=True)
class OfficeSettings(Settings):
    """Options of the figure."""

    runs: int = option(3, "Draws of each law and each set of speeds", COUNT)


class Climb:
    """Keeps by how much the height of any person changed most between two looks [m]."""

    def begin(self, env: CrowdEnv, runs: Sequence[int]) -> None:
        """Start from no change."""
        self._before = self._look(env)
        self._most = np.zeros(env.num_envs)

    def add(self, env: CrowdEnv, step: Step) -> None:
        """Compare the heights of people that are there with the ones before."""
        now = self._look(env)
        for e in range(env.num_envs):
            people = env.people(e)
            self._most[e] = np.fmax(self._most[e], np.nanmax(np.abs(now - self._before)[people], initial=0.0))
        self._before = now

    def record(self, env: CrowdEnv, e: int) -> float:
        """Return the largest change."""
        return float(self._most[e])

    def _look(self, env: CrowdEnv) -> Floats:
        state, (geometry, *_) = env.simulation.state, env.simulation.geometries
        return np.where(state.active, geometry.heights(state.position, state.sheet), np.nan)


def place(speeds: str) -> Scenario:
    """Return the office with a set of speeds on stairs."""
    levels, stairs, people = [], [], []
    coming = _coming()
    for k, height in enumerate(HEIGHTS, start=1):
        landing = box(-0.25, 0.0, 3.5, 2.5)
        floor = landing if k > 1 else shapely.union(landing, box(0.25, 2.5, 3.25, 11.5))
        street = {"street": [[x, 11.5] for x in DOOR]} if k == 1 else {}
        doors = {f"{k} {side}": area for side, area in _SIDES.items()}
        levels.append(Level(f"{k}", height, floor, exits=street, regions=doors))
        people += [
            Population(len(times), start_region=door, arrivals=Arrivals(times=times), name=door)
            for door in doors
            if (times := coming.get(door))
        ]
        if k > 1:
            rise = height - HEIGHTS[k - 2]
            riser = rise / round(rise / RISER)
            stairs.append(
                Stair(
                    f"stair {k}", f"{k - 1}", f"{k}", (2.625, 0.0), -90.0, WIDTH, riser, TREAD, "u-right", core=0.25,
                    down=SPEEDS[speeds],
                )
            )  # fmt: skip
    return Scenario("office stair", building(levels, stairs), Cohorts(tuple(people)), 900.0)


@cache
def _coming() -> dict[str, tuple[float, ...]]:
    """Return when people come in [s] by doors, such as "4 right"."""
    text = (files("crowd_env.reproduce.hostikka2007") / "entries.csv").read_text(encoding="utf-8")
    found: dict[str, tuple[float, ...]] = {}
    for row in csv.DictReader(line for line in text.splitlines() if not line.startswith("#")):
        door = f"{row['storey']} {row['door']}"
        found[door] = (*found.get(door, ()), float(row["time_s"]))
    return found


def cases(settings: OfficeSettings) -> dict[tuple[str, str], Case]:
    """Return the draws under each law, with each set of speeds."""
    made = {}
    for speeds in SPEEDS:
        where = place(speeds)
        for law in LAWS:
            scheme = SCHEMES[law]
            dt = scheme.default_dt(extreme_bodies(where.population))
            made[law, speeds] = Case(f"drill-{law}-{speeds}", where, scheme, settings.seeds, dt, recorder=Climb())
    return made


def by_hand() -> Floats:
    """Return when people are out (N,) [s] by the hydraulic model: walks at its speeds, queues at the last stair and the door.

    The last stair ends before the right door of the ground floor.
    """
    where = place("SFPE")
    field, geometry = where.field(), where.geometry

    def walk(part: Population) -> float:
        return float(field.travel_time_for(part.spots(geometry).mean(axis=0, keepdims=True), 0.0)[0]) / SPEED

    below = walk(Population(1, start_region="1 right"))
    ready: dict[bool, list[float]] = {False: [], True: []}
    for part in where.population.parts:
        assert part.arrivals is not None
        ready[part.start_region[0] != "1"] += [time + walk(part) for time in part.arrivals.times]
    stair = _queue(np.array(ready[True]) - below, FLOW * speed_on_stairs(RISER, TREAD) * (WIDTH - 2.0 * BOUNDARY))
    return _queue([*ready[False], *stair + below], FLOW * (DOOR[1] - DOOR[0] - 2.0 * BOUNDARY))


def _queue(ready: Iterable[float], flow: float) -> Floats:
    """Return when people pass that come at these times [s], one behind the other, at most at a ``flow`` [1/s]."""
    passed: list[float] = []
    for time in sorted(ready):
        passed.append(max(time, passed[-1] + 1.0 / flow) if passed else time)
    return np.array(passed)


def reproduce(settings: OfficeSettings, runs: Mapping[tuple[str, str], Sequence[Episode]]) -> Result:
    """Return when the 25th, 50th ... person is out, beside the times observed, and the flow at the street door."""
    curves = {key: np.sort([one.exit_time for one in of], axis=1) for key, of in runs.items()}
    curves["by hand", "SFPE"] = by_hand()[None]
    episodes = [one for of in runs.values() for one in of]
    sections = [_rows(*key, times) for key, times in curves.items()]
    jumps, lost = [one.record for one in episodes], [np.isfinite(one.exit_time) for one in episodes]
    still = sum(int((~out & one.came).sum()) for out, one in zip(lost, episodes, strict=True))
    n = len(episodes)
    sections.append(
        [
            Row("in, not out", "0", still, "1", n, "people of all draws; nobody was outside of the plan at any look"),
            Row("largest change of height", None, max(jumps), "m", n, "of any person in 0.1 s"),
        ]
    )
    remarks = [
        f"{settings.draws_are} of bodies and speeds; when and by which door people come in is recorded. Nothing is fitted: "
        "people and manner (hurried) are the defaults.",
        "Speeds on stairs: SFPE by riser and tread; Fruin, of people up to 50 years, inside and outside.",
        "281 people were counted out and 274 in: 7 lack here from some time on. Observed times are read off a curve, 1 s.",
        f"By hand: the hydraulic model of the SFPE, at {SPEED} m/s, with queues at the last stair and the street door.",
        *_misses(sections),
    ]
    raw = [
        (law, speeds, k, n, f"{time:.2f}")
        for (law, speeds), times in curves.items()
        for k, one in enumerate(times, start=settings.seed)
        for n, time in enumerate(one, start=1)
    ]
    table = RawTable(("law", "speeds", "seed", "people_out", "time_s"), raw)
    return Result(sections, {"exits": table}, lambda: draw(curves), remarks, "s")


def _rows(law: str, speeds: str, times: Floats) -> list[Row]:
    """Return the rows of exit times (draws, people), ascending, under a law."""
    of, draws = f"{law}, {speeds}", len(times)
    here = np.median(times, axis=0)
    flows = ((times > STEADY[0]) & (times <= STEADY[1])).sum(axis=1) / (STEADY[1] - STEADY[0])
    apart = np.array([here[k - 1] / float(time) - 1.0 for k, time in OUT.items() if k <= JUDGED])
    far = apart[np.abs(apart).argmax()]
    near, met = int((np.abs(apart) <= NEAR).sum()), "" if abs(far) <= NEAR else "NOT "
    reading = f"of the 25th to the {JUDGED}th: {met}all within {NEAR:.0%}; furthest {100 * far:+.1f} %"
    return [
        *(Row(f"{k}th, {of}", time, float(here[k - 1]), "s", draws, "median of draws") for k, time in OUT.items()),
        mean_row(f"flow, {of}", flows, "1/s", f"street door, {STEADY[0]:g} to {STEADY[1]:g} s", STEADY_FLOW),
        Row(f"near, {of}", f"{len(apart)}", near, "1", draws, reading),
    ]


def _misses(sections: Sequence[Sequence[Row]]) -> list[str]:
    """Return a sentence that names what is not within the bounds, or none."""
    far = [row.quantity.removeprefix("near, ") for rows in sections for row in rows if "NOT" in row.reading]
    return [f"NOT within {NEAR:.0%} of all observed times: {'; '.join(far)}."] if far else []


def draw(curves: Mapping[tuple[str, str], Floats]) -> Figure:
    """Return people out against time, observed and by each law, a panel a set of speeds."""
    figure = new_figure((11.0, 4.9))
    observed = [float(time) for time in OUT.values()]
    for k, (axes, speeds) in enumerate(zip(figure.subplots(1, 2, sharey=True), SPEEDS, strict=True)):
        title = f"{'ab'[k]}. Speeds on stairs of {speeds}"
        quiet_axes(axes, "time [s]", "people out" if k == 0 else "", title=title, grid=True)
        for c, ((law, _), times) in enumerate((key, of) for key, of in curves.items() if key[1] == speeds):
            axes.step(np.median(times, axis=0), range(1, times.shape[1] + 1), where="post", color=series(c), label=law)
        axes.plot(observed, [*OUT], "D", mfc="white", mec="black", mew=1.5, ms=6, zorder=6, label="observed")
        axes.set(xlim=(0.0, 400.0), ylim=(0.0, 290.0))
        axes.legend(frameon=False, fontsize=9)
    return figure
