"""The laws that run with the tests: what breaks them, and by hand what other schemes and experiments must show."""

import pytest
from cases import looped
from typer.testing import CliRunner

from validation.cases import CASES, Setting, corner, counterflow, doors, laws, ring
from validation.cases.case import row as row_of
from validation.cli import app

SETTING = Setting("dem", "calm", draws=1)


@looped(("speeds", "holds"), [((1.2, 0.9, 0.5, 0.1), True), ((1.2, 0.9, 1.0, 1.1), False)])
def test_speed_must_fall_with_line_density(monkeypatch, speeds, holds):
    monkeypatch.setattr(ring, "speeds", lambda setting: dict(zip((0.5, 1.0, 1.5, 2.0), speeds, strict=True)))
    assert laws.speed_falls_in_single_file(SETTING)[0] == holds


@looped(
    ("speeds", "stuck", "holds"), [((1.2, 0.9, 0.3), 0, True), ((1.2, 1.3, 0.3), 0, False), ((1.2, 0.9, 0.3), 1, False)]
)
def test_speed_must_fall_at_a_corner(monkeypatch, speeds, stuck, holds):
    found = [
        {"density": d, "speed": v, "stuck": stuck if d == 3.0 else 0}
        for d, v in zip((0.2, 1.0, 3.0), speeds, strict=True)
    ]
    monkeypatch.setattr(corner, "measure", lambda setting, runs: found[::-1])
    assert laws.speed_falls_at_a_corner(SETTING)[0] == holds


def flows(*per_meter, stuck=0):
    return lambda setting, widths: {
        f"{width:g}": {"flow": flow, "stuck": stuck} for width, flow in zip(widths, per_meter, strict=False)
    }


def test_wider_doors_must_pass_more_and_nobody_be_stuck(monkeypatch):
    for per_meter, stuck, holds in (
        ((2.0, 2.0, 2.0), 0, True),
        ((2.0, 2.0, 1.0), 0, False),
        ((2.0, 2.0, 2.0), 1, False),
    ):
        monkeypatch.setattr(doors, "specific_flows", flows(*per_meter, stuck=stuck))
        assert laws.wider_doors_pass_more(SETTING)[0] == holds


def test_people_who_press_on_must_be_faster(monkeypatch):
    for pressing, holds in ((4.0, True), (2.1, False)):
        monkeypatch.setattr(
            doors,
            "specific_flows",
            lambda setting, widths, most=pressing: flows(most if setting.manner == "competitive" else 2.0)(
                setting, widths
            ),
        )
        assert laws.pressing_on_is_faster(SETTING)[0] == holds


def test_oncoming_people_must_pass_each_other_and_lose(monkeypatch):
    for both, gridlocked, holds in ((0.9, 0, True), (1.3, 0, False), (0.9, 1, False), (None, 1, False)):
        found = row_of("counterflow", SETTING, None, "", "", "", one_way=1.2, both_ways=both, gridlocked=gridlocked)
        monkeypatch.setattr(counterflow, "run", lambda setting, found=found: [found])
        assert laws.oncoming_people_slow_down(SETTING)[0] == holds


def test_a_law_that_is_broken_is_a_row_that_fails(monkeypatch):
    monkeypatch.setattr(laws, "LAWS", {"a": (lambda s: (True, "1"), "c"), "b": (lambda s: (False, "2"), "c")})
    assert [(one.case, one.passed, one.figure) for one in laws.run(SETTING)] == [("a", True, "1"), ("b", False, "2")]
    found = CliRunner().invoke(app, ["--quick", "--manner", "calm"])
    assert found.exit_code == 1 and "law: b" in found.stdout


def test_people_who_press_on_are_not_held_against_themselves(monkeypatch):
    press = {"press": laws.LAWS["press"]}
    monkeypatch.setattr(laws, "LAWS", press)
    assert not list(laws.run(Setting("dem", "competitive")))


def test_quick_is_one_scheme_and_one_draw(monkeypatch):
    asked = []
    monkeypatch.setattr(laws, "LAWS", {"a": (lambda s: (asked.append((s.scheme, s.manner, s.draws)) or True, ""), "c")})
    assert CliRunner().invoke(app, ["--quick"]).exit_code == 0
    assert asked == [("dem", "calm", 1), ("dem", "hurried", 1)]
    for words in (["gate", "--quick"], ["--quick", "--schemes", "dem"]):
        found = CliRunner().invoke(app, words)
        assert found.exit_code == 2 and "--quick is one case and one scheme" in found.stderr


@pytest.mark.more
def test_a_push_travels_under_dem():
    assert laws.pushes_travel(SETTING)[0]


@pytest.mark.nightly
@looped("scheme", ["dem", "nsm1-inertial", "nsm2"])
@looped(("case", "manner"), [("ring", "calm"), ("corner", "calm"), ("doors", "hurried"), ("counterflow", "hurried")])
def test_a_headway_makes_schemes_true_to_the_experiments(case, scheme, manner):
    (found,) = CASES[case].run(Setting(scheme, manner, draws=2))
    assert found.passed, found.figure


@pytest.mark.nightly
@looped("case", ["ring", "doors", "corner"])
def test_without_it_the_experiments_are_missed(case):
    (found,) = CASES[case].run(Setting("dem", "competitive", draws=1))
    assert not found.passed
