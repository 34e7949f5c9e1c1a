"""Crowds that have come to rest are not simulated to the end of the wait: what comes of them is as if they had been."""

from dataclasses import replace

import numpy as np
import pytest
from cases import looped
from evaluations import NAMES, RULED, hall, run

from crowd_env import CrowdEnv, Uniform
from crowd_env.agents import drivers
from crowd_env.agents.evaluation.entries import make_entries
from crowd_env.agents.evaluation.evaluation import evaluate_crowd
from crowd_env.agents.tasks import TASKS
from crowd_env.envs.tasks.task import HELD_OUT_SEED
from crowd_env.physics.simulation.simulation import Simulation
from crowd_env.recording import record

ASKED = ("blocked_since", "unfinished", "evacuation_time", "flow", "escaped", "max_overlap")
REST = drivers.REST


@pytest.fixture
def steps(monkeypatch):
    """Return a list that grows with every decision step that physics takes."""
    taken, advance = [], Simulation.advance
    monkeypatch.setattr(Simulation, "advance", lambda self, *a, **k: (taken.append(1), advance(self, *a, **k))[1])
    return taken


def judged(monkeypatch, name, task, rest, **options):
    monkeypatch.setattr(drivers, "REST", rest)
    place = task.place()
    (entry,) = make_entries([name], place, task)
    options |= {"measure": True, "first_seed": 1_000_001}
    return evaluate_crowd(entry.driver(place), **options)


@pytest.mark.more
@looped(
    ("task", "name", "runs"),
    [("competitive-door", "rule", 5), ("hertz-room", "rule", 5), ("narrow-door", "rule", 4), ("room", "shortest", 2)],
)
def test_what_comes_of_a_run_is_as_if_it_had_waited(monkeypatch, steps, task, name, runs):
    steps.clear()
    ours = judged(monkeypatch, name, TASKS[task], REST, runs=runs)
    few = len(steps)
    waited = judged(monkeypatch, name, TASKS[task], -1.0, runs=runs)
    assert np.isfinite(waited.column("blocked_since")).any() == (task != "room")
    if task == "competitive-door":  # where exits count as blocked after two minutes
        assert few < 0.75 * (len(steps) - few)
    for one, other in zip(ours.exit_times, waited.exit_times, strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_allclose(ours.ended, waited.ended, rtol=0.0, atol=1e-6)
    for column in ASKED:
        np.testing.assert_array_equal(ours.column(column), waited.column(column))
    np.testing.assert_allclose(ours.column("contact_impulse"), waited.column("contact_impulse"), rtol=1e-3)
    for column in ("walked", "crushed", "max_density", "max_pressure"):
        np.testing.assert_allclose(getattr(ours.measured, column), getattr(waited.measured, column), atol=2e-3)
    for one, other in zip(ours.measured.maps, waited.measured.maps, strict=True):
        np.testing.assert_allclose(one, other, atol=0.01 * other.max())


def test_a_crowd_that_stands_is_over_at_once_and_ends_when_it_would_have(steps):
    still = hall(time_limit=100.0, blocked_after=20.0)
    found = run("stand-still", still)
    env, first = CrowdEnv(still), []
    for seed in range(HELD_OUT_SEED, HELD_OUT_SEED + 3):
        env.reset([seed])
        first.append(env.observer.view.potential.min())  # s, when somebody could be out
    # The wait ends with the first decision after it.
    np.testing.assert_array_less(20.0 + np.array(first), found.ended)
    np.testing.assert_array_less(found.ended, 20.1 + np.array(first) + 1e-6)
    assert len(steps) <= 40 and found.measured.simulated == pytest.approx(found.ended.sum())
    assert found.column("blocked_since").tolist() == [0.0] * 3
    steps.clear()
    assert run("stand-still", replace(still, blocked_after=np.inf)).ended == pytest.approx(100.0) and len(steps) <= 40


def test_who_has_not_begun_to_walk_is_not_at_rest():
    place = hall(3, 60.0, blocked_after=30.0)
    late = replace(place, population=place.population.changed(response_time=Uniform(15.0, 15.0)))
    assert run("shortest", late).column("unfinished").tolist() == [0] * 3


def test_nobody_rests_who_may_go_on_by_oneself():
    """Who loses patience, finds another way, obeys a sign or draws what to do may walk again."""
    place, task = TASKS["competitive-door"].place(), TASKS["competitive-door"]
    entries = [(one, RULED) for one in make_entries(NAMES, RULED)]
    entries += [(one, replace(RULED, manner="eager")) for one in make_entries(["shortest"], RULED)]
    entries += [(one, place) for one in make_entries([f"{task.name}/ppo", f"{task.name}/ppo:sampled"], place, task)]
    made = [entry.driver(place)(1) for entry, place in entries]
    rest = [
        entry.name
        for (entry, _), driver in zip(entries, made, strict=True)
        if drivers.rests_for_good(driver.env, driver.policy)
    ]
    assert rest == ["shortest", "nearest", "west", "stand-still", "competitive-door/ppo"]


def test_a_film_shows_the_whole_wait():
    film = record(hall(time_limit=8.0), driver=make_entries(["stand-still"], hall())[0].driver(hall(time_limit=8.0)))
    assert np.diff(film.times).max() < 0.2
