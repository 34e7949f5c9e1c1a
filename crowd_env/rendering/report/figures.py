"""What a report shows: the plan as it was understood, what came out, and what the first folder's figures differ from."""

from collections.abc import Callable, Sequence
from itertools import pairwise, zip_longest
from math import inf, isfinite
from typing import Any

import numpy as np

from crowd_env.analysis.figures import FIGURES, exit_names, named, number, people_words
from crowd_env.analysis.plan_check import cells, check_place
from crowd_env.analysis.results.crowding import SERVICE
from crowd_env.core.checks import Plain, counted
from crowd_env.envs.rollout import Episode
from crowd_env.geometry.voronoi import REACH
from crowd_env.physics.pressure import INJURY
from crowd_env.rendering.canvas import encoded
from crowd_env.rendering.figures import egress_curves, share_figure, storey_figure
from crowd_env.rendering.heat import heat_maps
from crowd_env.rendering.palette import SERIES
from crowd_env.rendering.report.answer import answer, share_words, time_words
from crowd_env.rendering.report.maps import Measured, Worst, Zone, heat_of
from crowd_env.rendering.report.runs import Runs, table
from crowd_env.rendering.sheet import plan_figure


def figures(runs: Sequence[Runs], measured: Sequence[Measured]) -> Plain:
    """Return the tables and pictures (in base64) of a report."""
    names = [one.name for one in runs]
    found: dict[str, Any] = {
        "names": names,
        "head": ("", *names) if len(runs) > 1 else (),
        "places": _places(runs),
        "answer": answer(runs),
        "more": table(_ROWS, runs),
        "curves": _curves(runs),
        "exits": _exits(runs),
        "gaps": _gaps(runs),
        "storeys": [_storeys(one, measured) for one in runs if one.storeys],
        "storeys_head": _STOREYS,
        "maps": [],
        "pressed": table(_PRESSED, measured),
        "reach": f"{REACH:g}",
        "injury": f"{INJURY:g}",
    }
    of_name = {one.name: one for one in runs}
    for one in measured:
        picture = heat_maps(of_name[one.name].scenario.geometry, heat_of(one, measured), title=one.name)
        places = zip_longest(one.densest, one.hardest, one.loaded)
        rows = [
            (k + 1, _spot(dense, "people/m²"), _spot(hard, "kN/m", 1e-3), _spot(load, "kN/m", 1e-3))
            for k, (dense, hard, load) in enumerate(places)
        ]
        service = ("share of person-time", *(f"{100.0 * share:.0f} %" for share in one.service.values()))
        found["maps"].append(
            {
                "name": one.name,
                "runs": one.runs,
                "png": encoded(picture),
                "rows": rows,
                "service": [_AREAS, service],
                "service_head": ("level", *one.service),
                "zones": [_zone(zone) for zone in one.zones if not zone.is_sheet],
            }
        )
    return found


_EDGES = [f"{1.0 / most:.2f}" for most in SERVICE.values() if most]
_AREAS = (
    "floor area\n[m² a person]",
    f"{_EDGES[0]} or more",
    *(f"{low} to {high}" for high, low in pairwise(_EDGES)),
    f"below {_EDGES[-1]}",
)
_PRESSED: dict[str, Callable[[Measured], str]] = {
    f"time that people spent beyond {INJURY:g} N/m, means of 1 s, added up": lambda one: f"{one.squeezed:.1f} s a run",
    "moments of 0.1 s left out, since the solver did not finish a step": lambda one: str(one.left_out),
}


def _zone(zone: Zone) -> tuple[str, ...]:
    most = zone.most["mean"]
    people = (f"{zone.area:.1f}", number(most, digits=1), number(most / max(zone.area, 1e-9)))
    return (zone.name, *people, number(zone.empty["mean"], digits=1))


_STOREYS = (
    "storey or stair",
    "people at\nthe start",
    "most\nat once",
    "densest\n[1/m²]",
    "empty after\n[s]",
    "left by",
)


def _storeys(one: Runs, measured: Sequence[Measured]) -> Plain:
    """Return the picture and the table of storeys and stairs: people are means over runs."""
    zones = {zone.name: zone for found in measured if found.name == one.name for zone in found.zones if zone.is_sheet}
    rows = []
    for stay in one.storeys:
        found = stay.figures
        ways = [_way(name, taken, found["runs"]) for name, taken in found["left"].items() if taken["people"]]
        people = (number(found[key]["mean"], digits=1) for key in ("started", "most"))
        densest = number(zones[stay.sheet.name].densest, digits=1) if stay.sheet.name in zones else "–"
        rows.append(
            (stay.sheet.title, *people, densest, number(found["empty"]["mean"], digits=1), "\n".join(ways) or "–")
        )
    return {"name": one.name, "png": encoded(storey_figure(one.storeys)), "rows": rows}


def _way(name: str, taken: Plain, runs: int) -> str:
    flow, peak = (number(taken[key]["mean"]) for key in ("flow_per_meter", "peak_flow_per_meter"))
    people = f"{name}: {people_words(round(taken['people'] / runs, 1))}"
    return people if flow == "-" else f"{people}, {flow}, peak {peak} 1/(s m)"


def _places(runs: Sequence[Runs]) -> list[dict[str, Any]]:
    """Return each plan that differs from the others, as it was understood."""
    parts = []
    of_plan: dict[str, list[Runs]] = {}
    for one in runs:
        of_plan.setdefault(one.draw, []).append(one)
    for group in of_plan.values():
        scenario = group[0].scenario
        check = check_place(scenario, group[0].episodes[0].seed)
        rows = [(label, cell) for label, cell in cells(check).items() if label != "check"]
        names = "; ".join(one.name for one in group) if len(of_plan) > 1 else ""
        place = {"names": names, "name": scenario.name, "png": encoded(plan_figure(check))}
        parts.append({**place, "rows": rows, "remarks": check.remarks})
    return parts


def _spot(place: Worst | None, unit: str, scale: float = 1.0) -> str:
    if place is None:
        return "–"
    exit = f", {place.distance:.1f} m from exit {place.exit}" if place.exit else ""
    return f"{scale * place.value:.1f} {unit} at {place.where} m{exit}"


def _curves(runs: Sequence[Runs]) -> str:
    curves = {one.name: [episode.exit_time[episode.came] for episode in one.episodes] for one in runs}
    entries = {one.name: [episode.entries for episode in one.episodes] for one in runs}
    return encoded(egress_curves(curves, until={one.name: _known(one) for one in runs}, entries=entries))


def _known(runs: Runs) -> float:
    """Return until when it is known how many people are inside [s]: until the time limit ends a run; blocked ones stay."""
    cut = [one for one in runs.episodes if one.metrics.unfinished and not isfinite(one.metrics.blocked_since)]
    return min((one.end for one in cut), default=inf)


def _exits(runs: Sequence[Runs]) -> Plain | None:
    """Return the shares of the exits; None if there is one."""
    names = list(dict.fromkeys(name for one in runs for name in one.figures["exits"]))
    if len(names) < 2:
        return None
    shares = {one.name: {name: found["share"] for name, found in one.figures["exits"].items()} for one in runs}
    rows = [(name, *(share_words(one.figures["exits"].get(name)) for one in runs)) for name in names]
    shown = {
        "png": encoded(share_figure(shares, names)),
        "rows": rows,
        "head": ("exit", *(one.name for one in runs)),
    }
    return {**shown, "over_time": [{"name": one.name, "png": _over_time(one)} for one in runs]}


def _over_time(one: Runs) -> str:
    """Return the picture of how many are out by each exit, for as many exits as there are colors."""
    taken = [(exit_names(one.scenario, episode.exit_index), episode.exit_time) for episode in one.episodes]
    busiest = sorted(one.figures["exits"], key=lambda name: -one.figures["exits"][name]["people"])[: len(SERIES)]
    curves = {name: [times[names == name] for names, times in taken] for name in busiest}
    return encoded(egress_curves(curves, until=dict.fromkeys(busiest, _known(one)), out=True))


def _gaps(runs: Sequence[Runs]) -> Plain:
    """Return by how much the runs differ from the first, and why some cannot be compared."""
    minus_first = differences(runs)
    pairable = [one for one in minus_first if "why_not" not in one]
    rows = [(FIGURES[name].title, *(_gap(one[name]) for one in pairable)) for name in COMPARED]
    return {
        "head": ("", *(f"{one['name']} minus {one['minus']}" for one in pairable)) if pairable else (),
        "rows": [*rows, ("runs of the same draw", *(str(one["shared_seeds"]) for one in pairable))],
        "why_not": [f"{one['name']}: {one['why_not']}." for one in minus_first if "why_not" in one],
    }


def _gap(figure: Plain) -> str:
    if figure["mean"] is None:
        return "–"
    low, high = figure["ci95"]
    interval = "no interval" if low is None else f"{low:+.2f} to {high:+.2f}"
    return f"{figure['mean']:+.2f} s ({interval}), {counted(figure['pairs'], 'pair', 'pairs')}"


_ROWS: dict[str, Callable[[Runs], str]] = {
    "mean exit time": time_words("mean_exit_time"),
    "flow": time_words("flow"),
    "largest overlap of bodies": lambda runs: f"{runs.figures['overlap_mm']['max']:.2f} mm",
    "steps that the contact solver ended above its tolerance": lambda runs: str(runs.figures["unconverged_steps"]),
    "people found outside of the plan": lambda runs: (
        f"{runs.figures['escaped']}: these figures are void" if runs.figures["escaped"] else "nobody"
    ),
}


COMPARED = ("evacuation_time", "t95", "mean_exit_time")  # of `FIGURES`


def differences(runs: Sequence[Runs]) -> list[Plain]:
    """Return how much longer each folder took than the first, ready for JSON.

    Runs of one seed are paired where they begin with the same people in the same places (common random numbers): the interval
    of the mean difference is then that of paired values (Student's t).  ``pairs`` is the number of pairs in which both runs
    have the figure; a mean exit time counts where everyone got out, since those who got out of a run that was cut short are
    the quick ones.  A folder whose plan, people or seeds are others has ``why_not`` in place of figures.
    """
    return [_minus(other, runs[0]) for other in runs[1:]]


def _minus(one: Runs, first: Runs) -> Plain:
    head = {"name": one.name, "minus": first.name}
    if one.draw != first.draw:
        return {**head, "why_not": "the plan or the people are others, so that runs cannot be paired"}
    by_seed = {episode.seed: episode for episode in first.episodes}
    pairs = [(episode, by_seed[episode.seed]) for episode in one.episodes if episode.seed in by_seed]
    if not pairs:
        return {**head, "why_not": "no seed is in both, so that runs cannot be paired"}
    if not all(_same_people(*pair) for pair in pairs):
        return {**head, "why_not": "runs of the same seed are of other people, so that they cannot be paired"}
    found: dict[str, Any] = {**head, "shared_seeds": len(pairs)}
    for name in COMPARED:
        gap = np.array([_value(a, name) - _value(b, name) for a, b in pairs])
        found[name] = {**named(gap, least=-np.inf), "pairs": int(np.isfinite(gap).sum())}
    return found


def _same_people(one: Episode, other: Episode) -> bool:
    """Whether pedestrians that got out in both runs have the same bodies and desired speeds."""
    both = np.isfinite(one.exit_time) & np.isfinite(other.exit_time)
    bodies = ((one.radius, other.radius), (one.desired_speed, other.desired_speed))
    return all(np.array_equal(a[both], b[both]) for a, b in bodies)


def _value(episode: Episode, name: str) -> float:
    """Return a figure of a run; a mean exit time counts where everyone got out."""
    cut = name == "mean_exit_time" and episode.metrics.unfinished
    return float("nan") if cut else FIGURES[name].of(episode)
