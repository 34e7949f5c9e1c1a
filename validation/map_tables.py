"""The validation map as tables of docs/validation.md: what passes under which scheme and manner, and the figures behind it."""

from typing import TYPE_CHECKING, Any

from validation.cases.case import COMPARED

if TYPE_CHECKING:
    from validation.pages import Sources

Rows = list[dict[str, Any]]

_ONE_ROW = ("gate", "doors", "corridor", "ring", "counterflow", "crossing", "corner", "faster", "clogging", "row")
CASES = (*_ONE_ROW, "standards")
# What the second paper prints stands beside what this package makes of it.
SCHEMES = (*COMPARED, "hertz-literal")
_SAID = {True: "yes", False: "**no**", None: "–"}
_OUTCOME = {True: "yes", False: "no", None: "reported"}

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
