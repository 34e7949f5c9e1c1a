"""What a row says, and that a run does not notice that it is recorded."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from cases import looped
from recordings import CASES

from crowd_env import CrowdEnv, contact_pressure, make_scenario
from crowd_env.core.executors import Processes
from crowd_env.envs.rollout import run_episodes
from crowd_env.recording import RunRecorder, load, record
from crowd_env.recording.exits import APRON, places_beyond

ROOM = make_scenario("room-v0")


def test_rows_are_those_of_the_environment():
    """Everyone inside has a row in every frame, as the arrays of the environment have it."""
    kept = record(ROOM, seed=5, scheme="nsm2", contacts=True)
    env = CrowdEnv(ROOM)
    env.reset([5])
    np.testing.assert_array_equal(kept.radius, env.simulation.bodies.radius)
    for k in range(len(kept.times) - 1):
        rows = slice(*kept.frame_start[k : k + 2])
        inside = ~kept.beyond[rows]
        who = kept.person[rows][inside]
        assert kept.times[k] == pytest.approx(0.1 * k)
        np.testing.assert_array_equal(who, np.flatnonzero(env.active))
        np.testing.assert_array_equal(kept.position[rows][inside], env.simulation.state.position[who])
        np.testing.assert_array_equal(kept.velocity[rows][inside], env.simulation.state.velocity[who])
        pressure = contact_pressure(env.simulation.results.impulse_magnitude, 0.1, kept.radius)[who]
        assert kept.pressure[rows][inside] == pytest.approx(pressure * (k > 0))
        if not env.finished.all():
            env.step(None)
    np.testing.assert_array_equal(kept.exit_time, env.simulation.state.exit_time)
    assert np.isfinite(kept.exit_time).all()


@looped("case", CASES)
def test_who_leaves_has_two_rows_beyond_the_exit_line_in_the_frames_after(case):
    scenario, run, options = CASES[case]
    kept = record(scenario, seed=1, **run, **options)
    lines = np.array([line for _, line in kept.exits])
    out = np.flatnonzero(np.isfinite(kept.exit_time))
    assert len(out) and kept.beyond.sum() == 2 * len(out)
    for person in out:
        rows = np.flatnonzero(kept.person == person)
        assert kept.beyond[rows].tolist() == [False] * (len(rows) - 2) + [True, True]
        frames = kept.frame[rows]
        assert (np.diff(frames) == 1).all() and frames[0] == 0
        assert kept.times[frames[-3]] < kept.exit_time[person] <= kept.times[frames[-2]]
        (a, b), x = lines[kept.exit_index[person]], kept.position[rows]
        along = (b - a) / np.hypot(*(b - a))
        depth = (x - a) @ [along[1], -along[0]]
        assert depth[-3] <= 0.0 and depth[-2] >= 0.0499 and depth[-1] - depth[-2] >= 0.0499 and depth[-1] < APRON
    for person in np.flatnonzero(~np.isfinite(kept.exit_time)):
        assert kept.times[kept.frame[kept.person == person][-1]] == pytest.approx(scenario.time_limit)


def test_everybody_crosses_the_line_between_two_frames():
    """Whoever looks at frames alone sees the straight way from the row before cross the exit line, wherever they come from."""
    rng = np.random.default_rng(0)
    count = 2000
    ends = rng.uniform(-5, 5, (count, 2, 2))
    ends[:, 1] = ends[:, 0] + rng.uniform(0.3, 3, (count, 1)) * np.stack(
        [np.cos(a := rng.uniform(0, 7, count)), np.sin(a)], 1
    )
    along = ends[:, 1] - ends[:, 0]
    length = np.hypot(*along.T)
    along /= length[:, None]
    outward = np.stack([along[:, 1], -along[:, 0]], 1)
    crossed = ends[:, 0] + along * (length * rng.uniform(0, 1, count))[:, None]
    interval = 0.1
    since = rng.uniform(0, interval, count)
    velocity = outward * rng.uniform(0, 4, (count, 1)) + along * rng.uniform(-3, 3, (count, 1))
    # The way before the crossing need not have been straight.
    before = crossed - velocity * (interval - since)[:, None] - outward * rng.uniform(0, 0.1, (count, 1))
    before += along * rng.uniform(-0.3, 0.3, (count, 1))
    places = places_beyond(ends, before, crossed + 0.005 * velocity, velocity, since, interval)
    (d0, s0), (d1, s1) = (
        (((x - ends[:, 0]) * outward).sum(1), ((x - ends[:, 0]) * along).sum(1)) for x in (before, places[0])
    )
    meets = s0 + (s1 - s0) * d0 / (d0 - d1)
    assert (d1 >= 0.05 - 1e-12).all()
    possible = ((s0 > 0.0) & (s0 < length)) | (d0 < -0.15)  # nobody's center is nearer to the wall beside the door
    assert possible.mean() > 0.5 and ((meets > 0) & (meets < length))[possible].all()
    straight = places[0] - crossed - velocity * since[:, None]
    assert (np.hypot(*straight.T) < 1e-9).mean() > 0.2  # where nothing is in the way, that is where they are


@pytest.mark.parametrize(
    "executor", [None, pytest.param(Processes(2), marks=pytest.mark.more)], ids=["here", "processes"]
)
def test_recorded_runs_are_the_same_bit_by_bit(executor, tmp_path):
    runs = 4
    plain = run_episodes(ROOM, runs, seed=7)
    recorder = RunRecorder(tmp_path / "run.sqlite", runs=2, contacts=True, seed=7)
    recorded = run_episodes(ROOM, runs, seed=7, recorder=recorder, executor=executor)
    for one, other in zip(plain, recorded, strict=True):
        np.testing.assert_array_equal(one.exit_time, other.exit_time)
        np.testing.assert_equal(one.metrics._asdict(), other.metrics._asdict())
    assert [episode.record for episode in recorded] == [
        tmp_path / "run-0.sqlite",
        tmp_path / "run-1.sqlite",
        None,
        None,
    ]
    for k in range(2):
        kept = load(recorded[k].record)
        np.testing.assert_array_equal(kept.exit_time, plain[k].exit_time)
        assert (kept.facts["run"], kept.facts["seed"]) == (k, 7 + k)


class Received(RunRecorder):
    """Also keeps what everyone has received by contacts in each decision [N s]."""

    def begin(self, env, runs):
        super().begin(env, runs)
        self.impulse = []

    def add(self, env, step):
        super().add(env, step)
        self.impulse.append(env.simulation.results.impulse.copy())

    def record(self, env, e):
        return super().record(env, e), self.impulse


@pytest.mark.parametrize("scheme", ["nsm2", "nsm1-inertial", "dem", "hertz", "torso"])
def test_mean_forces_add_up_to_the_impulse_that_people_received(scheme, every=3):
    """Action and reaction: over the time between frames, the contacts of a person bring what that one has received."""
    room = make_scenario("room-v0", people=30, side=5.0, door_width=0.8, time_limit=4.0)
    place = replace(room, outline="torso" if scheme == "torso" else None)
    recorder = Received(contacts=True, every=every / 10)
    options = {"scheme": scheme.replace("torso", "hertz"), "seed": 4}
    (episode,) = run_episodes(place, 1, recorder=recorder, **options)
    kept, impulse = episode.record
    compared = 0
    for k in range(1, int((kept.times <= episode.end + 1e-9).sum())):  # one frame more may show who got out last
        contacts = kept.contacts
        there = slice(*contacts.start[k : k + 2])
        before, now = (kept.times[k - 1], kept.times[k])
        expected = np.sum(impulse[round(10 * before) : round(10 * now)], axis=0)
        if ((kept.exit_time > before) & (kept.exit_time <= now)).any():
            continue  # contacts with people who have left are not told
        n, f = contacts.normal[there], contacts.force[there] * (now - before)
        pushes = f[:, :1] * n + f[:, 1:] * np.stack([-n[:, 1], n[:, 0]], axis=1)
        found, i, j = np.zeros_like(expected), contacts.i[there], contacts.j[there]
        np.add.at(found, i, pushes)
        np.add.at(found, j[j >= 0], -pushes[j >= 0])
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max(initial=1.0))
        compared += len(i)
    assert compared > 40


def test_a_contact_tells_where_two_touched():
    kept = record(ROOM, seed=2, scheme="dem", contacts=True)
    contacts = kept.contacts
    k = int(np.argmax(np.diff(contacts.start)))
    rows, people = slice(*contacts.start[k : k + 2]), slice(*kept.frame_start[k : k + 2])
    i, j = contacts.i[rows], contacts.j[rows]
    assert len(i) > 5 and (np.diff(i) >= 0).all() and (contacts.normal[rows] ** 2).sum(axis=1) == pytest.approx(1.0)
    inside = set(kept.person[people][~kept.beyond[people]])
    assert set(i) <= inside and set(j[j >= 0]) <= inside and len({*zip(i, j, strict=True)}) == len(i)
    where = np.zeros((len(kept.radius), 2))
    where[kept.person[people]] = kept.position[people]
    pairs = j >= 0
    middle = 0.5 * (where[i] + where[j])[pairs]
    assert np.hypot(*(contacts.point[rows][pairs] - middle).T).max() < 0.1  # 0.1 s before at most


@pytest.mark.more
def test_a_simulation_that_was_listened_to_goes_on_alone(tmp_path):
    env = CrowdEnv("room-v0", num_envs=2)
    recorder = RunRecorder(tmp_path / "run.sqlite", contacts=True)
    for close in (recorder.close, lambda: recorder.begin(env, [7, 8])):  # a batch that broke off
        env.reset(seed=0)
        recorder.begin(env, [0, 1])
        assert len(env.simulation.listeners) == 1
        close()
        assert not env.simulation.listeners


@pytest.mark.more
def test_large_crowds_are_the_same_bit_by_bit():
    """They lie in the order of space, which is made anew now and then, never for a listener."""
    place = make_scenario("room-v0", side=40.0, people=1200, door_width=2.0, time_limit=2.5)
    plain, listened = (CrowdEnv(place, physics="dem") for _ in range(2))
    told = []
    listened.simulation.listeners.append(lambda: told.append(float(listened.simulation.state.time[0])))
    for env in (plain, listened):
        assert env.simulation._sorted is not None
        env.reset(seed=1)
        while not env.finished.all():
            env.step(None)
    assert len(told) == len(set(told)) == round(2.5 / plain.simulation.dt)
    for name in ("position", "velocity", "exit_time"):
        np.testing.assert_array_equal(getattr(plain.simulation.state, name), getattr(listened.simulation.state, name))


def test_the_number_inside_is_that_of_the_exit_times():
    kept = record(ROOM, seed=2)
    assert kept.inside(0.0) == 20 and kept.inside(kept.times[-1]) == 0
    middle = np.sort(kept.exit_time)[9]
    assert kept.inside([middle - 1e-9, middle]).tolist() == [11, 10]


@pytest.mark.more
def test_a_recorder_travels_while_it_records(tmp_path):
    env = CrowdEnv("room-v0", num_envs=2)
    env.reset(seed=0)
    recorder = RunRecorder(tmp_path / "run.sqlite", runs=[1])
    recorder.begin(env, [0, 1])
    copied = pickle.loads(pickle.dumps(recorder))
    assert copied.runs == {1} and copied.path == recorder.path
    assert [path.name for path in tmp_path.iterdir()] == ["run.part.sqlite"]


def test_frames_further_apart_than_a_run_is_long_are_refused():
    env = CrowdEnv("room-v0", people=2, time_limit=20.0)
    with pytest.raises(ValueError, match="every is 1000 s, longer than the 20 s of a run"):
        RunRecorder(runs=[0], every=1000.0).begin(env, [0])
