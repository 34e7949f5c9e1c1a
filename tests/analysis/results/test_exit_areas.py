"""Flow per meter of exits that are areas: by the sides through which people come, and by PedPy on the same runs."""

import json

import numpy as np
import pytest
from cases import looped
from commands import call
from late import late
from shapely.geometry import box

from crowd_env import make_scenario
from crowd_env.analysis.figures import cells, recorded_flow
from crowd_env.analysis.plan_check import check_place, plain_check
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
