"""The case of faster and slower crowds: what counts as slower, and who pushes."""

import numpy as np
import pytest
from cases import looped

from crowd_env import Hertz
from validation.cases import Setting, faster

INF = float("inf")


def test_a_time_that_grows_or_has_no_end_is_slower():
    assert faster.never_slower([60.0, 50.0, 51.0, 49.0])
    assert not faster.never_slower([60.0, 50.0, 55.0])
    assert not faster.never_slower([60.0, 50.0, INF])
    assert not faster.never_slower([INF, INF])


def test_friction_slows_if_it_does_on_the_whole():
    assert faster.slowed([60.0, 51.0, 39.0], [60.0, 48.0, 40.0]) and faster.slowed([60.0, INF], [60.0, 50.0])
    assert not faster.slowed([60.0, 50.0], [60.0, 50.0]) and not faster.slowed([INF, 50.0], [INF, 49.0])


def test_everyone_wants_the_same_speed():
    bodies, _ = faster.room(2.0).population.draw(np.random.default_rng(0), faster.room(2.0).geometry)
    assert (bodies.desired_speed == 2.0).all() and len(bodies.radius) == 100


@looped(
    ("scheme", "manner", "curves"),
    [("dem", "calm", 3), ("dem", "competitive", 1), ("hertz", "hurried", 6), (Hertz(), "competitive", 2)],
)
def test_curves_are_run_for_what_scheme_and_manner_have(scheme, manner, curves, monkeypatch):
    seen = []

    def times(setting, push, speeds=faster.SPEEDS):
        seen.append((getattr(setting.scheme, "friction", None), push))
        return [60.0, 50.0, 40.0, 30.0, INF if push == 1.0 and seen[-1][0] else 30.0]

    monkeypatch.setattr(faster, "clearing_times", times)
    (row,) = faster.run(Setting(scheme, manner, draws=1))
    assert len(seen) == len(set(seen)) == curves
    assert row.passed == (None if curves == 1 else True)
    assert row.scheme in ("dem", "hertz")
    assert ("stuck" in row.figure) == (curves in (6, 2))


@pytest.mark.more
def test_people_who_press_on_are_through_sooner():
    setting = Setting("dem", "calm", draws=1)
    polite, pressing = (faster.clearing_times(setting, push, (1.5,))[0] for push in (0.0, 0.5))
    assert pressing < polite
