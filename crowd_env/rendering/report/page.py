"""The page: a template, in which every text is escaped, filled with what the folders hold.

Nothing that a scenario, a file or a command is called becomes markup.
"""

import datetime
from collections.abc import Sequence
from pathlib import Path

from crowd_env.analysis.figures import PEAK, people_words, recorded_flow
from crowd_env.core.files.atomic import check_suffix, write_text
from crowd_env.rendering.pages import filled
from crowd_env.rendering.report.assumptions import assumptions
from crowd_env.rendering.report.figures import figures
from crowd_env.rendering.report.maps import Measured
from crowd_env.rendering.report.runs import Runs, remarks_on


def write_report(
    path: str | Path, runs: Sequence[Runs], *, measured: Sequence[Measured] = (), title: str | None = None
) -> Path:
    """Write one HTML page about the runs of one or several folders, and return its path.

    The page needs no network and no script; it can be printed.

    Parameters
    ----------
    path : ends in .html.
    runs : of `crowd_env.rendering.report.runs.load_runs`; differences are to the first.
    measured : of `crowd_env.rendering.report.maps.measure`, for folders with recordings; none = no maps.
    title : by default the names of the places.

    Raises
    ------
    ValueError
        If the suffix is unknown.
    ModuleNotFoundError
        If a drawing library is not installed; the message explains how to install it.
    """
    path = check_suffix(path, (".html",))
    text = filled(
        "crowd_env.rendering.report",
        "page_parts",
        title=title or f"Evacuation of {', '.join(dict.fromkeys(one.scenario.name for one in runs))}",
        date=datetime.date.today().isoformat(),
        asked=_asked(runs),
        peak=f"{PEAK:g}",
        recorded="; ".join(dict.fromkeys(recorded_flow(one.figures)[1] for one in runs)),
        remarks=remarks_on(runs),
        **figures(runs, measured),
        **assumptions(runs),
    )
    write_text(path, text)
    return path


def _asked(runs: Sequence[Runs]) -> str:
    people = dict.fromkeys("up to " * ("came" in one.figures) + people_words(one.figures["people"]) for one in runs)
    counts = dict.fromkeys(str(len(one.episodes)) for one in runs)
    text = f"How long does it take {' or '.join(people)} to leave, and by which exits? "
    text += f"{' or '.join(counts)} simulated {'evacuation' if set(counts) == {'1'} else 'evacuations'}"
    return text + (
        f" of each of {len(runs)}, compared: {'; '.join(one.name for one in runs)}." if len(runs) > 1 else "."
    )
