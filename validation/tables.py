"""What makes the tables of docs/tables/ anew: rows from commands or finished runs, and a format string for each column.

``source(LINE)`` is what ``python -m LINE --json`` prints; ``source.read(FILE)`` and ``source.rows(CASE)`` are of the folder
that --from names.  Verdicts of the table ``lin`` are written by hand, beside what ``crowd-env reproduce`` prints.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from crowd_env import SCHEMES
from crowd_env.core.checks import known
from crowd_env.reproduce.pecol2011.room import PRINTED as FLOWS
from crowd_env.reproduce.pecol2011.theatre import PRINTED as TIMES
from validation import task_tables
from validation.cases.case import DISC, share
from validation.cases.standing import DENSITIES
from validation.map import criteria, measured, passed, write_limits
from validation.pages import MADE_BY, Grid, grid, pivoted, read_table, write_table
from validation.seeds import seeds
from validation.sources import Source

_SPREAD = "{evacuation_time[mean]:.2f} ± {evacuation_time[sd]:.2f}"
_FLOW = "{flow[mean]:.2f} ± {flow[sd]:.2f}"
_INTERVAL = "{{{0}[mean]:.1f}} [{{{0}[ci95][0]:.1f}}, {{{0}[ci95][1]:.1f}}]".format
_BLOCKED = "{blocked_share[ci95][0]:%} to {blocked_share[ci95][1]:%} %"


def _room(source: Source, scheme: str, options: str = "", place: str = "room-v0", runs: int = 50) -> dict[str, Any]:
    return _left({"scheme": scheme, **source(f"crowd_env run {place} --physics {scheme}{options} --runs {runs}")})


def _left(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row that says who was left inside, and that a time is a bound if somebody was."""
    left = f"{row['unfinished']} people in {row['unfinished_runs']} of {row['runs']} runs"
    return {**row, "left": left if row["unfinished"] else "nobody", "bound": "≥ " if row["unfinished"] else ""}


def schemes(source: Source) -> Grid:
    """One row a scheme at its own step, and for three of them shorter steps."""
    shorter = {"dem": (0.001,), "nsm2": (0.005, 0.0025, 0.001), "nsm2-printed": (0.001,)}
    rows = [
        {**_room(source, scheme, f" --set dt={dt:g}" if dt else ""), "step": dt or SCHEMES[scheme].info.default_dt}
        for scheme in SCHEMES
        for dt in (None, *shorter.get(scheme, ()))
    ]
    overlap = "{overlap_mm[mean]:.3g} / {overlap_mm[max]:.3g}"
    return grid(rows, **{
        "scheme": "`{scheme}`", "step, s": "{step:g}", "overlap, mean / max, mm": overlap,
        "beyond a wall, mm": "{outside_mm:.3g}", "evacuation time, s": _SPREAD, "flow, 1/s": _FLOW,
        "left inside": "{left}", "largest speed, m/s": "{max_speed:.1f}",
    })  # fmt: skip


def halls(source: Source) -> Grid:
    """One row a scheme: how many were outside of the plan, and the largest speed in the halls of each size."""
    found = source.rows("halls", "great-halls")
    rows = []
    for scheme in dict.fromkeys(row["scheme"] for row in found):
        some = [row["more"] for row in found if row["scheme"] == scheme]
        fastest = {n: max(one["fastest, m/s"] for one in some if one["people"] == n) for n in (500, 1000, 2000, 5000)}
        outside, overlap = sum(one["outside"] for one in some), max(one["overlap, mm"] for one in some)
        rows.append({"scheme": scheme, "outside": outside or "nobody", "fastest": fastest, "overlap": overlap})
    return grid(rows, **{
        "scheme": "`{scheme}`", "outside of the plan": "{outside}", "fastest of 500, m/s": "{fastest[500]:.1f}",
        "of 1000": "{fastest[1000]:.1f}", "of 2000": "{fastest[2000]:.1f}", "of 5000": "{fastest[5000]:.1f}",
        "deepest overlap, mm": "{overlap:.3g}",
    })  # fmt: skip


def jambs(source: Source) -> Grid:
    """One row a scheme and manner: of how many draws the door was stuck, door by door and radius by radius."""
    stuck = ", ".join(f"{{more[stuck, radius {radius} m]}}" for radius in ("0", "0.05", "0.1", "0.2"))
    index = {"scheme": "`{scheme}`", "manner": "{manner}"}
    return pivoted(source.rows("jambs"), index, "door of {more[door, m]:g} m", stuck)


def _shapes(source: Source, case: str) -> list[dict[str, Any]]:
    """Return the rows of a case under `hertz`, of discs and of torsos."""
    shapes = {DISC: "discs", "torso": "torsos"}
    rows = [{**row, "bodies": name} for outline, name in shapes.items() for row in source.rows(case, outline=outline)]
    return [row for row in rows if row["scheme"] == "hertz"]


def bodies_gate(source: Source) -> Grid:
    """One row a shape and manner: the flow of the runs that were not stuck, and how many were."""
    rows = [
        {**row, **row["more"], "share": share(row["more"]["stuck"], len(row["more"]["passages"]))}
        for row in _shapes(source, "gate")
    ]
    return grid(rows, **{
        "bodies": "{bodies} of 0.17 m", "manner": "{manner}", "flow, 1/s": "{flow:.2f} ± {flow_error:.2f}",
        "variation of the gaps": "{variation:.2f}", "no passage for 20 s": "{share}",
    })  # fmt: skip


def bodies_doors(source: Source) -> Grid:
    """One row a shape and manner, one column a door: the flow per meter of the runs that were not stuck."""
    rows = [
        {**row, **one, "width": width, "lost": f", {one['stuck']} of {len(one['runs'])} stuck" if one["stuck"] else ""}
        for row in _shapes(source, "doors")
        for width, one in row["more"]["widths"].items()
    ]
    return pivoted(rows, {"bodies": "{bodies}", "manner": "{manner}"}, "{width} m", "{flow:.2f}{lost}")


def clogging(source: Source) -> Grid:
    """One row a desired speed."""
    rows = [{"speed": v, **source(f"crowd_env clogging {source.folder / v}")["sets"][0]} for v in ("1.0", "1.5", "1.8")]
    return grid(rows, **{
        "desired speed, m/s": "{speed}", "gaps": "{gaps[count]}", "mean, s": "{gaps[mean]:.2f}", "sd / mean": "{gaps[cv]:.2f}",
        "exponent α": "{tail[alpha]:.2f} ± {tail[error]:.2f}", "with open gaps": "{tail[alpha_open]:.2f}",
        "against an exponential": "{tail[ratio]:+.1f} (p = {tail[p]:.2g})",
        "blocked": "{blocked_runs} of {runs} (" + _BLOCKED + ")",
    })  # fmt: skip


def standing(source: Source) -> Grid:
    """One row a scheme, balance and push, one column a density: how many are reached, how fast, the force at a wall."""
    rows = [
        {
            **row,
            "balance": balance,
            "push": name[5:],
            "density": density,
            "reached": reached,
            "speed": speed,
            "force": force,
        }
        for row in source.rows("standing")
        for balance, found in row["more"].items()
        for name, waves in found.items()
        if name.startswith("push ")
        for density, reached, speed, force in zip(DENSITIES, *waves.values(), strict=True)
    ]
    index = {"scheme": "`{scheme}`", "balance": "{balance}", "push": "{push}"}
    return pivoted(rows, index, "{density:g} /m²", "{reached}, {speed:.1f} m/s, {force:.0f} N")


def frozen(source: Source) -> Grid:
    """One row a variant of Lin's room: how many draws block at each multiple of v*, and where half of them do."""
    names = {"friction of people": "friction:g", "A, N": "A, N:g", "φ": "phi:g", "v*, m/s": "v*, m/s:.2f"}
    columns = {head: "{{more[{}]:{}}}".format(*name.split(":")) for head, name in names.items()}
    for at in ("blocked at 1.2 v*", "blocked at 1.4 v*"):
        columns[at] = f"{{more[{at}]}} of {{more[draws]}} ({{more[{at}, least share]:%}} to {{more[{at}, most]:%}} %)"
    columns["half block at"] = "{more[half block at, v*]:.2f} v* = {more[half block at, m/s]:.2f} m/s"
    return grid(source.rows("frozen"), **columns)


def strategies(source: Source) -> Grid:
    """One row a strategy and scheme, beside the shortest way on the same draws."""
    line = "--scenario two-exit-hall-v0 --policies shortest fastest comfortable nearest"
    found = source(f"crowd_env evaluate {line} --physics dem nsm1 nsm2 nsm2-printed hertz --runs 20")["rows"]
    by = "minus_first[evacuation_time][ci95]"
    return grid(map(_left, found), **{
        "route": "{policy}", "scheme": "`{scheme}`", "last person out, s": "{median_time:.1f}",
        "beside the shortest, s": f"{{{by}[0]:+.1f}} to {{{by}[1]:+.1f}}", "left inside": "{left}",
    })  # fmt: skip


def controller(source: Source) -> Grid:
    """One row a controller of Routing-v0, the learned one last."""
    by = "learned_minus_this[last]"
    return grid(map(_left, source.read("results.json")["rows"]), **{
        "": "{policy}", "last person, s": "{last[mean]:.1f}",
        "learned minus this": f"{{{by}[mean]:+.1f}} ({{{by}[ci95][0]:+.1f}} to {{{by}[ci95][1]:+.1f}})",
        "mean, s": "{mean[mean]:.1f}", "left inside": "{left}",
    })  # fmt: skip


def training(source: Source) -> Grid:
    """One row a policy."""
    return grid(source.read("results.json")["rows"], **{
        "policy": "`{policy}`", "starts from": "{starts_from}",
        "exits blocked (Wilson interval)": "{blocked} of {runs} (" + _BLOCKED + ")",
        "last person out, of the runs that ended, s": _INTERVAL("clearing_time"), "mean exit time, s": _INTERVAL("mean_exit"),
        "flow, 1/s": "{flow:.2f}", "contact impulse, N s per person": "{contact_impulse[mean]:.0f}",
        "worst pressure, kN/m": "{max_pressure[mean]:k}", "above 1600 N/m": "{crushed_share[mean]:%} %",
        "for, s": "{crushed_time[mean]:.1f}",
    })  # fmt: skip


def plans(source: Source) -> Grid:
    """One row a policy in generated places, and one for the best rule of each of them in hindsight."""
    return grid(source.read("rows.json")["rows"], **{
        "policy": "`{policy}`", "places": "{plans}", "somebody left inside": "{left_in}", "elsewhere": "{elsewhere}",
        "all out, as meant": "{out:.1%}", "interval": "{out_interval[0]:%} to {out_interval[1]:%} %",
        "last person, interquartile mean, s": "{time:.1f}", "of that of the best rule": "{over_hindsight:.2f}",
        "somebody above 1.6 kN/m": "{pressed:%} %", "greatest pressure, median, kN/m": "{median_pressure:k}",
    })  # fmt: skip


def algorithms(source: Source) -> Grid:
    """One row an algorithm or a policy beside it, as the command prints them."""
    head, _, *rows = (source.folder / "table.md").read_text(encoding="utf-8").splitlines()
    return [line[2:-2].split(" | ") for line in (head, *rows)]


def scenarios(source: Source) -> Grid:
    """One row a scenario in which arches hold, one column a scheme: 100 runs each."""
    rows = [
        {"place": place, **_room(source, scheme, place=place, runs=100)}
        for place in ("two-exit-hall-v0", "pillar-v0")
        for scheme in ("dem", "nsm1", "nsm2", "nsm2-printed")
    ]
    return pivoted(rows, {"runs with people left inside": "`{place}`"}, "`{scheme}`", "{left}")


def bodies(source: Source) -> Grid:
    """The flow through the door of Table 5 for other bodies and other hurry, 50 draws each."""
    # Shoulders of 30 to 38 cm are those of children; 1 to 1.4 m/s is a walk, and 1.2 to 2 m/s the hurry of Table 4.
    kinds = {
        "Table 4: 0.2 to 0.25 m, 1.2 to 2 m/s": "",
        "pupils: 0.15 to 0.19 m, 1.2 to 2 m/s": " --set radius=0.15,0.19",
        "adults who walk: 0.2 to 0.25 m, 1 to 1.4 m/s": " --set speed=1,1.4",
        "pupils who walk: 0.15 to 0.19 m, 1 to 1.4 m/s": " --set radius=0.15,0.19 --set speed=1,1.4",
    }
    rows = [
        {"kind": kind, **_room(source, scheme, options)}
        for kind, options in kinds.items()
        for scheme in ("dem", "nsm1", "nsm2", "nsm2-printed")
    ]
    return pivoted(rows, {"flow, 1/s": "{kind}"}, "`{scheme}`", _FLOW)


def _report(source: Source, line: str) -> dict[str, Any]:
    """Return the rows of a table or figure of a paper by their quantities."""
    return {row["quantity"]: row for row in source(f"crowd_env reproduce {line}")["rows"]}


def theatre(source: Source) -> Grid:
    """Return Table 7: the exercise, the paper's simulation, ours with and without rules, and what the rules change."""
    found, change = _report(source, "table7"), ": rules change it by"
    rows = [
        {"of": f"{who}, {kind}, s", "exercise": exercise, "paper": simulation, "here": found[name],
         "free": found[f"{name}, no rules"], "change": found[name + change]}
        for name, (exercise, simulation) in TIMES.items()
        for kind, who in (name.split(", "),)
    ]  # fmt: skip
    return grid(rows, **{
        "of": "{of}", "exercise": "{exercise}", "paper's simulation": "{paper}", "here": "{here[here]:.1f}",
        "without rules": "{free[here]:.1f}",
        "the rules change it by (paired, 95 %)": "{change[here]:+.2f} ({change[ci95][0]:.2f} to {change[ci95][1]:.2f})",
    })  # fmt: skip


def variants(source: Source) -> Grid:
    """Return the flows of Table 5 with other readings of the room, and in how many runs people were left inside."""
    changes = [
        "door_width=0.78",
        "door_width=0.86",
        "door_width=0.9",
        "target=centre",
        "target=nearest",
        "target=width",
    ]
    changes += ["side=8", "dt=0.005", "dt=0.001 --set stiffness=1.2e6", "stiffness=1.2e4", "k_normal=80"]
    rows = [{"options": "(none)", "r": _report(source, "table5")}]
    for options in (*(f"--set {change}" for change in changes), "--seed 50"):
        rows.append({"options": f"`{options}`", "r": _report(source, f"table5 {options}")})
    flows = {f"`{scheme}`": f"{{r[flow, {scheme}, per run][here]:.2f}}" for scheme in FLOWS}
    stuck = "/".join(f"{{r[unfinished, {scheme}][here]}}" for scheme in FLOWS)
    order = "{r[draws with nsm1 > dem > nsm2-printed][here]:.2f}"
    found = grid(rows, options="{options}", **flows, order=order, stuck=stuck)
    return [*found, ["the paper", *FLOWS.values(), "–", "–"]]


def clearance(source: Source) -> Grid:
    """Return the median clearance times of 200 and 300 people by their desired speed, and how many draws blocked."""
    rows = []
    for people, name in ((200, "lin-fig7"), (300, "lin-fig8")):
        found, crowd = _report(source, name), f"{people} people (`{name}`)"
        for speed in (key.removeprefix("blocked, ") for key in found if key.startswith("blocked, ")):
            figures = {"time": found[f"clearance, {speed}"], "blocked": found[f"blocked, {speed}"]}
            rows.append({"crowd": crowd, "speed": speed, **figures})
    return pivoted(rows, {"desired speed": "{crowd}"}, "{speed}", "{time[here]:.0f} b{blocked[here]}")


def flows(source: Source) -> Grid:
    """Return the mean flows of Figure 10 by the number of people and their desired speed, as the report reads them."""
    found = [row | dict(zip(("people", "speed"), name.removeprefix("flow, ").split(" at "), strict=True))
             for name, row in _report(source, "lin-fig10").items() if name.startswith("flow, ") and " at " in name]  # fmt: skip
    return pivoted(found, {"desired speed": "{people} people"}, "{speed}", "{here:.2f}; {reading}")


def dilemma(source: Source) -> Grid:
    """One row a crowd: when it is out, what it costs if all push instead, and what one gains who deviates."""
    gains = {f"one who {head} gains, s": _INTERVAL(f"gain[{who}]") + " ({gain[" + who + "][share]:%} %)"
             for head, who in (("pushes", "push"), ("queues", "queue"), ("learns to", "learned"))}  # fmt: skip
    return grid(source.read("results.json")["rows"], **{
        "crowd": "{crowd}", "mean exit, s": _INTERVAL("mean_exit"), "last exit, s": _INTERVAL("last_exit"),
        "blocked": "{blocked} of {runs}", "impulse, N s": "{contact_impulse[mean]:.0f}",
        "price of anarchy, mean and last exit": "{price[mean_exit]:.2f}, {price[last_exit]:.2f}", **gains,
    })  # fmt: skip


def dilemma_shares(source: Source) -> Grid:
    """One row a share of pushers in a queue: when these are out, and when the others."""
    return grid(source.read("results.json")["shares"], **{
        "push": "{pushers:%} %", "blocked": "{blocked} of {runs}",
        "who pushes is out after, s": _INTERVAL("mean_exit_deviators"), "who follows, s": _INTERVAL("mean_exit_others"),
        "last exit, s": _INTERVAL("last_exit"), "price that deters, s per m/s": "{deterrent:.1f}",
    })  # fmt: skip


def _of_tasks(make: Callable[[], Grid]) -> Callable[[Source], Grid]:
    return lambda source: make()


_OF_CASES = (schemes, halls, jambs, bodies_gate, bodies_doors, clogging, frozen, standing, measured, criteria)
_OF_POLICIES = (strategies, controller, training, seeds, plans, algorithms, dilemma, dilemma_shares)
_OF_ROOMS = (scenarios, bodies, theatre, variants, clearance, flows)
# Name of the table -> what makes it; made_by.csv says by which command its figures are measured.
MAKERS: dict[str, Callable[[Source], Grid]] = {
    **{one.__name__.replace("_", "-"): one for one in (*_OF_CASES, *_OF_POLICIES, *_OF_ROOMS)},
    "full-speed": lambda source: measured(source, "gate", "doors", manner="competitive"),
    "map": lambda source: passed(read_table("measured")),
    **{name: _of_tasks(make) for name, make in task_tables.MAKERS.items()},
}


def make(names: Iterable[str], source: Source) -> None:
    """Make tables anew; ValueError if one is unknown, a command fails or a finished run is missing: it stays as it was then."""
    commands = {name: (command, note) for name, command, note in read_table(MADE_BY)[1:]}
    for name in names:
        write_table(name, MAKERS[known("table", name, MAKERS)](source), *commands[name])
        if name in ("measured", "criteria"):
            write_limits()
