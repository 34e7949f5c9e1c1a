"""A recorded stair drill: 274 people of an office of six storeys leave by one stair and one door.

When each of them came through which door of the stairwell, its lengths, and how many were out when, are measured: Hostikka
et al. 2007, Evacuation experiments in offices and public buildings, VTT Working Papers 85.  The times of exit are read off a
curve, +- 1 s and +- 1 person; 281 were counted out and 274 in.

People walk by the defaults of the package, with published speeds on stairs; nothing is fitted.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files

import numpy as np

from crowd_env.analysis.by_hand import BOUNDARY, FLOW, SPEED
from crowd_env.core.arrays.state import Floats
from crowd_env.core.checks import COUNT
from crowd_env.core.files.foreign import rows_in
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
from crowd_env.scenarios.shapes import rectangle

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
_LANDING, _CORRIDOR = rectangle(-0.25, 0.0, 3.5, 2.5), rectangle(0.25, 2.5, 3.25, 11.5)
_FOOT = (2.625, 0.0)  # of each stair; its flights are 0.25 m apart
_SIDES = {
    "left": rectangle(-0.25, 0.75, 0.25, 1.75),
    "right": rectangle(3.0, 0.75, 3.5, 1.75),
}  # floor behind the doors


@dataclass(frozen=True)
class OfficeSettings(Settings):
    """Options of the figure."""

    runs: int = option(3, "Draws of each law and each set of speeds", COUNT)


def place(speeds: str) -> Scenario:
    """Return the office with a set of speeds on stairs."""
    text = (files("crowd_env.reproduce.hostikka2007") / "entries.csv").read_text(encoding="utf-8")
    came = [line.split(",") for line in rows_in(text)[1:]]
    levels, stairs, people = [], [], []
    for k, height in enumerate(HEIGHTS):
        name, doors = f"{k + 1}", {f"{k + 1} {side}": area for side, area in _SIDES.items()}
        corridor, street = ([_CORRIDOR], {"street": [[x, 11.5] for x in DOOR]}) if k == 0 else ([], {})
        levels.append(Level(name, height, [_LANDING, *corridor], exits=street, regions=doors))
        for door in doors:
            if times := tuple(float(time) for storey, side, time in came if f"{storey} {side}" == door):
                people.append(Population(len(times), start_region=door, arrivals=Arrivals(times=times)))
        if k > 0:
            rise = height - HEIGHTS[k - 1]
            riser = rise / round(rise / RISER)
            joins = f"stair {k}", f"{k}", name
            stairs.append(Stair(*joins, _FOOT, -90.0, WIDTH, riser, TREAD, "u-right", down=SPEEDS[speeds]))
    return Scenario("office stair", building(levels, stairs), Cohorts(tuple(people)), 900.0)


def cases(settings: OfficeSettings) -> dict[tuple[str, str], Case]:
    """Return the draws under each law, with each set of speeds."""
    made = {}
    for speeds in SPEEDS:
        where = place(speeds)
        for law in LAWS:
            scheme = SCHEMES[law]
            dt = scheme.default_dt(extreme_bodies(where.population))
            made[law, speeds] = Case(f"drill-{law}-{speeds}", where, scheme, settings.seeds, dt)
    return made


def by_hand() -> Floats:
    """Return when people are out (N,) [s] by the hydraulic model: walks at its speeds, queues at the last stair and the door.

    From the last stair it is as far to the street as from the doors of the ground floor.
    """
    where = place("SFPE")
    entries = where.population.draw_entries(np.random.default_rng(0), where.geometry)
    spots = entries.first_spots()
    walk = where.field().travel_time_for(spots, 0.0) / SPEED
    come, above = entries.due + walk, where.geometry.on_sheets(spots)[1] > 0
    below = walk[~above].mean()
    stair = _queue(come[above] - below, FLOW * speed_on_stairs(RISER, TREAD) * (WIDTH - 2.0 * BOUNDARY))
    return _queue(np.append(come[~above], stair + below), FLOW * (DOOR[1] - DOOR[0] - 2.0 * BOUNDARY))


def _queue(ready: Floats, flow: float) -> Floats:
    """Return when people pass that come at these times (N,) [s], at most at a ``flow`` [1/s]."""
    turn = np.arange(len(ready)) / flow
    return np.maximum.accumulate(np.sort(ready) - turn) + turn


def reproduce(settings: OfficeSettings, runs: Mapping[tuple[str, str], Sequence[Episode]]) -> Result:
    """Return when the 25th, 50th ... person is out, beside the times observed, and the flow at the street door."""
    curves = {key: np.sort([one.exit_time for one in of], axis=1) for key, of in runs.items()}
    curves["by hand", "SFPE"] = by_hand()[None]
    left = sum(one.metrics.unfinished for of in runs.values() for one in of)
    heads = Row("left inside", "0", left, "1", settings.runs * len(runs), "people of all runs; outside of the plan: 0")
    remarks = [
        f"{settings.draws_are} of bodies and speeds; when and by which door people come in is recorded. Nothing is fitted: "
        "people and manner (hurried) are the defaults.",
        "Speeds on stairs, along the slope: SFPE by riser and tread; Fruin as in the RiMEA guideline, of people up to 50 "
        "years, mean of stairs inside and outside. Storeys are level floor, and walked at full speed.",
        "281 people were counted out and 274 in: 7 lack here from some time on. Observed times are read off a curve, +- 1 s.",
        f"By hand: the hydraulic model of the SFPE, at {SPEED} m/s, with queues at the last stair and the street door.",
    ]
    rows = [(*key, n, f"{t:.2f}") for key, of in curves.items() for one in of for n, t in enumerate(one, start=1)]
    table = RawTable(("law", "speeds", "people_out", "time_s"), rows)
    sections = [*(_rows(", ".join(key), times) for key, times in curves.items()), [heads]]
    return Result(sections, {"exits": table}, lambda: draw(curves), remarks, "s")


def _rows(of: str, times: Floats) -> list[Row]:
    """Return the rows of ascending exit times (draws, people)."""
    here, draws = np.median(times, axis=0), len(times)
    flows = ((times > STEADY[0]) & (times <= STEADY[1])).sum(axis=1) / (STEADY[1] - STEADY[0])
    apart = [here[k - 1] / float(time) - 1.0 for k, time in OUT.items() if k <= JUDGED]
    furthest = max(apart, key=abs)
    verdict = "all of them" if abs(furthest) <= NEAR else "NOT all"
    reading = f"of the 25th to the {JUDGED}th, {verdict}; furthest {100.0 * furthest:+.1f} %"
    return [
        *(Row(f"{k}th, {of}", time, float(here[k - 1]), "s", draws, "median of draws") for k, time in OUT.items()),
        mean_row(f"flow, {of}", flows, "1/s", f"street door, {STEADY[0]:g} to {STEADY[1]:g} s", STEADY_FLOW),
        Row(f"within {NEAR:.0%}, {of}", "10", int((np.abs(apart) <= NEAR).sum()), "1", draws, reading),
    ]


def draw(curves: Mapping[tuple[str, str], Floats]) -> Figure:
    """Return people out against time, observed and by each law, a panel a set of speeds."""
    figure = new_figure((11.0, 4.9))
    for axes, speeds in zip(figure.subplots(1, 2, sharey=True), SPEEDS, strict=True):
        quiet_axes(axes, "time [s]", "people out", title=f"Speeds on stairs: {speeds}", grid=True)
        for k, law in enumerate(law for law, of in curves if of == speeds):
            out = np.median(curves[law, speeds], axis=0)
            axes.plot(out, np.arange(len(out)) + 1, color=series(k), lw=max(4.0 - 1.3 * k, 1.4), label=law)
        axes.plot([*map(float, OUT.values())], [*OUT], "D", mfc="white", mec="black", zorder=6, label="observed")
        axes.set(xlim=(0.0, 400.0), ylim=(0.0, 290.0))
        axes.legend(frameon=False, fontsize=9)
    return figure
