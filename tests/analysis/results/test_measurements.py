"""What is measured while evacuations run: ways, densities, pressures, exits, and the maps of them."""

from dataclasses import replace

import numpy as np
import pytest
from evaluations import SMALL, hall, recorded, run

from crowd_env import Cohorts, Population, Uniform
from crowd_env.agents.evaluation.evaluation import Evaluation
from crowd_env.analysis.results.measurements import CELL
from crowd_env.rendering import save_figure
from crowd_env.rendering.heat import HeatMap, heat_maps


@pytest.mark.parametrize("scheme", ["dem", "nsm1", "nsm2", "hertz"])
def test_a_lone_walker_walks_the_length_of_the_way(scheme):
    result = run("shortest", hall(starts=[(4.0, 3.0)], speed=1.5), scheme, runs=2)
    assert result.measured.walked == pytest.approx(np.full((2, 1), 4.0), abs=1e-3)
    assert result.row()["walked"]["mean"] == pytest.approx(4.0, abs=1e-3)


def test_who_stays_has_walked_nowhere_and_presses_nobody():
    result = run("stand-still", hall(time_limit=1.0))
    assert result.measured.walked == pytest.approx(np.zeros((3, 14)), abs=1e-9)
    assert result.measured.max_pressure == pytest.approx(np.zeros(3))
    assert (result.measured.exit_index == -1).all()
    assert result.measured.simulated == pytest.approx(3.0)


def test_the_greatest_density_is_that_of_the_person_with_the_least_floor():
    starts = [(x, y) for x in (2.0, 2.5, 3.0) for y in (2.5, 3.0, 3.5)]  # the one in the middle has a square of 0.5 m
    env, recorder = recorded(hall(starts=starts, speed=0.0), steps=3)
    assert recorder.record(env, 0).max_density == pytest.approx(4.0, rel=0.003)
    env, recorder = recorded(hall(starts=[(5.0, 3.0)], speed=0.0))
    assert recorder.record(env, 0).max_density == pytest.approx(1.0 / (4.0 * np.pi), rel=0.003)


def test_one_standing_person_is_one_person_on_the_map():
    _, recorder = recorded(hall(starts=[(3.1, 3.3)], speed=0.0), steps=14)
    maps = recorder.maps
    for density in (maps.density_mean, maps.density_max):
        assert density.sum() * CELL**2 == pytest.approx(1.0, rel=0.02)
        assert density.max() == pytest.approx(1 / (4.0 * np.pi), rel=1e-3)
        row, column = np.nonzero(density)
        middle = np.array(recorder.grid.origin) + CELL * (np.array([column.mean(), row.mean()]) + 0.5)
        assert middle == pytest.approx([3.1, 3.3], abs=CELL / 2)
    assert not maps.pressure_max.any()


def test_even_in_a_corner_a_person_is_one_person_on_the_map():
    _, recorder = recorded(hall(starts=[(0.2, 5.8)], speed=0.0))
    assert recorder.maps.density_mean.sum() * CELL**2 == pytest.approx(1.0, rel=0.02)


def test_pressure_is_force_over_circumference_where_the_person_stands():
    env, recorder = recorded(hall(starts=[(3.1, 2.3), (7.1, 4.3)], speed=0.0))
    step = env.step(None)
    env.simulation.results.impulse_magnitude[:] = 50.0, 20.0  # N s in 0.1 s: 500 N and 200 N
    recorder.add(env, step)
    env.simulation.results.impulse_magnitude[:] = 10.0, 0.0
    recorder.add(env, step)
    circumference = 2 * np.pi * 0.2
    assert recorder.record(env, 0).max_pressure == pytest.approx(500.0 / circumference)
    at = {place: recorder.grid.cell_of(np.array([place]))[0] for place in ((3.1, 2.3), (7.1, 4.3), (5.0, 1.0))}
    most, mean = recorder.maps.pressure_max.ravel(), recorder.maps.pressure_mean.ravel()
    assert [most[cell] for cell in at.values()] == pytest.approx([500 / circumference, 200 / circumference, 0.0])
    # Three samples: the start, when nobody is pressed yet, and two steps.
    assert [mean[cell] for cell in at.values()] == pytest.approx([200 / circumference, 200 / 3 / circumference, 0.0])
    assert (most > 0).sum() == 2 * 5  # the cell and its neighbors


def test_who_bears_more_than_the_threshold_of_an_injury_and_for_how_long():
    env, recorder = recorded(hall(starts=[(3.1, 2.3), (7.1, 4.3), (5.0, 1.0)], speed=0.0))
    step, threshold = env.step(None), 1600.0 * 2 * np.pi * 0.2 * 0.1  # N s in 0.1 s
    for shares in ((1.01, 0.99, 3.0), (1.01, 0.99, 0.0), (0.5, 0.99, 0.0), (2.0, 0.0, 0.0)):
        env.simulation.results.impulse_magnitude[:] = threshold * np.array(shares)
        recorder.add(env, step)
    kept = recorder.record(env, 0)
    assert kept.crushed == pytest.approx([0.3, 0.0, 0.1])
    result = run("stand-still", hall(time_limit=0.2), runs=3)
    times = np.zeros((3, 14))
    times[0, :2], times[1, 3] = (0.3, 0.1), 0.4
    row = replace(result, measured=result.measured._replace(crushed=times)).row()
    assert row["crushed_share"]["mean"] == pytest.approx(3 / 42)
    assert row["crushed_time"]["mean"] == pytest.approx((0.2 + 0.4) / 2)  # of the two runs in which anyone was
    assert result.row()["crushed_time"]["mean"] is None


def test_nobody_hurries_more_than_wanted_on_a_free_way():
    result = run("shortest", hall(starts=[(4.0, 3.0)], speed=1.5), runs=2)
    assert result.measured.hurry == pytest.approx([0.9, 0.9], abs=0.1) and result.row()["hurry"]["max"] < 1.0
    assert run("stand-still", hall(time_limit=1.0)).measured.hurry == pytest.approx(np.zeros(3), abs=1e-9)


def test_whoever_hardly_wants_to_walk_and_is_pushed_on_does_not_hurry():
    """Somebody who wants to stand, and somebody who wants 0.05 m/s, in front of people who push."""
    wants = ((2.0, 3.0, 2.7), (2.0, 3.0, 3.3), (0.0, 2.5, 2.7), (0.05, 2.5, 3.3))  # m/s at (x, y)
    crowd = [Population(1, desired_speed=Uniform(v, v), starts=np.array([[x, y]])) for v, x, y in wants]
    env, recorder = recorded(replace(hall(), population=Cohorts(crowd)), steps=30)
    kept, wanted = recorder.record(env, 0), env.simulation.bodies.desired_speed
    assert (kept.walked[wanted < 0.1] > 0.3).all()  # they were pushed
    assert 0.0 < kept.hurry < 1.0


def test_a_jam_at_a_narrow_door_is_denser_there_and_presses():
    result = run("west", hall(count=40, time_limit=40.0), runs=2)
    maps, grid = result.measured.maps, result.measured.grid
    row, column = np.unravel_index(maps.density_mean.argmax(), maps.density_mean.shape)
    x, y = grid.origin[0] + CELL * column, grid.origin[1] + CELL * row
    assert 0 < x < 2 and 2 < y < 4
    assert 2 < result.measured.max_density.max() == pytest.approx(maps.density_max.max(), rel=0.2)
    assert result.measured.max_pressure.max() == pytest.approx(maps.pressure_max.max())


def test_the_figures_of_exits_add_up():
    row = run("fastest").row()
    by_exit = row["exits"]
    assert sum(found["people"]["mean"] for found in by_exit.values()) == 14
    total = sum(found["people"]["mean"] * (found["mean_exit_time"] or 0.0) for found in by_exit.values())
    assert total / 14 == pytest.approx(row["mean_exit_time"]["mean"])


def test_when_95_percent_are_out():
    times = [np.arange(1.0, 41.0), np.where(np.arange(40) < 37, np.arange(1.0, 41.0), np.nan)]
    result = Evaluation("x", "dem", [], times, np.array([60.0, 100.0]), 100.0)
    assert result.exit_time_95()[0] == 38.0 and np.isnan(result.exit_time_95()[1])
    assert result.times_of_all()[1, 37:].tolist() == [100.0] * 3


def test_replanning_is_counted_where_there_is_some():
    replanning, physics = (
        {name: run(name).row()[f"{key}_per_simulated_second"] for name in ("shortest", "fastest")}
        for key in ("replanning", "physics")
    )
    assert replanning["fastest"] > 20 * replanning["shortest"] and min(physics.values()) > 0


# ------------------------------------------------------------------------------------------------------------- pictures


def test_maps_are_drawn_over_the_floor_with_the_colors_asked_for(tmp_path):
    values = np.zeros((24, 40))
    values[10, 5], values[12, 30] = 4.0, 1.0
    maps = [HeatMap(f"map {k}", values, (0.0, 0.0), CELL, "1/m2", kind, full) for k, kind, full in
            ((0, "density", None), (1, "pressure", 2.0))]  # fmt: skip
    figure = heat_maps(SMALL.geometry, maps, title="title", note="note")
    images = [axes.images[0] for axes in figure.axes if axes.images]
    assert len(images) == 2
    assert [image.get_clim() for image in images] == [(0.0, 4.0), (0.0, 2.0)]
    drawn = images[0].get_array()
    assert drawn[10, 5] == 4.0 and drawn.mask.sum() == values.size - 2
    assert images[0].get_extent() == [0.0, 10.0, 0.0, 6.0] and images[0].get_clip_path() is not None
    path = save_figure(heat_maps(SMALL.geometry, maps), tmp_path / "maps.png")
    assert path.read_bytes().startswith(b"\x89PNG") and [p.name for p in tmp_path.iterdir()] == ["maps.png"]
