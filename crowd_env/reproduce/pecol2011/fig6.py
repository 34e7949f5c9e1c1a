"""Figure 6: egress curves of the movie theatre, on a synthetic plan; of the exercise only what Table 7 prints."""

import numpy as np

from crowd_env.reproduce.paper import Work
from crowd_env.reproduce.pecol2011.figures.theatre import egress_panels
from crowd_env.reproduce.pecol2011.settings import PecolSettings
from crowd_env.reproduce.pecol2011.theatre import (
    SYNTHETIC,
    Egress,
    draws_remark,
    evacuate,
    mean_row,
    raw_times,
    rows_with_rules,
    unfinished_row,
)
from crowd_env.reproduce.result import Result, Row

TITLE = "Figure 6: people out of a movie theatre (synthetic plan) against time, in s"

_SHARES = (0.1, 0.5, 0.9)


def reproduce(settings: PecolSettings, work: Work) -> Result:
    """Return Figure 6."""
    done = evacuate(settings, True, work.progress, work.executor)
    rows = [*rows_with_rules(done), unfinished_row("left inside", done), *_share_rows(done)]
    remarks = [
        SYNTHETIC,
        "The exercise's curve is not printed. Drawn of it is what Table 7 tells: when the last person was out, and the mean "
        "time; how many took which route is implied by the three means.",
        draws_remark(settings),
    ]
    raw = {"exit-times": raw_times(settings, [("yes", done)])}
    return Result("fig6", TITLE, rows, raw, lambda: egress_panels(done), remarks, {}, "s")


def _share_rows(done: Egress) -> list[Row]:
    """Return when the first is out, and when some shares of all are."""
    ordered, people = np.sort(done.time, axis=1), done.time.shape[1]
    rows = [mean_row("first person out", ordered[:, 0], "s", "mean of the runs")]
    for share in _SHARES:
        number = int(np.ceil(share * people))
        rows.append(mean_row(f"{number} people out", ordered[:, number - 1], "s", f"{100 * share:.0f} % of all"))
    return rows
