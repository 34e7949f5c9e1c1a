"""Who walks in groups: drawn with the crowd, in files, recorded, observed, and kept on one route."""

import numpy as np
import pytest
from cases import looped
from shapely.geometry import box

from crowd_env import (
    Attraction,
    Cohorts,
    CrowdEnv,
    Geometry,
    GroupCohesion,
    Population,
    Pulls,
    Scenario,
    make_scenario,
    record,
)
from crowd_env.recording import load
from crowd_env.scenarios.distributions import Uniform
from crowd_env.scenarios.groups import draw_groups, same_route

HALL = Geometry.from_polygon(
    box(0, 0, 12, 8), exits={"west": [(0, 3), (0, 5)], "east": [(12, 3), (12, 5)]}, regions={"left": box(0, 0, 5, 8)}
)

FILE = """
[geometry]
walkable = { box = [0, 0, 12, 8] }
[geometry.exits]
east = [[12, 3], [12, 5]]
[population]
people = 12
group_size = [2, 3]
[pulls.groups]
gaze = 0
apart = 5
[[pulls.attractions]]
x = 3
y = 4
strength = 2
lifetime = 20
"""


def hall(*parts, **options):
    crowd = Cohorts(parts) if len(parts) > 1 else parts[0]
    return Scenario("hall", HALL, crowd, 60.0, **options)


def test_groups_have_the_sizes_that_are_asked_for_and_the_crowd_is_as_without():
    drawn = {}
    for size in (None, 1, 3, (2, 4)):
        people = Population(31, group_size=size)
        drawn[size] = people.draw(np.random.default_rng(0), HALL)
    bodies, position = drawn[None]
    assert (bodies.group == -1).all() and (drawn[1][0].group == -1).all()
    for other, at in drawn.values():
        np.testing.assert_array_equal(at, position)
        for name in ("radius", "mass", "desired_speed"):
            np.testing.assert_array_equal(getattr(other, name), getattr(bodies, name))
    _, threes = np.unique(drawn[3][0].group, return_counts=True)
    assert sorted(threes) == [1, *[3] * 10]  # one is left, who walks alone
    group = drawn[(2, 4)][0].group
    _, sizes = np.unique(group[group >= 0], return_counts=True)
    assert set(sizes) <= {2, 3, 4} and len(set(sizes)) > 1


def test_members_stand_near_each_other():
    rng = np.random.default_rng(1)
    position = rng.uniform(0.0, 20.0, (300, 2))
    group = draw_groups(rng, Uniform(3, 3), position)
    apart = [np.hypot(*(position[group == c] - position[group == c].mean(axis=0)).T).mean() for c in range(100)]
    shuffled = rng.permutation(group)
    far = [np.hypot(*(position[shuffled == c] - position[shuffled == c].mean(axis=0)).T).mean() for c in range(100)]
    assert np.mean(apart) < 0.2 * np.mean(far)


@looped("row", [np.column_stack([np.arange(6.0), np.zeros(6)]), np.column_stack([np.zeros(6), np.arange(6.0)])])
def test_people_in_a_row_walk_with_their_neighbors(row):
    assert draw_groups(np.random.default_rng(0), Uniform(2, 2), row).tolist() == [0, 0, 1, 1, 2, 2]


@looped("rows", [2, 4, 5])
def test_strips_run_to_and_fro(rows):
    """In strips of three the pairs at the turn of two strips stand beside each other too."""
    x, y = np.meshgrid(np.arange(3.0), 0.9 * np.arange(rows))
    position = np.column_stack([x.ravel(), y.ravel()])
    group = draw_groups(np.random.default_rng(0), Uniform(2, 2), position)
    for c in set(group[group >= 0]):
        (one, other) = position[group == c]
        assert np.hypot(*(one - other)) <= 1.0
    assert len(set(group[group >= 0])) == 3 * rows // 2


def test_groups_of_several_cohorts_have_numbers_of_their_own():
    cohorts = Cohorts((Population(4, group_size=2), Population(5), Population(6, group_size=3)))
    bodies, _ = cohorts.draw(np.random.default_rng(0), HALL)
    first, alone, last = bodies.group[:4], bodies.group[4:9], bodies.group[9:]
    assert (alone == -1).all() and not set(first) & set(last) and len(set(first)) == len(set(last)) == 2
    assert bodies.group.max() < 15


def test_groups_take_one_route():
    assert same_route(np.array([1, 0, 2, 0, 1]), np.array([3, -1, 3, 0, 0])).tolist() == [1, 0, 1, 0, 0]
    env = CrowdEnv(hall(Population(40, group_size=4), strategy="nearest"), physics="dem")
    env.reset(0)
    route, group = env.simulation.state.route, env.simulation.bodies.group
    assert len(set(route)) > 1
    assert all(len(set(route[group == c])) == 1 for c in set(group[group >= 0]))


def test_a_file_says_who_walks_together_and_what_pulls(tmp_path):
    path = tmp_path / "hall.toml"
    path.write_text(FILE, encoding="utf-8")
    place = make_scenario(str(path))
    assert place.pulls == Pulls(GroupCohesion(gaze=0.0, apart=5.0), (Attraction(3.0, 4.0, 2.0, lifetime=20.0),))
    assert place.population.group_size == Uniform(2, 3)
    env = CrowdEnv(place, num_envs=2)
    env.reset(0)
    assert len(set(env.simulation.bodies.group)) > 3
    np.testing.assert_array_equal(env.simulation.batch.behaviors.pulls.attraction, [[3, 4, 2, 2, 20, 0]])
    turned = place.turned(0.5 * np.pi)
    at = turned.pulls.attractions[0]
    assert turned.geometry.contains(np.array([[at.x, at.y]]))[0] and (at.x, at.y) != (3, 4)


def test_a_file_with_the_older_words_is_read_as_before(tmp_path):
    older = FILE.replace("group_size", "companions").replace("[pulls.groups]", "[pulls.companions]")
    older = older.replace("[population]\npeople = 12\n", "[[groups]]\npeople = 12\n")
    for name, text in {"older": older, "today": FILE}.items():
        (tmp_path / f"{name}.toml").write_text(text, encoding="utf-8")
    was, now = (make_scenario(str(tmp_path / f"{name}.toml")) for name in ("older", "today"))
    assert vars(was.population.parts[0]) == vars(now.population) and was.pulls == now.pulls
    (tmp_path / "both.toml").write_text(FILE.replace("people = 12", "people = 12\ncompanions = 2"), encoding="utf-8")
    with pytest.raises(ValueError, match="'companions' is the older word for 'group_size'; give one of them"):
        make_scenario(str(tmp_path / "both.toml"))


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match="population: group_size must be >= 1, but can be as low as 0"):
        Population(10, group_size=0)
    with pytest.raises(ValueError, match=r"attraction at \(13, 4\) is outside the walkable area"):
        hall(Population(2), pulls=Pulls(attractions=(Attraction(13.0, 4.0, 1.0),)))
    with pytest.raises(ValueError, match=r"pulls: unknown key 'gaze'; known: groups, attractions"):
        hall(Population(2), pulls={"gaze": 1})


@pytest.mark.parametrize("suffix", [".sqlite", ".h5"])
def test_a_recording_says_who_walked_together(suffix, tmp_path):
    made = record(hall(Population(9, group_size=3)), seed=1, scheme="dem", time_limit=0.5)
    kept = load(made.save(tmp_path / f"run{suffix}"))
    assert sorted(made.group) == [0, 0, 0, 1, 1, 1, 2, 2, 2]
    np.testing.assert_array_equal(kept.group, made.group)


def test_the_group_is_observed():
    env = CrowdEnv(
        hall(Population(10, group_size=3)),
        num_envs=2,
        physics="dem",
        observation={"terms": ["velocity", "group"]},
        action={"name": "continuous", "frame": "world"},
    )
    seen = env.reset(3)[0][:, env.layout["group"]]
    position, group = env.simulation.state.position, env.simulation.bodies.group
    for i in range(20):
        same = np.flatnonzero((group == group[i]) & (np.arange(20) // 10 == i // 10) & (np.arange(20) != i))
        if group[i] < 0:
            assert (seen[i] == 0.0).all()
            continue
        offset = position[same].mean(axis=0) - position[i]
        np.testing.assert_allclose(seen[i, :2], offset / (3.0 + np.hypot(*offset)), atol=1e-6)
        assert seen[i, 2] == pytest.approx(len(same) / (len(same) + 3.0))
    assert (group < 0).any() and (seen != 0.0).any()
