"""The one loop over evacuations: each is its draw's, nothing finished is lost, and recorders see every moment."""

import numpy as np
import pytest
from evacuations import evacuated

from crowd_env import CrowdEnv, make_scenario
from crowd_env.analysis.figures import report
from crowd_env.core.executors import Processes, Serial
from crowd_env.envs.rollout import Driver, RunsInterrupted, rollout, run_episodes
from crowd_env.recording import record


def room(count=3, **options):
    return make_scenario("room-v0", people=count, **options)


def decisions(time):
    """Return the number of decision steps in which times [s] are reached."""
    return np.ceil(np.asarray(time) / 0.1 - 1e-9)


@pytest.fixture
def two_at_once(monkeypatch):
    monkeypatch.setattr("crowd_env.envs.rollout._RUNS_AT_ONCE", 2)


def test_an_episode_is_the_evacuation_of_its_draw(two_at_once):
    episodes = run_episodes(room(), 5, scheme="dem", seed=7)
    assert [(episode.run, episode.seed) for episode in episodes] == [(k, 7 + k) for k in range(5)]
    for episode in episodes:
        env = evacuated(room(), physics="dem", seed=[episode.seed])
        state = env.simulation.state
        assert repr(episode.metrics) == repr(env.metrics(0)) and episode.end == state.time[0]
        np.testing.assert_array_equal(episode.exit_time, state.exit_time)
        np.testing.assert_array_equal(episode.exit_index, state.exit_index)


def test_an_evacuation_is_yielded_when_it_ends_and_not_when_its_batch_does():
    episodes = list(rollout(room(), 20, scheme="dem"))
    ends = [decisions(episode.end) for episode in episodes]
    assert ends == sorted(ends) and len(set(ends)) > 5
    assert repr(next(rollout(room(), 20, scheme="dem"))) == repr(episodes[0])


def test_an_interruption_keeps_what_is_finished(two_at_once, monkeypatch):
    whole = run_episodes(room(), 6, scheme="dem")
    steps, step = [], CrowdEnv.step

    def interrupted(self, *args):
        steps.append(1)
        if len(steps) > 100 and self.finished.any():
            raise KeyboardInterrupt
        return step(self, *args)

    monkeypatch.setattr(CrowdEnv, "step", interrupted)
    with pytest.raises(RunsInterrupted, match="of 6 runs are finished") as stopped:
        run_episodes(room(), 6, scheme="dem")
    kept = stopped.value.episodes
    assert 2 < len(kept) < 6 and stopped.value.runs == 6
    assert {0, 1} <= {episode.run for episode in kept}  # those of the batches before too
    assert isinstance(stopped.value, KeyboardInterrupt) and report(room(), "dem", kept)["runs"] == len(kept)
    assert [repr(episode) for episode in kept] == [repr(whole[episode.run]) for episode in kept]


class Counts:
    """Counts moments of each evacuation, and how many of its people were seen inside in all."""

    def begin(self, env, runs):
        self.moments, self.inside = np.ones(env.num_envs, dtype=int), env.active.reshape(env.num_envs, -1).sum(axis=1)

    def add(self, env, step):
        self.moments += step.info["finished"] | ~env.finished
        self.inside = self.inside + env.active.reshape(env.num_envs, -1).sum(axis=1)

    def record(self, env, e):
        return int(self.moments[e]), int(self.inside[e])


def test_a_recorder_sees_every_moment_of_every_evacuation(two_at_once):
    for episode in run_episodes(room(), 5, scheme="dem", recorder=Counts()):
        moments, inside = episode.record
        assert moments == 1 + decisions(episode.end)
        assert inside == decisions(episode.exit_time).sum()


def test_some_of_the_runs_are_those_of_all(two_at_once):
    every, some = run_episodes(room(), 6, scheme="dem"), run_episodes(room(), 6, scheme="dem", only=[1, 4, 5])
    assert [repr(one) for one in some] == [repr(every[run]) for run in (1, 4, 5)]
    kept = []
    run_episodes(room(), 6, scheme="dem", only=[1, 4, 5], at_once=1, keep=kept.extend)
    assert [repr(one) for one in kept] == [repr(one) for one in some]


def test_a_driver_of_ones_own_leads_the_batches(two_at_once):
    class Idle(Driver):
        def step(self):
            return self.env.step(np.zeros((self.env.num_people, 2)))

    made = []

    def driver(num_envs):
        made.append(num_envs)
        return Idle(CrowdEnv(room(time_limit=1.0), num_envs=num_envs, physics="dem"))

    episodes = run_episodes(room(time_limit=1.0), 5, driver=driver)
    assert made == [2, 1]  # a batch of the same size is used again
    assert all(episode.metrics.unfinished == 3 for episode in episodes)


def test_nonsense_is_refused_before_anything_is_run():
    for options, words in (({"runs": 0}, "runs is 0"), ({"runs": 1, "seed": -1}, "seed is -1")):
        with pytest.raises(ValueError, match=words):
            rollout(room(), **options)


def test_a_film_has_every_moment_of_the_evacuation_of_its_seed():
    film = record(room(), scheme="dem", seed=4)
    (episode,) = run_episodes(room(), 1, scheme="dem", seed=4)
    np.testing.assert_array_equal(film.exit_time, episode.exit_time)
    assert film.times == pytest.approx(0.1 * np.arange(len(film.times)))
    assert film.end == episode.metrics.evacuation_time


@pytest.mark.more
def test_an_executor_makes_the_same_evacuations():
    expected, counts = run_episodes(room(), 7, scheme="dem", seed=2, recorder=Counts()), []
    found = run_episodes(
        room(),
        7,
        scheme="dem",
        seed=2,
        recorder=Counts(),
        executor=Processes(2),
        keep=lambda some: counts.append(len(some)),
    )
    assert repr(found) == repr(expected) and sorted(counts) == [3, 4]


def test_an_executor_keeps_what_is_finished_at_an_interruption():
    class Interrupted(Serial):
        workers = 3

        def run(self, work, pieces, done):
            super().run(work, pieces[:2], done)
            raise KeyboardInterrupt

    with pytest.raises(RunsInterrupted, match="4 of 7 runs are finished"):
        run_episodes(room(), 7, scheme="dem", executor=Interrupted())
