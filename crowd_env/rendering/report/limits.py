"""What a report says of the limits of its own figures: what is not modeled, and what the validation map says of the runs."""

import json
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

from crowd_env.analysis.results.plain import plain
from crowd_env.physics import make_scheme
from crowd_env.rendering.report.runs import Runs

_WORDS = {"yes": "met", "no": "NOT met", "reported": "reported, not judged"}
_ORDER = ("no", "yes", "reported")


class Limits(NamedTuple):
    """What the validation map says of a contact scheme with people who walk in a manner."""

    about: str  # the scheme and the manner
    summary: str
    notes: tuple[str, ...]  # in what the runs are others than those of the map
    rows: tuple[tuple[str, str, str], ...]  # case, outcome, criterion with its source; first those that are not met


@cache
def validation_map() -> Any:
    """Return the content of ``page_parts/limits.json``; its cases are made with the map of ``docs/validation.md``."""
    return json.loads((files("crowd_env.rendering.report") / "page_parts" / "limits.json").read_text(encoding="utf-8"))


def limits_of(runs: Runs) -> Limits:
    """Return what the validation map says of the scheme and manner of runs."""
    scheme, manner = runs.config["scheme"]["name"], runs.config["manner"]
    name = manner if isinstance(manner, str) else "of their own manner"
    about = f"{scheme}, {name}"
    rows = []
    for case in validation_map()["cases"]:
        outcome = case["results"].get(name, {}).get(scheme, "")
        if outcome:
            rows.append((case["case"], outcome, case["criterion"]))
    rows.sort(key=lambda row: _ORDER.index(row[1]))
    judged = [row for row in rows if row[1] != "reported"]
    met = sum(row[1] == "yes" for row in judged)
    every = len(validation_map()["cases"])
    if not rows:
        text = f"The validation map has no row of {about}: nothing is known of how near to recorded crowds these figures are."
    else:
        failed = [row[0] for row in judged if row[1] == "no"]
        text = f"{met} of {len(judged)} judged cases are met" + (f"; not met: {', '.join(failed)}." if failed else ".")
        if len(rows) < every:
            text += (
                f" Of {every} cases of the map, {every - len(rows)} have no row of {about}: of these nothing is known."
            )
    said = tuple((case, _WORDS[outcome], criterion) for case, outcome, criterion in rows)
    return Limits(about, text, tuple(_others(runs.config)), said)


def _others(config: Mapping[str, Any]) -> list[str]:
    """Return in what a config is another than the runs of the map."""
    said = []
    if config["manner"] == "competitive":
        said.append(
            "Competitive people walk at full speed whatever is in front of them, as in the papers; people who do not press "
            "keep a distance and leave more slowly (docs/walking.md)."
        )
    if config["outline"] != "disc":
        said.append("The rows are of people with the outline of discs; the bodies of these runs are others.")
    scheme = make_scheme(config["scheme"]["name"])
    changed = [key for key, value in plain(scheme).items() if config["scheme"].get(key) != value]
    if changed:
        said.append(f"The rows are of the scheme's own parameters; in these runs others are set: {', '.join(changed)}.")
    if config["dt"] != scheme.info.default_dt:
        said.append(
            f"The rows are of a physics step of {scheme.info.default_dt:g} s; that of these runs is {config['dt']:g} s."
        )
    return said
