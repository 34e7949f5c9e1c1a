"""The synthetic movie theatre: its plan, who sits where, stairs and control rules."""

from functools import cache
from itertools import combinations

import numpy as np
import pytest
from cases import looped
from evacuations import evacuated

from crowd_env import Routing
from crowd_env.envs.crowd import CrowdEnv
from crowd_env.reproduce.pecol2011.theatre import IMPLIED, SCHEME
from crowd_env.scenarios import make_scenario
from crowd_env.scenarios.population import Population, Uniform
from crowd_env.scenarios.shipped.theatre import SEATS_A_ROW, plan, seats, taken_seats

THEATRE = make_scenario("theatre-v0")
STAND_STILL = Uniform(1e3, 1e3)


routes = cache(THEATRE.route_set)


def node(name, at):
    """Return the field of the route of this name, and its node nearest to each of the places (K, 2)."""
    field = routes().routes[routes().number(name)].field
    j, i = np.rint((np.atleast_2d(at) - field.origin) / field.spacing).astype(int).T
    return field, (i, j)


def distance(name, at):
    field, there = node(name, at)
    return field.travel_time[there]


def leads_through(name, at, region):
    field, there = node(name, at)
    return (field.through[there] >> list(THEATRE.geometry.regions).index(region)) & 1 == 1


# ------------------------------------------------------------------------------------------------------------ the plan


def test_there_are_174_seats_and_101_people_on_seats_of_their_own():
    everything, starts = seats(), THEATRE.population.starts
    assert everything.shape == (174, 2) and len(np.unique(everything, axis=0)) == 174
    assert starts.shape == (101, 2) and len(np.unique(starts, axis=0)) == 101
    assert {tuple(place) for place in starts} <= {tuple(place) for place in everything}
    taken = taken_seats(101)
    assert min(taken) >= 4 * SEATS_A_ROW  # nobody in front
    assert max(np.diff(taken)) == 2  # no two empty seats side by side: spread evenly
    assert taken == taken_seats(101)


def test_other_numbers_of_people_have_seats_too():
    for count in (1, 40, 126, 127, 174):
        assert len(set(taken_seats(count))) == count == make_scenario("theatre-v0", people=count).population.people
    assert max(np.diff(taken_seats(150))) == 2 and min(taken_seats(150)) < SEATS_A_ROW  # over all rows
    for count in (0, 175):
        with pytest.raises(ValueError, match=rf"people is {count}; it must be 1 to 174: the number of seats"):
            make_scenario("theatre-v0", people=count)


def test_the_largest_bodies_fit_on_all_seats():
    everyone = Population(174, radius=Uniform(0.25, 0.25), starts=seats())
    everyone.draw(np.random.default_rng(0), plan())
    assert plan().clearance(seats()).min() >= 0.25
    gaps = [np.hypot(*(a - b)) for a, b in combinations(seats(), 2)]
    assert min(gaps) == pytest.approx(0.55)


def test_every_seat_reaches_both_exits_by_the_end_of_its_row():
    x, y = seats().T
    a, b = distance("A", seats()), distance("B", seats())
    assert np.isfinite(a).all() and np.isfinite(b).all()
    # Nobody climbs: along the row to an aisle (its upper end is the nearer one for A at y = 4.5, the lower one for B).
    along = np.minimum(y - 1.2, 7.8 - y)
    assert (b > (y - 1.2) + (x - 4.0)).all()
    before_last = np.arange(174) < 168
    assert (a > along + (19.75 - x))[before_last].all()
    shortest = distance("out", seats())
    np.testing.assert_allclose(shortest, np.minimum(a, b), atol=0.05)


def test_the_shortest_ways_part_the_audience_about_as_the_paper_implies():
    starts = THEATRE.population.starts
    by_a = int((distance("A", starts) < distance("B", starts)).sum())
    assert (by_a, 101 - by_a) == (44, 57)
    assert abs(by_a - IMPLIED["people by A"][0]) <= 2


def test_rectangles_lie_inside_and_on_the_ways_that_they_guard():
    geometry, starts = THEATRE.geometry, THEATRE.population.starts
    for rule in THEATRE.rules:
        region = geometry.regions[rule.region]
        assert geometry.walkable.buffer(1e-9).covers(region)
        assert rule.at_least / region.area == pytest.approx(2.0, abs=0.02)  # people per m2
    for one, other in combinations("123", 2):
        assert not geometry.regions[one].intersects(geometry.regions[other])
    for stairs, part in (("upper aisle", "1"), ("lower aisle", "2")):
        assert geometry.regions[stairs].buffer(1e-9).covers(geometry.regions[part])
    assert leads_through("B", starts, "3").all()
    by_a = starts[distance("A", starts) < distance("B", starts)]
    guarded = leads_through("A", by_a, "1") ^ leads_through("A", by_a, "2")
    last_row = by_a[:, 0] > 18.6
    assert guarded[~last_row].all() and not leads_through("A", by_a, "3").any()


# -------------------------------------------------------------------------------------------------- stairs and rules


def people_at(starts, response_time):
    speed = Uniform(1.6, 1.6)
    return Population(len(starts), desired_speed=speed, starts=np.array(starts, float), response_time=response_time)


def test_stairs_slow_everybody_to_half_a_meter_per_second():
    places = [(15.0, 0.6), (15.0, 8.4), (8.0, -1.1), (3.0, 5.0), (15.0, 10.0), (10.6, 4.5)]
    place = make_scenario("theatre-v0", population=people_at(places, Uniform(0.0, 0.0)))
    env = CrowdEnv(place, routing=Routing(signs=False))
    env.reset(seed=0)
    while env.simulation.state.time[0] < 1.2:
        env.step(None)
    speed = np.hypot(*env.simulation.state.velocity.T)
    np.testing.assert_allclose(speed[:3], 0.5, atol=0.03)
    np.testing.assert_allclose(speed[3:], 1.6, atol=0.1)


def followed_routes(starts, **options):
    """Return the name of the route that each of those who stand at ``starts`` would follow now."""
    place = make_scenario("theatre-v0", population=people_at(starts, STAND_STILL), **options)
    env = CrowdEnv(place)
    env.reset(seed=0)
    env.step(None)
    return [env.route_set[0].routes[k].name for k in env.simulation.history.followed]


UPPER = [(18.0 + 0.55 * (k // 2), 8.1 + 0.6 * (k % 2)) for k in range(6)]  # in rectangle 1
LOWER = [(x, 9.0 - y) for x, y in UPPER]  # in rectangle 2
FLOOR = [(0.4 + 0.55 * (k % 5), 0.4 + 0.6 * (k // 5)) for k in range(15)]  # in rectangle 3
ELSEWHERE = {
    "below 1": (15.0, 8.4),
    "below 2": (17.0, 0.6),
    "behind": (20.4, 6.5),
    "in front": (5.0, 0.6),
}


def with_others(crowd, **options):
    names = followed_routes([*crowd, *ELSEWHERE.values()], **options)
    return names[: len(crowd)], dict(zip(ELSEWHERE, names[len(crowd) :], strict=True))


@pytest.mark.more
@looped(("crowd", "least", "turned", "to"), [
    (UPPER, 5, {"below 1"}, "B"),
    (LOWER, 5, {"below 2"}, "B"),
    (FLOOR, 15, {"in front"}, "A"),
])  # fmt: skip
def test_a_rule_turns_away_those_elsewhere_whose_way_leads_through(crowd, least, turned, to):
    for count in (least - 1, least):
        inside, others = with_others(crowd[:count])
        assert inside == ["out"] * count  # whoever is in there goes on
        expected = dict.fromkeys(ELSEWHERE, "out") | (dict.fromkeys(turned, to) if count >= least else {})
        assert others == expected, count


@pytest.mark.more
def test_other_thresholds():
    assert with_others(UPPER[:2], crowded=(2, 5, 15))[1]["below 1"] == "B"
    assert with_others(UPPER[:6], crowded=(7, 5, 15))[1]["below 1"] == "out"


def exits_of(options, rules=True):
    place = make_scenario("theatre-v0", **options)
    env = evacuated(place, physics=SCHEME, routing=Routing(signs=rules), time_limit=14.0)
    return env.simulation.state.exit_time.copy(), env.simulation.state.position.copy()


@pytest.mark.more
def test_rules_that_are_never_on_change_nothing():
    for one, other in zip(exits_of({"crowded": (500, 500, 500)}), exits_of({}, rules=False), strict=True):
        np.testing.assert_array_equal(one, other)
    assert not np.array_equal(exits_of({})[1], exits_of({}, rules=False)[1])


@pytest.mark.more
@looped("scheme", [SCHEME, "nsm2", "dem"], ids=["reproduction", "nsm2", "dem"])
def test_everybody_gets_out(scheme):
    env = evacuated("theatre-v0", num_envs=2, physics=scheme, seed=[5, 6])
    for e in range(2):
        metrics = env.metrics(e)
        assert metrics.unfinished == 0 and 40.0 < metrics.evacuation_time < 100.0
    names = np.array(THEATRE.geometry.exit_names)[env.simulation.state.exit_index]
    assert 30 * 2 < (names == "A").sum() < 55 * 2


@pytest.mark.more
def test_rules_turn_nobody_away_from_the_fastest_way_which_is_faster_than_the_shortest():
    options = {"physics": "dem", "num_envs": 3, "seed": [1, 2, 3]}
    shortest = evacuated("theatre-v0", **options).simulation.state.exit_time
    quick, free = (
        evacuated("theatre-v0", routing=Routing("fastest", signs=rules), **options).simulation.state.exit_time
        for rules in (True, False)
    )
    np.testing.assert_array_equal(quick, free)
    assert (quick.reshape(3, -1).max(axis=1) < shortest.reshape(3, -1).max(axis=1)).all()
    assert quick.mean() < shortest.mean()
