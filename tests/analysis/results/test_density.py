"""Densities and levels of service beside walls: by hand, and by PedPy on the same people."""

from dataclasses import replace

import numpy as np
import pytest
from cases import looped
from late import late
from shapely.geometry import Polygon, box

from crowd_env import CrowdEnv, Geometry, Population, Scenario, make_scenario
from crowd_env.analysis.results.crowding import SAMPLE, SERVICE, CrowdingRecorder
from crowd_env.analysis.results.measurements import CELL, Density, grid_over
from crowd_env.envs.rollout import Recorders, run_episodes
from crowd_env.geometry.voronoi import REACH
from crowd_env.recording import RunRecorder

pedpy, pandas = late("pedpy"), late("pandas")


def standing(geometry, starts, **options):
    """Return a scenario of people who stand where they are put."""
    people = Population(len(starts), starts=np.array(starts, dtype=float), radius=0.15, desired_speed=0.0)
    return Scenario("standing", geometry, people, 1.0, **options)


def measured(place):
    """Return the floor (N,) [m2] of people who stand in a place, and the density [1/m2] in each cell and where it is."""
    env, grid = CrowdEnv(place, physics="dem"), grid_over(place.geometry)
    env.reset(0)
    density = np.zeros((1, grid.shape[0] * grid.shape[1]), dtype=np.float32)
    return Density(place.geometry, grid)(env, env.active, density), density[0], grid.middles()


def corridor(width, length=40.0, **options):
    return Geometry.from_polygon(box(0, 0, length, width), exits={"east": [(length, 0), (length, width)]}, **options)


def rows(step, across, count):
    """Return people one behind the other from x = 10 on, in rows across."""
    return [(10.0 + step * k, y) for k in range(count) for y in across]


# What stands: width of the corridor, the people, people a square meter, and the level of service.
STANDING = [
    (0.8, rows(0.6, [0.4], 20), 1 / (0.6 * 0.8), "E"),
    (1.0, rows(0.5, [0.25, 0.75], 20), 4.0, "F"),
    (1.2, rows(0.5, [0.6], 20), 1 / (0.5 * 1.2), "E"),
    (2.0, rows(0.5, [0.5, 1.5], 20), 2.0, "E"),
    (10.0, rows(0.5, np.arange(2.75, 7.5, 0.5).tolist(), 20), 4.0, "F"),  # a block, far from walls
]


@looped(("width", "people", "expected", "level"), STANDING)
def test_the_density_of_people_beside_walls_is_that_by_hand(width, people, expected, level):
    place = standing(corridor(width), people)
    floor, density, where = measured(place)
    at = np.array(people)
    inner = (at[:, 0] > 11.5) & (at[:, 0] < 18.0) & ((width < 3.0) | (abs(at[:, 1] - 5.0) < 1.6))
    assert floor[inner] == pytest.approx(1.0 / expected, rel=0.003)
    near = (abs(where - at[inner].mean(axis=0)) < (2.5, 0.4 * min(width, 3.0))).all(axis=1)
    assert near.sum() > 20 and density[near] == pytest.approx(expected, rel=0.003)
    (episode,) = run_episodes(place, 1, scheme="dem", recorder=CrowdingRecorder(place.geometry))
    shares = dict(zip(SERVICE, episode.record.service / episode.record.service.sum(), strict=True))
    assert shares[level] >= inner.mean() and max(shares, key=shares.get) == level
    assert episode.record.density.max() == pytest.approx(expected, rel=0.003)


@looped(
    ("width", "at"), [(6.0, (0.2, 0.2)), (6.0, (20.0, 0.2)), (6.0, (20.0, 3.0)), (0.6, (20.0, 0.3)), (0.6, (39.9, 0.3))]
)
def test_someone_alone_has_the_best_level_of_service(width, at):
    """In a corner, at a wall, in the open, in the narrowest corridor, and on the last step out of it."""
    floor, _, _ = measured(standing(corridor(width), [at]))
    assert floor[0] > 2.33


def test_a_map_of_densities_has_as_many_people_as_there_are():
    rng = np.random.default_rng(1)
    people = [(x, y) for x in np.arange(2.0, 30.0, 0.8) for y in np.arange(0.6, 6.0, 0.8)]
    people = np.array(people) + rng.uniform(-0.2, 0.2, (len(people), 2))
    floor, density, where = measured(standing(corridor(6.0), people))
    inside = (where[:, 0] < 38.0) & corridor(6.0).contains(where)
    assert density[inside].sum() * CELL**2 == pytest.approx(len(people), rel=0.02)
    assert density.max() == pytest.approx(1.0 / floor.min(), rel=1e-6)


CROWD = [(x, y) for x in np.arange(5.0, 15.0, 0.45) for y in (2.15, 2.6, 3.05)]
BEHIND = {
    "a wall": Geometry.from_polygon(
        box(0, 0, 20, 4),
        obstacles=[box(0, 1.95, 20, 2.0)],
        exits={"one": [(20, 0), (20, 1)], "two": [(20, 3), (20, 4)]},
    ),
    "a line": Geometry.from_polygon(
        box(0, 0, 20, 4), thin_walls=[[(0, 2), (20, 2)]], exits={"one": [(20, 0), (20, 1)], "two": [(20, 3), (20, 4)]}
    ),
    "a closed door": Geometry.from_polygon(
        box(0, 0, 20, 4),
        thin_walls=[[(0, 2), (8, 2)], [(12, 2), (20, 2)]],
        doors={"gate": [(8, 2), (12, 2)]},
        exits={"one": [(20, 0), (20, 1)], "two": [(20, 3), (20, 4)]},
    ),
}


@looped("what", BEHIND)
def test_people_behind_a_wall_are_not_in_the_density_here(what):
    few = [(9.0, 1.6), (10.0, 1.0), (11.0, 1.7)]
    closed = {"closed_doors": ("gate",)} if "door" in what else {}
    alone, _, _ = measured(standing(BEHIND[what], few, **closed))
    beside, density, where = measured(standing(BEHIND[what], [*few, *CROWD], **closed))
    np.testing.assert_array_equal(beside[:3], alone)
    assert np.median(beside[3:]) < 0.25 and alone.min() > 2.5
    here = where[:, 1] < 1.9
    assert density[here].max() == pytest.approx(1.0 / alone.min())
    if closed:  # through an open one they are, and its floor
        assert measured(standing(BEHIND[what], few))[0][0] > 1.1 * alone[0]
        assert (measured(standing(BEHIND[what], [*few, *CROWD]))[0][:3] < 0.9 * alone).any()


@looped("scheme", ["dem", "nsm2"], quick=1)
def test_floor_beyond_an_exit_counts_so_that_the_last_step_is_not_crowded(scheme):
    """Of a row through a door, the person in it has as much floor as the others."""
    place = make_scenario("room-v0", people=1)
    ((a, b),) = place.geometry.exits
    out = np.array([b[1] - a[1], a[0] - b[0]]) / np.hypot(*(b - a))
    starts = [0.5 * (a + b) - k * out for k in (0.0, 1.0, 2.0)]
    floor, _, _ = measured(replace(place, population=standing(place.geometry, starts).population))
    assert floor[0] > 0.45 * floor[1]


# ------------------------------------------------------------------------------------------------------- PedPy


def trajectories(frame, person, position):
    """Return PedPy's view of rows (K,)."""
    x, y = position.T
    return pedpy.TrajectoryData(pandas.DataFrame({"id": person, "frame": frame, "x": x, "y": y}), frame_rate=10.0)


def floor_by_pedpy(moved, walkable, in_sight=None):
    """Return the areas (K,) of the Voronoi cells that PedPy finds, cut where ours end, frame by frame.

    PedPy looks through walls: ``in_sight`` (x, y) is what a pedestrian sees of a walkable area with corners.
    """
    cells = pedpy.compute_individual_voronoi_polygons(
        traj_data=moved,
        walkable_area=pedpy.WalkableArea(walkable),
        cut_off=pedpy.Cutoff(radius=REACH, quad_segments=16),
    )
    cells = cells.merge(moved.data, on=["frame", "id"]).sort_values(["frame", "id"])
    rows = zip(cells.polygon, cells.x, cells.y, strict=True)
    return np.array([(cell if in_sight is None else cell & in_sight(x, y)).area for cell, x, y in rows])


def from_a_corridor(x, y):
    """Return what is seen from a place of a corridor 15 m long and 1.2 m wide, and through its end."""
    below, above = (y + (side - y) * (15.0 + REACH - x) / (15.0 - x) for side in (0.0, 1.2))
    return box(0, 0, 15, 1.2) | Polygon([(15, 0), (15 + REACH, below), (15 + REACH, above), (15, 1.2)])


@pytest.mark.more
@looped(("width", "people", "expected", "level"), STANDING)
def test_standing_people_have_the_floor_that_pedpy_finds(width, people, expected, level):
    """Of all of them, those at the ends and at the rims too, in the block up to ties of four cells that meet in a point."""
    floor, _, _ = measured(standing(corridor(width), people))
    moved = trajectories(np.zeros(len(people), int), np.arange(len(people)), np.array(people))
    np.testing.assert_allclose(floor, floor_by_pedpy(moved, box(0, 0, 40, width)), rtol=0.012)
    area = pedpy.MeasurementArea(box(11.25, 0 if width < 3 else 3.5, 17.25, min(width, 6.5)))
    (classic,) = pedpy.compute_classic_density(traj_data=moved, measurement_area=area).density
    assert expected == pytest.approx(classic, rel=0.02)


@pytest.fixture(scope="module")
def walked():
    """People who walk out of a corridor of 1.2 m: what was collected, and the rows of their recording."""
    people = Population(30, start_region="start", radius=(0.15, 0.2), desired_speed=(1.0, 1.5))
    geometry = corridor(1.2, 15.0, regions={"start": box(0, 0, 7, 1.2)})
    place = Scenario("corridor", geometry, people, 60.0, manner="hurried")
    seen = Recorders(crowding=CrowdingRecorder(place.geometry), recording=RunRecorder())
    (episode,) = run_episodes(place, 1, recorder=seen, scheme="nsm2")
    return episode, episode.record["crowding"], episode.record["recording"]


@pytest.mark.more
def test_walking_people_have_the_levels_of_service_that_pedpy_finds(walked):
    episode, found, kept = walked
    inside = ~(episode.exit_time[kept.person] <= kept.times[kept.frame] + 1e-9)
    rows_of = inside & (kept.frame % round(SAMPLE / 0.1) == 0)
    # PedPy has people on the floor alone: it goes on as far as our cells do beyond the exit, to the sides too.
    moved = trajectories(kept.frame[rows_of], kept.person[rows_of], kept.position[rows_of])
    beyond = box(15, -50, 15 + REACH, 50)
    theirs = 1.0 / floor_by_pedpy(moved, box(0, 0, 15, 1.2) | beyond, from_a_corridor)
    level = np.searchsorted(list(SERVICE.values()), theirs, side="right") - 1
    shares = np.bincount(level, minlength=len(SERVICE)) / len(level)
    np.testing.assert_allclose(found.service / found.service.sum(), shares, atol=0.01)
    assert found.density.max() == pytest.approx(theirs.max(), rel=0.012)
    assert shares[-2:].sum() > 0.3 and theirs.max() > 2.0


@pytest.mark.more
def test_the_map_has_the_mean_density_that_pedpy_finds_in_a_field(walked):
    """Classic density counts whole people in a field of 2 m, and the map has parts of them: the mean over the run is one."""
    episode, _, kept = walked
    inside = ~(episode.exit_time[kept.person] <= kept.times[kept.frame] + 1e-9)
    frame, person, position = kept.frame[inside], kept.person[inside], kept.position[inside]
    moved = trajectories(frame, person, position)
    classic = pedpy.compute_classic_density(traj_data=moved, measurement_area=pedpy.MeasurementArea(box(8, 0, 10, 1.2)))
    ours = []
    for moment in range(0, int(frame.max()) + 1, 5):
        _, density, where = measured(standing(corridor(1.2, 15.0), position[frame == moment]))
        ours.append(density[(abs(where[:, 0] - 9.0) < 1.0) & (abs(where[:, 1] - 0.6) < 0.6)].mean())
    assert np.mean(ours) == pytest.approx(classic.density.mean(), rel=0.05)
