"""Figures of each storey and stair of a building: how many came and left by which way, and when it was empty.

They follow from where people came in, how they went from sheet to sheet and the exits that they took: none is lost between.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crowd_env.analysis.figures import named
from crowd_env.analysis.sections import Place, for_good
from crowd_env.core.arrays.state import Floats, Ints
from crowd_env.core.checks import Plain
from crowd_env.envs.rollout import Episode
from crowd_env.geometry.geometry import Geometry
from crowd_env.geometry.sheets import Sheet


class Storey(NamedTuple):
    """A storey or stair, and the people there.

    ``figures`` are ready for JSON: ``started``, people that came in there, ``most`` at once, ``empty``, when it was empty for
    good [s], a mean over the runs in which it was, and ``left``: for each way off how many took it and the flow, as of exits,
    see `crowd_env.analysis.figures.passing`.
    """

    sheet: Sheet
    counts: list[Floats]  # (C, 2) of each run  s, and how many are there from then on
    figures: Plain


def storeys_of(
    geometry: Geometry, places: Sequence[Place], episodes: Sequence[Episode], figures: Plain
) -> list[Storey]:
    """Return the storeys and stairs of a building, the highest first; none if no sheets meet, or nothing was counted.

    ``figures`` are of the runs, with exits and sections.
    """
    building, runs = geometry.building, [one for one in episodes if one.crossings is not None]
    if building is None or not any(one.sheets for one in places) or not runs:
        return []
    exit_sheet = geometry.on_sheets(geometry.exits.mean(axis=1))[1]
    events, found = [_events(run, places, exit_sheet) for run in runs], []
    for s, sheet in enumerate(building.sheets):
        here = [one[one[:, 1] == s] for one in events]
        counts = [np.column_stack([one[:, 0], np.cumsum(one[:, 2])]) for one in here]
        last = [one[-1] if len(one) else (0.0, 0.0) for one in counts]
        of_runs = {
            "started": [(run.crossings[:, 2] == -1 - s).sum() for run in runs],  # type: ignore[index]
            "most": [one[:, 1].max(initial=0.0) for one in counts],
            "empty": [np.nan if count else time for time, count in last],
        }
        exits = [name for name, on in zip(geometry.exit_names, exit_sheet, strict=True) if on == s]
        left = {f"exit {name}": figures["exits"][name] for name in exits}
        for one in places:
            if s in one.sheets:
                other = 1 - one.sheets.index(s)
                left[one.onto[other]] = figures["sections"][one.name]["towards"][one.directions[other]]
        of_each = {name: named(np.array(values, dtype=np.float64)) for name, values in of_runs.items()}
        found.append(Storey(sheet, counts, {"height": sheet.middle, "runs": len(runs), **of_each, "left": left}))
    return sorted(found, key=lambda one: -one.sheet.middle)


def _events(run: Episode, places: Sequence[Place], exit_sheet: Ints) -> Floats:
    """Return a row (C, 3) for each coming of people to a sheet and going from one, in order: when [s], which sheet, 1 or -1."""
    assert run.crossings is not None
    start, crossed = run.crossings[run.crossings[:, 3] == 0.0], for_good(run.crossings)
    ends = np.array([one.sheets or (-1, -1) for one in places])[crossed[:, 2].astype(np.int64)]
    out = run.exit_index >= 0
    parts = (
        (start[:, 0], -1.0 - start[:, 2], np.ones(len(start))),
        (crossed[:, 0], ends[:, 0], crossed[:, 3]),
        (crossed[:, 0], ends[:, 1], -crossed[:, 3]),
        (run.exit_time[out], exit_sheet[run.exit_index[out]], -np.ones(out.sum())),
    )
    every = np.concatenate([np.column_stack(part) for part in parts])
    return every[np.argsort(every[:, 0], kind="stable")]
