"""PedPy opens recordings, counts everybody who leaves, and finds the densities, speeds and flows that are ours.

PedPy is installed by `make test`.
"""

import numpy as np
import pytest
from cases import looped
from late import late
from recordings import two_doors
from storeys import with_stair

from crowd_env import Scenario, make_scenario
from crowd_env.envs.rollout import run_episodes
from crowd_env.recording import RunRecorder, load, of_storey, record

pedpy = late("pedpy")

pytestmark = pytest.mark.more  # it takes seconds to import

READERS = {".sqlite": "jupedsim_sqlite", ".h5": "ped_data_archive_hdf5"}


def speeds(trajectory, frame_step):
    """Return everybody's speed in every frame, also in the first and the last."""
    sides = pedpy.SpeedCalculation.BORDER_SINGLE_SIDED
    return pedpy.compute_individual_speed(traj_data=trajectory, frame_step=frame_step, speed_calculation=sides)


def opened(path):
    """Return what PedPy reads of a recording."""
    trajectory, area = (
        getattr(pedpy, f"load_{what}_from_{READERS[path.suffix]}") for what in ("trajectory", "walkable_area")
    )
    return trajectory(trajectory_file=path), area(trajectory_file=path)


@pytest.fixture(scope="module", params=[".sqlite", pytest.param(".h5", marks=pytest.mark.more)])
def door(request, tmp_path_factory):
    """60 people before a door of 1.2 m: the episode, our reading, PedPy's reading."""
    scenario = make_scenario("room-v0", people=60, door_width=1.2, side=8.0)
    path = tmp_path_factory.mktemp("door") / f"run{request.param}"
    (episode,) = run_episodes(scenario, 1, seed=4, scheme="nsm2", recorder=RunRecorder(path))
    return episode, load(path), *opened(path)


def test_all_rows_are_there_and_lie_in_the_walkable_area(door):
    _, kept, trajectory, area = door
    assert pedpy.is_trajectory_valid(traj_data=trajectory, walkable_area=area)
    assert trajectory.frame_rate == pytest.approx(10.0)
    data = trajectory.data.sort_values(["frame", "id"])
    np.testing.assert_array_equal(data[["frame", "id"]], np.stack([kept.frame, kept.person], axis=1))
    np.testing.assert_array_equal(data[["x", "y"]], kept.position)


def test_n_t_on_the_exit_line_counts_everybody_within_a_frame_of_the_exit(door):
    episode, kept, trajectory, _ = door
    ((_, line),) = kept.exits
    n_t, crossings = pedpy.compute_n_t(traj_data=trajectory, measurement_line=pedpy.MeasurementLine(line))
    assert n_t.cumulative_pedestrians.iloc[-1] == 60 == np.isfinite(episode.exit_time).sum()
    frames = crossings.set_index("id").frame.reindex(range(60)).to_numpy()
    late = frames / 10.0 - episode.exit_time
    assert (late >= -1e-9).all() and (late <= 0.1 + 1e-9).all()
    inside = 60 - n_t.cumulative_pedestrians.to_numpy()
    np.testing.assert_array_equal(inside, kept.inside(n_t.time.to_numpy() + 1e-9))


@looped(("every", "limit"), [(every, limit) for every in (0.1, 0.5, 1.0) for limit in (30.0, 2.5)])
def test_every_exit_counts_those_who_leave_by_it(every, limit, tmp_path):
    """Also if frames are rare, and if people are left inside."""
    (episode,) = run_episodes(
        two_doors(people=30, time_limit=limit),
        1,
        seed=1,
        strategy="nearest",
        recorder=RunRecorder(tmp_path / "run.sqlite", every=every),
    )
    trajectory, area = opened(episode.record)
    assert pedpy.is_trajectory_valid(traj_data=trajectory, walkable_area=area)
    kept, counted = load(episode.record), 0
    for k, (_, line) in enumerate(kept.exits):
        n_t, _ = pedpy.compute_n_t(traj_data=trajectory, measurement_line=pedpy.MeasurementLine(line))
        assert n_t.cumulative_pedestrians.iloc[-1] == (kept.exit_index == k).sum()
        counted += n_t.cumulative_pedestrians.iloc[-1]
    assert 0 < counted == np.isfinite(kept.exit_time).sum()
    assert (counted < 30) == (limit < 10)


def test_the_flow_is_the_one_of_our_report(door):
    episode, kept, trajectory, _ = door
    ((_, line),) = kept.exits
    n_t, crossings = pedpy.compute_n_t(traj_data=trajectory, measurement_line=pedpy.MeasurementLine(line))
    speed = speeds(trajectory, 5)
    options = {"nt": n_t, "crossing_frames": crossings, "individual_speed": speed, "frame_rate": 10.0}
    flow = pedpy.compute_flow(**options, delta_frame=20)
    times = np.sort(episode.exit_time)
    assert flow.flow.mean() == pytest.approx(59 / (times[-1] - times[0]), rel=0.15)
    assert flow.flow.mean() == pytest.approx(episode.metrics.flow, rel=0.15)


@pytest.mark.more
def test_the_voronoi_density_counts_the_people_in_the_room(door):
    """Over all of the area, cells of everybody fill it: N / A, which we know."""
    _, kept, trajectory, area = door
    cells = pedpy.compute_individual_voronoi_polygons(traj_data=trajectory, walkable_area=area)
    square = pedpy.MeasurementArea([(0, 0), (8, 0), (8, 8), (0, 8)])
    voronoi, _ = pedpy.compute_voronoi_density(individual_voronoi_data=cells, measurement_area=square)
    classic = pedpy.compute_classic_density(traj_data=trajectory, measurement_area=square)
    inside = np.add.reduceat(~kept.beyond, kept.frame_start[:-1]) / 64.0
    np.testing.assert_allclose(classic.density.reindex(range(len(inside)), fill_value=0.0), inside, atol=1e-12)
    apart = np.abs(voronoi.density.to_numpy() - inside) * 64.0  # people: cells reach through the door, both ways
    assert apart.max() < 2.0 and apart.mean() < 1.0
    assert np.isfinite(cells.density).all()


def test_the_speed_is_the_one_that_people_have(tmp_path):
    """PedPy's speeds are positions over 0.2 s, ours those of the moment: where nobody is in the way they agree."""
    scenario = make_scenario("room-v0", people=4, door_width=1.2, side=10.0)
    (episode,) = run_episodes(scenario, 1, seed=4, recorder=RunRecorder(tmp_path / "run.h5"))
    kept, (trajectory, _) = load(episode.record), opened(episode.record)
    found = speeds(trajectory, 1)
    speed = found.sort_values(["frame", "id"]).speed.to_numpy()
    inside = ~kept.beyond & (kept.frame > 20)
    ours = np.hypot(*kept.velocity.T)[inside]
    assert len(ours) > 20 and np.median(np.abs(speed[inside] / ours - 1.0)) < 0.01
    assert ours.mean() == pytest.approx(kept.desired_speed[kept.person[inside]].mean(), rel=0.1)


@pytest.fixture(scope="module")
def house():
    """24 people in a house of two storeys and a stair, recorded."""
    return record(Scenario("house", with_stair(), [{"people": 24, "desired_speed": 1.4}], 60.0), seed=5)


@looped("suffix", READERS)
def test_a_storey_of_a_building_is_a_trajectory_in_true_coordinates_that_counts_at_its_seams(suffix, house, tmp_path):
    true, height, sheet = house.places()
    for s, name in enumerate(("ground", "upper", "stair")):
        storey = of_storey(house, name)
        path = storey.save(tmp_path / f"{name}{suffix}")
        trajectory, area = opened(path)
        assert pedpy.is_trajectory_valid(traj_data=trajectory, walkable_area=area), name
        data = trajectory.data.sort_values(["frame", "id"])
        np.testing.assert_array_equal(data[["frame", "id"]], np.stack([storey.frame, storey.person], axis=1))
        read = load(path)
        np.testing.assert_array_equal(read.memory["height"], storey.memory["height"])
        rows = {(f, n): k for k, (f, n) in enumerate(zip(house.frame.tolist(), house.person.tolist(), strict=True))}
        same = [rows[key] for key in zip(storey.frame.tolist(), storey.person.tolist(), strict=True)]
        np.testing.assert_array_equal(storey.position, true[same])
        np.testing.assert_array_equal(storey.memory["height"], height[same])
        assert set(np.flatnonzero(sheet == s)) <= set(same)
        for k, (way, line) in enumerate(storey.exits):
            _, crossings = pedpy.compute_n_t(traj_data=trajectory, measurement_line=pedpy.MeasurementLine(line))
            for n in np.flatnonzero(storey.exit_index == k):
                frame = crossings.set_index("id").frame[n]
                assert abs(frame / 10.0 - storey.exit_time[n]) <= 0.1 + 1e-9, way
    assert [name for name, _ in of_storey(house, "stair").exits] == ["to ground", "to upper"]
    assert np.ptp(of_storey(house, "stair").memory["height"]) > 2.5
    with pytest.raises(ValueError, match="storey or stair"):
        of_storey(house, "attic")
    with pytest.raises(ValueError, match="storey or stair"):
        of_storey(record("room-v0", people=2), "upper")
