"""Texts of pages and films about recordings: a title, what tells them apart, and a table of all facts."""

from collections.abc import Mapping, Sequence
from typing import Any

from crowd_env.core.behaviors import IN_WORDS
from crowd_env.core.checks import counted
from crowd_env.recording import Recording

# Facts that a title names, in this order.
_NAMED = ("scheme", "strategy", *IN_WORDS, "seed")
_UNSAID = {None, "", "none"}.union(*(behavior.unsaid for behavior in IN_WORDS.values()))

_DRAWN = ("building", "zones")  # facts that pictures show


def _short(name: str, value: Any) -> str:
    """Return a fact in a few words; a table of parameters is only named."""
    if isinstance(value, Mapping | list):
        return f"{name} of its own"
    return "" if value in _UNSAID else f"seed {value}" if name == "seed" else str(value)


def _parts(recording: Recording) -> dict[str, str]:
    """Return what a title can say, by the name of the fact."""
    facts = recording.facts
    found = {"scenario": str(facts.get("scenario", "")), **{name: _short(name, facts.get(name)) for name in _NAMED}}
    return found | {"people": counted(recording.came, "person", "people")}


def told_apart(facts: Sequence[Mapping[str, str]], separator: str) -> list[str]:
    """Return for each thing the facts that are not the same for all."""
    apart = [name for name in facts[0] if len({one[name] for one in facts}) > 1]
    return [separator.join(one[name] for name in apart if one[name]) for one in facts]


def titles(recordings: Sequence[Recording], names: Sequence[str]) -> tuple[str, str, list[str]]:
    """Return the title of a page, the line below it, and what to write over each plan.

    What recordings have in common stands in the title; over each plan stands what tells it apart, or its name.
    """
    parts = [_parts(recording) for recording in recordings]
    common = {name: text for name, text in parts[0].items() if all(other[name] == text for other in parts)}
    title = common.pop("scenario", "") or " and ".join(
        own["scenario"] or name for own, name in zip(parts, names, strict=True)
    )
    labels = [text or name for text, name in zip(told_apart(parts, " · "), names, strict=True)]
    return title, " · ".join(text for text in common.values() if text), labels


def outcome(recording: Recording) -> str:
    """Return "all out after 39.6 s", or how many were left inside, when, and why."""
    facts, end = recording.facts, float(recording.times[-1])
    left, away = recording.left_inside, int(facts.get("turned_away") or 0)
    if facts.get("finished") is False:
        return f"{left} inside after {end:.1f} s, when the recording broke off"
    turned_away = f", {away} could not enter" if away else ""
    if left == 0:
        return f"all out after {recording.end:.1f} s{turned_away}"
    end = min(float(facts.get("end") or end), end)  # one frame may follow the end
    blocked = facts.get("blocked_since")
    why = "" if blocked is None else f", exits blocked since {blocked:.1f} s"
    return f"{left} still inside after {end:.1f} s{turned_away}{why}"


def fact_rows(recording: Recording) -> list[list[str]]:
    """Return names and values of all facts, tables within tables as "versions: numpy"."""
    rows: list[list[str]] = []

    def add(name: str, value: Any) -> None:
        if isinstance(value, Mapping):
            for key, inner in value.items():
                add(f"{name}: {key}", inner)
        else:
            rows.append([name, _text(value)])

    for name, value in recording.facts.items():
        if name in _DRAWN:
            continue
        add(str(name).replace("_", " "), value)
    return rows


def _text(value: Any) -> str:
    match value:
        case None:
            return "none"
        case bool():
            return "yes" if value else "no"
        case float():
            return f"{value:.10g}"
        case list() | tuple():
            return ", ".join(_text(part) for part in value)
        case _:
            return str(value)
