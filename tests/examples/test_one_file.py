"""`examples/one_file.py` computes what the package computes: steps, the first second, observations, rewards, exit times."""

import ast
import importlib.util
import sys
from functools import cache, partial

import numba
import numpy as np
import pytest
from repository import ROOT

from crowd_env import DEM, NSM1, CrowdEnv, ObservationLayout

with pytest.MonkeyPatch.context() as patch:  # to compile it takes ten times as long as these few steps in plain Python
    patch.setattr(numba, "njit", lambda function: function)
    from examples import one_file

SCHEMES = {one_file.DEM: DEM(), one_file.NSM1: NSM1(tolerance=1e-12, max_iterations=100_000)}
LAWS = pytest.mark.parametrize("law", SCHEMES, ids=["dem", "nsm1"])


@cache
def compiled():
    """Return the file compiled, as it runs by itself; here what is compiled is kept."""
    spec = importlib.util.spec_from_file_location("compiled_one_file", one_file.__file__)
    file = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(numba, "njit", partial(numba.njit, cache=True))
        spec.loader.exec_module(file)
    return file


@cache
def square(file=one_file):
    """Return the room of `room-v0` as the one file has it."""
    return file.make_room(5.0, 0.82)


def room(law, decision_dt=one_file.H, **options):
    return CrowdEnv("room-v0", physics=SCHEMES[law], decision_dt=decision_dt, **options)


def copy_of(simulation):
    """Return the crowd of a simulation as the one file has it."""
    state, bodies = simulation.state, simulation.bodies
    given = (bodies.radius, bodies.mass, bodies.desired_speed, bodies.relaxation_time, state.active, state.exit_time)
    people = len(state.active)
    return one_file.Crowd(
        *(array.copy() for array in (state.position, state.velocity, *given)), np.zeros(people), state.time.copy()
    )


@LAWS
def test_single_steps_from_recorded_states(law):
    env, touched = room(law), 0
    for draw in range(4):
        env.reset(seed=draw)
        for _ in range(5):
            for _ in range(45):
                env.step()
            crowd, state = copy_of(env.simulation), env.simulation.state
            one_file.step(square(), crowd, np.ones(20), law, tolerance=1e-13)
            env.step()
            touched += np.count_nonzero(crowd.impulse)
            inside = crowd.inside
            np.testing.assert_array_equal(inside, state.active)
            np.testing.assert_allclose(crowd.q[inside], state.position[inside], rtol=0, atol=1e-12)
            np.testing.assert_allclose(crowd.u[inside], state.velocity[inside], rtol=0, atol=1e-10)
            np.testing.assert_allclose(crowd.exit_time, state.exit_time, rtol=0, atol=1e-12)
    assert touched > 100  # people in contact


def test_the_first_second_of_soft_discs():
    env = room(one_file.DEM, decision_dt=0.1)
    for draw in range(5):
        env.reset(seed=draw)
        crowd, state = copy_of(env.simulation), env.simulation.state
        for _ in range(100):
            one_file.step(square(), crowd, np.ones(20), one_file.DEM)
        for _ in range(10):
            env.step()
        np.testing.assert_array_equal(crowd.inside, state.active)
        np.testing.assert_allclose(crowd.q[crowd.inside], state.position[crowd.inside], rtol=0, atol=1e-9)
        np.testing.assert_allclose(crowd.exit_time, state.exit_time, rtol=0, atol=1e-9)


def test_what_people_see_and_are_paid():
    layout = ObservationLayout(terms=("velocity", "desired_speed", "travel_time", "ahead"))
    weights = {"progress": 0.5, "time": 1.0, "contact": 1.0}
    env, rng = room(one_file.DEM, decision_dt=0.1, observation=layout, reward=weights), np.random.default_rng(0)
    expected, _ = env.reset(seed=0)
    crowd, seen = copy_of(env.simulation), np.zeros((20, one_file.SEEN), np.float32)
    to_go = one_file.look(square(), crowd, seen)
    np.testing.assert_allclose(seen, expected, rtol=0, atol=1e-6)
    for _ in range(15):
        share = rng.choice(one_file.SPEEDS, 20)
        to_go, reward = one_file.decide(square(), crowd, share, one_file.DEM, to_go, seen)
        step = env.step(np.column_stack([share, np.zeros(20)]))
        inside = crowd.inside
        np.testing.assert_allclose(seen[inside], step.observation[inside], rtol=0, atol=1e-6)
        np.testing.assert_allclose(reward, step.reward, rtol=0, atol=1e-6)


@pytest.mark.more
@LAWS
def test_exit_times_have_the_same_distribution(law, draws=60):
    """Kolmogorov and Smirnov, over draws: the time by which half are out, and all."""
    one_file = compiled()
    env = CrowdEnv("room-v0", num_envs=draws, physics=("dem", "nsm1")[law])
    env.reset(seed=0)
    while not env.finished.all():
        env.step()
    theirs = np.nan_to_num(env.simulation.state.exit_time.reshape(draws, 20), nan=60.0)
    ours = np.full((draws, 20), 60.0)
    for draw in range(draws):
        crowd = one_file.draw_crowd(square(one_file), 20, np.random.default_rng(draw))
        while crowd.inside.any() and crowd.clock[0] < 60.0:
            one_file.step(square(one_file), crowd, np.ones(20), law, tolerance=1e-2)
        ours[draw, ~crowd.inside] = crowd.exit_time[~crowd.inside]
    for a, b in (
        (np.median(times, axis=1) for times in (ours, theirs)),
        (times.max(axis=1) for times in (ours, theirs)),
    ):
        at = np.concatenate([a, b])
        apart = np.abs((a[:, None] <= at).mean(axis=0) - (b[:, None] <= at).mean(axis=0)).max()
        assert apart < 1.95 * np.sqrt(2 / draws)  # p = 0.001


@pytest.mark.more
def test_a_few_rollouts_and_a_picture():
    pytest.importorskip("torch")
    one_file = compiled()
    act = one_file.learn(square(one_file), 6, seed=0, rollouts=2, rooms=2, decisions=8)
    crowd = one_file.evacuate(square(one_file), 6, 0, act, until=1.0)
    assert crowd.clock[0] == pytest.approx(1.0)
    assert set(act(np.zeros((50, one_file.SEEN), np.float32), np.random.default_rng(0))) <= set(one_file.SPEEDS)
    assert "".join(one_file.picture(square(one_file), crowd)).count("o") == 6


@pytest.mark.nightly
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_learned_crowd_leaves_nobody_inside(seed, capsys):
    pytest.importorskip("torch")
    one_file = compiled()
    one_file.main(seed)
    table = capsys.readouterr().out.splitlines()
    blocked = {line[:10].strip(): int(line.split(" of ")[0].split()[-1]) for line in table if " of 20 " in line}
    assert blocked["full speed"] >= 4
    assert blocked["learned"] == 0


def test_it_is_one_page_of_three_libraries():
    text = (ROOT / "examples" / "one_file.py").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 400
    imported = {
        name.split(".")[0]
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Import | ast.ImportFrom)
        for name in ([node.module] if isinstance(node, ast.ImportFrom) else [alias.name for alias in node.names])
    }
    assert imported == {"numba", "numpy", "sys", "time", "torch", "typing"}
