"""Table 7: a movie theatre is evacuated, by two routes; on a synthetic plan, with and without the control rules."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from crowd_env.envs.rollout import Episode
from crowd_env.reproduce.evacuations import Case
from crowd_env.reproduce.pecol2011.figures.theatre import theatre_table
from crowd_env.reproduce.pecol2011.settings import PecolSettings
from crowd_env.reproduce.pecol2011.theatre import (
    IMPLIED,
    PRINTED,
    Egress,
    case,
    mean_row,
    raw_times,
    remarks,
    rows_with_rules,
    theatre,
    unfinished_row,
)
from crowd_env.reproduce.result import Result

TITLE = "Table 7: evacuation of a movie theatre (synthetic plan), times in s"

_RULES = (
    "5 or more in rectangle 1: from A to B",
    "5 or more in rectangle 2: from A to B",
    "15 or more in rectangle 3: from B to A",
)


def cases(settings: PecolSettings) -> dict[str, Case]:
    """Return the same draws with and without the control rules."""
    return {"yes": case(settings, True), "no": case(settings, False)}


def reproduce(settings: PecolSettings, runs: Mapping[str, Sequence[Episode]]) -> Result:
    """Return Table 7, and what the control rules change in it."""
    done = {rules: Egress(episodes) for rules, episodes in runs.items()}
    ruled, free = done["yes"], done["no"]
    rows, changes = rows_with_rules(ruled), []
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
    rows.append(mean_row("turned away for a while", ruled.turned, "people", reading))
    rows += [mean_row(f"rule {k + 1} is on", ruled.ruled[:, k], "s", _RULES[k]) for k in range(3)]

    def draw() -> object:
        return theatre_table(theatre(), {"here, with rules": ruled, "here, without rules": free})

    return Result("table7", TITLE, rows, raw_times(done), draw, remarks(settings), {}, "s")
