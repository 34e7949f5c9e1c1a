"""The command that reproduces tables and figures."""

import json

import pytest
from reproductions import PNG, call, check_files, reported

from crowd_env.cli import reproduce as command
from crowd_env.core.files.atomic import written
from crowd_env.reproduce import FIGURES, Row

KEYS = {"quantity", "paper", "here", "unit", "n"}


@pytest.mark.more
def test_json_files_and_figure(folder):
    for name, line in {
        "fig2": "fig2 --runs 2 --seed 3",
        "fig3": "fig3 --runs 2 --set people=6 --seed 3 --workers 1",
    }.items():
        object = reported(f"{line} --out reproduce")
        assert object["name"] == name and all(set(row) >= KEYS for row in object["rows"]), name
        check_files(object, folder)
        files = sorted(path.name for path in (folder / "reproduce").glob(f"{name}*"))
        assert len(files) == 4 and not list((folder / "reproduce").glob(".*")), name
        assert json.loads((folder / "reproduce" / f"{name}.json").read_text(encoding="utf-8")) == object
    assert reported("fig3 --runs 2 --set people=6 --seed 3 --workers 1") == object  # from the runs that are kept
    assert reported("fig3 --runs 2 --set people=6 --seed 9 --workers 1") != object


@pytest.mark.more
def test_table_is_readable_and_fits(folder):
    result = call("fig3 --runs 2 --set people=6 --workers 1 --out here/and/there")
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert max(len(line) for line in lines) <= 100
    head = (
        "quantity",
        "paper",
        "here",
        "difference",
        "estimator and reading used",
        "flow, nsm2-printed, per run",
        "people 6",
    )
    assert all(words in result.stdout for words in head) and "nan" not in result.stdout
    assert (folder / "here/and/there/fig3-exit-times.csv").exists()
    assert "files: here/and/there/fig3.csv" in result.stderr


@pytest.mark.more
def test_other_options_are_reported(folder):
    object = reported(
        "fig3 --runs 1 --workers 1 --set people=5 --set scheme=dem --set stiffness=5e4 --set door_width=0.9"
    )
    assert object["options"] == {"scheme": "dem", "people": 5, "stiffness": 5e4, "door_width": 0.9}


MISTAKES = (
    ("fig9", "fig9 table3 fig1 fig2 fig3 table5 list all"),
    ("table3 --set door_width=1", "door_width fig3 table5 table3"),
    ("fig1 --set scheme=dem", "scheme fig3 fig1"),
    ("table5 --set scheme=dem", "scheme fig3 table5"),
    ("fig3 --set scheme=glue", "glue dem nsm1 nsm2-printed"),
    ("fig3 --set scheme=hertz", "scheme hertz dem nsm1 nsm2-printed"),
    ("fig3 --set scheme=nsm2", "scheme nsm2 dem nsm1 nsm2-printed"),
    ("fig3 --set stiffness=1e5 --set scheme=nsm1", "stiffness dem nsm1"),
    ("fig3 --set k_normal=1e4 --set scheme=dem", "k_normal nsm2-printed dem"),
    ("table5 --runs 0", "--runs 0 at least 1"),
    ("table5 --seed -1", "--seed -1 at least 0"),
    ("table5 --set people=2", "people 2 slope 3 people"),
    ("table5 --set people=900", "900 do not fit"),
    ("table5 --set target=up", "target up path nearest centre width"),
    ("table5 --set door_width=0", "door_width > 0"),
    ("table5 --set door_width=6", "door_width side"),
    ("table5 --set door_width=0.3", "0.30 m narrower"),
    ("table5 --set door_width=nan", "door_width nan finite"),
    ("table5 --set side=inf", "side inf finite"),
    ("table5 --set side=0", "side > 0"),
    ("table5 --set dt=0", "dt > 0"),
    ("table5 --set dt=0.05", "dt 0.05 stable step dem 0.0316"),
    ("table5 --set stiffness=0", "stiffness > 0"),
    ("table5 --set stiffness=1e9", "stable step dem"),
    ("table5 --set k_normal=-1", "normal_dissipation >= 0"),
    ("table5 --set k_tangent=-1", "tangential_dissipation >= 0"),
    ("all --set k_tangent=-1", "tangential_dissipation >= 0"),
    ("table3 --out taken", "--out taken not a folder"),
    ("lin-fig11", "lin-fig11 lin-fig4 lin-fig10 pecol lin all"),
    ("table5 --set preset=literal", "preset lin table5"),
    ("pecol --set no_rotation=true", "no_rotation lin pecol"),
    ("table3 --workers 2", "--workers lin table3"),
    ("fig2 --fresh", "--fresh lin fig2"),
    ("lin --set door_width=1", "door_width fig3 table5 lin"),
    ("lin-fig7 --set people=50", "people fig3 table5 lin-fig7"),
    ("lin-fig7 --set scheme=dem", "scheme fig3 lin-fig7"),
    ("lin-fig5 --set no_rotation=true", "no_rotation belongs to lin-fig4, lin-fig6"),
    ("lin-fig6 --runs 3", "--runs lin-fig6"),
    ("lin-fig4 --set preset=guess", "preset guess calibrated literal"),
    ("lin-fig4 --set damping=much", "damping much per-length rate critical"),
    ("lin-fig4 --set target=up", "target up path nearest centre width"),
    ("lin-fig4 --runs 0", "--runs 0 at least 1"),
    ("lin-fig4 --seed -1", "--seed -1 at least 0"),
    ("lin-fig4 --workers 0", "--workers 0 at least 1"),
    ("lin-fig4 --set dt=0", "dt > 0"),
    ("lin-fig4 --set dt=nan", "dt finite"),
    ("lin-fig7 --set dt=0.02", "dt 0.02 stable step"),
    ("lin-fig4 --set wall_friction=-1", "wall_friction >= 0"),
    ("lin-fig4 --set wall_social=-1", "wall_strength >= 0"),
    ("lin-fig4 --set anisotropy=2", "anisotropy [-1, 1]"),
    ("lin-fig4 --set cutoff=0", "cutoff > 0"),
    ("lin-fig4 --set cutoff=inf", "cutoff finite"),
    ("lin-fig4 --set exit_depth=-1", "exit_depth [0, 5]"),
    ("all --set preset=guess", "preset guess"),
    ("lin-fig4 --out taken", "--out taken not a folder"),
)


def test_a_mistake_is_one_plain_line_before_anything_runs(folder, monkeypatch):
    (folder / "taken").write_text("a file")
    monkeypatch.setattr(command, "_results", lambda *_: pytest.fail("ran"))
    failures = []
    for line, words in MISTAKES:
        result = call(line)
        plain = result.stderr.startswith("error: ") and result.stderr.count("\n") == 1
        if (result.exit_code, result.stdout, plain) != (2, "", True) or any(
            w not in result.stderr for w in words.split()
        ):
            failures.append((line, words, result.output))
    assert not failures
    assert [path.name for path in folder.iterdir()] == ["taken"]


@pytest.mark.more
def test_a_malformed_command_is_a_usage_error():
    for line in ("", "table3 fig1", "table5 --runs many", "table5 --set"):
        result = call(line)
        assert result.exit_code == 2 and result.stdout == "" and "Traceback" not in result.output, line


@pytest.mark.more
def test_an_interruption_leaves_old_files_and_no_pieces(tmp_path, results):
    result = results("table3")
    (tmp_path / "table3.csv").write_text("old")

    def interrupted():
        yield ("first",)
        raise KeyboardInterrupt

    from crowd_env.core.files.csv_table import write_csv

    with pytest.raises(KeyboardInterrupt):
        write_csv(tmp_path / "table3.csv", ("name",), interrupted())
    with pytest.raises(KeyboardInterrupt), written(tmp_path / "table3.png") as part:
        part.write_bytes(PNG)
        raise KeyboardInterrupt
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("table3.csv", "old")]
    result.save(tmp_path)
    assert (tmp_path / "table3.csv").read_text().startswith("quantity,paper,here")


@pytest.mark.more
def test_without_a_drawing_library_the_numbers_are_still_written(folder, monkeypatch):
    def missing(*_):
        raise ModuleNotFoundError("drawing needs matplotlib, which is not installed")

    monkeypatch.setattr("crowd_env.reproduce.pecol2011.fig2.draw", missing)
    result = call("fig2")
    assert result.exit_code == 0 and "no figure: drawing needs matplotlib" in result.stderr
    assert sorted(path.name for path in (folder / "reproduce").iterdir()) == [
        "fig2-trajectories.csv",
        "fig2.csv",
        "fig2.json",
    ]


def test_a_row_says_how_far_it_is_from_the_paper():
    for paper, here, unit, shown, difference in (
        ("2.03066571837719", 2.030665718377193, "m/s", "2.03066571837719", "exact"),
        ("2.03066571837719", 2.03066571837712, "m/s", "2.03066571837712", "-7e-14"),
        ("2", 2.0, "m/s", "2", "exact"),
        ("2", 1.9332, "m/s", "1.9332", "-0.067"),
        ("0", 1e-15, "m/s", "0", "exact"),
        ("2.60", 2.4339, "1/s", "2.43", "-6.4 %"),
        ("2.67", None, "1/s", "-", "-"),
        (None, 0.5, "share", "0.50", "-"),
    ):
        row = Row("x", paper, here, unit, 1, "")
        assert (row.shown(), row.difference()) == (shown, difference), paper


@pytest.mark.nightly
def test_all_runs_everything(folder):
    object = reported("all --runs 2 --set people=8")
    assert object["name"] == "all" and object["options"] == {"people": 8}
    assert [name for name in FIGURES if any(row["of"] == name for row in object["rows"])] == list(FIGURES)
    for name in FIGURES:
        assert (folder / "reproduce" / f"{name}.png").read_bytes()[:8] == PNG
        assert (folder / "reproduce" / f"{name}.csv").stat().st_size > 200
    result = call("all --runs 1 --set people=5")
    assert result.exit_code == 0 and max(len(line) for line in result.stdout.splitlines()) <= 100
