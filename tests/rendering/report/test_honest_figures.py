"""What a report must not say: differences that come from a time limit, curves beyond it, shares of what was not looked for."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from cases import looped
from reported_pages import Parsed, command

from crowd_env.cli.report import place_of
from crowd_env.rendering.report import figures
from crowd_env.rendering.report.figures import differences
from crowd_env.rendering.report.runs import load_runs

pytestmark = pytest.mark.more

HALL = ("run", "two-exit-hall-v0", "--people", 20, "--runs", 3, "--scheme", "dem")


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of two folders of runs that differ by the time limit alone; in the second all runs are cut short."""
    home = tmp_path_factory.mktemp("cut")
    assert command(*HALL, "--out", home / "whole")[0] == 0
    assert command(*HALL, "--time-limit", 4, "--out", home / "cut")[0] == 0
    return home


def test_people_who_were_cut_off_make_no_run_quicker(folders: Path) -> None:
    runs = load_runs([folders / "whole", folders / "cut"], place_of)
    assert all(0 < one.metrics.unfinished < 20 for one in runs[1].episodes)
    (gap,) = differences(runs)
    assert gap["shared_seeds"] == 3
    assert gap["mean_exit_time"]["mean"] is None and gap["mean_exit_time"]["pairs"] == 0


def test_figures_of_those_who_got_out_are_said_to_be_that(folders: Path, tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    code, _, said = command("report", folders / "whole", folders / "cut", "-o", page, "--no-maps")
    left = sum(one.metrics.unfinished for one in load_runs([folders / "cut"], place_of)[0].episodes)
    warning = f"in 3 of 3 runs people were left inside, {left} in all"
    assert code == 0 and warning in said
    text = Parsed(page).text
    assert warning in text and "the time limit ended a run" in text
    assert "0 of 3 (0 to 56 %)" in text  # runs in which someone was left inside: of the whole ones
    assert text.count("not looked for") == 3  # one cell of the assumptions for both, and one of the results for each


def test_an_evacuation_time_says_of_how_many_runs_it_is(folders: Path, tmp_path: Path) -> None:
    limit = np.sort([one.metrics.evacuation_time for one in load_runs([folders / "whole"], place_of)[0].episodes])[1]
    some = tmp_path / "some"
    assert command(*HALL, "--time-limit", f"{limit + 0.01:.3f}", "--out", some)[0] == 0
    page = tmp_path / "report.html"
    assert command("report", some, "-o", page, "--no-maps")[0] == 0
    assert "of the 2 of 3 runs in which everyone got out" in Parsed(page).text


def test_a_curve_ends_where_the_time_limit_ended_a_run(
    folders: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[np.ndarray] = []
    made = figures.egress_curves

    def keep(curves, **options):
        figure = made(curves, **options)
        drawn.extend(line.get_xdata() for axes in figure.axes for line in axes.lines if len(line.get_xdata()) > 4)
        return figure

    monkeypatch.setattr(figures, "egress_curves", keep)
    code, _, _ = command("report", folders / "whole", folders / "cut", "-o", tmp_path / "report.html", "--no-maps")
    whole, cut, *of_exits = drawn
    assert code == 0 and cut.max() == pytest.approx(4.0) and whole.max() > 5.0
    assert [times.max() <= 4.0 for times in of_exits] == [False, False, True, True]  # two exits each


def test_a_folder_is_not_compared_with_itself(folders: Path, tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    code, _, said = command("report", folders / "whole", folders / "cut" / ".." / "whole", "-o", page)
    assert code == 2 and "is given twice" in said and not page.exists()


def test_folders_of_one_name_are_told_apart(folders: Path, tmp_path: Path) -> None:
    shutil.copytree(folders / "whole", tmp_path / "whole")
    code, out, _ = command(
        "report", folders / "whole", tmp_path / "whole", "-o", tmp_path / "r.html", "--no-maps", "--json"
    )
    names = [one["name"] for one in json.loads(out)["runs"]]
    assert code == 0 and len(set(names)) == 2 and all(str(tmp_path.parent.parent) in name for name in names)


def test_one_evacuation_is_one(folders: Path, tmp_path: Path) -> None:
    one, page = tmp_path / "one", tmp_path / "report.html"
    assert command("run", "room-v0", "--people", 4, "--runs", 1, "--scheme", "dem", "--out", one)[0] == 0
    assert command("report", one, "-o", page, "--no-maps")[0] == 0
    assert "1 simulated evacuation." in Parsed(page).text


@pytest.mark.more
@looped("name", ["$x^2$.wkt", r"$\x$.wkt"])
def test_a_dollar_in_the_name_of_a_plan_is_no_formula(name: str, tmp_path: Path) -> None:
    plan = tmp_path / name
    plan.write_text("POLYGON ((0 0, 6 0, 6 4, 0 4, 0 0))", "utf-8")
    place = (plan, "--exit", "6,1,6,2.2", "--people", 3)
    assert command("plan", *place, "--out", tmp_path / "plan.png")[0] == 0
    code, _, said = command("run", *place, "--runs", 1, "--out", tmp_path / f"runs {len(name)}")
    assert code == 0, said
    code, _, said = command("report", tmp_path / f"runs {len(name)}", "-o", tmp_path / "report.html")
    assert code == 0, said
