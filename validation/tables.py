"""The tables of docs/tables/: rows from commands or finished runs, laid out as tables.toml says.

``source(LINE)`` is what ``python -m LINE --json`` prints; ``source.read(FILE)`` and ``source.rows(CASE)`` are of the folder
that --from names.  Verdicts of the table ``lin`` are written by hand, beside what ``crowd-env reproduce`` prints.
"""

from collections.abc import Callable, Iterable
from typing import Any

from crowd_env import SCHEMES
from crowd_env.core.checks import Plain, known
from crowd_env.reproduce.pecol2011.room import PRINTED as FLOWS
from crowd_env.reproduce.pecol2011.theatre import PRINTED as TIMES
from crowd_env.scenarios.profiles import PROFILES, speed_words
from validation import facts, task_tables
from validation.cases.case import DISC, share
from validation.cases.standing import DENSITIES
from validation.map import criteria, measured, of_all, passed, standards, write_limits
from validation.pages import MADE_BY, Grid, Rows, grid, laid_out, read_table, write_table
from validation.seeds import seeds
from validation.sources import Source

_SCHEMES = ("dem", "nsm1", "nsm2", "nsm2-printed")  # of tables that compare rooms


def _room(source: Source, scheme: str, options: str = "", place: str = "room-v0", runs: int = 50) -> Plain:
    return _left({"scheme": scheme, **source(f"crowd_env run {place} --scheme {scheme}{options} --runs {runs}")})


def _left(row: Plain) -> Plain:
    """Return a row that says how many people were left inside."""
    left = f"{row['unfinished']} people in {row['unfinished_runs']} of {row['runs']} runs"
    return {**row, "left": left if row["unfinished"] else "nobody"}


def schemes(source: Source) -> Rows:
    """One row a scheme at its own step, and for three of them shorter steps."""
    shorter = {"dem": (0.001,), "nsm2": (0.005, 0.0025, 0.001), "nsm2-printed": (0.001,)}
    return [
        {**_room(source, scheme, f" --set dt={dt:g}" if dt else ""), "step": dt or SCHEMES[scheme].info.default_dt}
        for scheme in SCHEMES
        for dt in (None, *shorter.get(scheme, ()))
    ]


def halls(source: Source) -> Rows:
    """One row a scheme: how many were outside of the plan, and the largest speed in the halls of each size."""
    found: dict[str, list[dict[str, Any]]] = {}
    for row in source.rows("halls", "great-halls"):
        found.setdefault(row["scheme"], []).append(row["more"])
    for scheme, some in found.items():
        fastest = {n: max(one["fastest, m/s"] for one in some if one["people"] == n) for n in (500, 1000, 2000, 5000)}
        outside, overlap = sum(one["outside"] for one in some), max(one["overlap, mm"] for one in some)
        yield {"scheme": scheme, "outside": outside or "nobody", "fastest": fastest, "overlap": overlap}


def _shapes(source: Source, case: str) -> Rows:
    """Return the rows of a case under `hertz`, of discs and of torsos."""
    for outline, name in ((DISC, "discs"), ("torso", "torsos")):
        rows = source.rows(case, outline=outline)
        yield from ({**row, "bodies": name} for row in rows if row["scheme"] == "hertz")


def bodies_gate(source: Source) -> Rows:
    """One row a shape and manner: the flow of the runs that were not stuck, and how many were."""
    for row in _shapes(source, "gate"):
        more = row["more"]
        yield {**row, **more, "share": share(more["stuck"], len(more["passages"]))}


def bodies_doors(source: Source) -> Rows:
    """One row a shape, manner and door: the flow per meter of the runs that were not stuck."""
    for row in _shapes(source, "doors"):
        for width, one in row["more"]["widths"].items():
            lost = f", {one['stuck']} of {len(one['runs'])} stuck" if one["stuck"] else ""
            yield {**row, **one, "width": width, "lost": lost}


def clogging(source: Source) -> Rows:
    """One row a desired speed."""
    return [{"speed": v, **source(f"crowd_env clogging {source.folder / v}")["sets"][0]} for v in ("1.0", "1.5", "1.8")]


def standing(source: Source) -> Rows:
    """One row a scheme, balance, push and density: how many are reached, how fast, the force at a wall."""
    for row in source.rows("standing"):
        for balance, found in row["more"].items():
            for name in (name for name in found if name.startswith("push ")):
                for density, *wave in zip(DENSITIES, *found[name].values(), strict=True):
                    figures = dict(zip(("reached", "speed", "force"), wave, strict=True))
                    yield {**row, **figures, "balance": balance, "push": name[5:], "density": density}


def strategies(source: Source) -> Rows:
    """One row a strategy and scheme, beside the shortest way on the same draws."""
    line = "--scenario two-exit-hall-v0 --policies shortest fastest comfortable nearest"
    found = source(f"crowd_env evaluate {line} --scheme dem nsm1 nsm2 nsm2-printed hertz --runs 20")
    return map(_left, found["rows"])


def fastest(source: Source) -> Rows:
    """One row a place and number of people: the fastest beside the shortest way, of hurried people."""
    places = (("two-exit-hall-v0", 60), ("two-exit-hall-v0", 150), ("examples/office.dxf", 100), ("bottleneck-v0", 60))
    for place, people in places:
        line = f"crowd_env evaluate --scenario {place} --people {people} --walking hurried --policies shortest fastest"
        (row,) = (row for row in source(f"{line} --scheme dem --runs 12")["rows"] if row["policy"] == "fastest")
        yield {"place": place, "people": people, **_left(row)}


def algorithms(source: Source) -> Grid:
    """One row an algorithm or a policy beside it, as the command prints them."""
    head, _, *rows = (source.folder / "table.md").read_text(encoding="utf-8").splitlines()
    return [line[2:-2].split(" | ") for line in (head, *rows)]


def backgrounds(source: Source) -> Rows:
    """One row a policy and background: the mean exit of the people that the policy moves, and how many runs blocked."""
    for row in source.read("results.json")["backgrounds"]:
        for others, told in _BACKGROUNDS.items():
            yield {"crowd": row["crowd"], "others": told, **row[others]}


_BACKGROUNDS = {
    "push": "full speed, as in training",
    "follow": "`follow`",
    "headway": "`headway`",
    "random": "random speed",
    "learned": "PPO's best response to full speed",
}


def scenarios(source: Source) -> Rows:
    """One row a scenario in which arches hold and a scheme: 100 runs each."""
    for place in ("two-exit-hall-v0", "pillar-v0"):
        for scheme in _SCHEMES:
            yield {"place": place, **_room(source, scheme, place=place, runs=100)}


def bodies(source: Source) -> Rows:
    """The flow through the door of Table 5 for other bodies and other hurry, 50 draws each."""
    # Shoulders of 30 to 38 cm are those of children; 1 to 1.4 m/s is a walk, and 1.2 to 2 m/s the hurry of Table 4.
    kinds = {
        "Table 4: 0.2 to 0.25 m, 1.2 to 2 m/s": "",
        "pupils: 0.15 to 0.19 m, 1.2 to 2 m/s": " --set radius=0.15,0.19",
        "adults who walk: 0.2 to 0.25 m, 1 to 1.4 m/s": " --set speed=1,1.4",
        "pupils who walk: 0.15 to 0.19 m, 1 to 1.4 m/s": " --set radius=0.15,0.19 --set speed=1,1.4",
    }
    for kind, options in kinds.items():
        for scheme in _SCHEMES:
            yield {"kind": kind, **_room(source, scheme, options)}


def _report(source: Source, line: str) -> Plain:
    """Return the rows of a table or figure of a paper by their quantities."""
    return {row["quantity"]: row for row in source(f"crowd_env reproduce {line}")["rows"]}


def theatre(source: Source) -> Rows:
    """Return Table 7: the exercise, the paper's simulation, ours with and without rules, and what the rules change."""
    found = _report(source, "table7")
    for name, (exercise, simulation) in TIMES.items():
        kind, who = name.split(", ")
        ours = {"here": found[name], "free": found[f"{name}, no rules"], "change": found[f"{name}: rules change it by"]}
        yield {"of": f"{who}, {kind}, s", "exercise": exercise, "paper": simulation, **ours}


def variants(source: Source) -> Grid:
    """Return the flows of Table 5 with other readings of the room, and in how many runs people were left inside."""
    changes = (
        *("door_width=0.78", "door_width=0.86", "door_width=0.9", "target=centre", "target=nearest", "target=width"),
        *("side=8", "dt=0.005", "dt=0.001 --set stiffness=1.2e6", "stiffness=1.2e4", "k_normal=80"),
    )
    rows = [{"options": "(none)", "r": _report(source, "table5")}]
    for options in (*(f"--set {change}" for change in changes), "--seed 50"):
        rows.append({"options": f"`{options}`", "r": _report(source, f"table5 {options}")})
    flows = {f"`{scheme}`": f"{{r[flow, {scheme}, per run][here]:.2f}}" for scheme in FLOWS}
    stuck = "/".join(f"{{r[unfinished, {scheme}][here]}}" for scheme in FLOWS)
    order = "{r[draws with nsm1 > dem > nsm2-printed][here]:.2f}"
    found = grid(rows, options="{options}", **flows, order=order, stuck=stuck)
    return [*found, ["the paper", *FLOWS.values(), "–", "–"]]


def clearance(source: Source) -> Rows:
    """Return the median clearance times of 200 and 300 people by their desired speed, and how many draws blocked."""
    for people, name in ((200, "lin-fig7"), (300, "lin-fig8")):
        found = _report(source, name)
        for speed in (key.removeprefix("blocked, ") for key in found if key.startswith("blocked, ")):
            figures = {"time": found[f"clearance, {speed}"], "blocked": found[f"blocked, {speed}"]}
            yield {"crowd": f"{people} people (`{name}`)", "speed": speed, **figures}


def flows(source: Source) -> Rows:
    """Return the mean flows of Figure 10 by the number of people and their desired speed, as the report reads them."""
    for name, row in _report(source, "lin-fig10").items():
        if name.startswith("flow, ") and " at " in name:
            people, speed = name.removeprefix("flow, ").split(" at ")
            yield {**row, "people": people, "speed": speed}


def faster(source: Source) -> Rows:
    """Return the median leaving time by law and desired speed, with its interval, or how many draws blocked."""
    for name, row in _report(source, "faster-is-slower").items():
        kind, _, rest = name.partition(", ")
        law, _, speed = rest.rpartition(", ")
        if kind == "time":
            middle, spread, blocked = row["here"], row["ci95"], row["reading"].partition(", ")[2]
            median = [f"{middle:.0f}" + (f" ({spread[0]:.0f} to {spread[1]:.0f})" if spread else "")] if middle else []
            yield {"law": law, "speed": speed, "cell": ", ".join([*median, *filter(None, [blocked])])}
        elif kind == "pressed" and law == "helbing":
            yield {"law": "`helbing`: people beyond 1600 N/m", "speed": speed, "cell": f"{row['here']:.0f}"}


def stair_drill(source: Source) -> Rows:
    """Return when the 25th, 50th ... person is out by law and speeds on stairs, below the observed ones; how many are near."""
    found = [(*name.partition(", ")[::2], row) for name, row in _report(source, "stair-drill").items()]
    for what, law, row in found:
        if law == "dem, SFPE" and row["unit"] != "1":
            yield {"law": "observed", "what": what, "cell": f"{row['paper']:g}"}
    for what, law, row in found:
        if law:
            near = f"{row['here']} of {row['paper']:g}"
            cells = {"1": near, "s": f"{row['here']:.0f}", "1/s": f"{row['here']:.2f}"}
            yield {"law": law, "what": what, "cell": cells[row["unit"]]}


# Table -> the rows that tables.toml lays out; made_by.csv says by which command their figures are measured.
_ROWS: dict[str, Callable[[Source], Rows]] = {
    "schemes": schemes,
    "halls": halls,
    "jambs": lambda source: source.rows("jambs"),
    "bodies-gate": bodies_gate,
    "bodies-doors": bodies_doors,
    "clogging": clogging,
    "frozen": lambda source: source.rows("frozen"),
    "standing": standing,
    "measured": measured,
    "full-speed": lambda source: measured(source, "gate", "doors", manner="competitive"),
    "criteria": criteria,
    "standard-tests": lambda source: measured(source, "standards"),
    "standard-criteria": lambda source: criteria(source, "standards"),
    "strategies": strategies,
    "controller": lambda source: map(_left, source.read("results.json")["rows"]),
    "training": lambda source: source.read("results.json")["rows"],
    "seeds": seeds,
    "plans": lambda source: source.read("rows.json")["rows"],
    "dilemma": lambda source: source.read("results.json")["rows"],
    "dilemma-shares": lambda source: source.read("results.json")["shares"],
    "dilemma-backgrounds": backgrounds,
    "scenarios": scenarios,
    "profiles": lambda _: (
        {"name": name, **one._asdict(), "speed": speed_words(one)} for name, one in PROFILES.items()
    ),
    "bodies": bodies,
    "theatre": theatre,
    "clearance": clearance,
    "flows": flows,
    "faster": faster,
    "stair-drill": stair_drill,
    "tasks": lambda _: task_tables.tasks(),
    "task-facts": lambda _: task_tables.tasks(),
    "task-presets": lambda _: task_tables.presets(),
    "task-floors": lambda _: task_tables.floors(),
    "tiers": lambda _: task_tables.tiers(),
    "submissions": lambda _: task_tables.submissions(),
    "variations": lambda _: task_tables.varied(),
    "cards": lambda _: task_tables.cards(),
    "facts": lambda _: facts.facts(),
    "fastest": fastest,
}


def _maker(name: str, rows: Callable[[Source], Rows]) -> Callable[[Source], Grid]:
    return lambda source: laid_out(name, rows(source))


MAKERS: dict[str, Callable[[Source], Grid]] = {
    **{name: _maker(name, rows) for name, rows in _ROWS.items()},
    "algorithms": algorithms,
    "variants": variants,
    "map": lambda source: passed(read_table("measured")),
    "standards": lambda source: standards(of_all("standard-tests", "measured")),
}


def make(names: Iterable[str], source: Source) -> None:
    """Write tables; a table that cannot be made stays as it was.

    Raises
    ------
    ValueError
        If a table is unknown, a command fails or a finished run is missing.
    """
    commands = {name: (command, note) for name, command, note in read_table(MADE_BY)[1:]}
    for name in names:
        write_table(name, MAKERS[known("table", name, MAKERS)](source), *commands[name])
    if not {"measured", "criteria", "standard-tests", "standard-criteria"}.isdisjoint(names):
        write_limits()
