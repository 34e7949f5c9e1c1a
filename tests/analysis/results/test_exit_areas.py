"""Flow per meter of exits that are areas: by the sides through which people come, and by PedPy on the same runs."""

import json

import numpy as np
import pytest
from cases import looped
from commands import call
from late import late
from shapely.geometry import Point, box

from crowd_env import Geometry, Population, Scenario, make_scenario
from crowd_env.analysis.figures import cells, entered_lengths, exits_of, recorded_flow
from crowd_env.analysis.plan_check import check_place, plain_check
from crowd_env.envs.rollout import run_episodes
from crowd_env.recording import load

pedpy, pandas = late("pedpy"), late("pandas")

AREAS = {
    # The place, its people, the area, and its open sides [m].
    "in the middle": (box(0, 0, 14, 14), 200, box(6, 6, 8, 8), 8.0),
    "at a wall": (box(0, 0, 14, 10), 150, box(6, 0, 8, 1), 4.0),
    "in a corner": (box(0, 0, 14, 10), 150, box(0, 0, 2, 2), 4.0),
    "across an end": (box(0, 0, 14, 2), 60, box(12, 0, 14, 2), 2.0),
    "a strip": (box(0, 0, 14, 10), 40, box(6, 0, 7, 0.1), 1.2),
}


def written(which, folder):
    """Write the place as a scenario file and return its path."""
    walkable, people, area, _ = AREAS[which]
    text = f'[geometry]\nwalkable = "{walkable.wkt}"\nexits = {{ z = "{area.wkt}" }}\n[population]\npeople = {people}\n'
    path = folder / f"{which.replace(' ', '-')}.toml"
    path.write_text(text, "utf-8")
    return path


@looped("which", AREAS)
def test_a_plan_calls_an_area_as_wide_as_its_open_sides(which, tmp_path):
    check, sides = check_place(make_scenario(written(which, tmp_path))), AREAS[which][3]
    assert check.widths["z"] == pytest.approx(sides) and plain_check(check)["exits"][0]["width"] == pytest.approx(sides)
    assert check.passages["z"].gap.width == pytest.approx(sides, rel=0.01) and check.passages["z"].is_exit


@pytest.mark.more
@looped("which", [which for which in AREAS if which != "a strip"])
def test_the_flow_of_an_area_is_that_of_all_its_sides(which, tmp_path):
    path, (_, people, _, sides) = written(which, tmp_path), AREAS[which]
    figures = json.loads(call(f"run {path} --runs 2 --record all --json --out {path.with_suffix('')}").stdout)
    flow = figures["exits"]["z"]["flow_per_meter"]["mean"]
    assert flow * sides == pytest.approx(figures["flow"]["mean"])
    assert ("pass exit z" in figures["doubts"]) == (round(flow, 1) > recorded_flow(figures)[0])
    assert f"z {sides:.2f} m" in cells(make_scenario(path), figures)["exits"]
    slopes = [flow_by_pedpy(path.with_suffix("") / f"recordings/run-{run}.sqlite", people) for run in (0, 1)]
    assert flow == pytest.approx(np.mean(slopes) / sides, rel=0.02)


@looped(
    "took, area, entered",
    [
        ({(10.3, 5.0): 40}, box(10.3, 3.9, 11.3, 6.1), 1.2),  # the door behind which it lies
        ({(10.3, 5.0): 40}, box(10.3, 4.4, 11.3, 5.6), 1.2),
        ({(10.3, 5.0): 39, (11.3, 5.0): 1}, box(10.3, 3.9, 11.3, 6.1), 1.2),
        ({(10.3, 5.0): 30, (11.3, 5.0): 10}, box(10.3, 3.9, 11.3, 6.1), 3.4),
        ({(5.0, 5.0): 30, (5.5, 5.5): 6, (5.5, 4.5): 4}, box(5.0, 4.5, 6.0, 5.5), 3.0),  # in the middle, from one side
        ({(4.0, 5.0): 40}, Point(5.0, 5.0).buffer(1.0), 2.0 * np.pi),
        ({(10.3, 5.0): 5}, box(10.3, 3.9, 11.3, 6.1), 5.4),
    ],
)
def test_the_flow_of_an_area_is_by_the_sides_that_people_enter(took, area, entered):
    geometry = Geometry.from_polygon(
        [box(0, 0, 10, 10), box(10, 4.4, 10.3, 5.6), box(10.3, 0, 15, 10)], exits={"z": area, "door": [(0, 4), (0, 6)]}
    )
    rows = np.repeat(geometry.nearest_exit([*took]), [*took.values()])
    lengths = entered_lengths(geometry, np.append(rows, -1))
    assert lengths == pytest.approx({"z": entered, "door": 2.0}, rel=0.01)


def test_the_flow_through_a_door_into_an_area_is_that_of_the_door():
    floor = [box(0, 0, 5, 5), box(5, 1.9, 5.3, 3.1), box(5.3, 0, 9, 5)]
    place = Geometry.from_polygon(floor, exits={"z": box(5.3, 1.4, 6.3, 3.6)}, regions={"room": box(0, 0, 5, 5)})
    scenario = Scenario("yard", place, Population(30, start_region="room"), 60.0)
    episodes = run_episodes(scenario, 1, scheme="dem")
    assert exits_of(scenario, episodes)["z"]["flow_per_meter"]["mean"] * 1.2 == pytest.approx(episodes[0].metrics.flow)


def flow_by_pedpy(path, people):
    """Return the slope [1/s] of how many people PedPy sees crossing the lines of a recording's exits."""
    kept = load(path)
    x, y = kept.position.T
    moved = pedpy.TrajectoryData(
        pandas.DataFrame({"id": kept.person, "frame": kept.frame, "x": x, "y": y}), frame_rate=10.0
    )
    frames = []
    for _, line in kept.exits:
        _, crossings = pedpy.compute_n_t(traj_data=moved, measurement_line=pedpy.MeasurementLine(line))
        frames += crossings.frame.tolist()
    assert len(frames) == people
    return np.polyfit(np.sort(frames) / 10.0, np.arange(people), 1)[0]
