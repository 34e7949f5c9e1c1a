"""The cases on made-up data: the gate with its recording, geometry, counts, figures and files; halls; and their command."""

import gzip
import json
import shlex

import numpy as np
import pytest
from typer.testing import CliRunner

from crowd_env.cli.main import app as crowd_env_app
from validation.cases import CASES
from validation.cases.case import Case, Finding
from validation.cases.gate import Counts, export, gate_geometry, gate_scenario, largest_radius, recorded, simulated
from validation.cases.halls import Hall, empty, holds
from validation.cases.trajectories import find_recording, read_trajectories
from validation.cli import app

HEADER = "#made up\n# framerate: 10 fps\n# id frame x/m y/m z/m\n"
# Three people walk straight down at 1 m/s and pass the end of the gate (y = -1.1) one after the other.
STARTS = [(0.0, 0.4), (0.1, 2.05), (-0.6, 1.0)]


def lines():
    rows = []
    for person, (x, y) in enumerate(STARTS, start=1):
        rows += [f"{person}\t{frame}\t{x}\t{y - 0.1 * frame:.4f}\t1.7" for frame in range(50)]
    return rows


@pytest.fixture
def data(tmp_path):
    folder = tmp_path / "data"
    folder.mkdir()
    (folder / "run.txt").write_text(HEADER + "\n".join(lines()) + "\n")
    (folder / "README.md").write_text("not a trajectory")
    return folder


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


# ------------------------------------------------------------------------------------------------------------ reading


def test_first_positions_and_times_at_the_line(data):
    trajectories = read_trajectories(find_recording(data))
    np.testing.assert_allclose(trajectories.starts, STARTS)
    np.testing.assert_allclose(trajectories.crossing_times(-1.1), [1.5, 3.15, 2.1])
    assert np.isnan(trajectories.crossing_times(-10.0)).all()
    np.testing.assert_allclose(recorded(trajectories).times, [[1.5, 2.1, 3.15]])


def test_rows_in_any_order_and_packed(data, tmp_path):
    shuffled = np.random.default_rng(0).permutation(lines())
    packed = tmp_path / "packed.txt.gz"
    packed.write_bytes(gzip.compress((HEADER + "\n".join(shuffled) + "\n").encode()))
    plain, other = read_trajectories(find_recording(data)), read_trajectories(find_recording(packed))
    np.testing.assert_array_equal(plain.position, other.position)
    np.testing.assert_array_equal(plain.time, other.time)


def test_only_the_first_crossing_counts(tmp_path):
    path = tmp_path / "back.txt"
    path.write_text(HEADER + "\n".join(f"7 {k} 0 {y}" for k, y in enumerate([1, -1, 1, -3])) + "\n")
    assert read_trajectories(path).crossing_times(0.0) == pytest.approx([0.05])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1 0 0.0 1.0\n", "framerate"),
        (HEADER + "1 0 zero 1.0\n", "columns must be id, frame, x, y"),
        (HEADER + "1 0 0.0\n", "four numbers"),
        (HEADER + "1 0 nan 1.0\n", "four numbers"),
        (HEADER, "four numbers"),
    ],
)
def test_what_is_no_recording_is_refused(tmp_path, text, said):
    path = tmp_path / "bad.txt"
    path.write_text(text)
    with pytest.raises(ValueError, match=said):
        read_trajectories(path)


def test_the_folder_must_hold_one_recording(tmp_path, data):
    with pytest.raises(ValueError, match="no such folder"):
        find_recording(tmp_path / "nowhere")
    (data / "second.txt").write_text(HEADER)
    with pytest.raises(ValueError, match="2 files"):
        find_recording(data)
    result = run("gate", "--data", data)
    assert result.exit_code == 2
    assert "2 files" in result.output


# ----------------------------------------------------------------------------------------------------- plan and people


def test_the_plan_is_waiting_area_funnel_and_gate():
    geometry = gate_geometry()
    assert geometry.area == pytest.approx(5.6 * 6.7 + (0.8 + 0.5) / 2 * 0.15 + 0.5 * 0.95)
    assert geometry.exit_names == ("gate",)
    np.testing.assert_allclose(np.hypot(*(geometry.exits[0, 1] - geometry.exits[0, 0])), 0.5)
    inside = geometry.contains([(0, 3), (0, -1), (0.3, -0.05), (0.3, -0.5), (2.9, 3), (0, -1.2)])
    assert inside.tolist() == [True, True, True, False, False, False]


def test_the_largest_radius_is_the_largest_that_is_accepted():
    starts = np.array([(0.0, 1.0), (0.33, 1.2), (-2.0, 3.0)])
    geometry = gate_geometry()
    radius = largest_radius(geometry, starts)
    gate_scenario(starts, radius).population.draw(np.random.default_rng(0), geometry)
    with pytest.raises(ValueError, match="overlap"):
        gate_scenario(starts, radius + 1e-3).population.draw(np.random.default_rng(0), geometry)
    assert largest_radius(geometry, np.array([(0.0, 3.0), (0.2, 3.0)])) == pytest.approx(0.1)
    with pytest.raises(ValueError, match="person 2"):
        largest_radius(geometry, np.array([(0.0, 3.0), (4.0, 3.0)]))


def test_people_start_where_they_were_seen_and_leave_by_the_gate():
    counts = simulated(gate_scenario(np.array(STARTS), 0.2), "nsm2", runs=2)
    assert counts.times.shape == (2, 3)
    assert np.isfinite(counts.times).all()
    # The one in front has 1.5 m to go, at 1.2 to 2 m/s after getting up speed.
    assert (counts.times[:, 0] > 1.5 / 2.0).all() and (counts.times[:, 0] < 1.5 / 1.2 + 0.5).all()
    assert not np.array_equal(counts.times[0], counts.times[1])  # other speeds and masses


# ------------------------------------------------------------------------------------------------------------- figures


def figure(times):
    return Counts("made up", times, "1", {}).finding().figure


def test_a_run_that_got_stuck_counts_as_stuck():
    found = figure(np.array([[1.0, 2.0, 3.0, 4.0], [1.0, 2.0, np.nan, np.nan]]))
    assert (found["flow, 1/s"], found["sd of flow"]) == (1.0, None)  # of the run that finished
    assert (found["left inside"], found["stuck"], found["runs"]) == (2, 1, 2)
    assert found["4th, s"] is None


def test_counted_persons():
    found = figure(np.arange(1.0, 76.0)[None])
    assert [key for key in found if key.endswith("th, s")] == ["10th, s", "20th, s", "40th, s", "60th, s", "75th, s"]
    assert found["40th, s"] == 40.0


def test_the_command_reports_draws_and_writes(data, tmp_path):
    out = tmp_path / "out"
    words = ["gate", "--data", data, "--schemes", "nsm1", "--schemes", "dem", "--draws", 2, "--json", "--out", out]
    result = run(*words)
    assert result.exit_code == 0, result.output
    report = json.loads(result.stdout.splitlines()[-1])
    assert [row["scheme"] for row in report["rows"]] == ["recorded", *["nsm1", "dem"] * 2]
    recording, nsm1 = report["rows"][:2]
    assert set(recording) == {"case", "scheme", "passed", "figure", "criterion", "source"}
    assert "10.34735/ped.2018.1" in recording["source"] and recording["passed"] is None
    assert recording["figure"]["speed in the gate, m/s"] == pytest.approx(1.0)
    assert recording["figure"]["3th, s"] == pytest.approx(3.15)
    assert (nsm1["figure"]["desired speed, m/s"], nsm1["figure"]["runs"]) == ("1.2 to 2", 2)
    assert json.loads((out / "gate.json").read_text()) == report
    assert (out / "gate.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(path.name for path in out.iterdir()) == ["gate.json", "gate.png", "gate.wkt", "starts.csv"]


def test_the_command_prints_a_table(data):
    result = run("gate", "--data", data, "--schemes", "nsm2", "--draws", 1)
    assert result.exit_code == 0, result.output
    assert "recorded" in result.stdout and "nsm2" in result.stdout


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["gate", "--schemes", "magic"], "unknown contact scheme"),
        (["--schemes", "magic"], "unknown contact scheme"),
        (["nowhere"], "unknown case 'nowhere'; known: frozen, gate, halls, great-halls"),
        (["gate"], "name their folder by --data"),
        (["gate", "--out", __file__], "is not a folder"),
    ],
)
def test_bad_input_is_said_plainly(words, said):
    result = run(*words)
    assert result.exit_code == 2
    assert said in result.output


@pytest.mark.parametrize("passed", [True, False])
def test_a_new_case_is_one_line_and_decides_the_exit_code(monkeypatch, passed):
    asked = []

    def measure(settings):
        asked.append(settings)
        yield Finding("dem", passed, {"flow, 1/s": 1.25, "stopped": None})

    monkeypatch.setattr("validation.cli.CASES", {"made-up": Case("t", "more is better", "none", ("dem",), measure)})
    result = run("--draws", 3)
    assert result.exit_code == (0 if passed else 1)
    assert "more is better" in result.stdout and "1.25" in result.stdout and "stopped" not in result.stdout
    assert (asked[0].schemes, asked[0].draws) == (("dem",), 3)
    assert json.loads(run("made-up", "--json").stdout)["rows"][0]["passed"] is passed


def test_an_interruption_loses_no_finished_row(monkeypatch, tmp_path):
    def measure(settings):
        yield Finding("dem", True, {"flow, 1/s": 1.25})
        raise KeyboardInterrupt

    monkeypatch.setattr("validation.cli.CASES", {"made-up": Case("t", "c", "s", ("dem",), measure)})
    result = run("--out", tmp_path / "out")
    assert result.exit_code == 130 and "finished are in" in result.stderr
    assert len(json.loads((tmp_path / "out" / "made-up.json").read_text())["rows"]) == 1


def test_a_case_without_its_data_is_left_out_unless_it_is_named(monkeypatch):
    monkeypatch.setattr("validation.cli.CASES", {"gate": CASES["gate"]})
    result = run()
    assert result.exit_code == 0 and "gate is left out" in result.stderr


# ---------------------------------------------------------------------------------------------------------------- export


def test_the_exported_files_run_and_give_the_same_evacuation(data, tmp_path):
    starts = read_trajectories(find_recording(data)).starts
    words = shlex.split(export(tmp_path / "plan", starts, 0.2))
    assert words[:2] == ["crowd-env", "run"]
    words[words.index("--runs") + 1] = "1"
    rerun = CliRunner().invoke(crowd_env_app, [*words[1:], "--json"])
    assert rerun.exit_code == 0, rerun.output
    expected = simulated(gate_scenario(starts, 0.2), "nsm2", runs=1).times.max()
    assert json.loads(rerun.stdout)["evacuation_time"]["mean"] == pytest.approx(expected, abs=1e-9)


def test_export_writes_the_plan_and_the_starts(tmp_path):
    command = export(tmp_path, np.array(STARTS), 0.2)
    assert (tmp_path / "gate.wkt").read_text().startswith("POLYGON ((-2.8 6.7, -2.8 0, ")
    assert (tmp_path / "starts.csv").read_text().splitlines()[:2] == ["x,y", "0.0000,0.4000"]
    assert "--exit -0.25,-1.1,0.25,-1.1" in command


# ------------------------------------------------------------------------------------------------------------- halls


def test_a_hall_is_emptied_with_nobody_outside():
    found = empty(Hall(500, 4.0, 4.0), "dem", time_limit=3.0)
    assert found.passed is True and found.figure["people"] == 500
    assert found.figure["outside"] == 0 < found.figure["fastest, m/s"] <= 12.5


def test_a_step_that_is_refused_is_told_with_what_was_seen_until_then(monkeypatch):
    def refused(self, action):
        raise FloatingPointError("person 7 went too far")

    monkeypatch.setattr("crowd_env.envs.crowd.CrowdEnv.step", refused)
    found = empty(Hall(500, 4.0, 4.0), "dem")
    assert found.passed is False
    assert (found.figure["stopped"], found.figure["left"]) == ("person 7 went too far", 500)


def test_halls_that_do_not_hold_are_said_to():
    figure = {"outside": 0, "stopped": None, "fastest, m/s": 12.5}
    assert holds(figure)
    for bad in ({"outside": 1}, {"stopped": "went too far"}, {"fastest, m/s": 12.6}):
        assert not holds(figure | bad)
