"""The page: a template and a style sheet that lie beside this file, and sections made of what the folders hold."""

import datetime
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template

from crowd_env.core.files.atomic import check_suffix, write_text
from crowd_env.core.version import __version__
from crowd_env.rendering.report.assumptions import assumptions, limits, population, provenance
from crowd_env.rendering.report.differences import differences
from crowd_env.rendering.report.figures import maps, place, results
from crowd_env.rendering.report.maps import Measured
from crowd_env.rendering.report.markup import Drawer, bullets
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
    measured : of `crowd_env.rendering.report.maps.measure`, one for each folder; none = no maps.
    title : by default the names of the places.

    Raises
    ------
    ValueError
        If the suffix is another, or there are no runs.
    ModuleNotFoundError
        If a drawing library is not installed; the message says how to install it.
    """
    path = check_suffix(path, (".html",))
    if not runs:
        raise ValueError("a report needs the runs of at least one folder")
    with Drawer() as drawer:
        sections = [
            place(runs, drawer),
            population(runs),
            assumptions(runs),
            results(runs, differences(runs), drawer),
            maps(runs, measured, drawer),
            limits(runs),
            provenance(runs),
        ]
    parts = {
        "title": escape(title or f"Evacuation of {_places(runs)}"),
        "date": datetime.date.today().isoformat(),
        "asked": escape(_asked(runs)),
        "version": escape(__version__),
        "remarks": bullets(remarks_on(runs), "remarks"),
        "style": _read("style.css"),
        "sections": "\n".join(sections),
    }
    write_text(path, Template(_read("template.html")).substitute(parts))
    return path


def _places(runs: Sequence[Runs]) -> str:
    return ", ".join(dict.fromkeys(one.scenario.name for one in runs))


def _asked(runs: Sequence[Runs]) -> str:
    people = dict.fromkeys(str(one.figures["people"]) for one in runs)
    counts = dict.fromkeys(str(len(one.episodes)) for one in runs)
    text = f"How long do {' or '.join(people)} people take to leave, and by which exits? "
    text += f"{' or '.join(counts)} simulated {'evacuation' if set(counts) == {'1'} else 'evacuations'}"
    return text + (
        f" of each of {len(runs)}, compared: {'; '.join(one.name for one in runs)}." if len(runs) > 1 else "."
    )


def _read(name: str) -> str:
    return (files("crowd_env.rendering.report") / "page_parts" / name).read_text(encoding="utf-8")
