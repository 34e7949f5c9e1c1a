"""`crowd-env replay` makes a page of recordings in files, and refuses what cannot become one before it writes anything."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cases import looped
from replayed_pages import Parsed, read_page
from typer.testing import CliRunner

from crowd_env.cli.main import app
from crowd_env.recording import load, record
from crowd_env.scenarios import make_scenario

pytestmark = pytest.mark.more


def replay(*arguments: str | Path) -> tuple[int, str]:
    """Return the exit code, and what the command said."""
    result = CliRunner().invoke(app, ["replay", *map(str, arguments)])
    assert not result.stdout
    return result.exit_code, " ".join(result.stderr.split())


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scenario = make_scenario("room-v0")
    few = replace(scenario, population=scenario.population.changed(people=5))
    path = tmp_path_factory.mktemp("recordings") / "room.sqlite"
    return record(few, seed=2, contacts=True).save(path)


def test_the_page_lies_beside_the_recording_and_holds_it(recorded: Path) -> None:
    code, said = replay(recorded)
    page = recorded.with_suffix(".html")
    assert code == 0 and f"page: {page}, " in said
    recording = load(recorded)
    (found,) = read_page(page)
    order = np.argsort(recording.person, kind="stable")
    np.testing.assert_allclose(found["x"], recording.position[order, 0], atol=0.51e-3)
    np.testing.assert_allclose(found["exit_time"], recording.exit_time, atol=0.51e-4)
    parsed = Parsed(page.read_text("utf-8"))
    assert parsed.texts["title"] == "room-v0"
    assert ["seed", "2"] in parsed.about()["recordings"][0]["facts"]
    assert parsed.about()["recordings"][0]["outcome"] == f"all out after {np.max(recording.exit_time):.1f} s"


def test_a_folder_of_runs_is_filmed_replayed_and_its_forces_drawn(recorded: Path, tmp_path: Path) -> None:
    (tmp_path / "recordings").mkdir()
    (tmp_path / "recordings" / "000.sqlite").write_bytes(recorded.read_bytes())
    for words, made in (
        (["film", "--speed", "4", "-o", str(tmp_path / "a.gif")], "a.gif"),
        (["replay"], "replay.html"),
        (["forces", "--around", "2"], "forces.png"),
    ):
        result = CliRunner().invoke(app, [*words, str(tmp_path)])
        assert result.exit_code == 0, result.stderr
        assert str(tmp_path / made) in result.stderr.replace("\n", "") and (tmp_path / made).stat().st_size > 1000
    result = CliRunner().invoke(app, ["forces", str(tmp_path), "--at", "99"])
    assert result.exit_code == 2 and "there are no forces at 99 s" in result.stderr


def test_two_recordings_share_a_page(recorded: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.sqlite"
    other.write_bytes(recorded.read_bytes())
    code, _ = replay(recorded, other, "-o", tmp_path / "both.html")
    assert code == 0
    about = Parsed((tmp_path / "both.html").read_text("utf-8")).about()
    assert [one["label"] for one in about["recordings"]] == ["room", "other"]  # nothing else tells them apart


@looped(
    ("arguments", "said"),
    [
        (["empty"], "holds no recording"),
        (["nowhere.sqlite"], "nowhere.sqlite"),
        (["broken.sqlite"], "broken.sqlite"),
        (["broken.sqlite", "-o", "page.pdf"], "must end in .html"),
        (["broken.sqlite", "-o", "folder.html"], "is a folder"),
        (["a.sqlite", "b.sqlite", "c.sqlite"], "3 recordings"),
        (["plan.wkt"], "plan.wkt"),
    ],
)
def test_mistakes_are_one_sentence_and_nothing_is_written(
    arguments: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.sqlite").write_bytes(b"SQLite format 3\x00 and no more")
    (tmp_path / "plan.wkt").write_text("POLYGON ((0 0, 1 0, 1 1, 0 0))")
    (tmp_path / "folder.html").mkdir(exist_ok=True)
    (tmp_path / "empty").mkdir(exist_ok=True)
    before = sorted(tmp_path.iterdir())
    code, text = replay(*arguments)
    assert code == 2
    assert text.startswith("error: ") and said in text and "Traceback" not in text
    assert sorted(tmp_path.iterdir()) == before
