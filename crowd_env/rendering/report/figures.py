"""The sections of a report that show something: the plan as it was understood, and what came out."""

from collections.abc import Callable, Mapping, Sequence
from itertools import zip_longest
from math import inf, isfinite
from typing import Any

from crowd_env.analysis.plan_check import PlanCheck, check_plan, spot
from crowd_env.analysis.results.egress import QUANTILES, egress
from crowd_env.analysis.results.measurements import INJURY, REACH
from crowd_env.core.arrays.outline import room_of
from crowd_env.rendering.comparison import Band, Share, egress_bands, share_bars
from crowd_env.rendering.heat import heat_maps
from crowd_env.rendering.report.differences import COMPARED
from crowd_env.rendering.report.maps import Measured, Worst, heat_of
from crowd_env.rendering.report.markup import Drawer, bullets, heading, paragraph, picture, section, table
from crowd_env.rendering.report.runs import Runs
from crowd_env.rendering.sheet import draw_sheet

_LOW, _HIGH = QUANTILES.index(0.05), QUANTILES.index(0.95)


def place(runs: Sequence[Runs], drawer: Drawer) -> str:
    """Return the section on the plan: each that differs from the others, as it was understood."""
    parts = []
    of_plan: dict[str, list[Runs]] = {}
    for one in runs:
        of_plan.setdefault(one.draw, []).append(one)
    for group in of_plan.values():
        scenario = group[0].scenario
        check = check_plan(
            scenario.name,
            scenario.geometry,
            scenario.population,
            title=scenario.title,
            room=room_of(scenario.outline_of_run()),
            seed=group[0].episodes[0].seed,
        )
        if len(of_plan) > 1:
            parts.append(heading("; ".join(one.name for one in group)))
        draw_sheet(drawer.path, [check])
        parts.append(
            picture(drawer.taken(), f"Plan of {scenario.name} with exits and people at the start", kind="plan")
        )
        parts.append(table(_plan_rows(check)))
        if check.remarks:
            parts += [paragraph("To be checked:"), bullets(check.remarks, "remarks")]
    return section("The plan as it was understood", *parts)


def _plan_rows(check: PlanCheck) -> list[tuple[str, str]]:
    x0, y0, x1, y1 = check.geometry.bounds
    least, most = check.body
    rows = [
        ("extent", f"{x1 - x0:.2f} m x {y1 - y0:.2f} m, {check.geometry.area:.1f} m²"),
        ("exits", "\n".join(f"{name}: {width:.2f} m wide" for name, width in check.widths.items())),
        ("narrowest passage", "\n".join(_passage(check, name) for name in check.passages)),
        ("people", f"{check.people.people}, bodies {least:.2f} to {most:.2f} m wide; at most {check.capacity} fit"),
    ]
    if check.geometry.doors:
        rows.append(("doors", ", ".join(check.geometry.doors)))
    lost = [f"{area:.3g} m²" for _, area in check.unreached]
    return [*rows, ("no exit reaches", ", ".join(lost))] if lost else rows


def _passage(check: PlanCheck, name: str) -> str:
    passage = check.passages[name]
    if passage is None:
        return f"to {name}: nobody who starts has a way"
    where = (
        "the exit itself"
        if passage.is_exit
        else f"at {spot(passage.gap)}, for {100 * passage.behind:.0f} % of the people"
    )
    return f"to {name}: {passage.gap.width:.2f} m, {where}"


def results(runs: Sequence[Runs], minus_first: Sequence[Mapping[str, Any]], drawer: Drawer) -> str:
    """Return the section on what came out."""
    head = ("", *(one.name for one in runs)) if len(runs) > 1 else ()
    rows = [(label, *(words(one) for one in runs)) for label, words in _ROWS.items()]
    parts = [
        table(rows, head, kind="numbers"),
        paragraph(
            "Means over runs with the 95 % interval of the mean (Student's t) and ± the standard deviation of single runs; "
            "shares of runs with Wilson's 95 % interval. Evacuation time is over the runs in which everyone got out, mean exit "
            "time over those who got out. The intervals are those of the draw of people, not of what the model leaves out.",
            "small",
        ),
        _curves(runs, drawer),
        _shares(runs, drawer),
    ]
    if len(runs) > 1:
        parts += [heading(f"Differences to {runs[0].name}"), *_differences(minus_first)]
    return section("Results", *parts)


def maps(runs: Sequence[Runs], found: Sequence[Measured], drawer: Drawer) -> str:
    """Return the section on where it was crowded, and where people pressed each other; nothing if it was not measured."""
    if not found:
        return ""
    parts = [
        paragraph(
            "In each cell the largest value of any moment of the runs that were made again for this. Density: people within "
            f"{REACH:g} m over the area of that disc. Pressure: contact force on a person over the circumference of the body, "
            f"mean of one decision; beyond {INJURY:g} N/m people are taken for injured in Helbing, Farkas, Vicsek 2000 (Nature "
            "407:487). Forces are those of the contact scheme and were not held against measured ones.",
            "small",
        )
    ]
    for one, measured in zip(runs, found, strict=True):
        again = "1 run" if measured.runs == 1 else f"{measured.runs} runs"
        came = "came out as before, to the last bit" if measured.same else "did NOT come out as before"
        heat_maps(drawer.path, one.scenario.geometry, heat_of(measured, found), title=one.name)
        caption = (
            f"{one.name}: {again} made again from their seeds; they {came}. All maps of a kind have the same colors."
        )
        parts.append(picture(drawer.taken(), f"Maps of {one.name}", caption, "maps"))
        rows = [
            (k + 1, *(_spot(pair, unit) for pair, unit in zip(pairs, ("people/m²", "N/m"), strict=True)))
            for k, pairs in enumerate(zip_longest(measured.densest, measured.hardest))
        ]
        parts.append(table(rows, ("worst places", "density", "pressure"), kind="numbers"))
    return section("Where it was crowded, and where people pressed", *parts)


def _spot(place: Worst | None, unit: str) -> str:
    if place is None:
        return "–"
    value = f"{place.value:.1f}" if unit == "people/m²" else f"{place.value:.0f}"
    return f"{value} {unit} at ({place.x:.1f}, {place.y:.1f}) m, {place.distance:.1f} m from exit {place.exit}"


def _curves(runs: Sequence[Runs], drawer: Drawer) -> str:
    bands = {}
    for one in runs:
        curve = egress([episode.exit_time for episode in one.episodes])
        bands[one.name] = Band(curve.time, curve.mean, curve.quantiles[:, _LOW], curve.quantiles[:, _HIGH], _known(one))
    egress_bands(drawer.path, bands)
    caption = (
        "N(t): how many people are inside; lines are means over draws, bands hold 90 % of them (5 % to 95 % quantile). "
        "A curve ends where the time limit ended a run with people inside."
    )
    return heading("Egress curves") + picture(
        drawer.taken(), "Number of people inside over time", caption, "small-plot"
    )


def _known(runs: Runs) -> float:
    """Return until when it is known how many people are inside [s]: until the time limit ends a run; blocked ones stay."""
    cut = [one for one in runs.episodes if one.metrics.unfinished and not isfinite(one.metrics.blocked_since)]
    return min((one.end for one in cut), default=inf)


def _shares(runs: Sequence[Runs], drawer: Drawer) -> str:
    exits = list(dict.fromkeys(name for one in runs for name in one.figures["exits"]))
    if len(exits) < 2:
        return ""
    shares = {one.name: {name: _share(found["share"]) for name, found in one.figures["exits"].items()} for one in runs}
    share_bars(drawer.path, shares, exits)
    rows = [(name, *(_exit(one.figures["exits"].get(name)) for one in runs)) for name in exits]
    caption = "Share of those who got out by each exit, mean over runs with its 95 % interval."
    shown = picture(drawer.taken(), "Shares of the exits", caption, "small-plot")
    return heading("Exits") + shown + table(rows, ("exit", *(one.name for one in runs)), kind="numbers")


def _share(figure: Mapping[str, Any]) -> Share:
    low, high = figure["ci95"]
    return Share(*(float("nan") if value is None else value for value in (figure["mean"], low, high)))


def _exit(found: Mapping[str, Any] | None) -> str:
    if found is None or found["share"]["mean"] is None:
        return "–"
    if not found["share"]["sd"]:  # an interval of no width would claim too much
        return f"{100 * found['share']['mean']:.1f} % in every run"
    low, high = found["share"]["ci95"]
    interval = "" if low is None else f" ({100 * max(low, 0.0):.1f} to {100 * min(high, 1.0):.1f})"
    return f"{100 * found['share']['mean']:.1f} %{interval}"


def _differences(minus_first: Sequence[Mapping[str, Any]]) -> list[str]:
    pairable = [one for one in minus_first if "why_not" not in one]
    parts = []
    if pairable:
        rows = [(label, *(_gap(one[name]) for one in pairable)) for name, label in COMPARED.items()]
        rows.append(("runs of the same draw", *(str(one["shared_seeds"]) for one in pairable)))
        parts.append(table(rows, ("", *(f"{one['name']} minus {one['minus']}" for one in pairable)), kind="numbers"))
        parts.append(
            paragraph(
                "Paired, run by run on the same people in the same places (common random numbers), with the 95 % interval of "
                "the mean difference. An interval that holds 0 shows no clear difference.",
                "small",
            )
        )
    parts.append(bullets(f"{one['name']}: {one['why_not']}." for one in minus_first if "why_not" in one))
    return parts


def _gap(figure: Mapping[str, Any]) -> str:
    if figure["mean"] is None:
        return "–"
    low, high = figure["ci95"]
    interval = "no interval" if low is None else f"{low:+.2f} to {high:+.2f}"
    return f"{figure['mean']:+.2f} s ({interval}), {figure['pairs']} {'pair' if figure['pairs'] == 1 else 'pairs'}"


def _time(name: str, unit: str) -> Callable[[Runs], str]:
    def words(runs: Runs) -> str:
        found = runs.figures[name]
        if found["mean"] is None:
            return "–"
        if found["sd"] is None:
            return f"{found['mean']:.2f} {unit}"
        low, high = found["ci95"]
        return f"{found['mean']:.2f} ({low:.2f} to {high:.2f}) {unit}\n± {found['sd']:.2f} {unit}"

    return words


def _evacuation_time(runs: Runs) -> str:
    whole = runs.figures["runs"] - runs.figures["unfinished_runs"]
    of = f"\nof the {whole} of {runs.figures['runs']} runs in which everyone got out"
    return _time("evacuation_time", "s")(runs) + (of if 0 < whole < runs.figures["runs"] else "")


def _runs_in(kind: str) -> Callable[[Runs], str]:
    def words(runs: Runs) -> str:
        low, high = (100.0 * bound for bound in runs.figures[f"{kind}_share"]["ci95"])
        return f"{runs.figures[f'{kind}_runs']} of {runs.figures['runs']} ({low:.0f} to {high:.0f} %)"

    return words


def _blocked(runs: Runs) -> str:
    return _runs_in("blocked")(runs) if isfinite(runs.scenario.blocked_after) else "not looked for"


_ROWS: dict[str, Callable[[Runs], str]] = {
    "runs": lambda runs: str(runs.figures["runs"]),
    "evacuation time": _evacuation_time,
    "95 % of the people out (T95)": _time("t95", "s"),
    "mean exit time": _time("mean_exit_time", "s"),
    "flow": _time("flow", "1/s"),
    "runs in which someone was left inside": _runs_in("unfinished"),
    "people left inside, all runs": lambda runs: str(runs.figures["unfinished"]),
    "runs in which the exits blocked": _blocked,
    "largest overlap of bodies": lambda runs: f"{runs.figures['overlap_mm']['max']:.2f} mm",
    "people found outside of the plan": lambda runs: (
        f"{runs.figures['escaped']}: these figures are void" if runs.figures["escaped"] else "nobody"
    ),
}
