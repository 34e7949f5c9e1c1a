"""Threads that work together: none is left behind by Ctrl-C, a fork, a copy or a pickle."""

import copy
import multiprocessing
import os
import pickle
import signal
import threading
import time

import numpy as np
import pytest
from cases import looped

from crowd_env import CrowdEnv, Physics, make_scenario
from crowd_env.core.arrays.state import make_state
from crowd_env.core.kernels.threads import Workers
from crowd_env.physics import DEM
from crowd_env.physics.simulation.simulation import Simulation

can_interrupt = pytest.mark.skipif(
    not hasattr(signal, "pthread_kill"), reason="signals cannot be sent to a thread here"
)
can_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="processes cannot be forked here")


@pytest.fixture(autouse=True)
def listens_to_ctrl_c():
    """A shell that starts the tests in the background has them ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def press_ctrl_c():
    signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)


def test_parts_run_at_the_same_time_each_once():
    here, ended = threading.Barrier(3), []

    def work(part):
        here.wait(60)
        ended.append(part)

    workers = Workers()
    for _ in range(3):
        workers.run(work, [(k,) for k in range(3)])
    assert sorted(ended) == [0, 0, 0, 1, 1, 1, 2, 2, 2]


def test_more_parts_than_before_get_a_thread_each_too():
    workers = Workers()
    for parts in (2, 4):
        here = threading.Barrier(parts)
        workers.run(lambda _, here=here: here.wait(60), [(k,) for k in range(parts)])


def test_an_error_of_one_part_is_raised_when_the_others_have_ended():
    ended = []

    def work(part):
        if part == 0:
            raise ValueError("part 0")
        time.sleep(0.05)
        ended.append(part)

    workers = Workers()
    with pytest.raises(ValueError, match="part 0"):
        workers.run(work, [(0,), (1,), (2,)])
    assert sorted(ended) == [1, 2]


@can_interrupt
def test_ctrl_c_goes_on_when_all_parts_have_ended():
    here, ended = threading.Barrier(2), []

    def work(part):
        if part == 0:
            press_ctrl_c()
        time.sleep(0.05)
        here.wait(60)
        ended.append(part)

    workers = Workers()
    with pytest.raises(KeyboardInterrupt):
        workers.run(work, [(0,), (1,)])
    assert sorted(ended) == [0, 1]
    workers.run(work, [(1,), (2,)])
    assert sorted(ended) == [0, 1, 1, 2]


@can_interrupt
def test_ctrl_c_between_two_requests_leaves_nobody_waiting_for_a_part_that_never_begins(monkeypatch):
    here, ended, workers = threading.Barrier(2), [], Workers()

    def work(part):
        here.wait(60)
        ended.append(part)

    workers.run(work, [(0,), (1,)])
    submit, calls = workers._pool.submit, []

    def interrupted(task):
        calls.append(submit(task))
        if len(calls) == 1:
            raise KeyboardInterrupt

    monkeypatch.setattr(workers._pool, "submit", interrupted)
    with pytest.raises(KeyboardInterrupt):
        workers.run(work, [(2,), (3,)])
    assert sorted(ended) == [0, 1, 2, 3]
    assert len(calls) == 3  # once too often, which does no harm


class Interrupted(DEM):
    """Soft discs in the midst of whose step somebody presses Ctrl-C."""

    def advance(self, batch, dt, n_substeps, first, stop, thread=0, threads=1, *, desire=None):
        if (thread or first) and not pressed:  # the second thread
            pressed.append(True)
            press_ctrl_c()
        super().advance(batch, dt, n_substeps, first, stop, thread, threads, desire=desire)


pressed = []


def large(scheme, threads):
    place = make_scenario("room-v0", people=4050, side=42.0)
    bodies, position = place.population.draw(np.random.default_rng(0), place.geometry)
    return Simulation(place.geometry, bodies, make_state(position), physics=Physics(scheme, threads=threads))


@can_interrupt
def test_a_shared_crowd_goes_on_after_ctrl_c():
    simulation, expected = large(Interrupted(), threads=2), large(DEM(), threads=1)
    pressed.clear()
    with pytest.raises(KeyboardInterrupt):
        simulation.advance(n_substeps=10)
    assert pressed
    simulation.advance(n_substeps=10)
    for _ in range(2):
        expected.advance(n_substeps=10)
    for ours, then in zip(simulation.state, expected.state, strict=True):
        np.testing.assert_array_equal(ours, then)


@can_interrupt
def test_a_step_goes_on_with_the_one_that_was_interrupted_and_nobody_is_lost():
    env = CrowdEnv("room-v0", num_envs=2, physics=Physics(Interrupted(), threads=2))
    env.reset([1, 2])
    paid, left = np.zeros(40), np.zeros(40, dtype=int)
    for k in range(200):
        pressed[:] = [True] if k % 3 else []
        try:
            step = env.step(None)
        except KeyboardInterrupt:
            continue
        paid += step.info["reward/time"]
        left += step.terminated
    assert env.finished.all()
    assert (left == 1).all()
    np.testing.assert_allclose(paid, -env.simulation.state.exit_time, atol=1e-9)


def stepped(env, steps=3):
    for _ in range(steps):
        env.step(None)
    return env.simulation.state.position.tobytes()


def threaded(**options):
    """Return a batch of which physics and observations are shared out."""
    env = CrowdEnv(
        make_scenario("room-v0", side=14.0), num_envs=4, people=260, physics=Physics("dem", threads=2), **options
    )
    env.reset(0)
    env.step(None)
    return env


@looped("how", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))], ids=["copy", "pickle"])
def test_an_environment_with_threads_can_be_copied_and_pickled(how):
    env = threaded()
    other = how(env)
    assert stepped(other) == stepped(env)
    assert not np.shares_memory(other.simulation.state.position, env.simulation.state.position)


@can_fork
@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of forking where threads run: that is what this is about
def test_a_forked_process_steps_what_it_inherits():
    env = threaded()
    context = multiprocessing.get_context("fork")
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=lambda: there.send_bytes(stepped(env)), daemon=True)
    process.start()
    try:
        assert here.poll(120), "the child waits for threads that it does not have"
        assert here.recv_bytes() == stepped(env)
    finally:
        process.kill()
        process.join()
