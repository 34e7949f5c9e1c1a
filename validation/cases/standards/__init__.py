"""Tests of the standards for evacuation models; rows.toml says of each row of these which test runs it, or why none does."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from validation.cases.case import Row, Setting, row
from validation.cases.standards import evacuations, fire, groups, stairs, walking
from validation.pages import read_toml

TESTS = {
    "rimea-1": walking.corridor_of_40_m,
    "rimea-2": stairs.speeds,
    "rimea-4": walking.fundamental_diagram,
    "rimea-5": walking.response_times,
    "rimea-6": walking.corner,
    "rimea-7": walking.ages,
    "rimea-8": stairs.three_storeys,
    "rimea-9": evacuations.four_doors,
    "rimea-10": evacuations.rooms,
    "rimea-11": evacuations.near_exit,
    "rimea-12a": evacuations.goal_position,
    "rimea-12b": evacuations.neck_length,
    "rimea-12c": evacuations.neck,
    "rimea-12d": evacuations.neck_width,
    "rimea-13": stairs.diagram,
    "rimea-14": stairs.lower_floor,
    "rimea-15": evacuations.turned_corner,
    "imo-4": evacuations.exit_flow,
    "imo-11": stairs.congestion,
    "nist-4.1": evacuations.closing_exit,
    "nist-2.10": evacuations.slow_person,
    "iso-12": stairs.flow_by_width,
    "iso-14": groups.keep_together,
    "iso-15": groups.companions,
    "iso-16": groups.familiar_exit,
    "iso-18": fire.smoke,
    "iso-19": fire.gases,
}


class Asked(NamedTuple):
    """A row of a standard."""

    number: str
    title: str
    strict: str  # tolerance, tendency or documentation
    public: str  # what a public suite asks for
    test: str  # or case; "" = none


_FACTS = read_toml(Path(__file__).with_name("rows.toml"))
ROWS = {standard: [Asked(*row) for row in rows] for standard, rows in _FACTS["rows"].items()}
WHY: dict[str, str] = _FACTS["why"]


def run(setting: Setting) -> Iterator[Row]:
    """Yield a row for each test."""
    for name, test in TESTS.items():
        setting.notify(f"{setting.scheme}, {setting.manner}: {name}")
        passed, figure, more = test(setting)
        yield row(name, setting, passed, figure, **more)
