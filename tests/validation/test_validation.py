"""The command of the validation map: recordings that it reads, what it prints and writes; and crowded halls."""

import gzip
import json

import numpy as np
import pytest
from cases import looped
from typer.testing import CliRunner

from crowd_env.core.behaviors.headway import Headway
from validation.cases import Case, Setting
from validation.cases.case import COMPARED, row
from validation.cases.halls import Hall, empty, holds, run_in, told
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


@looped(
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


# ----------------------------------------------------------------------------------------------------- the command


def crowd(count):
    return [(0.5 * (k % 8) - 1.75, 0.4 + 0.5 * (k // 8)) for k in range(count)]


@pytest.fixture
def students(tmp_path):
    """Return a folder with a recording of 75 people who stand, as far as the case looks at it."""
    folder = tmp_path / "students"
    folder.mkdir()
    rows = [f"{i}\t{k}\t{x}\t{y - 0.3 * k}\t1.7" for i, (x, y) in enumerate(crowd(75)) for k in range(40)]
    (folder / "run.txt").write_text(HEADER + "\n".join(rows) + "\n")
    return folder


@pytest.mark.more
def test_the_command_reports_draws_and_writes(students, tmp_path):
    out = tmp_path / "out"
    words = ["gate", "--data", students, "--schemes", "nsm1", "--schemes", "dem", "--manner", "calm", "--draws", 1]
    result = run(*words, "--json", "--out", out)
    assert result.exit_code in (0, 1), result.output
    report = json.loads(result.stdout.splitlines()[-1])
    assert [(row["scheme"], row["manner"]) for row in report["rows"]] == [("nsm1", "calm"), ("dem", "calm")]
    first = report["rows"][0]
    assert set(first) == {"case", "scheme", "manner", "passed", "figure", "criterion", "source", "more", "outline"}
    assert "10.34735/ped.2018.1" in first["source"]
    assert first["more"]["starts"] == "recorded" and len(first["more"]["position"]) == 75
    assert result.exit_code == (0 if all(row["passed"] for row in report["rows"]) else 1)
    parts = [json.loads((out / "gate" / f"{scheme}-calm.json").read_text()) for scheme in ("nsm1", "dem")]
    assert [part["rows"] for part in parts] == [[row] for row in report["rows"]]
    assert (out / "gate.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(path.name for path in out.rglob("*.*")) == [
        "dem-calm.json",
        "gate-gaps.png",
        "gate.png",
        "nsm1-calm.json",
    ]


@looped(
    ("words", "said"),
    [
        (["gate", "--schemes", "magic"], "unknown contact scheme"),
        (["--schemes", "magic"], "unknown contact scheme"),
        (["--manner", "rude"], "unknown manner"),
        (["nowhere"], "unknown case 'nowhere'; known: gate, doors"),
        (["gate", "--data", "nowhere"], "no such folder"),
        (["gate", "--out", __file__], "is not a folder"),
    ],
)
def test_bad_input_is_said_plainly(words, said):
    result = run(*words)
    assert result.exit_code == 2
    assert said in result.output


def made_up(run_case, **options):
    return {"made-up": Case("t", run_case, "none", **options)}


@looped("passed", [True, False])
def test_a_new_case_is_one_line_and_decides_the_exit_code(monkeypatch, passed):
    asked = []

    def run_case(setting):
        asked.append(setting)
        return [row("made-up", setting, passed, "1.25 /s", "more is better", "none", flow=1.25)]

    monkeypatch.setattr("validation.cli.CASES", made_up(run_case, manners=("calm", "hurried"), draws=7))
    result = run("--schemes", "dem", "--schemes", "nsm1")
    assert result.exit_code == (0 if passed else 1)
    assert "more is better" in result.stdout and "1.25" in result.stdout
    assert [(one.scheme, one.manner, one.draws, one.seed) for one in asked] == [
        (scheme, manner, 7, 0) for scheme in ("dem", "nsm1") for manner in ("calm", "hurried")
    ]
    again = run("made-up", "--json", "--manner", "competitive", "--draws", 3, "--seed", 5)
    assert [(one["scheme"], one["passed"]) for one in json.loads(again.stdout)["rows"]] == [
        (scheme, passed) for scheme in COMPARED
    ]
    assert (asked[-1].manner, asked[-1].draws, asked[-1].seed) == ("competitive", 3, 5)


def test_a_crowd_that_a_scheme_refuses_is_a_row_and_not_the_end(monkeypatch):
    def run_case(setting):
        if setting.scheme == "nsm1":
            raise FloatingPointError("pedestrian 3 would move 2 m in one step")
        return [row("made-up", setting, True, "1.25 /s", "c", "s")]

    monkeypatch.setattr("validation.cli.CASES", made_up(run_case, manners=("calm",)))
    result = run("--schemes", "nsm1", "--schemes", "dem", "--json")
    assert result.exit_code == 1
    first, second = json.loads(result.stdout)["rows"]
    assert (first["passed"], second["passed"]) == (False, True) and "pedestrian 3" in first["figure"]


def test_numbers_of_a_row_are_what_json_holds():
    setting = Setting("dem", Headway(time_gap=0.7))
    one = row("made-up", setting, None, "", "", "", a=np.arange(2), b=(np.float64("nan"), float("inf")), c={"d": True})
    assert one.more == {"a": [0, 1], "b": [None, None], "c": {"d": True}}
    assert "time_gap=0.7" in one.manner and json.dumps(one._asdict(), allow_nan=False)


# ------------------------------------------------------------------------------------------------------------- halls


PACKED = Setting("dem", "competitive", draws=1)


@pytest.mark.more
def test_a_hall_is_emptied_with_nobody_outside():
    found = empty(Hall(500, 4.0, 4.0), PACKED, time_limit=3.0)
    assert holds(found) and found["people"] == 500
    assert found["outside"] == 0 < found["fastest, m/s"] <= 12.5
    assert "nobody outside" in told(found)


@pytest.mark.more
def test_a_step_that_is_refused_is_told_with_what_was_seen_until_then(monkeypatch):
    def refused(self, action):
        raise FloatingPointError("person 7 went too far")

    monkeypatch.setattr("crowd_env.envs.crowd.CrowdEnv.step", refused)
    (one,) = run_in((Hall(500, 4.0, 4.0),), "halls")(PACKED)
    assert one.passed is False and "person 7 went too far" in one.figure
    assert (one.more["stopped"], one.more["left"]) == ("person 7 went too far", 500)


def test_halls_that_do_not_hold_are_said_to():
    found = {"outside": 0, "stopped": None, "fastest, m/s": 12.5}
    assert holds(found)
    for bad in ({"outside": 1}, {"stopped": "went too far"}, {"fastest, m/s": 12.6}):
        assert not holds(found | bad)
