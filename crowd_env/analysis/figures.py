"""The figures of evacuations: what they are, how they are found from runs, and how they are written.

Every table of figures takes its cells from here, so that a figure looks the same on the command line, in a report and in a
comparison of policies.
"""

import string
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from crowd_env.analysis.results.plain import plain
from crowd_env.core.arrays.state import MAX_SPEED, Floats, Ints, segment_lengths
from crowd_env.core.behaviors.headway import Headway
from crowd_env.core.checks import Plain, counted
from crowd_env.core.files.json_file import json_number
from crowd_env.core.version import __version__
from crowd_env.envs.metrics import EpisodeMetrics, flow_slope, share_interval, summarise
from crowd_env.envs.rollout import Episode
from crowd_env.envs.settings import physics_step
from crowd_env.geometry.geometry import Geometry
from crowd_env.physics import ContactScheme, make_scheme
from crowd_env.physics.settings import Physics
from crowd_env.scenarios.scenario import Scenario

_HALF, _NEARLY_ALL = 0.5, 0.95  # of the people, for T50 and T95
FEWEST = 10  # runs, before an interval is believed
PEAK = 10.0  # s  over which the largest flow of an exit is a mean
# 1/(s m), at doors of experiments: of people that walk (Seyfried et al. 2009), and the most of any (tests/data).  Beyond the
# third, that of a crowd with children (docs/reproduce.md), only the crowds of the papers come.
WALKING_FLOW, HIGHEST_FLOW, _OF_PAPERS = 1.9, 2.8, 3.3
_WALKING = 0.25  # s  people with a longer time gap walk; with a shorter one they press
HANDFUL = 10  # people; the flow of fewer is chance: three side by side are 20 a second
_ENTERED = 0.05  # of the people of an exit; a side that fewer took is none that it is entered by
_SIDE = 0.5  # cosine: lines of an area that turn by less are one side
_EXITS_SHOWN, _RUNS_SHOWN, _SECTIONS_SHOWN = 4, 10, 8
_FASTER = 2.0 / 3.0  # of the time by hand: a crowd that needs less is doubtful


class Figure(NamedTuple):
    """A figure that every run has."""

    title: str
    unit: str
    of: Callable[[Episode], float]  # nan where a run has none


FIGURES: dict[str, Figure] = {
    "evacuation_time": Figure("evacuation time", "s", lambda run: run.metrics.evacuation_time),
    "t50": Figure("50 % of the people out", "s", lambda run: time_of_share(run.exit_time[run.came], _HALF)),
    "t95": Figure("95 % of the people out", "s", lambda run: time_of_share(run.exit_time[run.came], _NEARLY_ALL)),
    "mean_exit_time": Figure("mean exit time", "s", lambda run: run.metrics.mean_exit_time),
    "flow": Figure("flow", "1/s", lambda run: run.metrics.flow),
}


def report(
    scenario: Scenario,
    scheme: str | ContactScheme,
    episodes: Sequence[Episode],
    *,
    dt: float | None = None,
    strategy: str | None = None,
) -> dict[str, Any]:
    """Return the figures of many evacuations, ready for JSON: times in s, flow in 1/s, lengths in mm, residual in m/s.

    ``dt`` [s] and ``strategy`` are those of the run, by default the scheme's and the shortest way.

    ``blocked`` lists the runs in which the exits blocked: the number of the run, since when [s], and how many were left.
    Where people arrive, ``came`` is how many, and ``turned_away`` lists how many of each run could not enter.
    ``evacuation_time``, ``t50`` and ``t95`` (so many percent of the people are out) and ``flow`` (per-run least-squares
    slopes) are over the runs in which everyone, so many, or at least three people, got out. ``mean_exit_time`` is the mean
    over runs of the mean over the people out. ``exits`` comes from `exits_of`. ``overlap_mm.mean`` is the mean over
    runs of the mean over all overlapping contacts of a run. ``outside_mm`` is the furthest that any body reached beyond a
    wall. The shares of runs in which people were left inside, and in which the exits blocked, have Wilson's interval.
    """
    runs, chosen = columns_of([episode.metrics for episode in episodes]), make_scheme(scheme)
    came = [int(episode.came.sum()) for episode in episodes]
    turned_away = [episode.turned_away for episode in episodes]
    return {
        "scenario": scenario.name,
        "scheme": chosen.info.name,
        **scenario.plain_behaviors(),
        "strategy": scenario.strategy_of_run(strategy),
        "seed": episodes[0].seed - episodes[0].run,
        "dt": physics_step(Physics(chosen, dt), scenario),
        "time_limit": episodes[0].time_limit,
        "version": __version__,
        "people": scenario.population.people,
        "population": plain(scenario.population.parts),
        **({"came": named(np.array(came, float)), "turned_away": turned_away} if scenario.has_arrivals else {}),
        **figures_of(runs),
        **{name: named(np.array([figure.of(one) for one in episodes])) for name, figure in FIGURES.items()},
        "exits": exits_of(scenario, episodes),
        "blocked": [
            {"run": episode.run, "since": episode.metrics.blocked_since, "left": episode.metrics.unfinished}
            for episode in episodes
            if np.isfinite(episode.metrics.blocked_since)
        ],
        "overlap_mm": {
            "mean": 1e3 * float(runs["mean_overlap"].mean()),
            "max": 1e3 * float(runs["max_overlap"].max()),
        },
        "outside_mm": 1e3 * float(runs["max_outside"].max()),
        "residual": float(runs["residual"].max()),
        "unconverged_steps": int(runs["unconverged"].sum()),
    }


def columns_of(metrics: Sequence[EpisodeMetrics]) -> dict[str, Floats]:
    """Return the metrics of evacuations by name, each of every run (R,)."""
    return dict(zip(EpisodeMetrics._fields, np.array(metrics, dtype=np.float64).T.copy(), strict=True))


def figures_of(runs: Mapping[str, Floats]) -> Plain:
    """Return the figures that every report of many evacuations has, ready for JSON, from `columns_of` them; see `report`."""
    count, unfinished = len(runs["unfinished"]), runs["unfinished"]
    left, blocked = int((unfinished > 0).sum()), int(np.isfinite(runs["blocked_since"]).sum())
    return {
        "runs": count,
        "unfinished": int(unfinished.sum()),
        "unfinished_runs": left,
        "unfinished_share": share(left, count),
        "blocked_runs": blocked,
        "blocked_share": share(blocked, count),
        "evacuation_time": named(runs["evacuation_time"]),
        "flow": named(runs["flow"]),
        "max_speed": float(runs["max_speed"].max()),
        "escaped": int(runs["escaped"].sum()),
    }


def time_of_share(exit_time: Floats, share: float) -> float:
    """Return when at least this share of the people were out [s]; nan if they never were, or there are none.

    ``exit_time`` (N,) [s] is nan for people who did not get out.
    """
    count = max(int(np.ceil(share * len(exit_time) - 1e-9)), 1)
    return float(np.sort(exit_time)[count - 1]) if len(exit_time) else float("nan")  # nan go last


def runs_enough(times: Floats, share: float) -> int | None:
    """Return after how many of the first evacuation times (R,) [s] their mean is known to this share of it; None if after none.

    That is the 95 % interval of `summarise`, over the runs that ended, `FEWEST` at least.
    """
    for runs in range(FEWEST, len(times) + 1):
        mean, _, (_, high) = summarise(times[:runs])
        if np.isfinite(times[:runs]).sum() >= FEWEST and high - mean <= share * mean:
            return runs
    return None


def exit_names(scenario: Scenario, exit_index: Ints) -> np.ndarray:
    """Return the name of the exit that each pedestrian (N,) took; "" for one left inside."""
    return np.append(np.array(scenario.geometry.exit_names), "")[exit_index]


def exits_of(scenario: Scenario, episodes: Sequence[Episode]) -> Plain:
    """Return figures of each exit, the busiest first, ready for JSON.

    ``share`` is of the people out in a run; flows are over its `entered_lengths`, see `passing`.
    """
    taken = [exit_names(scenario, episode.exit_index) for episode in episodes]
    out = np.array([(names != "").sum() for names in taken])
    found: dict[str, Any] = {}
    for name, width in entered_lengths(scenario.geometry, np.concatenate([one.exit_index for one in episodes])).items():
        count = np.array([(names == name).sum() for names in taken])
        of_run = np.divide(count, out, out=np.full(len(out), np.nan), where=out > 0)
        times = [np.sort(one.exit_time[names == name]) for one, names in zip(episodes, taken, strict=True)]
        found[name] = {"share": named(of_run), **passing(times, width)}
    return busiest_first(found)


def passing(times: Sequence[Floats], width: float) -> Plain:
    """Return figures of people passing a line of ``width`` [m], from the ascending times [s] of each run, ready for JSON.

    ``people`` pass it in all runs, ``first`` and ``last`` are when [s].  ``flow_per_meter`` is the flow [1/(s m)],
    ``peak_flow_per_meter`` the `peak_flow`; a handful of people have none.
    """
    flows = [one if len(one) >= HANDFUL else one[:0] for one in times]
    of_each = {
        "first": [one[0] if len(one) else np.nan for one in times],
        "last": [one[-1] if len(one) else np.nan for one in times],
        "flow_per_meter": [flow_slope(one) / width for one in flows],
        "peak_flow_per_meter": [peak_flow(one) / width for one in flows],
    }
    return {"people": sum(map(len, times)), **{name: named(np.array(values)) for name, values in of_each.items()}}


def busiest_first(found: Mapping[str, Plain]) -> Plain:
    """Return what people pass in the order of their number, see `passing`."""
    return dict(sorted(found.items(), key=lambda one: -one[1]["people"]))


def entered_lengths(geometry: Geometry, exit_index: Ints) -> dict[str, float]:
    """Return the length [m] of the sides of each exit through which at least a twentieth of its people went.

    Lines of an area that turn little are one side, as all of a circle.  An exit that a handful took has all its sides.

    Parameters
    ----------
    exit_index : (N,) row of `Geometry.exits` of each pedestrian, -1 = none.
    """
    people = np.bincount(exit_index[exit_index >= 0], minlength=len(geometry.exits))
    length = segment_lengths(geometry.exits)
    names, lengths = np.array(geometry.exit_names), dict.fromkeys(geometry.exit_names, 0.0)
    for name, rows in geometry.openings(_SIDE):
        of_all = people[names == name].sum()
        if of_all < HANDFUL or people[rows].sum() >= _ENTERED * of_all:
            lengths[name] += float(length[rows].sum())
    return lengths


def peak_flow(times: Floats) -> float:
    """Return the largest flow [1/s] through an exit, from the ascending times (K,) [s] at which people crossed it.

    It is how many cross, at most, within `PEAK` seconds after a crossing, over these.  Where the mean flow is more (an exit was
    used for a shorter time, or hardly), it is the mean flow.  Fewer than 3 people have no flow: nan.
    """
    following = np.searchsorted(times, times + PEAK + 1e-9, side="right") - np.arange(1, len(times) + 1)
    return max(flow_slope(times), float(following.max(initial=0)) / PEAK)  # nan stays nan: it comes first


def named(values: np.ndarray, least: float = 0.0) -> Plain:
    """Return mean, spread and interval of the mean of the finite values, ready for JSON.

    No value can be below ``least``: nor is the interval, as the t interval of two runs often is.
    """
    mean, sd, (low, high) = summarise(values)
    bounds = [json_number(bound) for bound in (np.maximum(low, least), high)]
    return {"mean": json_number(mean), "sd": json_number(sd), "ci95": bounds}


def median_time(times: Floats) -> float | None:
    """Return when [s] half of all evacuations (R,) had ended, nan for one that never did; None if more than half never did."""
    ended = np.where(np.isfinite(times), times, np.inf)
    return json_number(float(np.quantile(ended, 0.5, method="inverted_cdf")))


def share(count: int, of: int) -> Plain:
    """Return a share with its Wilson interval, ready for JSON."""
    return {"mean": count / of, "ci95": list(share_interval(count, of))}


# ---------------------------------------------------------------------------------------------------- in tables


def number(value: float | None, unit: str = "", digits: int = 2) -> str:
    """Return "1.25 s"; "-" for no number."""
    return "-" if value is None or value != value else f"{value:.{digits}f} {unit}".rstrip()


def spread(figure: Plain, unit: str = "", digits: int = 2) -> str:
    """Return "1.25 ± 0.10 s": the mean with the standard deviation over runs, if there is one."""
    if figure["mean"] is None or figure["sd"] is None:
        return number(figure["mean"], unit, digits)
    return f"{number(figure['mean'], digits=digits)} ± {number(figure['sd'], unit, digits)}"


def interval(figure: Plain, unit: str = "", digits: int = 2) -> str:
    """Return "1.05 to 1.45 s": the 95 % interval of the mean; "" if there is none."""
    low, high = figure["ci95"]
    return "" if low is None else f"{number(low, digits=digits)} to {number(high, unit, digits)}"


def percent(share: Plain) -> str:
    """Return "12 (3..20)": a share of runs in percent with its interval."""
    low, high = (100.0 * bound for bound in share["ci95"])
    return f"{100.0 * share['mean']:.0f} ({low:.0f}..{high:.0f})"


def half(time: float | None, digits: int = 1) -> str:
    """Return when [s] half of all runs had cleared, in words if they never did."""
    return "never" if time is None else f"{time:.{digits}f}"


def with_interval(found: Plain, digits: int = 1, sign: str = "") -> str:
    """Return "52.3 (51.2..53.4)": a mean with its interval, "–" for none; the larger the numbers, the fewer digits."""
    if found["mean"] is None:
        return "–"
    bounds = [bound for bound in found["ci95"] if bound is not None]
    largest = max(abs(value) for value in (found["mean"], *bounds))
    digits = min(digits, 2 if largest < 9.995 else 1 if largest < 99.95 else 0)
    between = "..".join(f"{bound:{sign}.{digits}f}" for bound in bounds)
    return f"{found['mean']:{sign}.{digits}f}" + (f" ({between})" if between else "")


# What a format writes of a figure, with its digits: "{evacuation_time:spread/2}".
_WRITTEN: dict[str, Callable[[Any, int], str]] = {
    "half": half,
    "spread": lambda found, digits: "–" if found["mean"] is None else spread(found, digits=digits),
    "percent": lambda found, digits: percent(found),
    "interval": with_interval,
    "difference": lambda found, digits: "–" if found is None else with_interval(found, digits, "+"),
}
_SCALED = {
    "%": (100.0, ".0f"),
    "%1": (100.0, ".1f"),
    "k": (1e-3, ".1f"),
    "m": (1e3, ".1f"),
}  # percent, and units with a prefix


class _Cells(string.Formatter):
    """Format strings over what JSON holds: a dash for what is missing, `_WRITTEN` figures, `_SCALED` units, a true minus."""

    def get_field(self, field_name: str, args: Sequence[Any], kwargs: Mapping[str, Any]) -> Any:
        try:
            return super().get_field(field_name, args, kwargs)
        except (KeyError, TypeError, IndexError):
            return None, field_name

    def format_field(self, value: Any, format_spec: str) -> str:
        name, _, digits = format_spec.partition("/")
        if name in _WRITTEN:
            return _WRITTEN[name](value, int(digits or 1))
        if value is None:
            return "–"
        scale, format_spec = _SCALED.get(format_spec, (None, format_spec))
        text = str(super().format_field(value if scale is None else scale * value, format_spec))
        return text.replace("-", "−") if format_spec.startswith("+") else text


def cell(text: str, row: Plain) -> str:
    """Return a format string such as "{flow[mean]:.2f}" filled from a row of figures; a dash if nothing of it is known."""
    found = _Cells().vformat(text, (), row)
    return "–" if "–" in found and not any(sign.isdigit() for sign in found) else found


def cells(place: Scenario, figures: Plain) -> dict[str, str]:
    """Return the rows of the table of a `report`: label -> cell."""
    x0, y0, x1, y1 = place.geometry.bounds
    widths = [f"{name} {place.geometry.exit_lengths[name]:.2f} m" for name in figures["exits"]]
    rows = {
        "plan": f"{place.geometry.area:.1f} m2 in {x1 - x0:.2f} m x {y1 - y0:.2f} m",
        "exits": listed(widths),
    }
    if "came" in figures:
        rows["people who came"] = spread(figures["came"], "people")
        if away := sum(figures["turned_away"]):
            rows["  could not enter"] = f"{counted(away, 'person', 'people')} in all runs"
    ended = figures["runs"] - figures["unfinished_runs"]
    of = f", of the {ended} of {figures['runs']} runs that ended" if ended < figures["runs"] else ""
    for name, figure in FIGURES.items():
        rows[figure.title] = spread(figures[name], figure.unit) + (of if name == "evacuation_time" else "")
        if name == "evacuation_time" and (bounds := interval(figures[name], figure.unit)):
            rows["  95 % interval of the mean"] = bounds
        if name == "evacuation_time" and "by_hand" in figures:
            rows["  by hand (SFPE)"] = figures["by_hand"]["words"]
    flows = {name: number(taken["flow_per_meter"]["mean"]) for name, taken in figures["exits"].items()}
    parts = [f"{name} {flow}" if len(flows) > 1 else flow for name, flow in flows.items()]
    rows["flow per meter of exit"] = f"{listed(parts)} 1/(s m); {recorded_flow(figures)[1]}"
    if len(figures["exits"]) > 1:
        shares = {name: taken["share"]["mean"] for name, taken in figures["exits"].items()}
        parts = [f"{name} {'-' if mean is None else f'{100.0 * mean:.0f} %'}" for name, mean in shares.items()]
        rows["shares of the exits"] = listed(parts)
    if figures.get("sections"):
        said = [f"{name}, {found['length']:.2f} m: {_flows(found)}" for name, found in figures["sections"].items()]
        rows["flow inside"] = listed(said, _SECTIONS_SHOWN, "\n")
    if figures.get("storeys"):
        said = [f"{name} {number(found['empty']['mean'], 's', 1)}" for name, found in figures["storeys"].items()]
        rows["empty after"] = listed(said, _SECTIONS_SHOWN, "\n")
    left = counted(figures["unfinished"], "person", "people"), counted(figures["unfinished_runs"], "run", "runs")
    rows["unfinished"] = f"{left[0]} in {left[1]}"
    if figures["unfinished_runs"]:
        rows["unfinished"] += f", {percent(figures['unfinished_share'])} % of runs"
    if figures["blocked"]:
        runs = [f"run {one['run']} since {one['since']:.1f} s, {one['left']} left" for one in figures["blocked"]]
        rows["  blocked"] = listed(runs, _RUNS_SHOWN, "\n")
    overlap, fastest, lost = figures["overlap_mm"], figures["max_speed"], figures["escaped"]
    bound = " (the bound: some were pushed harder)" if fastest >= MAX_SPEED * (1 - 1e-12) else ""
    return {
        **rows,
        "overlap of bodies": f"mean {number(overlap['mean'])}, at most {number(overlap['max'], 'mm')}",
        "reach beyond a wall": f"at most {number(figures['outside_mm'], 'mm')}",
        "largest speed": number(fastest, "m/s") + bound,
        "outside of the plan": f"{counted(lost, 'person', 'people')}: these figures are void" if lost else "nobody",
        "solver residual": f"at most {figures['residual']:.1e} m/s",
    }


def _flows(section: Plain) -> str:
    """Return how many people cross a section each way, the flow and the largest flow."""
    said = []
    for way, found in section["towards"].items():
        flow, peak = (number(found[figure]["mean"]) for figure in ("flow_per_meter", "peak_flow_per_meter"))
        if found["people"]:
            people = f"{people_words(found['people'] / section['runs'])} {way}"
            said.append(people if flow == "-" else f"{people}, {flow} 1/(s m), peak {peak}")
    return "; ".join(said) or "nobody"


def recorded_flow(figures: Plain) -> tuple[float, str]:
    """Return what experiments with people of this manner found at doors [1/(s m)], as a number and in words."""
    manner = Headway.of(figures.get("manner"))
    if manner is not None and manner.time_gap > _WALKING and manner.push == 0.0:
        return WALKING_FLOW, f"walking people in experiments reach {WALKING_FLOW:g}"
    return HIGHEST_FLOW, f"crowds in experiments reach {HIGHEST_FLOW:g} at most"


def doubts(figures: Plain) -> str:
    """Return in one sentence what makes the figures of a `report` doubtful; "" if nothing does."""
    fast = {f"exit {name}": taken["flow_per_meter"]["mean"] or 0.0 for name, taken in figures["exits"].items()}
    inside = {
        name: max(taken["flow_per_meter"]["mean"] or 0.0 for taken in found["towards"].values())
        for name, found in figures.get("sections", {}).items()
    }
    fast |= dict(sorted(inside.items(), key=lambda one: -one[1])[:1])
    highest, recorded = recorded_flow(figures)
    said = [
        f"{flow:.1f} people per second and meter pass {name}; {recorded}"
        for name, flow in fast.items()
        if round(flow, 1) > highest
    ]
    if max(fast.values(), default=0.0) > _OF_PAPERS and Headway.of(figures.get("manner")) is None:
        said.append("competitive people are those of the papers, faster than any recorded crowd")
    by_hand, mean = (figures.get(name, {}) for name in ("by_hand", "evacuation_time"))
    by_hand, mean = by_hand.get("time"), mean.get("mean")
    if highest == WALKING_FLOW and by_hand and mean and mean < _FASTER * by_hand:
        said.append(f"the last person is out after {mean:.0f} s, by hand (SFPE) after {by_hand:.0f} s")
    if figures["unfinished"]:
        left, cut = figures["unfinished"], figures["unfinished_runs"] - figures["blocked_runs"]
        away = sum(figures.get("turned_away", ()))
        said.append(f"{counted(left - away, 'person is', 'people are')} left inside")
        said += [f"{counted(away, 'person', 'people')} could not enter"] * bool(away)
        if cut:
            said.append(f"{counted(cut, 'run was', 'runs were')} cut by the time limit")
    if figures.get("until") and not figures["enough"]:
        said.append(f"the mean evacuation time is not known to {100.0 * figures['until']:g} % yet: give more --runs")
    if figures.get("unconverged_steps"):
        said.append(
            f"the contact solver ended above its tolerance in {counted(figures['unconverged_steps'], 'step', 'steps')}"
        )
    if "interrupted_of" in figures:
        said.append(f"only {figures['runs']} of {figures['interrupted_of']} runs were finished")
    return "; ".join(said)


def people_words(mean: float) -> str:
    """Return "1 person", "2 people", "2.5 people": a mean over runs."""
    return f"{mean:.1f}".removesuffix(".0") + (" person" if mean == 1 else " people")


def listed(items: Sequence[str], most: int = _EXITS_SHOWN, separator: str = ", ") -> str:
    """Return the first few items, and how many more there are."""
    more = [f"and {len(items) - most} more"] if len(items) > most else []
    return separator.join([*items[:most], *more])
