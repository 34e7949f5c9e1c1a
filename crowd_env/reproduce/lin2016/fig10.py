"""Figure 10 of Lin, Ma, Lo: the mean flow through the exit against the desired speed, 100, 200 and 300 people."""

from collections.abc import Mapping

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.envs.metrics import share_interval
from crowd_env.reproduce.lin2016.figures.flow import mean_flows
from crowd_env.reproduce.lin2016.sample import Sample, raw_runs, result
from crowd_env.reproduce.lin2016.settings import LinSettings
from crowd_env.reproduce.lin2016.speeds import SPEEDS
from crowd_env.reproduce.result import Result, Row

TITLE = "Lin, Ma, Lo, Figure 10: mean flow through the exit, people/s"

CROWDS = (100, 200, 300)  # people
CASES = {(n, v): {"count": n, "desired_speed": v} for n in CROWDS for v in SPEEDS}
STATES = (("smooth", 0.6, 1.0), ("transition", 1.0, 1.6), ("phase separation", 1.6, 2.1))  # m/s
PRINTED_MEAN, PRINTED_LOW, PRINTED_HIGH = "0.82", "0.7", "0.95"  # 1/s, in the transition state
PRINTED_FASTEST = "1.22"  # 1/s, above 1.6 m/s

Found = Mapping[tuple[int, float], Sample]


def reproduce(settings: LinSettings, found: Found) -> Result:
    """Return the figure, made of a sample for each number of people and speed [m/s]."""
    rows = [*(row for people in CROWDS for row in _rows(found, people)), *_transition(found), *_separation(found)]
    raw = {"runs": raw_runs(found.values())}

    def draw() -> object:
        return mean_flows(found, STATES, (float(PRINTED_LOW), float(PRINTED_HIGH)), float(PRINTED_MEAN))

    samples, remarks = found.values(), _remarks(found, rows)
    return result("lin-fig10", TITLE, settings, samples, rows, remarks, draw, raw=raw, unit="1/s")


def _rows(found: Found, people: int) -> list[Row]:
    rows = []
    for speed in SPEEDS:
        draws = found[people, speed]
        flows = draws.mean_flows
        spread = f"median, {flows.min():.2f} to {flows.max():.2f}; " if len(flows) > 1 else ""
        value = float(np.median(flows)) if len(flows) else None
        last = speed == SPEEDS[-1]
        reading = spread + draws.blocked_share()
        rows.append(Row(f"flow, {people} at {speed:.1f} m/s", None, value, "1/s", len(flows), reading, closes=last))
    return rows


def _pooled(found: Found, low: float, high: float) -> tuple[Floats, int]:
    """Return the flows of the draws that cleared at speeds in [low, high], and how many blocked."""
    some = [draws for (_, speed), draws in found.items() if low <= speed <= high]
    return np.concatenate([draws.mean_flows for draws in some]), sum(draws.blocked for draws in some)


def _transition(found: Found) -> list[Row]:
    flows, lost = _pooled(found, 1.0, 1.6)
    counted = f"{lost or 'none'} of {lost + len(flows)} blocked"
    mean, low, high = (flows.mean(), flows.min(), flows.max()) if len(flows) else (None, None, None)
    return [
        Row("mean, 1.0 to 1.6 m/s", PRINTED_MEAN, mean, "1/s", len(flows), f"of the draws that cleared; {counted}"),
        Row("lowest, 1.0 to 1.6 m/s", PRINTED_LOW, low, "1/s", len(flows), "draw that cleared"),
        Row("highest, 1.0 to 1.6 m/s", PRINTED_HIGH, high, "1/s", len(flows), "draw that cleared"),
    ]


def _separation(found: Found) -> list[Row]:
    flows, lost = _pooled(found, 1.7, np.inf)
    most = flows.max() if len(flows) else None
    of = lost + len(flows)
    reading = f"paper: from 1.22 /s to zero; {lost or 'none'} of {of} blocked"
    return [
        Row("highest, above 1.6 m/s", PRINTED_FASTEST, most, "1/s", len(flows), "draw that cleared"),
        Row("blocked, above 1.6 m/s", None, lost / of, "share", of, reading, ci95=share_interval(lost, of)),
    ]


def _remarks(found: Found, rows: list[Row]) -> list[str]:
    remarks = []
    for row in rows:
        if row.quantity == "mean, 1.0 to 1.6 m/s" and row.here is not None:
            off = 100 * (row.here / float(PRINTED_MEAN) - 1)
            verdict = "within 10 % of it" if abs(off) <= 10 else "NOT reproduced to 10 %"
            remarks.append(f"Transition state: mean flow {row.here:.2f} /s, the paper {PRINTED_MEAN} /s: {verdict}.")
    slow, fast = (_pooled(found, speed, speed)[0] for speed in (1.0, 1.6))
    if len(slow) and len(fast):
        change = 100 * (fast.mean() / slow.mean() - 1)
        flat = "flat, as in the paper" if abs(change) <= 5 else "the paper sees neither rise nor fall"
        remarks.append(f"From 1.0 to 1.6 m/s the flow of those that cleared changes by {change:+.0f} % ({flat}).")
    thresholds = []
    for people in CROWDS:
        first = next((speed for speed in SPEEDS if found[people, speed].mostly_blocked), None)
        thresholds.append(f"{people} people {'never' if first is None else f'from {first:g} m/s on'}")
    remarks.append(f"Half of the draws or more block: {', '.join(thresholds)}; the paper: above 1.6 m/s.")
    return remarks
