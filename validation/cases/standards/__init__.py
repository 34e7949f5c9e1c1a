"""Tests of the standards for evacuation models, as far as they apply: a row each, and a row with the reason for the others."""

from collections.abc import Iterator

from validation.cases.case import Row, Setting, row
from validation.cases.standards import evacuations, walking
from validation.cases.standards.verdict import Check

SOURCE = "RiMEA 4.1.1, ISO 20414:2020, NIST TN 1822, IMO MSC.1/Circ.1533"

TESTS = {
    "rimea-1": Check(
        walking.corridor_of_40_m, "26 to 34 s at 1.33 m/s; 1 ± 0.05 m/s", "RiMEA 1, ISO 2, NIST 2.1, IMO 1"
    ),
    "rimea-2": Check(
        walking.stairs, "0.5 ± 0.05 m/s on stairs where 0.5 is set", "RiMEA 2 and 3, ISO 3, NIST 2.2, IMO 2 and 3"
    ),
    "rimea-4": Check(
        walking.fundamental_diagram,
        "speed falls from each density to the next, and the flow is largest in between",
        "RiMEA 4, ISO 13 (in a ring)",
    ),
    "rimea-5": Check(
        walking.response_times,
        "everyone starts within 1 s after the own response time: uniform, normal, log-normal",
        "RiMEA 5, ISO 1, NIST 1.1, IMO 5",
    ),
    "rimea-6": Check(walking.corner, "all out, nobody outside of the walls", "RiMEA 6, ISO 4, NIST 2.3, IMO 6"),
    "rimea-7": Check(
        walking.ages, "each within 5 % of the own speed; mean and sd within 0.05 m/s", "RiMEA 7, ISO 5, NIST 2.4, IMO 7"
    ),
    "rimea-9": Check(evacuations.four_doors, "two doors take 1.6 to 2.4 times as long as four", "RiMEA 9, IMO 9"),
    "rimea-10": Check(evacuations.rooms, "100 % take the assigned exit", "RiMEA 10, ISO 8, NIST 3.1, IMO 10"),
    "rimea-11": Check(evacuations.near_exit, "most take the near exit, some the other", "RiMEA 11, ISO 17"),
    "rimea-12": Check(evacuations.neck, "no more per second at the exit than at the neck (+ 0.05 /s)", "RiMEA 12"),
    "imo-4": Check(
        evacuations.exit_flow, "1.33 /(m s), a value of design: reported, not judged", "IMO 4, ISO 11, NIST 5.2"
    ),
    "nist-4.1": Check(evacuations.closing_exit, "everyone leaves by the exit that stays open", "NIST 4.1, ISO 9"),
    "nist-2.10": Check(evacuations.slow_person, "longer than without", "NIST 2.10, ISO 7"),
}

# Test -> why there is no row with figures.
NOT_SUPPORTED = {
    "RiMEA 8": "three storeys, and the effect of each parameter is to be written down; floors are not linked",
    "RiMEA 13, ISO 10, NIST 5.1": "the jam at the foot of stairs: stairs are floor on which people are slower",
    "RiMEA 14": "a short way over another floor: floors are not linked",
    "RiMEA 15": "its lengths cannot be told apart from the text at hand, and the figure is not at hand",
    "ISO 12, IMO 11": "flow on stairs: stairs are floor on which people are slower",
    "ISO 14, NIST 2.9": "groups that stay together: there is no such behavior",
    "ISO 15, NIST 3.2": "social influence on the choice of exits: there is no such behavior",
    "ISO 16, NIST 3.3": "affinity to familiar exits: people know an exit or do not, without a share",
    "NIST 2.5, 2.6": "smoke and toxic gas: there is no fire",
    "NIST 2.7": "lifts: there are none",
}


def run(setting: Setting) -> Iterator[Row]:
    """Yield a row for each test, and one for those that are not supported."""
    for name, check in TESTS.items():
        setting.notify(f"{setting.scheme}, {setting.manner}: {name}")
        verdict = check.run(setting)
        yield row(name, setting, verdict.passed, verdict.figure, check.criterion, check.source, **verdict.more)
    for names, reason in NOT_SUPPORTED.items():
        yield row("not supported", setting, None, reason, "", names)
