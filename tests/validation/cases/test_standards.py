"""Tests of the standards in the validation map: each is run small, and is seen to fail where the model breaks it."""

import json
from collections import Counter
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from cases import looped

from crowd_env import Normal
from crowd_env.scenarios.buildings import Stair
from validation.cases import CASES, Setting, standards
from validation.cases.case import Verdict, adults, plain
from validation.cases.crowds import Moment, draw_crowds
from validation.cases.standards import ROWS, TESTS, WHY, evacuations, fire, groups, stairs, walking
from validation.cases.standards.places import PLACES

ONE = Setting("dem", "hurried", draws=1)
QUICK = (
    *("rimea-1", "rimea-2", "rimea-6", "rimea-10", "rimea-12c", "rimea-13", "nist-4.1", "nist-2.10"),
    *("iso-12", "iso-14", "iso-15", "iso-16", "iso-18", "iso-19"),
)


@pytest.mark.more
@looped("name", QUICK)
def test_people_of_the_package_pass(name):
    verdict = standards.TESTS[name](ONE)
    assert verdict.passed, verdict.figure
    json.dumps(plain(verdict.more), allow_nan=False)


def test_every_row_of_the_standards_names_what_runs_it_or_why_nothing_does():
    counts = {"RiMEA 4.1": 19, "IMO MSC.1/Circ.1533": 11, "NIST TN 1822": 18, "ISO 20414": 19}
    assert {standard: len(rows) for standard, rows in ROWS.items()} == counts
    every = [(f"{standard.split()[0]} {one.number}", one) for standard, rows in ROWS.items() for one in rows]
    assert max(Counter(name for name, _ in every).values()) == 1
    assert {one.strict for _, one in every} == {"tolerance", "tendency", "documentation"}
    assert all((name if not one.test else one.test) in {*TESTS, *CASES, *WHY} for name, one in every)
    assert {one.test for _, one in every} >= {*TESTS}
    assert {*WHY} <= {*TESTS, *CASES, *(name for name, one in every if not one.test)}


def test_every_test_has_a_row(monkeypatch):
    tests = dict.fromkeys(TESTS, lambda setting: Verdict(True, "fine", {}))
    monkeypatch.setattr(standards, "TESTS", tests)
    rows = list(standards.run(ONE))
    assert [row.case for row in rows] == list(TESTS) and all(row.criterion and row.source for row in rows)


@pytest.mark.more
def test_walking_speed_is_that_between_two_lines():
    desired, walked, out = walking.alone(replace(ONE, draws=3), walking.corridor(walking.adults(1)), 5.0, 35.0)
    np.testing.assert_allclose(walked, desired, rtol=0.01)
    np.testing.assert_allclose(out, 40.0 / desired, rtol=0.05)
    assert len(set(desired)) == 3


@pytest.mark.more
def test_who_does_not_wait_leaves_a_slow_member_behind():
    assert groups.spreads(ONE, None)[0] > groups.WITHIN


# ------------------------------------------------------------------------------------------------- what is wrong goes red


@pytest.mark.more
def test_a_stair_of_another_speed_is_seen(monkeypatch):
    monkeypatch.setattr(stairs, "Stair", lambda *words, up=None, down=None: Stair(*words))
    verdict = stairs.speeds(ONE)
    assert not verdict.passed and np.abs(verdict.more["off"])[:2].min() > 0.2


@pytest.mark.more
def test_points_beside_the_band_are_seen(monkeypatch):
    monkeypatch.setattr(stairs, "_UP", 0.3)
    verdict = stairs.diagram(ONE)
    assert not verdict.passed and verdict.more["shares"][0] < 0.5 < verdict.more["shares"][1]


def test_the_band_is_that_of_the_figure():
    low, high = stairs.band(np.array([1.0]), "down")
    np.testing.assert_allclose([low, high], [[0.59 - 0.08], [0.70 + 0.18]])


@pytest.mark.more
def test_a_stair_that_passes_as_many_as_the_corridor_makes_no_jam(monkeypatch):
    monkeypatch.setattr(stairs, "Stair", lambda *words, up=None, down=None: Stair(*words, up=1.9))
    assert not stairs.congestion(ONE).passed


@pytest.mark.more
def test_stairs_in_the_wrong_order_are_seen(monkeypatch):
    monkeypatch.setattr(stairs, "_WIDTHS", (1.6, 1.0))
    assert not stairs.flow_by_width(ONE).passed


@pytest.mark.more
def test_which_way_people_take_is_seen(monkeypatch):
    monkeypatch.setattr(stairs, "Stair", partial(Stair, up=0.2, down=0.2))
    verdict = stairs.lower_floor(ONE)
    assert not verdict.passed and verdict.more == {"short": 0.0, "sent": 0.0}


@pytest.mark.more
def test_three_storeys_have_112_rooms(monkeypatch):
    building, starts = stairs._storeys()
    _, sheet = building.on_sheets(starts)
    assert np.bincount(sheet).tolist() == [4 * 36, 4 * 38, 4 * 38]
    assert building.clearance(starts).min() > 0.19
    for time, passed in ((200.0, True), (np.nan, False)):
        monkeypatch.setattr(
            stairs, "last_out", lambda _, scenarios, limit, time=time: [200.0, 200.0, 250.0, 230.0, time]
        )
        assert stairs.three_storeys(ONE).passed is passed


@looped(
    ("test", "good", "bad"),
    [
        (evacuations.goal_position, ([2.5, 2.5, 2.6], [60.0, 62.0, 70.0]), ([2.0, 2.5, 2.6], [60.0, 62.0, 70.0])),
        (evacuations.neck_length, ([2.5, 2.3], [60.0, 70.0]), ([2.3, 2.5], [60.0, 70.0])),
        (evacuations.neck_width, ([2.0, 2.5, 3.0], [70.0, 60.0, 50.0]), ([2.0, 2.5, 2.5], [70.0, 60.0, 50.0])),
    ],
)
def test_necks_that_pass_the_wrong_numbers_are_seen(monkeypatch, test, good, bad):
    for found, passed in ((good, True), (bad, False)):
        monkeypatch.setattr(evacuations, "beyond_necks", lambda setting, *kinds, found=found: found)
        assert test(ONE).passed is passed


@pytest.mark.more
def test_a_jam_before_the_second_neck_is_seen(monkeypatch):
    floor = [*PLACES["neck"]["floor"]]
    floor[3] = [24.99, -0.3, 25.31, 0.3]
    monkeypatch.setitem(PLACES["neck"], "floor", floor)
    verdict = evacuations.neck(ONE)
    assert not verdict.passed and verdict.more["peaks"][1] > 0.5 * verdict.more["peaks"][0]


def test_a_corner_slower_than_its_outer_side_is_seen(monkeypatch):
    for times, passed in (([60.0, 80.0, 100.0], True), ([60.0, 110.0, 100.0], False), ([60.0, np.nan, 100.0], False)):
        monkeypatch.setattr(evacuations, "last_out", lambda *_, times=times: times)
        assert evacuations.turned_corner(ONE).passed is passed


@pytest.mark.more
def test_a_flow_below_the_value_of_design_is_seen(monkeypatch):
    assert not evacuations.exit_flow(ONE).passed
    monkeypatch.setattr(evacuations, "flows_past", lambda *_: [1.3])
    verdict = evacuations.exit_flow(ONE)
    assert verdict.passed and verdict.more["held"] == pytest.approx(1.33, rel=0.02)


@pytest.mark.more
def test_people_who_choose_by_themselves_are_seen(monkeypatch):
    monkeypatch.setattr(groups, "adults", lambda count, **kind: adults(count, start_region=kind["start_region"]))
    assert not groups.companions(ONE).passed
    assert not groups.familiar_exit(ONE).passed


@pytest.mark.more
def test_response_times_of_another_law_are_seen(monkeypatch):
    monkeypatch.setattr(walking, "_MANY", 5)
    monkeypatch.setattr(walking, "Normal", lambda mean, *law: Normal(mean - 15.0, *law))
    verdict = walking.response_times(ONE)
    assert not verdict.passed and np.argmin(verdict.more["p"]) == 1


@pytest.mark.more
def test_smoke_that_slows_nobody_is_seen(monkeypatch):
    monkeypatch.setattr(fire, "_SLOWER", ())
    monkeypatch.setattr(fire, "speed_in_smoke", lambda thick: 1.0)
    assert not fire.smoke(ONE).passed


def test_half_of_a_dose_is_seen(monkeypatch):
    dose = fire.dose
    assert fire.gases(ONE).passed
    monkeypatch.setattr(fire, "dose", lambda *air: 0.99 * dose(*air))
    assert not fire.gases(ONE).passed


@pytest.mark.more
def test_a_share_of_people_at_the_wrong_exit_is_seen(monkeypatch):
    def everyone_by_the_first(scenarios, setting):
        crowds = draw_crowds(scenarios, setting)
        crowds.simulation.state.exit_index[:] = 0
        crowds.simulation.state.active[:] = False
        return crowds

    monkeypatch.setattr(evacuations, "draw_crowds", everyone_by_the_first)
    verdict = evacuations.rooms(ONE)
    assert not verdict.passed and verdict.more["share"] == pytest.approx(15 / 23)
    assert not evacuations.closing_exit(ONE).passed


@pytest.mark.more
def test_a_crowd_that_never_slows_has_no_fundamental_diagram(monkeypatch):
    monkeypatch.setattr(walking, "_DENSITIES", (0.5, 2.0, 4.0))
    assert walking.fundamental_diagram(Setting("dem", "calm", draws=1)).passed
    assert not walking.fundamental_diagram(Setting("dem", "competitive", draws=1)).passed


def test_the_ring_is_walked_along():
    position = np.array([(10.0, 0.0), (0.0, -9.0)])
    np.testing.assert_allclose(walking.along(Moment(0.0, position, np.ones(2, dtype=bool))), [(0.0, 1.0), (1.0, 0.0)])
