"""The map: which case and test is passed under which manner and scheme, as tables of docs/, and as reports have it."""

import json

from crowd_env.core.checks import Plain
from crowd_env.core.files.atomic import write_text
from crowd_env.core.files.json_file import read_json
from validation.cases import CASES
from validation.cases.case import COMPARED
from validation.cases.standards import ROWS, TESTS, WHY
from validation.pages import ROOT, Grid, Rows, pivoted, read_table
from validation.sources import Source

LIMITS = ROOT / "crowd_env/rendering/report/page_parts/limits.json"
CASES_OF_MAP = tuple(
    name for name in CASES if name not in ("frozen", "jambs", "laws", "standing", "halls", "great-halls", "standards")
)
_SAID = {True: "yes", False: "**no**", None: "–"}
_OUTCOME = {"yes": "yes", "**no**": "no", "–": "reported"}


def measured(source: Source, *cases: str, manner: str = "") -> Rows:
    """One row a case or test, manner and scheme: whether it passed, and the figures."""
    rows = [
        {**row, "said": _SAID[row["passed"]]}
        for row in source.rows(*(cases or CASES_OF_MAP))
        if manner in ("", row["manner"])
    ]
    order = list(dict.fromkeys(row["case"] for row in rows)).index
    manners = list(dict.fromkeys(row["manner"] for row in rows)).index
    return sorted(rows, key=lambda row: (order(row["case"]), manners(row["manner"])))


def criteria(source: Source, *cases: str) -> Rows:
    """One row a case or test: what it asks for, and where that comes from."""
    return {row["case"]: row for row in source.rows(*(cases or CASES_OF_MAP))}.values()


def standards(rows: Grid, manner: str = "hurried") -> Grid:
    """Return every row of the standards, from the figures of tests and cases: what it asks for, what runs it, what passes."""
    said = {(case, scheme): passed for case, of, scheme, passed, _ in rows if of == manner}
    schemes = list(dict.fromkeys(scheme for case, scheme in said if case.strip("`") in TESTS))
    table = [["row", "about", "asks for", "a public suite asks for", "test", *schemes, "why not"]]
    for standard, asked in ROWS.items():
        for number, *about, test in asked:
            found = [said.get((f"`{test}`", scheme), "") for scheme in schemes]
            why = "" if test and _SAID[False] not in found else WHY[test or f"{standard.split()[0]} {number}"]
            table.append([f"{standard.split()[0]} {number}", *about, test and f"`{test}`", *found, why])
    return table


def passed(rows: Grid) -> Grid:
    """Return the map of the table of `measured`: one row a case or test and manner, one column a scheme."""
    found = [dict(zip(("case", "manner", "scheme", "passed"), row, strict=False)) for row in rows[1:]]
    order = [f"`{scheme}`" for scheme in (*COMPARED, "hertz-literal")].index
    found.sort(key=lambda row: order(row["scheme"]) if row["case"] == rows[1][0] else 0)  # columns as in the first case
    head, *lines = pivoted(found, {"case or test": "{case}", "manner": "{manner}"}, "{scheme}", "{passed}")
    first = [row[0] for row in rows[1:]].index
    return [head, *sorted(lines, key=lambda line: first(line[0]))]


def limits(rows: Grid, asked: Grid) -> Plain:
    """Return the map as reports have it: what each case and test asks for, and what came out by manner and scheme."""
    results: dict[str, dict[str, dict[str, str]]] = {}
    for case, manner, scheme, said, _ in rows[1:]:
        results.setdefault(case, {}).setdefault(manner, {})[scheme.strip("`")] = _OUTCOME[said]
    cases = [
        {"case": case.strip("`"), "criterion": f"{criterion} ({origin}).", "results": results[case]}
        for case, _, criterion, origin in asked[1:]
    ]
    missing = [f"{standard.split()[0]} {one.number}" for standard, of in ROWS.items() for one in of if not one.test]
    return {"cases": cases, "not_supported": [f"{name}: {WHY[name]}." for name in missing]}


def of_all(*names: str) -> Grid:
    """Return the rows of tables with the same columns."""
    head, *_ = grids = [read_table(name) for name in names]
    return [head[0], *(row for one in grids for row in one[1:])]


def write_limits() -> None:
    """Write what reports say of the map, from the tables; what is written by hand beside it stays."""
    made = limits(of_all("measured", "standard-tests"), of_all("criteria", "standard-criteria"))
    write_text(LIMITS, json.dumps({**read_json(LIMITS), **made}, indent=1, ensure_ascii=False) + "\n")
