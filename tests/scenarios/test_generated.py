"""Places that a seed draws: everybody can get out of each, and none has a compass."""

import collections
import warnings

import numpy as np
import pytest
from cases import looped
from evacuations import evacuated

from crowd_env import SCHEMES, CrowdEnv, make_scenario
from crowd_env.scenarios.generated import KINDS, LAWS, SEEDS, VERSION, conditions_of

MANY = range(200)


@pytest.fixture(scope="module")
def places():
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # nothing is joined, moved or left out
        return [make_scenario("generated-v0", seed=seed) for seed in MANY]


def test_a_seed_draws_one_place():
    one, same, other = (make_scenario("generated-v0", seed=seed) for seed in (5, 5, 6))
    assert (
        one.title == same.title != other.title
        and "the seed 5" in one.reference
        and f"version {VERSION}" in one.reference
    )
    np.testing.assert_array_equal(one.geometry.walls, same.geometry.walls)
    crowds = [place.population.draw(np.random.default_rng(0), place.geometry)[1] for place in (one, same)]
    np.testing.assert_array_equal(*crowds)
    assert make_scenario("generated-v0", seed=5, people=12).population.people == 12
    assert make_scenario("generated-v0", seed=SEEDS.high).title
    with pytest.raises(ValueError, match="seed is -1"):
        make_scenario("generated-v0", seed=-1)
    with pytest.raises(ValueError, match="kind of place 'castle'; known: doors"):
        make_scenario("generated-v0", kind="castle")


def test_places_are_of_all_kinds_and_sizes(places):
    about = collections.Counter(" ".join(w for w in place.title.split() if w.isalpha()) for place in places)
    assert len(about) >= len(KINDS)
    people = np.array([place.population.people for place in places])
    assert people.min() < 15 and people.max() > 300 and (people >= 10).all() and (people <= 400).all()
    speed = np.array([place.population.desired_speed.high for place in places])
    assert speed.min() < 1.0 and speed.max() > 2.3
    assert {len(place.exits) for place in places} >= {1, 2, 3}
    laws = collections.Counter(conditions_of(seed).law for seed in MANY)
    assert set(laws) == set(LAWS) <= set(SCHEMES) and min(laws.values()) > 0.15 * len(MANY)


@looped("first", range(4), quick=1)
def test_the_largest_fit_through_every_exit_and_everyone_has_a_way(places, first):
    some = places[first::4]
    for place in some:
        widths = place.geometry.clear_widths(2.0 * place.population.radius.high)
        assert min(widths.values()) > 2.0 * place.population.radius.high + 0.04, place.title
        assert min(place.geometry.exit_widths.values()) > 0.599
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for place in some[::8]:
            walk, _ = place.longest_walk()
            assert 0.0 < walk < place.time_limit, place.title


def test_no_way_leads_east(places):
    """Angles of exits are spread evenly: of 500 unit vectors the mean is longer than 0.1 in 1 of 150 samples."""
    along = np.concatenate([np.diff(place.geometry.exits, axis=1)[:, 0] for place in places])
    turn = (along[:, 0] + 1j * along[:, 1]) / np.hypot(*along.T)
    assert len(turn) > 250
    for harmonic in (1, 2, 4):
        assert abs(np.mean(turn**harmonic)) < 2.3 / np.sqrt(len(turn))


@pytest.mark.more
@looped("kind", KINDS)
def test_few_people_get_out_of_every_kind_of_place(kind):
    env = evacuated(make_scenario("generated-v0", seed=3, kind=kind, people=10), physics="dem", seed=0)
    assert env.metrics(0).unfinished == 0


def test_several_make_a_batch():
    env = CrowdEnv(
        [make_scenario("generated-v0", seed=seed, people=10) for seed in range(4)], num_envs=8, physics="dem"
    )
    env.reset(seed=0)
    assert env.step(None).observation.shape == (80, env.layout.size)


def test_conditions_are_drawn_apart_from_the_place():
    drawn = [conditions_of(seed) for seed in range(1000)]
    assert 150 < sum(one.manner == "hurried" for one in drawn) < 250
    noise = np.array([one.noise for one in drawn])
    assert 200 < (noise > 0.0).sum() < 300 and noise.max() < 0.1
    delays = collections.Counter(one.delay for one in drawn)
    assert set(delays) == {0.0, 0.1, 0.2, 0.3, 0.4} and 700 < delays[0.0] < 800


@pytest.mark.more
def test_an_exit_that_shuts_lets_some_out_and_all_leave_by_the_others(places):
    shutting = [place for place in places if place.door_events and place.population.people < 60]
    assert len(shutting) > 3
    for place in shutting[:4]:
        env = evacuated(place, physics="nsm2", seed=0, routing="fastest")
        (event,) = place.door_events
        assert env.metrics(0).unfinished == 0, place.title
        state, row = env.simulation.state, list(place.geometry.exit_names).index(event.door)
        by_it = state.exit_time[state.exit_index == row]
        assert (by_it <= event.at + env.decision_dt).all(), place.title
