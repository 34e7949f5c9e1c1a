"""Population: who is drawn, where they stand, and one clear sentence when they do not fit."""

import re

import numpy as np
import pytest
from cases import looped
from crowds import HALL, PLANS, clear, scatter
from shapely.geometry import box

from crowd_env.geometry.geometry import Geometry
from crowd_env.geometry.placement import sample_positions
from crowd_env.scenarios.population import TABLE_4, Normal, Population, Uniform
from crowd_env.scenarios.starts import check_starts

ROOM = Geometry.from_polygon(box(0, 0, 5, 5), exits=[[(5, 2.09), (5, 2.91)]])

# ----------------------------------------------------------------------------------------------------- distributions


def test_table_4_is_uniform():
    bodies, _ = Population(4000, **TABLE_4).draw(np.random.default_rng(0), Geometry.from_polygon(box(0, 0, 60, 60)))
    for values, low, high in (
        (bodies.radius, 0.2, 0.25),
        (bodies.mass, 60, 100),
        (bodies.desired_speed, 1.2, 2.0),
        (bodies.relaxation_time, 0.1, 0.5),
    ):
        assert low <= values.min() <= low + 0.01 * (high - low)
        assert high - 0.01 * (high - low) <= values.max() <= high
        share, _ = np.histogram(values, bins=10, range=(low, high))
        assert ((share - 400) ** 2 / 400).sum() < 27.9  # chi-square, 9 degrees of freedom, p = 0.001
    assert (bodies.response_time == 0).all()
    np.testing.assert_allclose(bodies.inertia, bodies.mass * bodies.radius**2 / 2)
    drawn = np.column_stack([bodies.radius, bodies.mass, bodies.desired_speed, bodies.relaxation_time])
    assert np.abs(np.corrcoef(drawn.T) - np.eye(4)).max() < 0.06  # independent of each other


def test_normal_is_cut_at_its_bounds_and_keeps_its_shape():
    speed = Normal(1.34, 0.26, 0.8, 2.2)
    values = speed.sample(np.random.default_rng(1), 20_000)
    assert (speed.low <= values.min()) and (values.max() <= speed.high)
    assert values.min() < 0.82
    middle = (np.abs(values - 1.34) < 0.26).mean()
    assert middle == pytest.approx(0.6827 / 0.9804, abs=0.01)  # of what the bounds leave of the bell


def test_equal_bounds_give_a_constant():
    assert Uniform(0.3, 0.3).sample(np.random.default_rng(0), 3).tolist() == [0.3] * 3


# ------------------------------------------------------------------------------------------------------------- starts


@looped("count", [1, 20, 45, 70, 90], ids=lambda n: f"{n} people")
@looped("seed", range(3))
def test_starts_never_overlap_and_lie_inside(count, seed):
    # 70 of these people cover 45 % of the room and 90 of them 57 %: more than random placement can reach.
    bodies, position = Population(count).draw(np.random.default_rng(seed), ROOM)
    assert position.shape == (count, 2)
    assert clear(ROOM, position, bodies.radius) >= -1e-9


@looped("plan", PLANS)
@looped("share", [0.2, 0.4, 0.55])
def test_starts_in_every_plan(plan, share):
    geometry = PLANS[plan]()
    population = Population(int(share * geometry.area / (np.pi * 0.15**2)), radius=Uniform(0.15, 0.15))
    bodies, position = population.draw(np.random.default_rng(5), geometry)
    assert clear(geometry, position, bodies.radius) >= -1e-9


def test_very_unequal_bodies_do_not_overlap():
    population = Population(60, radius=Uniform(0.05, 0.5))
    bodies, position = population.draw(np.random.default_rng(2), HALL)
    assert clear(HALL, position, bodies.radius) >= -1e-9


def test_a_lone_start_is_uniform_over_the_room():
    rng = np.random.default_rng(3)
    starts = np.concatenate([sample_positions(ROOM, np.array([0.25]), rng) for _ in range(3000)])
    # 5 x 5 cells over where a center can be; the exit opens no wall-free strip of note.
    counts, *_ = np.histogram2d(*starts.T, bins=5, range=[[0.25, 4.75]] * 2)
    assert counts.sum() > 2900
    expected = counts.sum() / 25
    assert ((counts - expected) ** 2 / expected).sum() < 51.2  # 24 degrees of freedom, p = 0.001


def test_a_crowd_covers_the_room_evenly():
    rng = np.random.default_rng(4)
    starts = np.concatenate([Population(20).draw(rng, ROOM)[1] for _ in range(200)])
    counts, *_ = np.histogram2d(*starts.T, bins=3, range=[[0.2, 4.8]] * 2)
    share = counts / counts.sum()
    # Others push people into the margins a little: cells at the border may hold a few per cent more.
    assert np.abs(share * 9 - 1).max() < 0.15
    symmetric = (share + share[::-1] + share[:, ::-1] + share[::-1, ::-1]) / 4
    assert np.abs(share - symmetric).max() < 0.012  # no side is preferred


def test_crowds_stand_as_if_placed_one_by_one():
    # Against plain rejection, one person after the other: same distances to the middle, and to the nearest neighbor.
    def figures(starts):
        apart = np.hypot(*(starts[:, :, None] - starts[:, None]).transpose(3, 0, 1, 2))
        apart[:, np.arange(30), np.arange(30)] = np.inf
        away = np.hypot(*(starts - 2.5).transpose(2, 0, 1))
        return (
            away[:, :10].mean(),
            away[:, 20:].mean(),
            apart.min(axis=2)[:, :10].mean(),
            apart.min(axis=2)[:, 20:].mean(),
        )

    rng, radius = np.random.default_rng(6), np.full(30, 0.2)
    placed = figures(np.array([sample_positions(ROOM, radius, rng) for _ in range(400)]))
    expected = figures(np.array([scatter(rng, ROOM, radius) for _ in range(100)]))
    np.testing.assert_allclose(placed, expected, rtol=0.02)


@looped("count", [20, 80])
def test_the_same_generator_gives_the_same_crowd(count):
    first, second, other = (Population(count).draw(np.random.default_rng(seed), ROOM) for seed in (7, 7, 8))
    for a, b in zip([*first[0], first[1]], [*second[0], second[1]], strict=True):
        np.testing.assert_array_equal(a, b)
    assert (first[1] != other[1]).any()


@looped(("region", "count"), [("stage", 6), ("stage", 45), ("aisle", 6), ("corner", 2)])
def test_starts_in_a_region(region, count):
    population = Population(count, start_region=region)
    bodies, position = population.draw(np.random.default_rng(9), HALL)
    assert HALL.contains(position, region).all()
    assert clear(HALL, position, bodies.radius) >= -1e-9


def test_recorded_starts_are_taken_as_they_are():
    starts = np.array([[1.0, 1.0], [2.0, 3.0]])
    bodies, position = Population(2, starts=starts).draw(np.random.default_rng(0), ROOM)
    np.testing.assert_array_equal(position, starts)
    position += 1
    assert starts[0, 0] == 1.0
    assert len(bodies.radius) == 2


# ------------------------------------------------------------------------------------------------------- wrong input


@looped("count", [112, 130, 500])
def test_too_many_people_are_refused_with_the_numbers(count):
    with pytest.raises(ValueError, match=rf"^{count} people do not fit without overlap into 25\.0 m2: ") as error:
        Population(count, radius=Uniform(0.25, 0.25)).draw(np.random.default_rng(0), ROOM)
    room_for = int(re.search(r"(?:at most|holds) (\d+)", str(error.value)).group(1))
    assert room_for < count, "the message contradicts itself"


def test_too_many_for_a_region():
    with pytest.raises(ValueError, match=r"^100 people do not fit without overlap into 12\.0 m2"):
        Population(100, start_region="stage").draw(np.random.default_rng(0), HALL)


def test_too_many_for_a_region_that_sticks_out_of_the_plan():
    # Of the 16 m2 of this region 1 m2 is walkable.
    with pytest.raises(ValueError, match=r"^20 people do not fit without overlap into 1\.0 m2"):
        Population(20, start_region="corner").draw(np.random.default_rng(0), HALL)


def test_an_unknown_start_region_lists_the_known():
    with pytest.raises(ValueError, match="unknown start region 'attic'; known: stage, aisle, corner"):
        Population(3, start_region="attic").draw(np.random.default_rng(0), HALL)
    with pytest.raises(ValueError, match="unknown start region 'attic'; known: none"):
        Population(3, start_region="attic").draw(np.random.default_rng(0), ROOM)


@looped(
    ("starts", "message"),
    [
        ([[1, 1], [6, 1]], r"start 1 at \(6, 1\) is outside the walkable area"),
        ([[1, 1], [float("nan"), 1]], r"start 1 at \(nan, 1\) is outside the walkable area"),
        (
            [[0.1, 2], [1, 1]],
            r"start 0 at \(0.1, 2\) is 0.100 m from a wall; its body of radius 0.200 m does not fit",
        ),
        ([[1, 1], [3, 3], [1.3, 1]], r"starts 0 and 2 overlap by 0.120 m: their radii add up to 0.420 m; take smaller"),
    ],
)
def test_recorded_starts_are_checked(starts, message):
    radius = np.array([0.2, 0.2, 0.22])[: len(starts)]
    with pytest.raises(ValueError, match=message):
        check_starts(ROOM, np.array(starts, dtype=float), radius)


def test_recorded_starts_may_touch_and_stand_in_the_door():
    check_starts(ROOM, np.array([[1.0, 1.0], [1.4, 1.0], [4.95, 2.5], [0.2, 4.8]]), np.full(4, 0.2))
