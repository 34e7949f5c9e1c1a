"""What was put into the runs of a report, and what may not be concluded from them.

The limits are what is not modeled, and what the validation map says of the runs.
"""

import json
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, partial
from importlib.resources import files
from typing import Any, NamedTuple

from crowd_env.analysis.results.folder import CONFIG
from crowd_env.analysis.results.plain import plain
from crowd_env.core.behaviors import BEHAVIORS, IN_WORDS
from crowd_env.core.behaviors.behavior import Behavior
from crowd_env.core.checks import Plain
from crowd_env.envs.settings import physics_step
from crowd_env.physics import SCHEMES
from crowd_env.physics.settings import Physics
from crowd_env.rendering.report.runs import Runs, described, table
from crowd_env.scenarios.profiles import PROFILES


def assumptions(runs: Sequence[Runs]) -> Plain:
    """Return the population, what was assumed and is not modeled, what the validation map says, and how to repeat it."""
    again = [["crowd-env", "run", "--config", str(one.folder / CONFIG)] for one in runs]
    first = [one.config.get("command") or ["crowd-env", "run"] for one in runs]
    people = _different(runs, ("population", *IN_WORDS))
    return {
        "population": [{"names": names, **_population(one)} for names, one in people],
        "assumed": table(_ASSUMED, runs),
        "known": validation_map(),
        "limits": [
            {"names": names, **limits_of(one)._asdict()} for names, one in _different(runs, ("scheme", *IN_WORDS, "dt"))
        ],
        "made": table(_MADE, runs),
        "again": "\n".join(map(shlex.join, again)),
        "first": "\n".join(map(shlex.join, first)),
    }


def _population(one: Runs) -> Plain:
    cohorts = plain(one.scenario.population.parts)
    rows = table(_OF_A_COHORT, cohorts)
    for name, behavior in IN_WORDS.items():
        rows.append((behavior.label, *([described(one.config[name])] * len(cohorts))))
    head = ("", *(part["name"] or f"cohort {k + 1}" for k, part in enumerate(cohorts)))
    return {"head": head if len(cohorts) > 1 else (), "rows": rows}


def _different(runs: Sequence[Runs], names: Sequence[str]) -> list[tuple[str, Runs]]:
    """Return the first of the folders with equal configs, and their names; no name if all are equal."""
    kinds: dict[str, list[Runs]] = {}
    for one in runs:
        kinds.setdefault(repr([one.config[name] for name in names]), []).append(one)
    return [("; ".join(one.name for one in kind) if len(kinds) > 1 else "", kind[0]) for kind in kinds.values()]


def _spread(value: Any, unit: str) -> str:
    """Return a distribution, or a number, with its unit."""
    if isinstance(value, Mapping) and value.get("distribution") == "uniform":
        low, high = value["low"], value["high"]
        return f"{low:g} {unit}" if low == high else f"{low:g} to {high:g} {unit}, uniform"
    return "the scheme's or manner's own" if value is None else f"{described(value)} [{unit}]"


def _starts(part: Plain) -> str:
    if come := part.get("arrivals"):
        where = "along a line" if come["line"] else "at recorded places" if part.get("starts") else part["start_region"]
        until = "" if come["until"] == "inf" else f" to {come['until']:g} s"
        rate = (
            f"{come['rate']} people per second, {come['spacing']}, from {come['since']:g} s{until}"
            if come["rate"]
            else ""
        )
        return f"come in later, {where}: {rate or 'at given times'}"
    if part.get("starts") is not None:
        return "at given positions"
    region = part.get("start_region")
    return f"at random in the region {region}" if region else "at random anywhere"


def _goals(part: Plain) -> str:
    exits = f"only by {', '.join(part['exits'])}" if part.get("exits") else ""
    route = f"by the route {part['route']}" if part.get("route") else ""
    wait = f"wait {_spread(part['wait'], 's')} on the way" if part.get("wait") else ""
    return ", ".join(filter(None, (route, exits, wait))) or "as the strategy says"


_OF_A_COHORT: dict[str, Callable[[Plain], str]] = {
    "number": lambda part: (
        f"{'up to ' if (part.get('arrivals') or {}).get('rate') else ''}{part.get('people', part.get('count'))}"
    ),
    "profile": lambda part: (
        f"{part['profile']} ({PROFILES[part['profile']].source})" if part.get("profile") else "none"
    ),
    "radius of the body": lambda part: _spread(part["radius"], "m"),
    "mass": lambda part: _spread(part["mass"], "kg"),
    "desired speed": lambda part: _spread(part["desired_speed"], "m/s"),
    "pre-movement time (response time)": lambda part: _spread(part["response_time"], "s"),
    "start": _starts,
    "way": _goals,
    "walk together": lambda part: f"{_spread(part['group_size'], 'people')}" if part.get("group_size") else "no",
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


def _aprons(one: Runs) -> str:
    apron = one.scenario.apron
    return f"people are bodies up to {apron:g} m behind the jambs" if apron else "people vanish at the exit line"


def _moving_doors(one: Runs) -> str:
    events = one.scenario.door_events
    return "\n".join(f"{event.door} {'opens' if event.opens else 'closes'}" for event in events) or "none"


def _chosen(kind: type[Behavior], one: Runs) -> str:
    """Return a behavior of the runs: that of the config, or of the place."""
    value = one.config.get(kind.NAME, plain(kind.plain_of(one.scenario.behavior(kind))))
    return described(value if value is not None else "none")


_ASSUMED: dict[str, Callable[[Runs], str]] = {
    "led by": lambda one: led_by(one) or "no policy: pedestrians follow the strategy",
    "strategy: how people choose their way": lambda one: str(one.config["strategy"]),
    "contact scheme": lambda one: f"{one.scheme.info.name}: {one.scheme.info.title}",
    "its reference": lambda one: one.scheme.info.reference,
    "its parameters (SI units)": _scheme_parameters,
    "physics step": lambda one: f"{one.config['dt']:g} s",
    "decisions": lambda one: f"every {one.config['decision_dt']:g} s",
    "time limit": lambda one: f"{one.scenario.time_limit:g} s",
    "exits count as blocked": _blocked,
    "behind exits": _aprons,
    "control rules": _rules,
    "doors that open or close": _moving_doors,
    **{kind.ABOUT: partial(_chosen, kind) for name, kind in BEHAVIORS.items() if name not in IN_WORDS},
    "where the place comes from": lambda one: one.scenario.reference or one.scenario.title or one.scenario.name,
}


def _files(one: Runs) -> str:
    found = [f"{path} (SHA-256 {digest[:16]}…)" for path, digest in one.config.get("files", {}).items()]
    return "\n".join(found) or "none: it ships with crowd-env"


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


def led_by(one: Runs) -> str:
    """Return the name of the policy that led the pedestrians; "" without one."""
    return str(one.config.get("policy", {}).get("name", ""))


_WORDS = {"yes": "met", "no": "NOT met", "reported": "reported, not judged"}
_ORDER = ("no", "yes", "reported")


class Limits(NamedTuple):
    """What the validation map says of a contact scheme and of how people behave."""

    about: str  # the scheme, and the behaviors that the map tells apart
    summary: str
    notes: tuple[str, ...]  # in what the runs differ from the runs of the map
    rows: tuple[tuple[str, str, str], ...]  # case, outcome, criterion with its source; unmet ones first


@cache
def validation_map() -> Any:
    """Return the content of ``page_parts/limits.json``; its cases are made with the map of ``docs/validation.md``."""
    return json.loads((files("crowd_env.rendering.report") / "page_parts" / "limits.json").read_text(encoding="utf-8"))


def limits_of(runs: Runs) -> Limits:
    """Return what the validation map says of runs."""
    scheme = runs.config["scheme"]["name"]
    if policy := led_by(runs):
        text = f"The validation map has no row of pedestrians led by {policy}: how near they are to recorded ones is not known."
        return Limits(f"{scheme}, led by {policy}", text, tuple(_others(runs)), ())
    values = {name: runs.config[name] for name, behavior in IN_WORDS.items() if behavior.judged}
    name = ", ".join(value if isinstance(value, str) else f"of their own {name}" for name, value in values.items())
    about = f"{scheme}, {name}"
    cases = [(case, case["results"].get(name, {}).get(scheme, "")) for case in validation_map()["cases"]]
    rows = [(case["case"], outcome, case["criterion"]) for case, outcome in cases if outcome]
    rows.sort(key=lambda row: _ORDER.index(row[1]))
    judged = [row for row in rows if row[1] != "reported"]
    met = sum(row[1] == "yes" for row in judged)
    every = len(cases)
    if not rows:
        text = f"The validation map has no row of {about}: nothing is known of how near to recorded crowds these figures are."
    else:
        failed = [row[0] for row in judged if row[1] == "no"]
        text = f"{met} of {len(judged)} judged cases are met" + (f"; not met: {', '.join(failed)}." if failed else ".")
        if less := every - len(rows):
            text += f" Of {every} cases of the map, {less} have no row of {about}: of these nothing is known."
    said = tuple((case, _WORDS[outcome], criterion) for case, outcome, criterion in rows)
    return Limits(about, text, tuple(_others(runs)), said)


def _others(one: Runs) -> Iterator[str]:
    """Yield in what runs differ from the runs of the map."""
    config = one.config
    for name, behavior in IN_WORDS.items():
        plain_form = config[name]
        limit = behavior.limits.get(plain_form, behavior.limit) if isinstance(plain_form, str) else behavior.limit
        if limit:
            yield limit
    scheme = SCHEMES.get(config["scheme"]["name"], one.scheme)
    changed = [key for key, value in plain(scheme).items() if config["scheme"].get(key) != value]
    if changed:
        yield f"The rows are of the scheme's own parameters; in these runs others are set: {', '.join(changed)}."
    if config["dt"] != (step := physics_step(Physics(scheme), one.scenario)):
        yield f"The scheme's own physics step is {step:g} s for these people; that of these runs is {config['dt']:g} s."
