"""The open-corridor case of the validation map: density and speed by the Voronoi method, flow, and what is judged."""

import numpy as np
import pytest
from cases import looped

from crowd_env.geometry.geometry import box
from validation.cases import Setting, corridor
from validation.cases.trajectories import read_trajectories
from validation.cases.voronoi import Look, cells, density_and_speed, fundamental_diagram

FLOOR, FIELD = box(0.0, -4.0, 1.8, 4.0), box(0.0, -2.0, 1.8, 0.0)


def lattice(spacing):
    """Return people in the middles of squares of ``spacing`` [m] that tile the corridor."""
    x, y = np.meshgrid(np.arange(0.5 * spacing, 1.8, spacing), np.arange(-4.0 + 0.5 * spacing, 4.0, spacing))
    return np.column_stack([x.ravel(), y.ravel()])


@looped("spacing", [0.2, 0.3, 0.6, 0.9])
def test_people_in_squares_have_the_density_of_squares(spacing):
    position = lattice(spacing)
    field = box(0.0, -4.0, 1.8, -4.0 + 6 * spacing)  # whole squares
    density, speed = density_and_speed(position, np.full(len(position), 0.7), FLOOR, field)
    assert density == pytest.approx(1.0 / spacing**2, rel=1e-6)
    assert speed == pytest.approx(0.7)


def test_someone_alone_fills_a_disc_and_nobody_nothing():
    (room,) = cells(np.array([(0.0, 0.0)]), box(-5.0, -5.0, 5.0, 5.0))
    assert room.area == pytest.approx(np.pi, rel=0.01)
    assert density_and_speed(np.empty((0, 2)), np.empty(0), FLOOR, FIELD)[0] == 0.0
    assert np.isnan(density_and_speed(np.array([(0.9, 3.0)]), np.ones(1), FLOOR, FIELD)[1])  # too far to matter


def test_the_speed_of_those_who_take_more_room_counts_more():
    position = np.array([(0.9, -0.5), (0.9, -1.6)])
    _, speed = density_and_speed(position, np.array([1.0, 0.0]), FLOOR, FIELD)
    assert speed == pytest.approx(0.5 * (0.5 + 0.55) / 1.0, rel=0.02)  # borders: y = 0, the middle, y = -2


def test_density_speed_and_flow_are_those_between_two_persons():
    run = corridor.Run(1.8, 1.8, 20, 3, 13, 0.0, 0.0, 0.0)
    times = 2.0 + 0.5 * np.arange(20.0)  # the third passes at 3 s, the thirteenth at 8 s
    dense, thin = lattice(0.3), lattice(0.9)
    looks = [
        Look(0, t, thin if 3.0 <= t <= 8.0 else dense, np.ones(len(thin if 3.0 <= t <= 8.0 else dense)))
        for t in np.arange(0.0, 12.0, 0.5)
    ]
    samples, flow = corridor.steady(run, times, looks)
    assert (*samples.mean(axis=0), flow) == pytest.approx((1.0 / 0.81, 1.0, 2.0), rel=0.1)
    samples, flow = corridor.steady(run, np.where(times > 7.0, np.nan, times), looks)
    assert len(samples) == 0 and np.isnan(flow)


@pytest.mark.more
def test_densities_and_speeds_are_those_of_pedpy():
    """Fifty moments of people at random, by PedPy (Schrödter et al., JOSS 10(111), 2025) and here."""
    pedpy = pytest.importorskip("pedpy", reason="PedPy is not installed")
    import pandas as pd

    rng = np.random.default_rng(0)
    position = np.column_stack([rng.uniform(0.05, 1.75, 1000), rng.uniform(-3.95, 3.95, 1000)]).reshape(50, 20, 2)
    frame, person = np.repeat(np.arange(50), 20), np.tile(np.arange(20), 50)
    x, y = position.reshape(-1, 2).T
    speed = pd.DataFrame({"id": person, "frame": frame, "speed": rng.uniform(0.0, 1.5, 1000)})
    moved = pedpy.TrajectoryData(pd.DataFrame({"id": person, "frame": frame, "x": x, "y": y}), frame_rate=10.0)
    near = pedpy.Cutoff(radius=1.0, quad_segments=8)
    rooms = pedpy.compute_individual_voronoi_polygons(
        traj_data=moved, walkable_area=pedpy.WalkableArea(FLOOR), cut_off=near
    )
    area = pedpy.MeasurementArea(FIELD)
    density, shared = pedpy.compute_voronoi_density(individual_voronoi_data=rooms, measurement_area=area)
    mean = pedpy.compute_voronoi_speed(
        traj_data=moved, individual_voronoi_intersection=shared, individual_speed=speed, measurement_area=area
    )
    ours = [
        density_and_speed(at, moment, FLOOR, FIELD)
        for at, moment in zip(position, speed.speed.to_numpy().reshape(50, 20), strict=True)
    ]
    # PedPy divides by the area of the field, where nobody is near too; here the speed is the mean over those who are.
    covered = shared.intersection.map(lambda part: part.area).groupby(shared.frame).sum() / FIELD.area
    theirs = np.column_stack([density.density, mean.speed.to_numpy() / covered.to_numpy()])
    np.testing.assert_allclose(ours, theirs, rtol=1e-9)


def test_a_fundamental_diagram_is_the_mean_speed_of_each_density():
    density = np.repeat([0.3, 0.4, 1.1, 2.0], [6, 6, 12, 3])
    samples = np.column_stack([density, 1.5 - 0.5 * density])
    samples = np.vstack([samples, [[1.1, np.nan]]])
    assert fundamental_diagram(samples) == pytest.approx({0.375: 1.5 - 0.5 * 0.35, 1.125: 0.95})


def test_recordings_are_measured_as_simulated_people_are(tmp_path):
    """People one behind the other at 1 m/s and 1 m apart, in centimetres at 16 frames a second."""
    assert corridor.recorded_diagram(tmp_path / "nowhere") is None
    walk = [f"{i} {k} {90} {100 * (12 + i - k / 16):.3f}" for i in range(30) for k in range(16 * 40)]
    for run in corridor.RUNS:
        name = f"uo-{100 * run.entrance:03.0f}-180-{100 * run.exit:03.0f}.txt"
        (tmp_path / name).write_text("\n".join(walk))
    path = tmp_path / "uo-050-180-180.txt"
    recorded = read_trajectories(path, frame_rate=16.0, unit=0.01)
    run = corridor.Run(1.8, 1.8, 30, 5, 25, 0.0, 0.0, 0.0)
    samples, flow = corridor.steady(run, np.sort(recorded.crossing_times(0.0)), corridor.recorded_looks(recorded, 16.0))
    assert flow == pytest.approx(1.0)
    np.testing.assert_allclose(samples, [[1.0 / 1.8, 1.0]] * len(samples), rtol=0.02)
    assert len(samples) == 41


def test_density_and_flow_are_judged_one_by_one():
    run = corridor.RUNS[5]
    assert corridor.near({"density": 1.24 * run.density, "flow": 0.86 * run.flow}, run) == (True, True)
    assert corridor.near({"density": 0.74 * run.density, "flow": 1.16 * run.flow}, run) == (False, False)


def test_corridors_are_as_narrow_as_they_say():
    for run in corridor.RUNS:
        place = corridor.corridor(run).geometry
        there = [(0.9 + 0.5 * run.entrance - 0.01, 8.1), (0.9 + 0.5 * run.entrance + 0.01, 8.1)]
        back = [(0.9 + 0.5 * run.exit - 0.01, -4.1), (0.9 + 0.5 * run.exit + 0.01, -4.1)]
        assert place.contains([*there, *back, (1.79, 0.0), (1.81, 0.0)]).tolist() == [True, False] * 3


@pytest.mark.more
def test_a_run_is_measured():
    small = corridor.Run(1.0, 1.8, 24, 4, 20, 1.0, 1.0, 1.0)
    (found,) = corridor.measure(Setting("dem", "calm", draws=1), (small,))
    assert 0.1 < found["density"] < 4.0 and 0.1 < found["speed"] < 1.9 and 0.3 < found["flow"] < 6.0
