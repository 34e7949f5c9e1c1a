"""JuPedSim opens recordings of this package, and its own are opened here."""

import numpy as np
import pytest
from client_examples import client_example

from crowd_env.recording import load

example = client_example("jupedsim", "jupedsim")


def test_every_row_is_read(tmp_path):
    theirs, ours = example.evacuate(tmp_path / "room.sqlite", seed=3), load(tmp_path / "room.sqlite")
    assert theirs.num_frames == len(ours.times) and theirs.fps == pytest.approx(10.0)
    for k in range(theirs.num_frames):
        agents, rows = theirs.frame(k).agents, slice(*ours.frame_start[k : k + 2])
        assert [agent.id for agent in agents] == ours.person[rows].tolist()
        np.testing.assert_array_equal(np.array([agent.position for agent in agents]), ours.position[rows])
        facing = np.array([agent.orientation for agent in agents])
        assert np.hypot(*facing.T) == pytest.approx(1.0)
        moving = np.hypot(*ours.velocity[rows].T) > 0.01
        assert ((facing * ours.velocity[rows]).sum(axis=1)[moving] > 0).all()
    box = theirs.bounds()
    assert (box.xmin, box.ymin, box.ymax) == (0.0, 0.0, 5.0) and box.xmax == pytest.approx(
        5.6
    )  # ground outside the door
    assert theirs.geometry().area == pytest.approx(25.0 + 0.6 * 0.82, abs=1e-6)
    assert theirs.geometry_id_for_frame(0) == theirs.geometry_id_for_frame(theirs.num_frames - 1)


def test_everybody_walks_out_of_the_room(tmp_path):
    walked = example.walked(example.evacuate(tmp_path / "room.sqlite", seed=3))
    ours = load(tmp_path / "room.sqlite")
    start, end = (ours.position[ours.frame == 0], np.array([5.0, 2.5]))
    assert sorted(walked) == list(range(30))
    assert all(walked[k] > np.hypot(*(start[k] - end)) - 0.41 for k in range(30))


def test_recordings_of_jupedsim_are_read(tmp_path):
    import jupedsim as jps

    path = tmp_path / "theirs.sqlite"
    simulation = jps.Simulation(
        model=jps.CollisionFreeSpeedModel(),
        geometry=[(0, 0), (10, 0), (10, 3), (0, 3)],
        trajectory_writer=jps.SqliteTrajectoryWriter(output_file=path, every_nth_frame=10),
    )
    leave = simulation.add_exit_stage([(9, 0), (10, 0), (10, 3), (9, 3)])
    journey = simulation.add_journey(jps.JourneyDescription([leave]))
    for y in (1.0, 2.0):
        simulation.add_agent(
            jps.CollisionFreeSpeedModelAgentParameters(journey_id=journey, stage_id=leave, position=(1.0, y))
        )
    while simulation.agent_count() > 0 and simulation.iteration_count() < 3000:
        simulation.iterate()
    simulation._writer.close()
    ours, theirs = load(path), jps.Recording(str(path))
    assert len(ours.times) == theirs.num_frames or len(ours.times) == theirs.num_frames - 1  # the last may be empty
    for k in range(len(ours.times)):
        rows = slice(*ours.frame_start[k : k + 2])
        np.testing.assert_array_equal([agent.position for agent in theirs.frame(k).agents], ours.position[rows])
    assert np.hypot(*ours.velocity.T).max() == pytest.approx(1.2, rel=0.05)  # JuPedSim's default speed
