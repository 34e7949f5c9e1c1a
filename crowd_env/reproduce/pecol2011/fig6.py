"""Figure 6: egress curves of the movie theatre, on a synthetic plan; of the exercise only what Table 7 prints."""

from collections.abc import Mapping, Sequence

import numpy as np

from crowd_env.envs.rollout import Episode
from crowd_env.reproduce.evacuations import Case
from crowd_env.reproduce.pecol2011.figures.theatre import egress_panels
from crowd_env.reproduce.pecol2011.settings import PecolSettings
from crowd_env.reproduce.pecol2011.theatre import Egress, case, mean_row, raw_times, remarks, rows_with_rules
from crowd_env.reproduce.result import Result

TITLE = "Figure 6: people out of a movie theatre (synthetic plan) against time, in s"

_SHARES = (0.1, 0.5, 0.9)
_EXERCISE = (
    "The exercise's curve is not printed. Drawn of it is what Table 7 tells: when the last person was out, and the mean time; "
    "how many took which route is implied by the three means."
)


def cases(settings: PecolSettings) -> dict[str, Case]:
    """Return the draws with the control rules, which are those of Table 7."""
    return {"yes": case(settings, True)}


def reproduce(settings: PecolSettings, runs: Mapping[str, Sequence[Episode]]) -> Result:
    """Return Figure 6."""
    done = Egress(runs["yes"])
    ordered, people = np.sort(done.time, axis=1), done.time.shape[1]
    rows = [*rows_with_rules(done), mean_row("first person out", ordered[:, 0], "s", "mean of the runs")]
    for share in _SHARES:
        number = int(np.ceil(share * people))
        rows.append(mean_row(f"{number} people out", ordered[:, number - 1], "s", f"{100 * share:.0f} % of all"))
    said = [*remarks(settings), _EXERCISE]
    return Result("fig6", TITLE, rows, raw_times({"yes": done}), lambda: egress_panels(done), said, {}, "s")
