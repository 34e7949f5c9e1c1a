"""The validation map as tables of docs/validation.md: what passes under which scheme and manner, and the figures behind it."""

from typing import TYPE_CHECKING, Any

from validation.cases.case import COMPARED
from validation.cases.doors import JUDGED, MEAN
from validation.cases.gate import FLOW

if TYPE_CHECKING:
    from validation.pages import Sources

Rows = list[dict[str, Any]]

_ONE_ROW = ("gate", "doors", "corridor", "ring", "counterflow", "crossing", "corner", "faster", "clogging", "row")
CASES = (*_ONE_ROW, "standards")
# What the second paper prints stands beside what this package makes of it.
SCHEMES = (*COMPARED, "hertz-literal")
_SAID = {True: "yes", False: "**no**", None: "–"}
_OUTCOME = {True: "yes", False: "no", None: "reported"}

FULL_SPEED = "competitive"
FULL_SPEED_HEAD = ("case", "scheme", "figures")
PASSED_HEAD = ("case or test", "manner", *(f"`{scheme}`" for scheme in SCHEMES))
FIGURES_HEAD = ("case or test", "manner", "scheme", "passed", "figures")


def passed(source: "Sources") -> list[list[str]]:
    """One row a case or test and manner, one column a scheme."""
    found: dict[tuple[str, str], dict[str, str]] = {}
    for row in _sorted(source):
        found.setdefault((row["case"], row["manner"]), {})[row["scheme"]] = _SAID[row["passed"]]
    return [
        [f"`{case}`", manner, *(cells.get(scheme, "") for scheme in SCHEMES)] for (case, manner), cells in found.items()
    ]


def criteria(source: "Sources") -> str:
    """Say what each case and test asks for, and which tests are not supported."""
    asked = _asked(source)
    made = {case: f"`{case}`, {source.draws(case)}" for case in _ONE_ROW if case in asked}
    lines = [f"* {made.get(case, f'`{case}`')}: {text}" for case, text in asked.items()]
    lines += [f"* Not supported, {text}" for text in _not_supported(source)]
    lines += [f"* `{case}` was not run for this table." for case in CASES if not _read(source, case)]
    return "\n".join(lines)


def as_data(source: "Sources") -> dict[str, Any]:
    """Return the same for reports: of each case and test what it asks for, and what came out by manner and scheme."""
    results: dict[str, dict[str, dict[str, str]]] = {}
    for row in _sorted(source):
        results.setdefault(row["case"], {}).setdefault(row["manner"], {})[row["scheme"]] = _OUTCOME[row["passed"]]
    cases = []
    for case, text in _asked(source).items():
        of_manner = {
            manner: {scheme: of_scheme[scheme] for scheme in SCHEMES if scheme in of_scheme}
            for manner, of_scheme in results[case].items()
        }
        cases.append({"case": case, "criterion": text, "results": of_manner})
    return {"cases": cases, "not_supported": _not_supported(source)}


def figures(source: "Sources") -> list[list[str]]:
    """One row a case or test, manner and scheme."""
    return [
        [f"`{row['case']}`", row["manner"], f"`{row['scheme']}`", _SAID[row["passed"]], row["figure"]]
        for row in _sorted(source)
    ]


def full_speed(source: "Sources") -> list[list[str]]:
    """One row a case and scheme: the two cases that recordings are nearest to, with people who keep no distance."""
    return [[f"`{row['case']}`", f"`{row['scheme']}`", row["figure"]] for row in _pressing(source)]


def full_speed_note(source: "Sources") -> str:
    """Say how much faster they are than people in experiments, and how often they get stuck."""
    rows = _pressing(source)
    at_doors = [
        (one["flow"], one["stuck"])
        for row in rows
        if row["case"] == "doors"
        for width, one in row["more"]["widths"].items()
        if float(width) in JUDGED
    ]
    flows = [flow for flow, _ in at_doors if flow is not None]
    gates = [row["more"] for row in rows if row["case"] == "gate"]
    stuck, runs = (sum(counts) for counts in zip(*((one["stuck"], len(one["passages"])) for one in gates), strict=True))
    through = [one["flow"] for one in gates if one["flow"] is not None]
    flow = " to ".join(dict.fromkeys(f"{one:.2f}" for one in (min(through), max(through)))) if through else ""
    passed = f"{flow} /s pass in the others" if through else "all get stuck"
    return (
        f"{source.draws('gate')} of the gate and {source.draws('doors')} of the doors. Through doors of {JUDGED[0]:g} to "
        f"{JUDGED[-1]:g} m {min(flows):.1f} to {max(flows):.1f} people pass a meter and second, where the published mean is "
        f"{MEAN:g}: {min(flows) / MEAN:.1f} to {max(flows) / MEAN:.1f} times as many. The gate blocks in {stuck} of {runs} "
        f"runs; {passed}, where {FLOW:g} /s were recorded."
    )


def _pressing(source: "Sources") -> Rows:
    rows = [row for case in ("gate", "doors") for row in source.rows(case) if row["manner"] == FULL_SPEED]
    return sorted(rows, key=lambda row: (("gate", "doors").index(row["case"]), SCHEMES.index(row["scheme"])))


def _asked(source: "Sources") -> dict[str, str]:
    return {row["case"]: f"{row['criterion']} ({row['source']})." for row in _sorted(source)}


def _not_supported(source: "Sources") -> list[str]:
    rows = [row for row in _read(source, "standards") if row["case"] == "not supported"]
    return list({row["source"]: f"{row['source']}: {row['figure']}." for row in rows}.values())


def _sorted(source: "Sources") -> Rows:
    """Return all rows by case or test, then by manner, each in the order in which they come."""
    rows = _cases(source) + _tests(source)
    cases, manners = (list(dict.fromkeys(row[key] for row in rows)) for key in ("case", "manner"))
    return sorted(rows, key=lambda row: (cases.index(row["case"]), manners.index(row["manner"])))


def _cases(source: "Sources") -> Rows:
    return [row for case in _ONE_ROW for row in _read(source, case)]


def _tests(source: "Sources") -> Rows:
    return [row for row in _read(source, "standards") if row["case"] != "not supported"]


def _read(source: "Sources", case: str) -> Rows:
    """Return the rows of a case; none if the finished run holds the gate, the first one, but not this one."""
    return source.rows(case) if case == _ONE_ROW[0] or source.path(case).exists() else []
