"""Table 7: a movie theatre is evacuated, by two routes; on a synthetic plan, with and without the control rules."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from crowd_env.reproduce.paper import Work
from crowd_env.reproduce.pecol2011.figures.theatre import theatre_table
from crowd_env.reproduce.pecol2011.settings import PecolSettings
from crowd_env.reproduce.pecol2011.theatre import (
    IMPLIED,
    PRINTED,
    SYNTHETIC,
    Egress,
    draws_remark,
    evacuate,
    mean_row,
    raw_times,
    rows_with_rules,
    theatre,
    unfinished_row,
)
from crowd_env.reproduce.result import Result, Row

TITLE = "Table 7: evacuation of a movie theatre (synthetic plan), times in s"

_CLOSE = 0.10


def reproduce(settings: PecolSettings, work: Work) -> Result:
    """Return Table 7, and what the control rules change in it."""
    ruled, free = (evacuate(settings, rules, work.progress, work.executor) for rules in (True, False))
    rows = [*rows_with_rules(ruled), unfinished_row("left inside", ruled)]
    changes = []
    for name in (*PRINTED, *IMPLIED):
        values, unit = free.quantities[name], "s" if name in PRINTED else "people"
        rows.append(mean_row(f"{name}, no rules", values, unit, "the same draws without control rules"))
        apart = ruled.quantities[name] - values
        changes.append(mean_row(f"{name}: rules change it by", apart, unit, "paired by draw"))
    rows.append(unfinished_row("left inside, no rules", free))
    sent = (ruled.route != free.route).sum(axis=1).astype(np.float64)
    rows += [*changes, mean_row("other route than without rules", sent, "people", "in the same draw")]
    rows[-1] = replace(rows[-1], closes=True)
    reading = "at any moment; most come back when the rule is off"
    rows.append(mean_row("turned away for a while", ruled.turned.astype(np.float64), "people", reading))
    rows += [mean_row(f"rule {k + 1} is on", ruled.ruled[:, k], "s", _RULES[k]) for k in range(3)]
    remarks = [SYNTHETIC, *_levels(ruled), *_effect(changes), draws_remark(settings)]
    raw = {"exit-times": raw_times(settings, [("yes", ruled), ("no", free)])}

    def draw() -> object:
        return theatre_table(theatre(), {"here, with rules": ruled, "here, without rules": free})

    return Result("table7", TITLE, rows, raw, draw, remarks, {}, "s")


_RULES = (
    "5 or more in rectangle 1: from A to B",
    "5 or more in rectangle 2: from A to B",
    "15 or more in rectangle 3: from B to A",
)


def _levels(ruled: Egress) -> list[str]:
    """Return which times of the exercise are met, here and by the paper's own simulation."""
    runs = {name: ruled.quantities[name][np.isfinite(ruled.quantities[name])] for name in PRINTED}
    if any(len(values) == 0 for values in runs.values()):
        return ["Not everything of Table 7 is there: nobody took one of the routes, or somebody never got out."]
    exercise = {name: float(values[0]) for name, values in PRINTED.items()}
    paper = {name: float(values[1]) for name, values in PRINTED.items()}
    here = {name: float(values.mean()) for name, values in runs.items()}
    inside = [name for name, values in runs.items() if values.min() <= exercise[name] <= values.max()]

    def met(values: Mapping[str, float]) -> str:
        close = [name for name, value in values.items() if abs(value / exercise[name] - 1.0) <= _CLOSE]
        worst = max(values, key=lambda name: abs(values[name] / exercise[name] - 1.0))
        return f"{len(close)} of {len(values)} (the worst: {worst}, {100 * (values[worst] / exercise[worst] - 1.0):+.1f} %)"

    return [
        f"Within 10 % of the exercise: here {met(here)}; the paper's own simulation {met(paper)}. The exercise is a single "
        f"run; between the least and the largest of the runs here lie of its times: {'; '.join(inside) or 'none'}. With "
        "another plan all numbers would be others."
    ]


def _effect(changes: Sequence[Row]) -> list[str]:
    """Return what the rules change, and what they do not."""
    if any(row.ci95 is None for row in changes):
        return ["One draw says nothing about what the control rules change."]
    moved: list[str] = []
    still: list[str] = []
    for row in changes:
        assert row.ci95 is not None and row.here is not None
        name, (low, high) = row.quantity.partition(":")[0], row.ci95
        change = f"{name} {row.here:+.2f} {row.unit} ({low:+.2f} to {high:+.2f})"
        (still if low <= 0.0 <= high else moved).append(change)
    text = "The control rules change (mean of the draws, 95 % interval): " + ("; ".join(moved) or "nothing") + "."
    if still:
        text += " No difference is told from zero in " + "; ".join(still) + "."
    by_name = {row.quantity.partition(":")[0]: row for row in changes}
    last = by_name["last, all"].ci95
    assert last is not None
    if last[1] < 0.0:
        verdict = "shorten the evacuation here."
    else:
        longer = "lengthen" if last[0] > 0.0 else "do not shorten"
        verdict = f"{longer} the evacuation here: whoever is turned away walks further, and the crowd passes anyway."
    return [text, f'The paper says that they "prevent the emergence of useless congested areas"; they {verdict}']
