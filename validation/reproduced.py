"""The cells of the tables of docs/reproduce.md: figures from what ``crowd-env reproduce NAME --json`` prints and writes.

``source(LINE)`` is what ``python -m LINE --json`` prints; of a folder that --from names, its files NAME.json are taken instead.
"""

import re
from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

from crowd_env.reproduce.pecol2011.evacuations import PRINTED as FLOWS
from crowd_env.reproduce.pecol2011.theatre import IMPLIED, PRINTED, ROUTES

if TYPE_CHECKING:
    from validation.pages import Sources

Cells = list[list[str]]

_CLOSE = 0.10
_DRAWS = 10  # of the page
_VARIANTS = (
    "",
    *(f"--set door_width={width}" for width in (0.78, 0.86, 0.9)),
    *(f"--set target={target}" for target in ("centre", "nearest", "width")),
    *(f"--set exit_line={line}" for line in (-0.1, 1)),
    "--set side=8",
    "--set dt=0.005",
    "--set dt=0.001 --set stiffness=1.2e6",
    "--set stiffness=1.2e4",
    "--set k_normal=80",
    "--seed 50",
)
_SCHEMES = ("dem", "nsm1", "nsm2", "nsm2-printed")
# Shoulders of 30 to 38 cm are those of children; 1 to 1.4 m/s is a walk, and 1.2 to 2 m/s the hurry of Table 4.
_BODIES = {
    "Table 4: 0.2 to 0.25 m, 1.2 to 2 m/s": "",
    "pupils: 0.15 to 0.19 m, 1.2 to 2 m/s": " --radius 0.15,0.19",
    "adults who walk: 0.2 to 0.25 m, 1 to 1.4 m/s": " --speed 1,1.4",
    "pupils who walk: 0.15 to 0.19 m, 1 to 1.4 m/s": " --radius 0.15,0.19 --speed 1,1.4",
}
_SPEEDS = ("0.6", "0.8", "1.0", "1.2", "1.4", "1.6", "1.8", "2.0", "2.2")  # m/s


def _report(source: "Sources", line: str) -> dict[str, Any]:
    """Return what comes of a table or figure of a paper, whose name may be followed by options."""
    if source.folder is not None:
        return dict(source.read(f"{line}.json"))
    return source(f"crowd_env reproduce {line}")


def _rows(source: "Sources", line: str) -> dict[str, dict[str, Any]]:
    return {row["quantity"]: row for row in _report(source, line)["rows"]}


def _signed(value: float, digits: int) -> str:
    return f"{value:+.{digits}f}".replace("-", "−")


def theatre(source: "Sources") -> Cells:
    """Return Table 7: the exercise, the paper's simulation, ours with and without rules, and what the rules change."""
    rows, cells = _rows(source, "table7"), []
    for name, (exercise, simulation) in PRINTED.items():
        kind, who = name.split(", ")
        here, free = (rows[key]["here"] for key in (name, f"{name}, no rules"))
        shown = "–" if here is None else f"{here:.1f}"
        if here is None or abs(here / float(exercise) - 1.0) > _CLOSE:
            shown = f"**{shown}**"
        change = rows[f"{name}: rules change it by"]
        by = "–" if change["here"] is None else _signed(change["here"], 2)
        if change["ci95"] is not None:
            by += " ({} to {})".format(*(f"{end:.2f}".replace("-", "−") for end in change["ci95"]))
        cells.append([f"{who}, {kind}, s", exercise, simulation, shown, "–" if free is None else f"{free:.1f}", by])
    people = [f"people by {route}" for route in ROUTES]
    implied = [" / ".join(str(IMPLIED[name][k]) for name in people) for k in range(2)]
    ours = [" / ".join(f"{rows[name + of]['here']:.1f}" for name in people) for of in ("", ", no rules")]
    changes = " / ".join(_signed(rows[f"{name}: rules change it by"]["here"], 2) for name in people)
    return [*cells, ["people by A / B (implied by the means)", *implied, *ours, changes]]


def variants(source: "Sources") -> Cells:
    """Return the flows of Table 5 with other readings of the room, and in how many runs people were left inside."""
    cells = []
    for options in _VARIANTS:
        rows = _rows(source, f"table5 {options}".strip())
        flows = (rows[f"flow, {scheme}, per run"]["here"] for scheme in FLOWS)
        order = rows["draws with nsm1 > dem > nsm2-printed"]["here"]
        stuck = "/".join(str(rows[f"unfinished, {scheme}"]["here"]) for scheme in FLOWS)
        numbers = ["–" if value is None else f"{value:.2f}" for value in (*flows, order)]
        cells.append([f"`{options}`" if options else "(none)", *numbers, stuck])
    return [*cells, ["the paper", *FLOWS.values(), "–", "–"]]


class _Point(NamedTuple):
    """The draws of one configuration: the number of the paper's kind, and how many draws blocked."""

    value: float | None
    blocked: int
    draws: int

    @property
    def mostly_blocked(self) -> bool:
        return 2 * self.blocked >= self.draws

    def __str__(self) -> str:
        return ", ".join(text for text in ("" if self.value is None else f"{self.value:.0f} s", self.lost(0)) if text)

    def lost(self, least: int = 1) -> str:
        """Return "b2", or "b2/5" where the draws are not those of the page; "" below ``least``."""
        text = f"b{self.blocked}" + ("" if self.draws == _DRAWS else f"/{self.draws}")
        return text if self.blocked >= least or self.value is None else ""


def _clearance(source: "Sources", name: str) -> dict[str, _Point]:
    """Return the points of Figure 4, 5, 7 or 8 by the names of their rows."""
    rows = _rows(source, name)
    blocked = {key.removeprefix("blocked, "): row for key, row in rows.items() if key.startswith("blocked, ")}
    return {key: _Point(rows[f"clearance, {key}"]["here"], row["here"], row["n"]) for key, row in blocked.items()}


def clearance(source: "Sources") -> Cells:
    """Return the median clearance times of 200 and 300 people by their desired speed."""
    cells = []
    for people, name in ((200, "lin-fig7"), (300, "lin-fig8")):
        points = _clearance(source, name)
        found = (points.get(f"{speed} m/s") for speed in _SPEEDS)
        shown = ("" if one is None else " ".join([*_number(one.value, 0), one.lost()]).strip() for one in found)
        cells.append([f"{people} people (`{name}`)", *shown])
    return cells


def flows(source: "Sources") -> Cells:
    """Return the mean flows of Figure 10 by the number of people and their desired speed."""
    rows, cells = _rows(source, "lin-fig10"), []
    for people in (100, 200, 300):
        shown = []
        for speed in _SPEEDS[:-1]:
            row = rows[f"flow, {people} at {speed} m/s"]
            point = _Point(row["here"], *_counted(row["reading"]))
            shown.append(" ".join([*(_number(point.value, 2) or ["–"]), point.lost()]).strip())
        cells.append([f"{people} people", *shown])
    return cells


def _number(value: float | None, digits: int) -> list[str]:
    return [] if value is None else [f"{value:.{digits}f}"]


def _counted(reading: str) -> tuple[int, int]:
    """Return the two numbers of "2 of 10 blocked" in a reading."""
    found = re.search(r"(\w+) of (\d+) (?:runs )?blocked", reading)
    assert found is not None, reading
    return 0 if found[1] == "none" else int(found[1]), int(found[2])


def lin(source: "Sources") -> Cells:
    """Return what Lin, Ma, Lo print, what comes out, and whether it is the same."""
    return [*_figure_4(source), *_figure_5(source), *_figures_7_and_8(source), *_figures_9_and_10(source)]


def _near(value: float | None, other: float | None) -> bool:
    return value is not None and other is not None and abs(value / other - 1.0) <= _CLOSE


def _met(value: float | None, paper: float) -> str:
    if value is None:
        return "NOT reproduced"
    return f"{_signed(100 * (value / paper - 1), 0)} %" + ("" if _near(value, paper) else ", NOT to 10 %")


def _yes(met: bool) -> str:
    return "yes" if met else "NOT reproduced"


def _figure_4(source: "Sources") -> Cells:
    points = _clearance(source, "lin-fig4")
    weak, base, *strong = (points[f"A = {strength} N"] for strength in (200, 300, 400, 500))
    others = ", ".join("–" if one.value is None else f"{one.value:.0f}" for one in strong)
    barely = f"{others} s, b{sum(one.blocked for one in strong)}"
    same = all(_near(one.value, base.value) for one in strong)
    return [
        ["4", "100 people, 1 m/s, A = 200 N", "170 s", str(weak), _yes(_near(weak.value, 170.0))],
        ["4", "A = 300 N", "120 s", str(base), _yes(_near(base.value, 120.0))],
        ["4", "A = 400, 500 N", "barely differ from 300 N", barely, _yes(same)],
    ]


def _figure_5(source: "Sources") -> Cells:
    points = _clearance(source, "lin-fig5")
    pairs = [[points[f"{speed} m/s, {kind}"] for kind in ("rotation", "no rotation")] for speed in (1, 2)]
    (turning, rigid), (fast_turning, fast_rigid) = pairs
    same = _near(rigid.value, turning.value)
    slow = "in the times" if same and rigid.blocked > turning.blocked else _yes(same)
    fast = _yes(fast_rigid.blocked > fast_turning.blocked)
    printed = ("basically the same", "off: clogs more, barely recovers")
    return [
        ["5", f"{speed} m/s, rotation on, off", paper, f"{pair[0]}; {pair[1]}", verdict]
        for speed, paper, pair, verdict in zip((1, 2), printed, pairs, (slow, fast), strict=True)
    ]


def _figures_7_and_8(source: "Sources") -> Cells:
    few, many = (
        {speed: of[f"{speed} m/s"] for speed in _SPEEDS if f"{speed} m/s" in of}
        for of in (_clearance(source, name) for name in ("lin-fig7", "lin-fig8"))
    )
    mean = _rows(source, "lin-fig7")["clearance, 1.0 to 1.8 m/s"]["here"]
    course = [one.value for speed, one in few.items() if 1.0 <= float(speed) <= 1.8 and one.value is not None]
    falls = bool(course) and all(b < a for a, b in pairwise(course))
    span = f"from {course[0]:.0f} to {course[-1]:.0f} s" if course else "nothing cleared"
    trend = f"{'–' if mean is None else f'{mean:.0f} s'}; {'but it falls ' if falls else ''}{span}"
    met = "the mean only" if _near(mean, 220.0) and falls else _yes(_near(mean, 220.0))
    fast = [one for speed, one in few.items() if float(speed) >= 1.8]
    fitted = "yes (fitted)" if all(one.mostly_blocked for one in fast) else "NOT reproduced"
    known = [(speed, one.value) for speed, one in many.items() if one.value is not None]
    lowest = next((a for (a, x), (_, y) in pairwise(known) if y >= x), known[-1][0] if known else "–")
    lost = [f"{one.lost(0)} at {speed} m/s" for speed, one in many.items() if one.mostly_blocked]
    blocks = _yes(all(one.mostly_blocked for speed, one in many.items() if float(speed) >= 1.8))
    return [
        ["7", "200 people, 0.6 m/s", "340 s", str(few["0.6"]), _met(few["0.6"].value, 340.0)],
        ["7", "1.0 m/s", "210 s", str(few["1.0"]), _met(few["1.0"].value, 210.0)],
        ["7", "1.0 to 1.8 m/s, mean of those that cleared", "close to 220 s, no trend", trend, met],
        ["7", "1.8, 2.0, 2.2 m/s", "blocked", ", ".join(one.lost(0) for one in fast), fitted],
        ["8", "300 people", "consistent with 200", "; ".join([f"falls to {lowest} m/s", *lost]), blocks],
    ]


def _figures_9_and_10(source: "Sources") -> Cells:
    windows, flow = _rows(source, "lin-fig9"), _rows(source, "lin-fig10")
    ends = {name: row for name, row in windows.items() if row["paper"] is not None and row["here"] is not None}
    far = [name for name, row in ends.items() if abs(row["here"] - row["paper"]) > 0.2 + 1e-9]
    close = f"{len(ends) - len(far)} of {len(ends)} ends within 0.2 /s"
    low, mean, high = (flow[f"{what}, 1.0 to 1.6 m/s"]["here"] for what in ("lowest", "mean", "highest"))
    change = re.search(r"From 1.0 to 1.6 m/s .* changes by (\S+) %", "\n".join(_report(source, "lin-fig10")["remarks"]))
    spread = "–" if mean is None else f"{mean:.2f} /s, {low:.2f} to {high:.2f}"
    if change is not None:
        spread += f", {_signed(float(change[1]), 0)} % from 1.0 to 1.6 m/s"
    flat = _yes(change is not None and abs(float(change[1])) <= 5 and _near(mean, 0.82))
    fastest = flow["highest, above 1.6 m/s"]["here"]
    lost = "{} of {} draws blocked".format(*_counted(flow["blocked, above 1.6 m/s"]["reading"]))
    most = f"{'–' if fastest is None else f'{fastest:.2f} /s'}; {lost}"
    crowds, printed = (
        "10-second flows, 100 and 300 people, three groups of speeds",
        "0.4 to 0.6, 0.3 to 1.3, 0 to 1.6 /s",
    )
    return [
        ["9", crowds, printed, close, f"NOT: {', '.join(far)}" if far else "yes"],
        ["10", "mean flow, 1.0 to 1.6 m/s", "0.82 /s, 0.7 to 0.95, flat", spread, flat],
        ["10", "fastest above 1.6 m/s", "1.22 /s, down to zero", most, _yes(_near(fastest, 1.22))],
    ]


def bodies(source: "Sources") -> Cells:
    """Return the flow through the door of Table 5 for other bodies and other hurry, 50 draws each."""
    rows = []
    for label, options in _BODIES.items():
        flows = [source(f"crowd_env run room-v0 --scheme {scheme}{options} --runs 50")["flow"] for scheme in _SCHEMES]
        rows.append([label, *(f"{flow['mean']:.2f} ± {flow['sd']:.2f}" for flow in flows)])
    return rows


TABLES: dict[str, tuple[tuple[str, ...], Callable[["Sources"], Cells]]] = {
    "theatre": (
        ("of", "exercise", "paper's simulation", "here", "without rules", "the rules change it by (paired, 95 %)"),
        theatre,
    ),
    "bodies": (("flow, 1/s", *(f"`{scheme}`" for scheme in _SCHEMES)), bodies),
    "variants": (("options", *(f"`{scheme}`" for scheme in FLOWS), "order", "stuck"), variants),
    "lin": (("figure", "quantity", "paper", "here", "reproduced?"), lin),
    "clearance": (("desired speed, m/s", *_SPEEDS), clearance),
    "flows": (("desired speed, m/s", *_SPEEDS[:-1]), flows),
}
