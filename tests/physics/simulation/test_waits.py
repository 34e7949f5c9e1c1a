"""People who wait in the region that their route is via, for a time or until a time."""

import numpy as np
import pytest
from crowds import every_scheme

from crowd_env import CrowdEnv, Geometry, Route, Scenario
from crowd_env.geometry.geometry import box

HALL = Geometry.from_polygon(
    box(0, 0, 12, 4),
    exits={"east": [(12, 1), (12, 3)]},
    regions={"west": box(0, 0, 2, 4), "lounge": box(4, 0, 8, 4)},
)


def hall(*routes, **people):
    crowd = {"people": 6, "start_region": "west", **people}
    return Scenario("hall", HALL, [crowd], time_limit=90.0, routes=routes)


@every_scheme
def test_people_wait_as_long_as_they_mean_to_and_then_leave(name):
    env = CrowdEnv(hall(Route("rest", ("east",), via="lounge"), route="rest", wait=(5.0, 8.0)), physics=name)
    env.reset(seed=0)
    state, entered, left = env.simulation.state, np.full(6, np.nan), np.full(6, np.nan)
    while not env.finished.all():
        env.step(None)
        x, now = state.position[:, 0], state.time[0]
        entered[np.isnan(entered) & (x > 4.0)] = now
        left[np.isnan(left) & (x > 8.3)] = now  # some stand at the edge
    stayed = left - entered
    assert np.isfinite(state.exit_time).all()
    assert (stayed > 5.0 - 0.2).all()
    assert (stayed < 8.0 + 4.0 / 0.8 + 2.5).all()  # the way out of the lounge, at the least speed


def test_people_wait_until_a_time_spread_over_the_region():
    env = CrowdEnv(hall(Route("rest", ("east",), via="lounge", until=20.0), route="rest", people=12))
    env.reset(seed=0)
    state = env.simulation.state
    while state.time[0] < 19.8:
        env.step(None)
    x, y = state.position.T
    assert env.active.all()
    assert ((x > 3.9) & (x < 8.1)).all()
    assert np.hypot(*state.velocity.T).max() < 0.2
    assert np.ptp(x) > 1.5 and np.ptp(y) > 1.5
    while not env.finished.all():
        env.step(None)
    assert np.isfinite(state.exit_time).all()
    assert (state.exit_time > 22.0).all()


def test_a_wait_of_nothing_changes_no_bit():
    plain, waits = (
        CrowdEnv(hall(Route("rest", ("east",), via="lounge"), route="rest", **options))
        for options in ({}, {"wait": 0.0})
    )
    for env in (plain, waits):
        env.reset(seed=0)
        for _ in range(60):
            env.step(None)
    assert plain.simulation.state.position.tobytes() == waits.simulation.state.position.tobytes()


def test_a_wait_needs_a_region():
    with pytest.raises(ValueError, match="wait needs such a route"):
        hall(wait=3.0)
    with pytest.raises(ValueError, match="give via too"):
        Route("rest", until=3.0)
