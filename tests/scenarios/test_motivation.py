"""How people press on, as data: time gap and push of populations, the manner of scenarios, and both in files."""

import numpy as np
from cases import looped
from refusals import refuses
from shapely.geometry import box

from crowd_env import MANNERS, Cohorts, Geometry, Headway, Population, Scenario, Uniform, make_scenario

ROOM = Geometry.from_polygon(box(0, 0, 8, 8), exits=[[(8, 3), (8, 5)]], regions={"west": box(0, 0, 4, 8)})
SEATS = [(x, y) for x in range(1, 8) for y in range(1, 8)]
FILE = """
manner = {manner}
[geometry]
walkable = {{ box = [0, 0, 8, 8] }}
exits = {{ door = [[8, 3], [8, 5]] }}
[population]
time_gap = [0.6, 1.0]
[[cohorts]]
people = 12
push = {push}
[[cohorts]]
people = 8
time_gap = {{ distribution = "normal", mean = 0.5, sd = 0.1, low = 0.3, high = 0.7 }}
"""


def drawn(people, seed=0):
    return people.draw(np.random.default_rng(seed), ROOM)


def file_of(folder, *, manner='"calm"', push="0.4"):
    path = folder / "place.toml"
    path.write_text(FILE.format(manner=manner, push=push))
    return path


@looped(
    "with_options",
    [
        lambda **given: Population(30, **given),
        lambda **given: Population(20, starts=SEATS, **given),
        lambda **given: Cohorts(
            (Population(9, start_region="west"), Population(7, **given), Population(8, starts=SEATS))
        ),
    ],
    ids=["anywhere", "seats", "cohorts"],
)
def test_motivation_is_drawn_behind_all_else_and_only_if_it_is_given(with_options):
    usual, place = drawn(with_options())
    found, same_place = drawn(with_options(push=(0.1, 0.3), time_gap=0.7))
    assert np.array_equal(place, same_place)
    for name in ("radius", "mass", "inertia", "desired_speed", "relaxation_time", "response_time", "env_start"):
        assert np.array_equal(getattr(usual, name), getattr(found, name))
    assert np.isnan(usual.push).all() and np.isnan(usual.time_gap).all()
    given = ~np.isnan(found.push)
    assert given.any() and len(np.unique(found.push[given])) == given.sum()  # one draw each
    assert ((found.push[given] >= 0.1) & (found.push[given] <= 0.3)).all() and (found.time_gap[given] == 0.7).all()


def test_cohorts_differ_in_push_and_the_crowds_of_two_seeds_differ():
    people = Cohorts((Population(5, push=0.0), Population(6, push=(0.5, 1.0)), Population(4)))
    (first, _), (second, _) = drawn(people, 0), drawn(people, 1)
    assert (first.push[:5] == 0.0).all() and (first.push[5:11] >= 0.5).all() and np.isnan(first.push[11:]).all()
    assert (first.push[5:11] != second.push[5:11]).all()
    everyone = people.changed(push=0.2, people=30)
    assert (drawn(everyone)[0].push == 0.2).all() and everyone.people == 30


def test_a_distribution_of_ones_own_that_leaves_its_bounds_is_refused_when_the_crowd_starts():
    class Liar(Uniform):
        def sample(self, rng, count):
            return np.full(count, 2.0)

    from crowd_env import CrowdEnv

    env = CrowdEnv(make_scenario("room-v0", population={"people": 3, "push": Liar(0.0, 1.0)}))
    refuses(lambda: env.reset(seed=0), ("push of pedestrian 0 is 2", "[0, 1]"))


@looped(
    ("options", "words"),
    [
        ({"push": 1.2}, ("push must be in [0, 1]", "1.2")),
        ({"push": (-0.1, 0.5)}, ("push must be in [0, 1]", "as low as -0.1")),
        ({"push": "much"}, ("push is 'much'", "a number, a pair")),
        ({"push": float("nan")}, ("push",)),
        ({"time_gap": 0}, ("time_gap must be > 0", "as low as 0")),
        ({"time_gap": [0.5]}, ("time_gap",)),
    ],
)
def test_bad_motivation_is_refused(options, words):
    refuses(lambda: Population(3, **options), ("population: ", *words))


def test_a_scenario_says_how_people_walk_unless_the_run_does():
    def place(manner):
        return Scenario("hall", ROOM, Population(5), 60.0, manner=manner)

    assert place(None).behavior(Headway) is None and place("competitive").behavior(Headway) is None
    assert place("calm").behavior(Headway) == MANNERS["calm"] != MANNERS["hurried"]
    assert place("calm").behavior(Headway, "hurried") == MANNERS["hurried"]
    assert place("calm").behavior(Headway, "competitive") is None
    assert place({"time_gap": 0.7}).manner == Headway(time_gap=0.7) == place(Headway(time_gap=0.7)).behavior(Headway)
    refuses(lambda: place("slow"), ("unknown manner 'slow'", *MANNERS))
    refuses(lambda: place({"time_gap": -1}), ("time_gap", "> 0"))
    refuses(lambda: place({"gap": 1}), ("unknown key 'gap'", "time_gap"))
    refuses(lambda: place(3), ("manner is 3", "calm"))


def test_a_file_says_manner_and_motivation(tmp_path):
    place = make_scenario(file_of(tmp_path))
    assert place.manner == "calm"
    bodies, _ = place.population.draw(np.random.default_rng(3), place.geometry)
    assert (bodies.push[:12] == 0.4).all() and np.isnan(bodies.push[12:]).all()
    assert (bodies.time_gap[:12] >= 0.6).all() and (bodies.time_gap[12:] <= 0.7).all()
    table = make_scenario(file_of(tmp_path, manner="{ time_gap = 0.9, push = 0.1 }", push="[0, 0.2]"))
    assert table.manner == Headway(time_gap=0.9, push=0.1)


@looped(
    ("given", "words"),
    [
        ({"manner": '"slow"'}, ("unknown manner 'slow'", *MANNERS)),
        ({"manner": "3"}, ("manner is 3", "a table of its parameters", *MANNERS)),
        ({"manner": "{ timegap = 1 }"}, ("unknown key 'timegap'", "time_gap")),
        ({"manner": "{ time_gap = 0 }"}, ("headway: time_gap", "> 0")),
        ({"push": "1.5"}, ("push must be in [0, 1]", "1.5")),
        ({"push": '"a lot"'}, ("cohorts[0]", "push is 'a lot'", "a number, a pair")),
    ],
)
def test_mistakes_in_a_file_are_named(tmp_path, given, words):
    path = file_of(tmp_path, **given)
    refuses(lambda: make_scenario(path), (str(path), *words))
