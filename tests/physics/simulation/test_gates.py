"""Gates let through so many per second, and the queue before them takes the rest."""

import numpy as np
import pytest
from crowds import every_scheme

from crowd_env import CrowdEnv, Gate, Geometry, Scenario
from crowd_env.geometry.geometry import box

HALL = Geometry.from_polygon(
    box(0, 0, 8, 4), exits={"east": [(8, 1.4), (8, 2.6)]}, doors={"gate": "east", "middle": [(4, 0), (4, 4)]}
)
SOURCE = {"arrivals": {"rate": 2.0, "until": 15.0, "line": [(0, 0.5), (0, 3.5)], "spacing": "regular"}}


def passed(place, scheme, until, **options):
    """Return when people passed x = 4 and the exit, and the environment at the time ``until`` [s]."""
    env = CrowdEnv(place, physics=scheme, **options)
    env.reset(seed=0)
    half = np.full(env.num_people, np.nan)
    while env.simulation.state.time[0] < until - 1e-6 and not env.finished.all():
        env.step(None)
        x = env.simulation.state.position[:, 0]
        half[np.isnan(half) & (x > 4.0)] = env.simulation.state.time[0]
    return np.sort(half), np.sort(env.simulation.state.exit_time), env


@every_scheme
def test_a_gate_of_1_per_s_fed_by_2_per_s_has_a_queue_that_grows_by_1_per_s(name):
    place = Scenario("gate", HALL, [SOURCE], time_limit=60.0, gates=(Gate("gate", 1.0),))
    _, out, env = passed(place, name, 15.0)
    come, out = np.isfinite(env.simulation.entrances.entry_time).sum(), out[np.isfinite(out)]
    assert come == 30
    assert np.diff(out).mean() == pytest.approx(1.0, abs=0.1)
    assert all(len(out[(out >= t) & (out < t + 5.0)]) <= 7 for t in out)
    assert come - len(out) == pytest.approx(30 - (15.0 - out[0]), abs=2.0)
    assert env.metrics(0).max_outside < 0.1  # the leaf holds
    assert not env.simulation.escaped.any()


def test_a_gate_inside_lets_no_more_through_and_all_of_them():
    place = Scenario("gate", HALL, [SOURCE], time_limit=60.0, gates=(Gate("middle", 1.5),))
    half, out, _ = passed(place, "nsm2", 60.0)
    assert np.isfinite(half).all()
    assert np.isfinite(out).all()
    for span in (2.0, 5.0, 10.0):
        most = max(((half >= t) & (half < t + span)).sum() for t in half)
        assert most <= 1.5 * span + 2
    assert (len(half) - 1) / (half[-1] - half[0]) == pytest.approx(1.5, rel=0.05)


def test_a_gate_of_a_crowd_alone_has_the_bits_of_one_in_a_batch():
    place = Scenario("gate", HALL, [SOURCE, {"people": 5}], time_limit=60.0, gates=(Gate("middle", 1.5),))
    other = Scenario("other", HALL, [{"people": 35}], time_limit=60.0, closed_doors=(), gates=())
    alone = passed(place, "dem", 8.0)[2].simulation.state
    env = CrowdEnv([other, place], num_envs=2, physics={"scheme": "dem", "threads": 2})
    env.reset(seed=[1, 0])
    reference = CrowdEnv(place, physics="dem")
    reference.reset(seed=[0])
    for _ in range(80):
        env.step(None), reference.step(None)
    people = env.people(1)
    assert env.simulation.state.position[people].tobytes() == reference.simulation.state.position.tobytes()
    assert len(alone.position) == 35


def test_a_large_crowd_passes_gates_too():
    field = Geometry.from_polygon(box(0, 0, 40, 40), exits={"east": [(40, 0), (40, 40)]}, doors={"gate": "east"})
    place = Scenario("field", field, [{"people": 1200}], time_limit=10.0, gates=(Gate("gate", 5.0),))
    env = CrowdEnv(place, physics="dem")
    env.reset(seed=0)
    for _ in range(60):
        env.step(None)
    out = np.isfinite(env.simulation.state.exit_time).sum()
    assert 15 <= out <= 31


def test_a_moment_with_gates_is_restored():
    place = Scenario("gate", HALL, [SOURCE], time_limit=60.0, gates=(Gate("gate", 1.0),))
    env = passed(place, "nsm2", 7.0)[2]
    moment = env.checkpoint()

    def future():
        for _ in range(40):
            env.step(None)
        return env.simulation.state.position.tobytes()

    first = future()
    env.restore(moment)
    assert future() == first


@pytest.mark.parametrize(
    ("gates", "message"),
    [
        ([{"door": "no"}], "key 'flow' is missing"),
        ([{"door": "no", "flow": 1}], "unknown door 'no'"),
        ([{"door": "gate", "flow": 1}, {"door": "gate", "flow": 2}], "door 'gate' has 2 gates; give one flow"),
        ([{"door": "gate", "flow": 0}], "gate 'gate': flow is 0; it must be > 0"),
    ],
)
def test_a_wrong_gate_is_refused(gates, message):
    with pytest.raises(ValueError, match=message):
        CrowdEnv(Scenario("gate", HALL, [SOURCE], time_limit=60.0, gates=gates))
