"""Figure 10 of Lin, Ma, Lo: the mean flow through the exit against the desired speed, 100, 200 and 300 people."""

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.envs.metrics import share_interval
from crowd_env.reproduce.evacuations import Case
from crowd_env.reproduce.lin2016.figures.flow import mean_flows
from crowd_env.reproduce.lin2016.sample import Samples, raw_runs, result
from crowd_env.reproduce.lin2016.settings import LinSettings
from crowd_env.reproduce.lin2016.speeds import SPEEDS
from crowd_env.reproduce.result import Result, Row

TITLE = "Lin, Ma, Lo, Figure 10: mean flow through the exit, people/s"

CROWDS = (100, 200, 300)  # people
STATES = (("smooth", 0.6, 1.0), ("transition", 1.0, 1.6), ("phase separation", 1.6, 2.1))  # m/s
PRINTED_MEAN, PRINTED_LOW, PRINTED_HIGH = "0.82", "0.7", "0.95"  # 1/s, in the transition state
PRINTED_FASTEST = "1.22"  # 1/s, above 1.6 m/s


def cases(settings: LinSettings) -> dict[tuple[int, float], Case]:
    """Return the draws for each number of people and speed [m/s]."""
    return {(people, speed): settings.case(people, speed) for people in CROWDS for speed in SPEEDS}


def reproduce(settings: LinSettings, found: Samples) -> Result:
    """Return the figure, made of a sample for each number of people and speed [m/s]."""
    rows = [*(row for people in CROWDS for row in _rows(found, people)), *_transition(found), *_separation(found)]

    def draw() -> object:
        return mean_flows(found, STATES, (float(PRINTED_LOW), float(PRINTED_HIGH)), float(PRINTED_MEAN))

    return result("lin-fig10", TITLE, settings, found, rows, draw, {"runs": raw_runs(found)}, "1/s")


def _rows(found: Samples, people: int) -> list[Row]:
    rows = []
    for speed in SPEEDS:
        draws = found[people, speed]
        flows = draws.mean_flows
        spread = f"median, {flows.min():.2f} to {flows.max():.2f}; " if len(flows) > 1 else ""
        value = float(np.median(flows)) if len(flows) else None
        low, high = share_interval(draws.blocked, len(draws.episodes))
        reading = f"{spread}{draws.count_blocked()} (95 %: {100 * low:.0f} to {100 * high:.0f} %)"
        last = speed == SPEEDS[-1]
        rows.append(Row(f"flow, {people} at {speed:.1f} m/s", None, value, "1/s", len(flows), reading, closes=last))
    return rows


def _pooled(found: Samples, low: float, high: float) -> tuple[Floats, int]:
    """Return the flows of the draws that cleared at speeds in [low, high], and how many blocked."""
    some = [draws for (_, speed), draws in found.items() if low <= speed <= high]
    return np.concatenate([draws.mean_flows for draws in some]), sum(draws.blocked for draws in some)


def _transition(found: Samples) -> list[Row]:
    flows, lost = _pooled(found, 1.0, 1.6)
    counted = f"{lost or 'none'} of {lost + len(flows)} blocked"
    mean, low, high = (flows.mean(), flows.min(), flows.max()) if len(flows) else (None, None, None)
    return [
        Row("mean, 1.0 to 1.6 m/s", PRINTED_MEAN, mean, "1/s", len(flows), f"of the draws that cleared; {counted}"),
        Row("lowest, 1.0 to 1.6 m/s", PRINTED_LOW, low, "1/s", len(flows), "draw that cleared"),
        Row("highest, 1.0 to 1.6 m/s", PRINTED_HIGH, high, "1/s", len(flows), "draw that cleared"),
    ]


def _separation(found: Samples) -> list[Row]:
    flows, lost = _pooled(found, 1.7, np.inf)
    most = flows.max() if len(flows) else None
    of = lost + len(flows)
    reading = f"paper: from 1.22 /s to zero; {lost or 'none'} of {of} blocked"
    return [
        Row("highest, above 1.6 m/s", PRINTED_FASTEST, most, "1/s", len(flows), "draw that cleared"),
        Row("blocked, above 1.6 m/s", None, lost / of, "share", of, reading, ci95=share_interval(lost, of)),
    ]
