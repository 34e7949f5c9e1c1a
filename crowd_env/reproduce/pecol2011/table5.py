"""Table 5: the average flow through a door of 82 cm under the three schemes, beside an experiment."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np

from crowd_env.reproduce.paper import Work
from crowd_env.reproduce.pecol2011.evacuations import (
    EXPERIMENT,
    PRINTED,
    Evacuations,
    evacuate,
    flow_rows,
    raw_times,
    room_remarks,
)
from crowd_env.reproduce.pecol2011.figures.room import flows
from crowd_env.reproduce.pecol2011.flow import ESTIMATORS
from crowd_env.reproduce.pecol2011.settings import PecolSettings
from crowd_env.reproduce.result import Halfway, Result, Row

TITLE = "Table 5: average flow through the door, persons/s"

SCHEMES = tuple(PRINTED)
# The paper's order, and the same with the NSM1 of its section 3.
_ORDERS = (("nsm1", "dem", "nsm2-printed"), ("nsm1-inertial", "dem", "nsm2-printed"))
_PAIRS = (("nsm1", "dem"), ("nsm1-inertial", "dem"), ("dem", "nsm2-printed"))
_CLOSE = 0.10


def reproduce(settings: PecolSettings, work: Work) -> Result:
    """Return Table 5."""
    done: dict[str, Evacuations] = {}
    for name in SCHEMES:
        try:
            done[name] = evacuate(settings, name, work.progress, work.executor)
        except Halfway as halfway:
            before = list(done.values())
            raise halfway.after(raw_times(settings, before), len(before) * settings.runs) from None
    rows = [row for result in done.values() for row in flow_rows(result)]
    rows += [_ordered(done, order) for order in (*_ORDERS, *_PAIRS)]
    rows[-1] = replace(rows[-1], closes=True)
    quoted = "Helbing et al. 2005, quoted; not simulated"
    rows.append(Row("flow, experiment imitating panic", EXPERIMENT, None, "1/s", 0, quoted))
    remarks = [*statement(done), *room_remarks(settings, list(done.values()))]
    raw = {"exit-times": raw_times(settings, list(done.values()))}
    title = f"Flow through a door of {100 * settings.door_width:g} cm, {settings.runs} draws of {settings.n} people"
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


def statement(done: Mapping[str, Evacuations]) -> list[str]:
    """Return what is and is not reproduced, from the figures themselves."""
    flow = {name: done[name].estimates["per run"].value for name in SCHEMES}
    known = {name: value for name, value in flow.items() if value is not None}
    if len(known) < len(SCHEMES):
        missing = [name for name in SCHEMES if name not in known]
        return [
            f"No flow for {', '.join(missing)}: nobody, or too few, got out. Nothing is reproduced with these options."
        ]
    return [_levels(done, known), _best_window(done), *_order_remarks(done, known), _explanation(known)]


def _levels(done: Mapping[str, Evacuations], flow: Mapping[str, float]) -> str:
    off = {name: flow[name] / float(PRINTED[name]) - 1.0 for name in SCHEMES}
    text = ", ".join(f"{name} {100 * value:+.1f} %" for name, value in off.items())
    close = [name for name in SCHEMES if abs(off[name]) <= _CLOSE]
    far = [name for name in SCHEMES if abs(off[name]) > _CLOSE]
    verdict = f"within 10 %: {', '.join(close) or 'none'}" + (f"; NOT reproduced: {', '.join(far)}" if far else "")
    spans = []
    for name in SCHEMES:
        values = [e.value for e in done[name].estimates.values() if e.value is not None]
        spans.append(f"{name} {min(values):.2f} to {max(values):.2f}")
    return (
        f"Mean slopes per run against the paper: {text}; {verdict}. The paper does not say which exits it regresses; the "
        f"estimators above give {', '.join(spans)} /s on the same runs."
    )


def _best_window(done: Mapping[str, Evacuations]) -> str:
    misfit = {}
    for name in ESTIMATORS:
        values = [done[scheme].estimates[name].value for scheme in _ORDERS[0]]
        if all(value is not None for value in values):
            pairs = zip(values, _ORDERS[0], strict=True)
            misfit[name] = max(abs((value or 0.0) / float(PRINTED[scheme]) - 1.0) for value, scheme in pairs)
    best = min(misfit, key=misfit.__getitem__)
    label, worst = ESTIMATORS[best].reading, 100 * misfit[best]
    text = f"Nearest to all three printed flows at once (spontaneous NSM1): {label}, at most {worst:.1f} % off"
    if best == "per run":
        return text + "."
    caution = ", and cutting in time raises a slope" if best.startswith("before") else ""
    return f"{text}; but that choice is made after the fact{caution}: it is no evidence."


def _order_remarks(done: Mapping[str, Evacuations], flow: Mapping[str, float]) -> list[str]:
    remarks = []
    for order in _ORDERS:
        holds = all(flow[a] > flow[b] for a, b in pairwise(order))
        share, n = order_share(done, order)
        kind = "spontaneous NSM1 (desired velocity, no inertia)" if order[0] == "nsm1" else "inertial NSM1 (section 3)"
        figures = ", ".join(f"{flow[name]:.2f}" for name in order)
        verdict = "comes out" if holds else "does NOT come out"
        text = f"The paper's order NSM1 > DEM > NSM2 {verdict} in the means with the {kind}: {figures} /s"
        if share is not None:
            text += f"; it holds in {100 * share:.0f} % of {n} draws"
        remarks.append(f"{text}.")
    return remarks


def _explanation(flow: Mapping[str, float]) -> str:
    """Return what inelastic contact and what missing inertia contribute: the paper says the first."""
    contact, inertia = flow["nsm1-inertial"] / flow["nsm2-printed"], flow["nsm1"] / flow["nsm1-inertial"]
    if contact * inertia <= 1.0:
        return "The paper explains why NSM1 is faster than NSM2; here it is not."
    return (
        "The paper explains the fast NSM1 by its inelastic contact. Of the factor "
        f"{contact * inertia:.2f} between nsm1 and nsm2-printed, inelastic instead of elastic contact with the same drive "
        f"(nsm1-inertial against nsm2-printed) makes {contact:.2f}, leaving out inertia (nsm1 against "
        f"nsm1-inertial) {inertia:.2f}: the explanation is {'' if contact >= inertia else 'NOT '}supported."
    )
