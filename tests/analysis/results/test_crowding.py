"""What is collected while runs go on, against positions and by hand on tiny crowds."""

from dataclasses import replace

import numpy as np
import pytest

from crowd_env import Cohorts, CrowdEnv, Population, make_scenario, record
from crowd_env.analysis.results.crowding import CrowdingRecorder, wall_pieces
from crowd_env.analysis.results.measurements import CELL
from crowd_env.envs.rollout import Recorders, run_episodes
from crowd_env.physics.pressure import INJURY
from crowd_env.recording import RunRecorder


def hall(starts, speed=1.0, **options):
    """Return a hall of 20 m x 12 m, exits of 1 m in the middle of its short sides, with people where they are put."""
    people = Population(len(starts), starts=starts, radius=0.2, mass=80.0, desired_speed=speed)
    return make_scenario("two-exit-hall-v0", population=people, **options)


def collected(place, steps=None, **options):
    """Return what is collected of one run, of so many decisions or until its end."""
    recorder = CrowdingRecorder(place.geometry)
    if steps is None:
        return run_episodes(place, 1, recorder=recorder, **options)[0].record
    env = CrowdEnv(place, physics=options.get("scheme", "dem"))
    env.reset(0)
    recorder.begin(env, [0])
    for _ in range(steps):
        recorder.add(env, env.step())
    return recorder.record(env, 0)


def test_who_stands_alone_is_one_person_on_the_map_and_at_the_best_level():
    found = collected(hall([(3.1, 2.3)], speed=0.0, time_limit=2.0), scheme="dem")
    assert found.density.sum() * CELL**2 == pytest.approx(1.0, rel=0.02)
    assert not found.pressure.any() and found.squeezed == 0.0
    assert found.service[0] == pytest.approx(2.5) and not found.service[1:].any()  # five samples of 0.5 s
    assert found.zone_most.tolist() == [1] and np.isnan(found.zone_empty[0])  # the western half


def test_a_zone_is_empty_from_the_time_on_at_which_the_last_has_left_it():
    """That pedestrian may be the last of all, so that the run ends before the next sample."""
    place = hall([(1.2, 6.0)])
    both = Cohorts((place.population, hall([(16.0, 2.0)], speed=0.0).population))
    last, first = (
        collected(replace(place, population=people, time_limit=5.0), scheme="dem", strategy="nearest").zone_empty
        for people in (place.population, both)
    )
    assert last[0] == pytest.approx(first[0]) and 1.0 < last[0] < 3.0


def test_who_walks_straight_out_has_not_queued_and_who_stands_before_a_closed_way_has():
    free = collected(hall([(4.0, 6.0)]), scheme="dem", strategy="nearest")
    assert free.queue.tolist() == [0, 0] and free.wait[0] == 0.0 and np.isnan(free.wait[1])
    late = hall([(4.0, 6.0)])
    late = make_scenario("two-exit-hall-v0", population=late.population.changed(response_time=3.0))
    assert collected(late, scheme="dem", strategy="nearest").wait[0] == 0.0  # standing still on purpose is no queue


def test_queues_are_those_of_recorded_positions():
    place = replace(make_scenario("two-exit-hall-v0", people=30), manner="hurried")
    seen = Recorders(crowding=CrowdingRecorder(place.geometry), recording=RunRecorder())
    (episode,) = run_episodes(place, 1, recorder=seen, scheme="dem", strategy="nearest")
    found, recording = episode.record["crowding"], episode.record["recording"]
    where = np.full((len(recording.times), 30, 2), np.nan)
    where[recording.frame, recording.person] = recording.position
    time = recording.times
    held = np.zeros((0, 30), dtype=bool)
    for k in range(10, len(time), 5):  # in the first half second they speed up
        moved = np.hypot(*(where[k] - where[k - 5]).T)
        inside = ~(episode.exit_time <= time[k] + 1e-9)
        held = np.vstack([held, inside & (moved < 0.5 * 0.5 * episode.desired_speed)])
    west = episode.exit_index == 0
    assert west.sum() > 15 and found.queue[0] > 3
    assert found.queue[0] == held[:, west].sum(axis=1).max()
    assert found.wait[0] == pytest.approx(0.5 * held[:, west].sum(axis=0).mean())


@pytest.mark.parametrize("scheme", ["dem", "nsm2"])
def test_pressures_are_those_of_the_recording(scheme):
    place = make_scenario("two-exit-hall-v0", people=30)
    seen = Recorders(crowding=CrowdingRecorder(place.geometry), recording=RunRecorder())
    (episode,) = run_episodes(place, 1, recorder=seen, scheme=scheme, strategy="nearest")
    found, recording = episode.record["crowding"], episode.record["recording"]
    assert found.left_out == 0
    of_frame = np.zeros((len(recording.times), 30))
    of_frame[recording.frame, recording.person] = np.nan_to_num(recording.pressure)
    assert found.impact == pytest.approx(of_frame.max())
    # Means of whole seconds, and how long these are; of who leaves within one, of that part, or of half a second at least.
    means = []
    for person in range(30):
        out = int(np.ceil(episode.exit_time[person] / 0.1 - 1e-9))  # the frame in which this one was out
        for first in range(1, out + 1, 10):
            last = min(first + 9, out)
            frames = max(last - first + 1, 5)
            means.append((of_frame[first : last + 1, person].sum() / frames, 0.1 * frames))
    mean, lasted = np.array(means).T
    assert found.pressure.max() == pytest.approx(mean.max(), rel=1e-6)
    assert mean.max() < 0.8 * found.impact
    assert found.squeezed == pytest.approx(lasted[mean > INJURY].sum())


def test_moments_that_a_solver_did_not_finish_are_left_out_and_counted():
    place = hall([(0.3 + 0.41 * k, 4.8 + 0.41 * m) for k in range(5) for m in range(6)], time_limit=3.0)
    env = CrowdEnv(place, physics={"name": "nsm2", "max_iterations": 8})
    recorder = CrowdingRecorder(place.geometry)
    env.reset(0)
    recorder.begin(env, [0])
    whole, cut = [], []  # the largest pressure of each decision, by whether all of its steps were finished
    while not env.finished.all():
        step = env.step()
        recorder.add(env, step)
        results = env.simulation.results
        pressure = results.impulse_magnitude / (0.1 * 2.0 * np.pi * 0.2)
        (cut if results.diagnostics.unconverged[0] else whole).append(pressure.max())
    found = recorder.record(env, 0)
    assert found.left_out == len(cut) > 0 and max(cut) > max(whole) > 0.0
    assert found.impact == pytest.approx(max(whole), rel=1e-6)
    assert 0.0 < found.pressure.max() <= max(whole)


def test_nothing_depends_on_the_batch():
    place = make_scenario("two-exit-hall-v0", people=12)
    alone, together = (
        [
            one.record
            for one in run_episodes(place, 3, scheme="dem", recorder=CrowdingRecorder(place.geometry), at_once=k)
        ]
        for k in (1, 3)
    )
    for one, other in zip(alone, together, strict=True):
        for a, b in zip(one, other, strict=True):
            np.testing.assert_array_equal(a, b)


def test_recording_changes_nothing():
    place = make_scenario("two-exit-hall-v0", people=12)
    recording = record(place, scheme="dem", seed=0)
    (episode,) = run_episodes(place, 1, scheme="dem", seed=0, recorder=CrowdingRecorder(place.geometry))
    np.testing.assert_array_equal(recording.exit_time, episode.exit_time)


@pytest.mark.parametrize("scheme", ["dem", "nsm2", "hertz"])
def test_the_load_of_a_wall_is_the_drive_of_who_leans_on_it(scheme):
    # Two of 80 kg, 1 m/s and 0.5 s lean on the western wall: 160 N each, 300 N at most, on pieces of 1.1 m (5.5 m in 5).
    people = Population(
        2, starts=[(0.2, 2.75), (0.2, 9.75)], radius=0.2, mass=80.0, desired_speed=1.0, relaxation_time=0.5
    )
    hall = make_scenario("two-exit-hall-v0", population=people, time_limit=4.0)
    env = CrowdEnv(hall, physics=scheme, action={"name": "continuous", "frame": "world"})
    recorder = CrowdingRecorder(hall.geometry)
    env.reset(0)
    recorder.begin(env, [0])
    while not env.finished.all():
        recorder.add(env, env.step(np.array([[-1.0, 0.0], [-1.0, 0.0]])))
    found, pieces = recorder.record(env, 0).wall_load, wall_pieces(hall.geometry)
    length = np.hypot(*(pieces[:, 1] - pieces[:, 0]).T)
    assert length.sum() == pytest.approx(np.hypot(*(hall.geometry.walls[:, 1] - hall.geometry.walls[:, 0]).T).sum())
    assert (length[length > 1.0] < 2.0).all()
    loaded = np.flatnonzero(found > 0.3 * found.max())
    assert sorted(np.round(pieces[loaded].mean(axis=1)[:, 0], 6)) == [0.0, 0.0]
    assert found[loaded] * length[loaded] == pytest.approx(160.0, rel=0.05)
