"""Tests of the standards for evacuation models, as far as they apply: a row each, and a row with the reason for the others."""

from collections.abc import Iterator

from validation.cases.case import FACTS, Row, Setting, row
from validation.cases.standards import evacuations, groups, walking

TESTS = {
    "rimea-1": walking.corridor_of_40_m,
    "rimea-2": walking.stairs,
    "rimea-4": walking.fundamental_diagram,
    "rimea-5": walking.response_times,
    "rimea-6": walking.corner,
    "rimea-7": walking.ages,
    "rimea-9": evacuations.four_doors,
    "rimea-10": evacuations.rooms,
    "rimea-11": evacuations.near_exit,
    "rimea-12": evacuations.neck,
    "imo-4": evacuations.exit_flow,
    "nist-4.1": evacuations.closing_exit,
    "nist-2.10": evacuations.slow_person,
    "iso-14": groups.keep_together,
}
NOT_SUPPORTED: dict[str, str] = FACTS["not_supported"]


def run(setting: Setting) -> Iterator[Row]:
    """Yield a row for each test, and one for those that are not supported."""
    for name, test in TESTS.items():
        setting.notify(f"{setting.scheme}, {setting.manner}: {name}")
        passed, figure, more = test(setting)
        yield row(name, setting, passed, figure, **more)
    for names, reason in NOT_SUPPORTED.items():
        yield row("not supported", setting, None, reason, "", names)
