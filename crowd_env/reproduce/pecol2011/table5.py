"""Table 5: the average flow through a door of 82 cm under the three schemes, beside an experiment."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from crowd_env.envs.rollout import Episode
from crowd_env.reproduce.evacuations import Case
from crowd_env.reproduce.pecol2011.evacuations import (
    EXPERIMENT,
    PRINTED,
    Evacuations,
    flow_rows,
    of_schemes,
    raw_times,
    room_remarks,
)
from crowd_env.reproduce.pecol2011.figures.room import flows
from crowd_env.reproduce.pecol2011.settings import PecolSettings
from crowd_env.reproduce.result import Result, Row

TITLE = "Table 5: average flow through the door, persons/s"

SCHEMES = tuple(PRINTED)
# The paper's order, the same with the NSM1 of its section 3, and in pairs.
_ORDERS = (
    ("nsm1", "dem", "nsm2-printed"),
    ("nsm1-inertial", "dem", "nsm2-printed"),
    ("nsm1", "dem"),
    ("nsm1-inertial", "dem"),
    ("dem", "nsm2-printed"),
)


def cases(settings: PecolSettings) -> dict[str, Case]:
    """Return the same draws under every scheme."""
    return settings.cases(SCHEMES)


def reproduce(settings: PecolSettings, runs: Mapping[str, Sequence[Episode]]) -> Result:
    """Return Table 5."""
    done = of_schemes(runs)
    rows = [row for result in done.values() for row in flow_rows(result)]
    rows += [_ordered(done, order) for order in _ORDERS]
    rows[-1] = replace(rows[-1], closes=True)
    quoted = "Helbing et al. 2005, quoted; not simulated"
    rows.append(Row("flow, experiment imitating panic", EXPERIMENT, None, "1/s", 0, quoted))
    remarks = [
        "The paper does not say which exits it regresses: the rows are readings that it can mean. Those that cut in time raise "
        "a slope.",
        *room_remarks(settings, done),
    ]
    title = (
        f"Flow through a door of {100 * settings.door_width:g} cm, {settings.runs} draws of {settings.people} people"
    )
    raw = {"exit-times": raw_times(done)}
    return Result("table5", TITLE, rows, raw, lambda: flows(done, title), remarks, settings.changed(), "1/s")


def _ordered(done: Mapping[str, Evacuations], order: tuple[str, ...]) -> Row:
    """Return in what share of the draws the schemes come in this order, fastest first."""
    share, n = order_share(done, order)
    return Row(f"draws with {' > '.join(order)}", None, share, "share", n, "slopes of the same draw compared")


def order_share(done: Mapping[str, Evacuations], order: tuple[str, ...]) -> tuple[float | None, int]:
    """Return the share of draws whose slopes come in this order, and the number of draws that have all of them."""
    slopes = np.array([done[name].slopes for name in order])
    slopes = slopes[:, np.isfinite(slopes).all(axis=0)]
    if slopes.shape[1] == 0:
        return None, 0
    return float((np.diff(slopes, axis=0) < 0).all(axis=0).mean()), slopes.shape[1]
