"""The sections of a report that say what was put in, and what may not be concluded from it."""

import shlex
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from crowd_env.analysis.results.folder import CONFIG
from crowd_env.rendering.report.limits import limits_of, validation_map
from crowd_env.rendering.report.markup import bullets, code, heading, paragraph, section, table
from crowd_env.rendering.report.runs import Runs, described


def population(runs: Sequence[Runs]) -> str:
    """Return the section on who is evacuated."""
    parts = []
    for names, one in _different(runs, lambda one: [one.config[key] for key in ("population", "manner", "outline")]):
        if names:
            parts.append(heading(names))
        groups = one.config["population"]
        head = ("", *(_group(k, part, len(groups)) for k, part in enumerate(groups)))
        rows = [(label, *(words(part) for part in groups)) for label, words in _OF_A_GROUP.items()]
        rows.append(("how they walk before they touch", *([described(one.config["manner"])] * len(groups))))
        rows.append(("shape of the body", *([described(one.config["outline"])] * len(groups))))
        parts.append(table(rows, head if len(groups) > 1 else ()))
    return section("Population", *parts)


def assumptions(runs: Sequence[Runs]) -> str:
    """Return the section on what was assumed, and what is not modeled."""
    head = ("", *(one.name for one in runs)) if len(runs) > 1 else ()
    rows = [(label, *(words(one) for one in runs)) for label, words in _ASSUMED.items()]
    return section(
        "Assumptions", table(rows, head), heading("What is not modeled"), bullets(validation_map()["not_modeled"])
    )


def limits(runs: Sequence[Runs]) -> str:
    """Return the section on what the validation map says of the schemes and manners of the runs."""
    parts = [
        paragraph(
            "Each row is a case of the project's own validation: the contact scheme and the manner of walking of these runs, "
            "held against a recorded experiment, published figures or a test of a standard. That a case is met says nothing of "
            f"plans and crowds unlike it. From {validation_map()['source']}, as it ships with this version."
        )
    ]
    for names, one in _different(runs, lambda one: [one.config[key] for key in ("scheme", "manner", "outline", "dt")]):
        found = limits_of(one)
        parts += [heading(f"{found.about} ({names})" if names else found.about), paragraph(found.summary, "lead")]
        parts.append(bullets(found.notes))
        if found.rows:
            parts.append(table(found.rows, ("case", "outcome", "criterion and source"), kind="limits"))
    parts += [heading("Tests of standards that cannot be run"), bullets(validation_map()["not_supported"], "small")]
    return section("Limits of validity", *parts)


def provenance(runs: Sequence[Runs]) -> str:
    """Return the section on versions, seeds and the commands that repeat the runs."""
    head = ("", *(one.name for one in runs)) if len(runs) > 1 else ()
    rows = [(label, *(words(one) for one in runs)) for label, words in _MADE.items()]
    again = [shlex.join(["crowd-env", "run", "--config", str(one.folder / CONFIG)]) for one in runs]
    first = [shlex.join(one.config.get("command") or ["crowd-env", "run"]) for one in runs]
    return section(
        "Versions, seeds, and how to repeat this",
        table(rows, head),
        paragraph("The same runs again, from the folders of this report:"),
        code(again),
        paragraph("They were made by:"),
        code(first),
    )


def _different(runs: Sequence[Runs], of: Callable[[Runs], Any]) -> list[tuple[str, Runs]]:
    """Return the first of those that are alike, with the names of all of them; no name if all are alike."""
    kinds: list[tuple[Any, list[Runs]]] = []
    for one in runs:
        alike = next((group for value, group in kinds if value == of(one)), None)
        if alike is None:
            kinds.append((of(one), [one]))
        else:
            alike.append(one)
    if len(kinds) == 1:
        return [("", runs[0])]
    return [("; ".join(one.name for one in group), group[0]) for _, group in kinds]


def _group(k: int, part: Mapping[str, Any], groups: int) -> str:
    return part["name"] or (f"group {k + 1}" if groups > 1 else "")


def _spread(value: Any, unit: str) -> str:
    """Return a distribution, or a number, with its unit."""
    if isinstance(value, Mapping) and value.get("distribution") == "uniform":
        low, high = value["low"], value["high"]
        return f"{low:g} {unit}" if low == high else f"{low:g} to {high:g} {unit}, uniform"
    return "the scheme's or manner's own" if value is None else f"{described(value)} [{unit}]"


def _starts(part: Mapping[str, Any]) -> str:
    if part.get("starts") is not None:
        return "at given positions"
    region = part.get("start_region")
    return f"at random in the region {region}" if region else "at random anywhere"


def _goals(part: Mapping[str, Any]) -> str:
    exits = f"only by {', '.join(part['exits'])}" if part.get("exits") else ""
    route = f"by the route {part['route']}" if part.get("route") else ""
    return ", ".join(filter(None, (route, exits))) or "as the strategy says"


_OF_A_GROUP: dict[str, Callable[[Mapping[str, Any]], str]] = {
    "number": lambda part: str(part.get("people", part.get("count"))),
    "radius of the body": lambda part: _spread(part["radius"], "m"),
    "mass": lambda part: _spread(part["mass"], "kg"),
    "desired speed": lambda part: _spread(part["desired_speed"], "m/s"),
    "response time": lambda part: _spread(part["response_time"], "s"),
    "start": _starts,
    "way": _goals,
}


def _scheme_parameters(one: Runs) -> str:
    return "\n".join(
        f"{key.replace('_', ' ')}: {described(value)}" for key, value in one.config["scheme"].items() if key != "name"
    )


def _rules(one: Runs) -> str:
    count = len(one.scenario.rules)
    return "the scenario has none" if not count else f"{count} in force" if one.config["rules"] else f"{count} left out"


def _blocked(one: Runs) -> str:
    after = one.scenario.blocked_after
    return f"nobody out for {after:g} s" if after < float("inf") else "not looked for"


_ASSUMED: dict[str, Callable[[Runs], str]] = {
    "strategy: how people choose their way": lambda one: str(one.config["strategy"]),
    "contact scheme": lambda one: f"{one.scheme.info.name}: {one.scheme.info.title}",
    "its reference": lambda one: one.scheme.info.reference,
    "its parameters (SI units)": _scheme_parameters,
    "physics step": lambda one: f"{one.config['dt']:g} s",
    "decisions": lambda one: f"every {one.config['decision_dt']:g} s",
    "time limit": lambda one: f"{one.scenario.time_limit:g} s",
    "exits count as blocked": _blocked,
    "control rules": _rules,
    "where the place comes from": lambda one: one.scenario.reference or one.scenario.title or one.scenario.name,
}


def _files(one: Runs) -> str:
    found = one.config.get("files") or {}
    return (
        "\n".join(f"{path} (SHA-256 {digest[:16]}…)" for path, digest in found.items())
        or "none: it ships with crowd-env"
    )


_MADE: dict[str, Callable[[Runs], str]] = {
    "runs": lambda one: f"{len(one.episodes)} of {one.config['runs']}",
    "seeds": lambda one: f"{one.episodes[0].seed} to {one.episodes[-1].seed}",
    "crowd-env": lambda one: f"{one.config['version']}, sources {one.config['sources']}",
    "versions": lambda one: "\n".join(
        f"{name} {version}" for name, version in one.config["versions"].items() if name != "crowd-env"
    ),
    "platform": lambda one: str(one.config.get("platform", "not known")),
    "fingerprint of plan, people and rules": lambda one: str(one.config["fingerprint"]),
    "files read": _files,
}
