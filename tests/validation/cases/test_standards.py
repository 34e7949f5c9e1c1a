"""Tests of the standards in the validation map: each is run small, and is seen to fail where the model breaks it."""

import json
from dataclasses import replace

import numpy as np
import pytest
from cases import looped

from validation.cases import Setting, standards
from validation.cases.case import Verdict
from validation.cases.crowds import Moment, draw_crowds
from validation.cases.standards import evacuations, groups, walking

ONE = Setting("dem", "hurried", draws=1)
QUICK = ("rimea-1", "rimea-2", "rimea-5", "rimea-6", "rimea-10", "nist-4.1", "nist-2.10", "iso-14")


@pytest.mark.more
@looped("name", QUICK)
def test_people_of_the_package_pass(name):
    verdict = standards.TESTS[name](ONE)
    assert verdict.passed, verdict.figure
    json.dumps(verdict.more, allow_nan=False)


def test_every_test_has_a_row_and_those_that_do_not_apply_a_reason(monkeypatch):
    tests = dict.fromkeys(standards.TESTS, lambda setting: Verdict(True, "fine", {}))
    monkeypatch.setattr(standards, "TESTS", tests)
    rows = list(standards.run(ONE))
    assert [row.case for row in rows[: len(tests)]] == list(standards.TESTS)
    rest = rows[len(tests) :]
    assert [row.source for row in rest] == list(standards.NOT_SUPPORTED)
    assert all(row.passed is None and row.figure for row in rest)


@pytest.mark.more
def test_walking_speed_is_that_between_two_lines():
    desired, walked, out = walking.alone(replace(ONE, draws=3), walking.corridor(walking.adults(1)), 5.0, 35.0)
    np.testing.assert_allclose(walked, desired, rtol=0.01)
    np.testing.assert_allclose(out, 40.0 / desired, rtol=0.05)
    assert len(set(desired)) == 3


@pytest.mark.more
def test_who_does_not_wait_leaves_a_slow_member_behind():
    assert groups.spreads(ONE, None)[0] > groups.WITHIN


@pytest.mark.more
def test_stairs_are_too_fast_without_their_zone(monkeypatch):
    plain = walking.corridor
    monkeypatch.setattr(walking, "corridor", lambda people, length, zones: plain(people, length))
    assert not walking.stairs(ONE).passed


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
