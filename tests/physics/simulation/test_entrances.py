"""People who come in during an episode: counted, without overlap, in order, the same to the bit however computed."""

from dataclasses import replace

import numpy as np
import pytest
from crowds import every_scheme
from evacuations import evacuated

from crowd_env import CrowdEnv, Geometry, Scenario
from crowd_env.geometry.geometry import box
from crowd_env.recording import record

HALL = Geometry.from_polygon(box(0, 0, 6, 3), exits={"east": [(6, 0.5), (6, 2.5)]}, regions={"west": box(0, 0, 2, 3)})


def hall(*people, **options):
    return Scenario("hall", HALL, list(people), time_limit=options.pop("time_limit", 30.0), **options)


def along_the_edge(rate=4.0, **options):
    return {"arrivals": {"rate": rate, "until": 3.0, "line": [(0, 0.5), (0, 2.5)], **options}}


BUSY = hall({"people": 4}, along_the_edge(), {"arrivals": {"timetable": [(1.05, 3)]}, "start_region": "west"})


@every_scheme
def test_people_inside_are_arrivals_less_exits_and_overlap_nobody_when_they_come(name):
    env = CrowdEnv(BUSY, physics=name)
    env.reset(seed=1)
    simulation, least = env.simulation, [np.inf]
    state, radius, let_in = simulation.state, simulation.bodies.radius, simulation.entrances.update

    def watched(*args):
        before = state.active.copy()
        entered = let_in(*args)
        for i in np.flatnonzero(state.active & ~before):
            others = np.flatnonzero(state.present & (np.arange(len(radius)) != i))
            gap = np.hypot(*(state.position[others] - state.position[i]).T) - radius[others] - radius[i]
            least[0] = min(least[0], gap.min(initial=np.inf), HALL.clearance(state.position[i])[0] - radius[i])
        return entered

    simulation.entrances.update = watched
    while not env.finished.all():
        env.step(None)
        come, out = np.isfinite(simulation.entrances.entry_time).sum(), np.isfinite(state.exit_time).sum()
        assert env.active.sum() == come - out
    assert come > 8
    assert come == out
    assert least[0] >= -1e-8
    assert env.metrics(0).unfinished == 0


@every_scheme
def test_a_crowd_alone_in_a_batch_and_under_threads_has_the_same_bits(name):
    others = hall({"people": 6}, along_the_edge(rate=7.0))

    def ended(places, which, **physics):
        env = CrowdEnv(places, num_envs=len(places), physics={"scheme": name, **physics})
        env.reset(seed=[3 if place is BUSY else 4 for place in places])
        for _ in range(45):
            env.step(None)
        people, simulation = env.people(which), env.simulation
        state = (*simulation.state[:-1], simulation.entrances.entry_time)
        return [column[people].tobytes() for column in state] + [float(simulation.state.time[which])]

    alone = ended([BUSY], 0)
    assert ended([others, BUSY, others], 1) == alone
    assert ended([others, others, BUSY], 2, threads=2) == alone


def test_the_clock_of_an_empty_place_goes_on_until_the_first_comes():
    late = {"arrivals": {"times": [4.0, 4.5]}, "start_region": "west", "response_time": 1.0, "desired_speed": 1.0}
    env = evacuated(hall(late))
    entrances, state = env.simulation.entrances, env.simulation.state
    assert entrances.entry_time.tolist() == pytest.approx([4.0, 4.5])
    assert (state.exit_time > 4.0 + 1.0 + 4.0).all()  # response and at least 4 m of way after the entry
    metrics = env.metrics(0)
    assert metrics.evacuation_time == state.exit_time.max()
    assert metrics.mean_exit_time == pytest.approx((state.exit_time - entrances.entry_time).mean())


def test_people_without_room_wait_outside_in_order_and_are_counted():
    closet = Geometry.from_polygon(box(0, 0, 3, 1), exits={"east": [(3, 0), (3, 1)]}, doors={"east": "east"})
    people = {"arrivals": {"rate": 20.0, "until": 2.0, "line": [(0, 0.2), (0, 0.8)], "spacing": "regular"}}
    place = Scenario("closet", closet, [people], time_limit=6.0, closed_doors=("east",))
    place = replace(place, door_events=())
    with pytest.warns(UserWarning, match="closed"):
        env = evacuated(place)
    entry, due = env.simulation.entrances.entry_time, np.arange(40) / 20.0
    inside = np.isfinite(entry)
    assert 5 < inside.sum() < 40
    assert inside[: inside.sum()].all()  # nobody overtakes
    assert (np.diff(entry[inside]) >= 0.0).all()
    assert (entry[inside] >= due[inside] - 1e-9).all()
    assert env.metrics(0).unfinished == 40


def test_a_wait_for_blocked_exits_begins_with_the_last_who_comes():
    late = {"arrivals": {"times": [20.0]}, "start_region": "west"}
    assert evacuated(hall({"people": 2}, late, blocked_after=5.0)).metrics(0).unfinished == 0


@pytest.mark.parametrize("name", ["dem", "hertz", "nsm2"])
def test_a_restored_moment_leads_to_the_same_entries(name):
    env = CrowdEnv(BUSY, num_envs=2, physics=name)
    env.reset(seed=0)
    for _ in range(12):
        env.step(None)
    moment = env.checkpoint()

    def future():
        while not env.finished.all():
            env.step(None)
        state = (*env.simulation.state, env.simulation.entrances.entry_time)
        return [column.tobytes() for column in state]

    first = future()
    env.restore(moment)
    assert future() == first


def test_torsos_come_in_with_room_to_turn():
    torsos = hall({"people": 3}, along_the_edge(), outline="torso")
    env = evacuated(torsos, physics="hertz")
    assert env.metrics(0).unfinished == 0
    assert env.metrics(0).max_overlap < 0.05


def test_a_crowd_in_spatial_order_takes_people_in():
    field = Geometry.from_polygon(box(0, 0, 60, 40), exits={"east": [(60, 0), (60, 40)]})
    people = [{"people": 990}, {"arrivals": {"rate": 20.0, "until": 1.0, "line": [(0, 5), (0, 35)]}}]
    place = Scenario("field", field, people, time_limit=2.0)
    env = CrowdEnv(place, physics="dem")
    env.reset(seed=0)
    while not env.finished.all():
        env.step(None)
    late, state = slice(990, None), env.simulation.state
    come = np.flatnonzero(np.isfinite(env.simulation.entrances.entry_time[late])) + 990
    assert 8 < len(come) < 40
    assert (state.position[come, 0] > 0.3).all()  # they walk
    assert np.isnan(state.exit_time[come]).all()


def test_a_person_is_recorded_from_the_entry_on():
    film = record(BUSY, seed=1, physics="dem")
    entry = film.first_seen
    come = np.isfinite(entry) & (entry > 0.0)
    assert come.sum() > 5
    assert film.inside(0.0) == 4
    assert film.inside(film.end) == 0
    assert film.inside(film.times).max() <= len(film.radius)
    for person in np.flatnonzero(come):
        rows = film.frame[film.person == person]
        assert (np.diff(rows) == 1).all()
    never = np.isinf(entry) & (entry > 0.0)
    assert np.isnan(film.exit_time[never]).all()
