"""The cases of ovals, of a jam and of four streams: what they measure, and that they fail where the rule lacks a part."""

from dataclasses import replace

import numpy as np
import pytest

from crowd_env import Headway
from validation.cases import Setting, ovals, streams
from validation.cases.case import adults
from validation.cases.crowds import Moment, crowds_at, generator
from validation.cases.ring import along, annulus, around

ONE = Setting("dem", "hurried", draws=1)
pytestmark = pytest.mark.more


def test_people_in_ovals_are_as_fast_as_recorded_and_too_fast_where_they_do_not_see_who_is_beside_them():
    at, calm = [0.5, 2.04], replace(ONE, manner="calm")
    recorded = np.array([ovals.JUDGED[density] for density in at])
    assert np.abs(ovals.speeds(calm, 1.8, at) / recorded - 1.0).max() < 0.3
    for lacks in ({"beside": 0.0, "off_walls": 0.0}, {"overtaking": 0.0}):  # the latter passes people in a queue
        assert ovals.speeds(replace(ONE, manner=Headway(**lacks)), 1.8, at[1:])[0] > 1.35 * recorded[1]


@pytest.mark.parametrize("speed", [-0.4, 0.7])
def test_the_drift_of_a_jam_is_that_of_its_center(speed):
    """Of people who stand in a cluster that is carried around."""
    angle = np.linspace(0.0, 1.0, 20)

    class Carried:
        count = 1

        def people(self, e):
            return slice(0, 20)

        def moments(self, limit, command):
            place = [ovals.RADIUS * np.exp(1j * (angle + speed * t / ovals.RADIUS)) for t in np.arange(0.0, 15.05, 0.1)]
            crowd = [np.column_stack([p.real, p.imag]) for p in place]
            for k in range(1, len(crowd)):
                yield (
                    Moment(0.1 * (k - 1), crowd[k - 1], np.ones(20, bool)),
                    Moment(0.1 * k, crowd[k], np.ones(20, bool)),
                )

    assert ovals.drift(Carried())[0] == pytest.approx(speed, abs=0.01)


@pytest.mark.parametrize("manner", ["calm", "hurried"])
def test_where_there_is_room_the_slow_are_passed(manner):
    """At 0.3 /m2 recorded people lose 5 % of their free speed."""
    place = annulus(ovals.RADIUS, 3.0)
    drawn = [adults(round(0.3 * place.area)).draw(generator(ONE, d), place) for d in range(2)]
    crowds = crowds_at(place, drawn, replace(ONE, manner=manner), draws=2)
    free = np.mean([bodies.desired_speed.mean() for bodies, _ in drawn])
    walked = np.mean(crowds.speeds(along, around, 15.0, 40.0))
    assert 0.92 < walked / free < 1.0


def test_a_jam_travels_against_the_way_people_walk():
    (found,) = ovals.jam(replace(ONE, draws=2))
    assert found.passed, found.figure


def test_four_streams_do_not_lock_unless_nobody_loses_patience():
    (found,) = streams.run(ONE)
    assert found.passed, found.figure
    (patient,) = streams.run(replace(ONE, manner=Headway(time_gap=0.3, impatience=0.0)))
    assert not patient.passed and patient.more["left"] > 100
