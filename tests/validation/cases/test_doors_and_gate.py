"""Cases of the validation map that measure flows: the measurement itself, against motions with known flows."""

import itertools
import json

import numpy as np
import pytest
from cases import looped
from repository import ROOT

from crowd_env import MANNERS, CrowdEnv
from validation.cases import Setting, doors, gate
from validation.cases.crowds import Moment, Passages, draw_crowds, steady_flow

ONE = Setting("dem", "hurried", draws=1)


def two_crowds():
    """Return two draws of 24 people in front of a door, whom the tests move by hand."""
    return draw_crowds([doors.door(0.8, 24)], Setting("dem", "hurried", draws=2))


def marching(time, people, pace=0.5, speed=1.0):
    """Return people one behind the other, ``pace`` seconds apart, of whom the first is at x = 0 at t = 1 s."""
    x = speed * (time - 1.0 - pace * np.arange(people))
    return Moment(time, np.column_stack([x, np.zeros(people)]), np.ones(people, dtype=bool))


def test_passages_are_counted_when_they_happen_crowd_by_crowd():
    crowds = two_crowds()
    people = crowds.people(1).stop
    passages = Passages(crowds, 0, 0.05)
    times = np.arange(0.0, 40.0, 0.1)
    for then, now in itertools.pairwise(times):
        passages.see(marching(then, people), marching(now, people))
    first = passages.times(0)
    np.testing.assert_allclose(first, 1.05 + 0.5 * np.arange(people // 2), atol=1e-9)
    np.testing.assert_allclose(passages.times(1)[0], first[-1] + 0.5)
    assert steady_flow(first) == pytest.approx(2.0)


def test_a_passage_counts_once_and_only_in_its_direction():
    crowds = two_crowds()
    away = Passages(crowds, 0, 0.0, sign=-1)
    still = np.zeros((crowds.people(1).stop, 2))
    here = np.ones(len(still), dtype=bool)
    places = [1.0, -1.0, 1.0, -1.0]
    for k in range(3):
        before, now = (Moment(0.1 * m, still + places[m], here) for m in (k, k + 1))
        away.see(before, now)
    np.testing.assert_allclose(away.time, 0.05)


def test_a_crowd_in_which_nobody_passes_any_more_is_stopped():
    crowds = two_crowds()
    passages = Passages(crowds, 0, 0.0)
    second = crowds.people(1)
    still = np.full((second.stop, 2), -1.0)
    passed = still.copy()
    passed[second] = 1.0
    here = np.ones(len(still), dtype=bool)
    passages.see(Moment(0.0, still, here), Moment(0.1, passed, here))
    passages.stop_the_stuck(Moment(20.0, passed, here), 20.0)
    assert not passages.stuck
    passages.stop_the_stuck(Moment(20.2, passed, here), 20.0)
    assert passages.stuck == {0: 20.2}  # of the second all have passed
    assert not crowds.simulation.state.active[crowds.people(0)].any()
    assert crowds.simulation.state.active[second].all()


@pytest.mark.more
def test_crowds_of_a_seed_are_the_same_for_every_scheme():
    one, other = (
        draw_crowds([doors.door(0.8, 24)], ONE),
        draw_crowds([doors.door(0.8, 24)], Setting("nsm1", "calm", draws=1)),
    )
    np.testing.assert_array_equal(one.simulation.state.position, other.simulation.state.position)
    np.testing.assert_array_equal(one.simulation.bodies.desired_speed, other.simulation.bodies.desired_speed)
    assert not np.array_equal(
        draw_crowds([doors.door(0.8, 24)], Setting("dem", draws=1, seed=1)).simulation.state.position,
        one.simulation.state.position,
    )


@pytest.mark.more
def test_crowds_walk_as_environments_do():
    crowds = draw_crowds([doors.door(0.8, 24)], Setting("dem", "hurried", draws=1, strategy="shortest"))
    env = CrowdEnv(doors.door(0.8, 24), physics="dem", walking="hurried")
    env.reset([0])
    bodies, state = crowds.simulation.bodies, crowds.simulation.state
    env.simulation.restart(0, bodies._replace(env_start=np.array([0, len(bodies.radius)])), state.position.copy())
    for _ in crowds.moments(2.0):
        env.step(None)
    np.testing.assert_array_equal(env.simulation.state.position, state.position)


@pytest.mark.more
def test_doors_are_as_wide_as_they_say_and_judged_by_the_worst():
    found = doors.specific_flows(ONE, (0.8,))["0.8"]
    assert 0.5 < found["flow"] < 10.0 and found["stuck"] == 0
    for width in doors.WIDTHS:
        place = doors.door(width).geometry
        assert place.contains([(0.15, 0.5 * width - 0.01), (0.15, 0.5 * width + 0.01)]).tolist() == [True, False]


def test_published_flows_lie_where_the_criterion_does():
    points = np.loadtxt(ROOT / "tests/data/published_flows.csv", delimiter=",", skiprows=1, usecols=(1, 2))
    per_meter = points[:, 1] / points[:, 0]
    assert (doors.LOW, doors.HIGH) == (1.6, 2.8) and pytest.approx(per_meter.mean(), abs=0.005) == doors.MEAN
    assert len(per_meter) == 79
    assert (min(per_meter), max(per_meter)) == pytest.approx((1.61, 2.77), abs=0.005)
    assert np.mean(per_meter) == pytest.approx(2.12, abs=0.005)


# -------------------------------------------------------------------------------------------------------------- gate


def test_recorded_heads_are_pushed_apart_no_further_than_needed(monkeypatch):
    starts = np.array([(0.0, 3.0), (0.2, 3.0), (-2.7, 1.0), (2.0, 5.0)])
    moved = gate.push_apart(starts, 0.17)
    np.testing.assert_allclose(moved, [(-0.07, 3.0), (0.27, 3.0), (-2.63, 1.0), (2.0, 5.0)], atol=1e-5)
    gate.gate(starts).population.draw(np.random.default_rng(0), gate.gate(starts).geometry)  # they fit
    monkeypatch.setattr(gate, "_ROUNDS", 20)
    with pytest.raises(ValueError, match="do not fit"):
        gate.push_apart(np.full((900, 2), 3.0) + 1e-3 * np.arange(1800).reshape(900, 2), 0.17)


def test_the_recorded_counts_meet_the_criterion_and_others_do_not():
    recorded = np.interp(np.arange(1, 76), [1, *gate.PASSED], [0.5, *gate.PASSED.values()])
    figures = gate.counted([recorded, recorded])
    assert figures["flow"] == pytest.approx(1.13, rel=0.05)
    assert figures["person"][40] == pytest.approx(33.1)
    assert figures["flow_error"] == pytest.approx(0.0) and np.isnan(gate.counted([recorded])["flow_error"])
    assert "± 0.00 /s" in gate.told(figures | {"stuck": 1, "starts": "recorded"}, 20)
    assert "±" not in gate.told(gate.counted([recorded]) | {"stuck": 0, "starts": "recorded"}, 1)
    assert "1 of 20 (1 to 24 %) stuck" in gate.told(figures | {"stuck": 1, "starts": "recorded"}, 20)
    assert gate.met(figures | {"stuck": 0})
    assert not gate.met(figures | {"stuck": 1})
    assert not gate.met(gate.counted([recorded / 1.2]) | {"stuck": 0})
    bursts = np.repeat(recorded[1::2], 2)[:75]
    assert not gate.met(gate.counted([np.append(bursts, recorded[-1])[:75]]) | {"stuck": 0})  # two at a time


@pytest.mark.more
def test_the_gate_runs_without_a_recording_and_says_so():
    (row,) = gate.run(ONE)
    assert "no recording" in row.figure and row.more["starts"] == "random"
    assert (row.case, row.scheme, row.manner) == ("gate", "dem", "hurried")
    json.dumps(row.more, allow_nan=False)


@pytest.mark.more
@looped("scheme", ["dem", "nsm2", "hertz"])
def test_the_more_hurry_the_more_people_pass_a_narrow_door(scheme):
    # From the crowd of the papers, which passes far more than any recorded one, down to calm people.
    flows = [doors.specific_flows(Setting(scheme, name, draws=2), (0.75,))["0.75"]["flow"] for name in MANNERS]
    assert list(MANNERS)[:2] == ["competitive", "pushing"] and list(MANNERS)[-1] == "calm"
    assert (np.diff(flows) < 0.0).all() and flows[1] < 0.75 * flows[0], flows
