"""Figure 9 of Lin, Ma, Lo: the flow through the exit in windows of 10 s, 100 and 300 people."""

import numpy as np

from crowd_env.core.arrays.state import Floats
from crowd_env.reproduce.evacuations import Case
from crowd_env.reproduce.lin2016.figures.flow import window_flows
from crowd_env.reproduce.lin2016.sample import Sample, Samples, result
from crowd_env.reproduce.lin2016.settings import LinSettings
from crowd_env.reproduce.result import RawTable, Result, Row

TITLE = "Lin, Ma, Lo, Figure 9: flow through the exit in windows of 10 s, people/s"

WINDOW = 10.0  # s  a single window is uncertain by about 0.2 to 0.3 /s
CROWDS = (100, 300)  # people, panels a and b
# Speeds [m/s] that the paper puts together, and the lowest and highest flow that it prints for them.
STATES = {
    "0.6 m/s": ((0.6,), "0.4", "0.6"),
    "1-1.2 m/s": ((1.0, 1.2), "0.3", "1.3"),
    "≥ 1.6 m/s": ((1.6, 2.0), "0", "1.6"),
}
PRINTED = {speed: (float(low), float(high)) for speeds, low, high in STATES.values() for speed in speeds}


def cases(settings: LinSettings) -> dict[tuple[int, float], Case]:
    """Return the draws for each number of people and speed [m/s]."""
    return {(people, speed): settings.case(people, speed) for people in CROWDS for speed in PRINTED}


def window_flow(exits: Floats, until: float, window: float = WINDOW) -> Floats:
    """Return the flow [1/s] in each window of ``window`` seconds from t = 0 on that has begun before ``until`` [s]."""
    edges = window * np.arange(int(np.ceil(until / window)) + 1)
    return np.histogram(exits, edges)[0] / window


def inner_flow(exits: Floats, window: float = WINDOW) -> Floats:
    """Return the flow [1/s] in the windows that lie wholly between the first and the last exit."""
    if len(exits) == 0:
        return np.empty(0)
    first, last = int(np.ceil(exits[0] / window)), int(exits[-1] // window)
    return window_flow(exits, exits[-1], window)[first:last]


def reproduce(settings: LinSettings, found: Samples) -> Result:
    """Return the figure, made of a sample for each number of people and speed [m/s]."""
    rows = [row for people in CROWDS for state in STATES for row in _rows(found, people, state)]
    flows = {key: _shown(draws) for key, draws in found.items()}
    raw = RawTable(
        ("people", "desired_speed_mps", "seed", "window_start_s", "flow_per_s"),
        [
            (*key, run.seed, f"{WINDOW * k:g}", f"{flow:.3f}")
            for key, draws in found.items()
            for run, of_run in zip(draws.episodes, flows[key], strict=True)
            for k, flow in enumerate(of_run)
        ],
    )

    def draw() -> object:
        return window_flows(flows, {key: draws.blocked for key, draws in found.items()}, PRINTED, WINDOW)

    return result("lin-fig9", TITLE, settings, found, rows, draw, {"windows": raw}, "1/s")


def _rows(found: Samples, people: int, state: str) -> list[Row]:
    speeds, low, high = STATES[state]
    draws = [found[people, speed] for speed in speeds]
    flows = np.concatenate([inner_flow(exits) for each in draws for exits in each.exits])
    lost, of = sum(each.blocked for each in draws), sum(len(each.episodes) for each in draws)
    counted = f"{lost or 'none'} of {of} runs blocked"
    values = [None] * 3 if len(flows) == 0 else [*np.percentile(flows, [5, 95]), flows.mean()]
    label = f"{people} at {state}"
    extreme = ("", "") if len(flows) == 0 else (f"; least {flows.min():.1f}", f"; most {flows.max():.1f}")
    return [
        Row(f"lowest, {label}", low, values[0], "1/s", len(flows), f"5th percentile{extreme[0]}; {counted}"),
        Row(f"highest, {label}", high, values[1], "1/s", len(flows), f"95th percentile{extreme[1]}; {counted}"),
        Row(f"mean, {label}", None, values[2], "1/s", len(flows), f"of the windows; {counted}", closes=True),
    ]


def _shown(draws: Sample) -> list[Floats]:
    """Return the flow of every draw in all windows until the last one got out, or until the exit was given up as blocked."""
    return [
        window_flow(exits, exits[-1] if since is None and len(exits) else (since or 0.0) + 120.0)
        for exits, since in zip(draws.exits, draws.blocked_since, strict=True)
    ]
