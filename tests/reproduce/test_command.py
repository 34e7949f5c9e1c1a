"""The command that reproduces tables and figures."""

import json

import pytest
import typer
from reproductions import PNG, call, check_files, reported
from typer.testing import CliRunner

from crowd_env.cli.reproduce import reproduce
from crowd_env.core.files.atomic import written
from crowd_env.reproduce import FIGURES, Row
from crowd_env.reproduce.lin2016.run import Run

# ---------------------------------------------------------------------------------------------------- how it is said


KEYS = {"quantity", "paper", "here", "unit", "n"}


@pytest.mark.parametrize("name", ["table3", "fig2", "fig3"])
def test_json_files_and_figure(name, folder):
    object = reported(f"{name} --runs 2 --n 6 --seed 3" if name == "fig3" else f"{name} --runs 2 --seed 3")
    assert object["name"] == name and all(set(row) >= KEYS for row in object["rows"])
    check_files(object, folder)
    files = sorted(path.name for path in (folder / "reproduce").iterdir())
    assert [file for file in files if file.startswith(".")] == [] and len(files) == 4
    assert json.loads((folder / "reproduce" / f"{name}.json").read_text(encoding="utf-8")) == object


def test_table_is_readable_and_fits(folder):
    result = call("fig3 --runs 2 --n 6 --out here/and/there")
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert max(len(line) for line in lines) <= 100
    for words in (
        "quantity",
        "paper",
        "here",
        "difference",
        "estimator and reading used",
        "flow, nsm2-printed, per run",
        "--n 6",
    ):
        assert words in result.stdout
    assert "nan" not in result.stdout
    assert (folder / "here/and/there/fig3-exit-times.csv").exists()
    assert "files: here/and/there/fig3.csv" in result.stderr


def test_the_same_command_gives_the_same_numbers(folder):
    assert reported("fig3 --runs 2 --n 6") == reported("fig3 --runs 2 --n 6")
    assert reported("fig3 --runs 2 --n 6") != reported("fig3 --runs 2 --n 6 --seed 9")


def test_other_options_are_reported(folder):
    object = reported("fig3 --runs 1 --n 5 --scheme dem --stiffness 5e4 --door-width 0.9")
    assert object["options"] == {"scheme": "dem", "n": 5, "stiffness": 5e4, "door_width": 0.9}
    assert reported("table3")["options"] == {}


def test_list_names_everything():
    names = reported("list")["names"]
    assert list(names)[:5] == ["table3", "fig1", "fig2", "fig3", "table5"]
    assert all(name in call("list").stdout for name in names)


def test_it_is_a_command_of_a_larger_one():
    parent = typer.Typer()
    parent.command("reproduce")(reproduce)
    parent.command("other")(lambda: None)
    result = CliRunner().invoke(parent, ["reproduce", "list", "--json"])
    assert result.exit_code == 0 and set(json.loads(result.stdout)["names"]) == set(FIGURES)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("fig9", "fig9 table3 fig1 fig2 fig3 table5 list all"),
        ("table3 --door-width 1", "--door-width fig3 table5 table3"),
        ("fig1 --scheme dem", "--scheme fig3 fig1"),
        ("table5 --scheme dem", "--scheme fig3 table5"),
        ("fig3 --scheme glue", "glue dem nsm1 nsm2-printed"),
        ("fig3 --scheme hertz", "--scheme hertz dem nsm1 nsm2-printed"),
        ("fig3 --scheme nsm2", "--scheme nsm2 dem nsm1 nsm2-printed"),
        ("fig3 --stiffness 1e5 --scheme nsm1", "--stiffness dem nsm1"),
        ("fig3 --k-normal 1e4 --scheme dem", "--k-normal nsm2-printed dem"),
        ("table5 --runs 0", "--runs 0 at least 1"),
        ("table5 --seed -1", "--seed -1 >= 0"),
        ("table5 --n 2", "--n 2 slope 3 people"),
        ("table5 --n 900", "900 do not fit"),
        ("table5 --target up", "--target up path nearest centre width"),
        ("table5 --door-width 0", "door_width above 0"),
        ("table5 --door-width 6", "door_width side"),
        ("table5 --door-width 0.3", "0.30 m narrower"),
        ("table5 --door-width nan", "--door-width nan finite"),
        ("table5 --side inf", "--side inf finite"),
        ("table5 --side 0", "side > 0"),
        ("table5 --dt 0", "--dt > 0"),
        ("table5 --dt 0.05", "--dt 0.05 stable step dem 0.0316"),
        ("table5 --stiffness 0", "stiffness > 0"),
        ("table5 --stiffness 1e9", "stable step dem"),
        ("table5 --k-normal -1", "normal_dissipation >= 0"),
        ("table5 --k-tangent -1", "tangential_dissipation >= 0"),
        ("all --k-tangent -1", "tangential_dissipation >= 0"),
        ("table3 --out taken", "--out taken not a folder"),
        ("lin-fig11", "lin-fig11 lin-fig4 lin-fig10 pecol lin all"),
        ("table5 --preset literal", "--preset lin table5"),
        ("pecol --no-rotation", "--no-rotation lin pecol"),
        ("table3 --workers 2", "--workers lin table3"),
        ("fig2 --fresh", "--fresh lin fig2"),
        ("lin --door-width 1", "--door-width fig3 table5 lin"),
        ("lin-fig7 --n 50", "--n fig3 table5 lin-fig7"),
        ("lin-fig7 --scheme dem", "--scheme fig3 lin-fig7"),
        ("lin-fig5 --no-rotation", "--no-rotation all but lin-fig5"),
        ("lin-fig6 --runs 3", "--runs lin-fig6"),
        ("lin-fig4 --preset guess", "--preset guess calibrated literal"),
        ("lin-fig4 --damping much", "--damping much per-length rate critical"),
        ("lin-fig4 --target up", "--target up path nearest centre width"),
        ("lin-fig4 --runs 0", "--runs 0 at least 1"),
        ("lin-fig4 --seed -1", "--seed -1 >= 0"),
        ("lin-fig4 --workers 0", "--workers 0 at least 1"),
        ("lin-fig4 --dt 0", "--dt > 0"),
        ("lin-fig4 --dt nan", "--dt finite"),
        ("lin-fig7 --dt 0.02", "dt 0.02 stable step"),
        ("lin-fig4 --wall-friction -1", "wall_friction >= 0"),
        ("lin-fig4 --wall-social -1", "wall_strength >= 0"),
        ("lin-fig4 --anisotropy 2", "anisotropy [-1, 1]"),
        ("lin-fig4 --cutoff 0", "cutoff > 0"),
        ("lin-fig4 --cutoff inf", "--cutoff finite"),
        ("lin-fig4 --exit-depth -1", "exit_depth [0, 5]"),
        ("all --preset guess", "--preset guess"),
        ("lin-fig4 --out taken", "--out taken not a folder"),
    ],
)
def test_a_mistake_is_one_plain_line_before_anything_runs(line, words, folder, monkeypatch):
    (folder / "taken").write_text("a file")
    monkeypatch.setattr(Run, "simulate", lambda *_: pytest.fail("ran"))
    monkeypatch.setattr("crowd_env.cli.reproduce._run", lambda *_: pytest.fail("ran"))
    result = call(line)
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert result.stderr.startswith("error: ") and result.stderr.count("\n") == 1
    for word in words.split():
        assert word in result.stderr
    assert [path.name for path in folder.iterdir()] == ["taken"]


def test_an_option_of_one_scheme_may_be_given_to_all(folder, monkeypatch):
    asked = []

    def stop(name, *_):
        asked.append(name)
        raise ValueError("far enough")

    monkeypatch.setattr("crowd_env.cli.reproduce._run", stop)
    assert "far enough" in call("all --stiffness 5e4").stderr
    assert asked == ["table3"]


@pytest.mark.parametrize("line", ["", "table3 fig1", "table5 --runs many", "table5 --dt"])
def test_a_malformed_command_is_a_usage_error(line):
    result = call(line)
    assert result.exit_code == 2 and result.stdout == "" and "Traceback" not in result.output


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


def test_without_a_drawing_library_the_numbers_are_still_written(folder, monkeypatch):
    def missing(*_):
        raise ModuleNotFoundError("drawing needs matplotlib, which is not installed")

    monkeypatch.setattr("crowd_env.reproduce.pecol2011.fig2.collisions", missing)
    result = call("fig2")
    assert result.exit_code == 0 and "no figure: drawing needs matplotlib" in result.stderr
    assert sorted(path.name for path in (folder / "reproduce").iterdir()) == [
        "fig2-trajectories.csv",
        "fig2.csv",
        "fig2.json",
    ]


@pytest.mark.parametrize(
    ("paper", "here", "unit", "shown", "difference"),
    [
        ("2.03066571837719", 2.030665718377193, "m/s", "2.03066571837719", "exact"),
        ("2.03066571837719", 2.03066571837712, "m/s", "2.03066571837712", "-7e-14"),
        ("2", 2.0, "m/s", "2", "exact"),
        ("2", 1.9332, "m/s", "1.9332", "-0.067"),
        ("0", 1e-15, "m/s", "0", "exact"),
        ("2.60", 2.4339, "1/s", "2.43", "-6.4 %"),
        ("2.67", None, "1/s", "-", "-"),
        (None, 0.5, "share", "0.50", "-"),
    ],
)
def test_a_row_says_how_far_it_is_from_the_paper(paper, here, unit, shown, difference):
    row = Row("x", paper, here, unit, 1, "")
    assert (row.shown(), row.difference()) == (shown, difference)


@pytest.mark.nightly
def test_all_runs_everything(folder):
    object = reported("all --runs 2 --n 8")
    assert object["name"] == "all" and object["options"] == {"n": 8}
    assert [name for name in FIGURES if any(row["of"] == name for row in object["rows"])] == list(FIGURES)
    for name in FIGURES:
        assert (folder / "reproduce" / f"{name}.png").read_bytes()[:8] == PNG
        assert (folder / "reproduce" / f"{name}.csv").stat().st_size > 200
    result = call("all --runs 1 --n 5")
    assert result.exit_code == 0 and max(len(line) for line in result.stdout.splitlines()) <= 100
