"""Names of users in tables and on consoles that cannot hold them, and folders of results that name code."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from commands import call
from reported_pages import Parsed, command
from repository import ROOT

pytestmark = pytest.mark.more

PLACE = {
    "name": "[/zz] :door:",
    "geometry": {
        "walkable": {"box": [0, 0, 6, 4]},
        "exits": {"[/east]": [[6, 1], [6, 2]], "[west]": [[0, 1], [0, 2]], ":door:": [[2, 4], [3, 4]]},
    },
    "population": {"people": 6},
}


@pytest.fixture
def place(tmp_path: Path) -> Path:
    path = tmp_path / "p.json"
    path.write_text(json.dumps(PLACE), encoding="utf-8")
    return path


def test_brackets_and_colons_in_names_stay_as_they_are(place: Path, tmp_path: Path) -> None:
    result = call(f"run {place} --runs 2 --workers 1 --out {tmp_path / 'o'}")
    assert result.exit_code == 0, result.output
    for name in ("[/east]", "[west]", ":door:", "[/zz]"):
        assert name in result.stdout
    assert (tmp_path / "o" / "exits.csv").exists()
    refused = call("evaluate --policies evil.py:X --runs 2")
    assert refused.exit_code == 2 and "evil.py:X" in refused.stderr


@pytest.mark.parametrize("encoding", ["cp1252", "ascii"])
def test_a_console_without_a_letter_of_a_name_loses_no_table(place: Path, tmp_path: Path, encoding: str) -> None:
    place.write_text(place.read_text(encoding="utf-8").replace("[/zz]", "Saal \u0141\u00f3d\u017a"), encoding="utf-8")
    out = tmp_path / "o"
    lines = [["run", str(place), "--runs", "2", "--workers", "1", "--out", str(out)], ["list"]]
    for words in lines:
        done = subprocess.run(
            [sys.executable, "-m", "crowd_env", *words],
            cwd=ROOT,
            env={**os.environ, "PYTHONIOENCODING": encoding},
            capture_output=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr.decode(encoding, "replace")
    assert (out / "exits.csv").exists()


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
@pytest.mark.parametrize(("file", "name"), [(b"S\xfcd", "S\\xfcd"), ("[p] Süd".encode(), "[p] Süd")])
def test_a_file_name_that_python_cannot_decode_ends_no_command(tmp_path: Path, file: bytes, name: str) -> None:
    """Python hands over such bytes, and under ``LC_ALL=C`` all that are not ASCII, as lone surrogates."""

    def decoded(text: bytes) -> str:
        return text.decode("ascii", "surrogateescape")

    exits = {"Süd": [[6, 1], [6, 2]], "west": [[0, 1], [0, 2]]}
    unnamed = {"geometry": {**PLACE["geometry"], "exits": exits}, "population": PLACE["population"]}
    path, folder, page = tmp_path / decoded(file + b".json"), tmp_path / decoded(file), tmp_path / "page.html"
    path.write_text(json.dumps(unnamed), encoding="utf-8")
    plan = tmp_path / decoded(file + b".wkt")
    plan.write_text("POLYGON ((0 0, 6 0, 6 4, 0 4, 0 0))", encoding="utf-8")
    run = ("run", path, "--runs", "1", "--workers", "1", "--out")
    for words in (
        (*run, folder),
        (*run, tmp_path / "other", "--routing", decoded("Süd".encode())),
        ("run", plan, "--exit", "6,1,6,2", "--runs", "1", "--workers", "1"),
        ("plan", path, plan, "--out", tmp_path / "plan.png"),
        ("forces", folder),
        ("run", "--config", folder / "config.json", "--workers", "1"),
        ("film", folder, tmp_path / "other", "--out", tmp_path / "film.gif", "--width", "320", "--fps", "1"),
        ("replay", folder, "-o", page),
        ("evaluate", "--scenario", path, "--policies", decoded("Süd".encode()), "--runs", "1"),
        ("report", folder, tmp_path / "other", "-o", page, "--title", decoded(file)),
    ):
        code, _, said = command(*words)
        assert code == 0, (words, said)
        if page in words:
            assert name in Parsed(page).text


def test_a_report_runs_no_code_that_a_folder_names(tmp_path: Path) -> None:
    folder, page = tmp_path / "results", tmp_path / "page.html"
    assert command("run", "room-v0", "--people", 4, "--runs", 1, "--workers", 1, "--out", folder)[0] == 0
    mark = tmp_path / "RAN"
    (folder / "evil.py").write_text(
        f"import pathlib\npathlib.Path({str(mark)!r}).touch()\nfrom crowd_env.physics import NSM2\nclass Law(NSM2): pass\n",
        encoding="utf-8",
    )
    config = json.loads((folder / "config.json").read_text(encoding="utf-8"))
    for name in ("scheme", "policy"):
        changed = {**config, "arguments": {**config["arguments"], name: f"{folder / 'evil.py'}:Law"}}
        (folder / "config.json").write_text(json.dumps(changed), encoding="utf-8")
        code, _, said = command("report", folder, "-o", page)
        assert code == 2 and "--trust-code" in said and not mark.exists() and not page.exists()
    assert command("report", folder, "-o", page, "--trust-code")[0] == 2 and mark.exists()  # a law is no policy


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder of one run."""
    out = tmp_path / "results"
    assert command("run", "room-v0", "--people", 4, "--runs", 1, "--workers", 1, "--out", out)[0] == 0
    return out


def with_argument(folder: Path, name: str, value: str) -> Path:
    config = json.loads((folder / "config.json").read_text(encoding="utf-8"))
    config["arguments"][name] = value
    (folder / "config.json").write_text(json.dumps(config), encoding="utf-8")
    return folder / "config.json"


@pytest.mark.parametrize("name", ["scheme", "physics", "policy"])
def test_no_code_that_a_config_alone_names_is_run(folder: Path, tmp_path: Path, name: str) -> None:
    law, mark = tmp_path / f"law_of_a_config_{name}.py", tmp_path / "RAN"
    law.write_text(
        f"import pathlib\npathlib.Path({str(mark)!r}).touch()\nfrom crowd_env.physics import NSM2\nLaw = NSM2()\n",
        encoding="utf-8",
    )
    config = with_argument(folder, name, f"{law}:Law")
    option = "--policy" if name == "policy" else "--scheme"
    code, _, said = command("run", "--config", config, "--out", tmp_path / "again")
    assert code == 2 and f"{option} FILE.py:NAME" in said and not mark.exists()
    code, _, _ = command("run", "--config", config, option, f"{law}:Law", "--runs", 1, "--workers", 1)
    assert mark.exists() and (code == 0 or option == "--policy")  # a law is no policy


@pytest.mark.parametrize("name", ["scenario", "starts"])
def test_a_report_prints_nothing_of_a_file_that_the_runs_were_not_made_with(
    folder: Path, tmp_path: Path, name: str
) -> None:
    secret = tmp_path / "secret"
    secret.write_text("zanzibar:x:0:0\n", encoding="utf-8")
    with_argument(folder, name, str(secret))
    code, _, said = command("report", folder, "-o", tmp_path / "page.html")
    assert code == 2 and "zanzibar" not in said and "secret is not the file that they were made with" in said


@pytest.mark.parametrize("name", ["runs", "crowding", "recordings"])
def test_nothing_is_written_through_a_link_in_a_folder(folder: Path, tmp_path: Path, name: str) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    shutil.rmtree(folder / name)
    (folder / name).symlink_to(elsewhere, target_is_directory=True)
    code, _, said = command("run", "room-v0", "--people", 4, "--runs", 1, "--workers", 1, "--out", folder)
    assert code == 2 and f"{name} in it is a link" in said and not [*elsewhere.iterdir()]


def test_a_folder_in_place_of_the_lock_is_named(folder: Path) -> None:
    (folder / ".lock").mkdir()
    code, _, said = command("run", "room-v0", "--people", 4, "--runs", 1, "--workers", 1, "--out", folder)
    assert code == 2 and ".lock is a folder" in said


def test_a_report_of_runs_under_a_law_of_ones_own(tmp_path: Path) -> None:
    folder, page, law = tmp_path / "results", tmp_path / "page.html", tmp_path / "soft_law_of_a_test.py"
    law.write_text(
        "from dataclasses import replace\nfrom crowd_env.physics import NSM2\n\n\n"
        "class Law(NSM2):\n    @property\n    def info(self):\n        return replace(super().info, name='soft')\n",
        encoding="utf-8",
    )
    run = ("run", "room-v0", "--people", 4, "--runs", 1, "--workers", 1, "--scheme", f"{law}:Law")
    assert command(*run, "--out", folder)[0] == 0
    code, _, said = command("report", folder, "-o", page, "--trust-code")
    assert code == 0, said
    assert "soft" in Parsed(page).text


def test_a_report_says_what_decided_the_runs(tmp_path: Path) -> None:
    folder, page = tmp_path / "led", tmp_path / "page.html"
    run = ("run", "room-v0", "--people", 6, "--runs", 1, "--workers", 1, "--policy", "follow", "--set", "max_drive=120")
    assert command(*run, "--out", folder)[0] == 0
    assert command("report", folder, "-o", page)[0] == 0
    text = " ".join(Parsed(page).text.split())
    assert "led by follow" in text and "as in the papers, is no limit120" in text
    assert "no row of pedestrians led by follow" in text and "judged cases are met" not in text
    place = tmp_path / "groups.json"
    attraction = {"x": 3.0, "y": 2.0, "strength": 1.5}
    content = PLACE | {"population": {"people": 6, "group_size": 3}, "pulls": {"attractions": [attraction]}}
    place.write_text(json.dumps(content | {"balance": "stepping"}), encoding="utf-8")
    assert command("run", place, "--runs", 1, "--workers", 1, "--out", tmp_path / "groups")[0] == 0
    assert command("report", tmp_path / "groups", "-o", page)[0] == 0
    text = " ".join(Parsed(page).text.split())
    assert "walk together" in text and "3 people" in text and "x 3, y 2, strength 1.5" in text and "stepping" in text
