"""The answer that a report opens with: when people are out, by which exits, and how sure that is."""

from collections.abc import Callable, Sequence
from math import isfinite

import numpy as np

from crowd_env.analysis.by_hand import response_of
from crowd_env.analysis.figures import FIGURES, columns_of, doubts, interval, named, number, people_words, spread
from crowd_env.core.checks import Plain, counted
from crowd_env.rendering.report.runs import Runs, table
from crowd_env.scenarios.population import Population

_AIM = 0.02  # of the mean: the interval that is aimed at
_FEW = 5  # runs or fewer say little of how many are needed


def answer(runs: Sequence[Runs]) -> Plain:
    """Return the sentences, the table and the exits of the first section."""
    named_runs = [(one.name if len(runs) > 1 else "", one) for one in runs]
    found = ((name, doubts(one.figures)) for name, one in named_runs)
    return {
        "said": [{"name": name, "text": _sentence(one)} for name, one in named_runs],
        "doubts": [f"{name}: {said}" if name else said for name, said in found if said],
        "rows": table(_ROWS, runs),
        "sections": [{"name": name, "rows": rows} for name, one in named_runs if (rows := _sections(one))],
        "sections_head": ("section", "length\n[m]", "direction", *_PASSING_HEAD),
        "exits": [{"name": name, "rows": _exits(one)} for name, one in named_runs],
        "exits_head": ("exit", "width\n[m]", *_PASSING_HEAD, "queue", "wait\n[s]"),
    }


def _sentence(one: Runs) -> str:
    figures = one.figures
    mean = figures["came"]["mean"] if "came" in figures else figures["people"]
    ended, every = figures["runs"] - figures["unfinished_runs"], figures["runs"]
    last = figures["evacuation_time"]
    if not ended:
        return f"In none of {counted(every, 'run', 'runs')} did all get out."
    bounds = interval(last, digits=1)
    sure = f", 95 % interval {bounds} s" if bounds else ""
    of = f"of the {ended} of {every} runs in which all got out" if ended < every else f"of {every} runs"
    text = f"{people_words(mean)} {'is' if mean == 1 else 'are'} out after {number(last['mean'], 's', 1)}" + (
        f" (mean {of}{sure})." if every > 1 else "."
    )
    return (
        f"In {figures['unfinished_runs']} of {every} runs people are left inside. Else {text}"
        if ended < every
        else text
    )


def time_words(name: str) -> Callable[[Runs], str]:
    """Return what says one of `FIGURES`: mean, interval of the mean, standard deviation."""

    def words(one: Runs) -> str:
        found, unit = one.figures[name], FIGURES[name].unit
        if not (bounds := interval(found)):
            return spread(found, unit)
        return f"{number(found['mean'])} ({bounds}) {unit}\n± {number(found['sd'], unit)}"

    return words


def _range(one: Runs) -> str:
    times = columns_of([episode.metrics for episode in one.episodes])["evacuation_time"]
    known = times[times == times]
    return f"{known.min():.1f} to {known.max():.1f} s" if len(known) else "–"


def _evacuation_time(one: Runs) -> str:
    whole = one.figures["runs"] - one.figures["unfinished_runs"]
    of = f"\nof the {whole} of {one.figures['runs']} runs in which everyone got out"
    return time_words("evacuation_time")(one) + (of if 0 < whole < one.figures["runs"] else "")


def _runs_in(kind: str) -> Callable[[Runs], str]:
    def words(one: Runs) -> str:
        low, high = (100.0 * bound for bound in one.figures[f"{kind}_share"]["ci95"])
        return f"{one.figures[f'{kind}_runs']} of {one.figures['runs']} ({low:.0f} to {high:.0f} %)"

    return words


def _blocked(one: Runs) -> str:
    return _runs_in("blocked")(one) if isfinite(one.scenario.blocked_after) else "not looked for"


def _convergence(one: Runs) -> str:
    """Say how near the mean is to that of endless runs; an interval falls with the root of their number."""
    found, ended = one.figures["evacuation_time"], one.figures["runs"] - one.figures["unfinished_runs"]
    if found["ci95"][0] is None:
        return "one run says nothing of it" if ended == 1 else "–"
    share = (found["ci95"][1] - found["mean"]) / found["mean"]
    text = f"± {100.0 * share:.1f} % of the mean"
    if share <= _AIM or ended <= _FEW:
        return text
    return f"{text}\n± {100.0 * _AIM:.0f} % needs about {ended * (share / _AIM) ** 2:.0f} runs"


def _premovement(one: Runs) -> str:
    return "\n".join(dict.fromkeys(map(_response, one.scenario.population.parts)))


def _response(part: Population) -> str:
    typical, latest = response_of(part)
    begin = "all walk at once" if part.arrivals is None else "all walk when they come"
    return f"{typical:.0f} s, {latest:.0f} s" if latest else f"0 s: {begin}"


_ROWS: dict[str, Callable[[Runs], str]] = {
    "pre-movement time, median and latest": _premovement,
    "half of the people out (T50)": time_words("t50"),
    "95 % of the people out (T95)": time_words("t95"),
    "last person out": _evacuation_time,
    "by hand (SFPE)": lambda one: one.figures.get("by_hand", {}).get(
        "words", "not where people arrive, wait or pass gates"
    ),
    "last person out, quickest and slowest run": _range,
    "convergence over runs (95 % interval)": _convergence,
    "runs": lambda one: str(one.figures["runs"]),
    "runs in which someone was left inside": _runs_in("unfinished"),
    "people left inside, all runs": lambda one: str(one.figures["unfinished"]),
    "runs in which the exits blocked": _blocked,
}


def _exits(one: Runs) -> list[tuple[str, ...]]:
    """Return a row for each exit, the busiest first; people and times are means over runs."""
    widths, runs = one.scenario.geometry.exit_lengths, one.figures["runs"]
    rows = []
    for name, found in one.figures["exits"].items():
        k = one.scenario.exits.index(name)
        line = [[float(getattr(seen, key)[k]) for seen in one.crowding] for key in ("queue", "wait")]
        queue = (number(named(np.array(values))["mean"], digits=1) for values in line)
        rows.append((name, f"{widths[name]:.2f}", *_passing(found, runs), *queue))
    return rows


def _sections(one: Runs) -> list[tuple[str, ...]]:
    """Return a row for each section and direction that people took; people and times are means over runs."""
    rows = []
    for name, found in one.figures["sections"].items():
        for way, taken in found["towards"].items():
            if taken["people"]:
                rows.append((name, f"{found['length']:.2f}", way, *_passing(taken, found["runs"])))
    return rows


_PASSING_HEAD = ("people", "first\n[s]", "last\n[s]", "flow\n[1/(s m)]", "peak\n[1/(s m)]")


def _passing(found: Plain, runs: int) -> tuple[str, ...]:
    times = (number(found[key]["mean"], digits=1) for key in ("first", "last"))
    flows = (number(found[key]["mean"]) for key in ("flow_per_meter", "peak_flow_per_meter"))
    return (f"{found['people'] / runs:.1f}", *times, *flows)


def share_words(found: Plain | None) -> str:
    """Return the share of an exit in percent with its interval."""
    if found is None or found["share"]["mean"] is None:
        return "–"
    if not found["share"]["sd"]:  # an interval of no width would claim too much
        return f"{100 * found['share']['mean']:.1f} % in every run"
    low, high = found["share"]["ci95"]
    bounds = "" if low is None else f" ({100 * max(low, 0.0):.1f} to {100 * min(high, 1.0):.1f})"
    return f"{100 * found['share']['mean']:.1f} %{bounds}"
