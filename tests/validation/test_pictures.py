"""The pictures of the pages: each has a command, which makes it again and as it is."""

import os
import shutil
from pathlib import Path

import pytest
from named_commands import check_command
from PIL import Image, ImageDraw
from repository import ROOT
from same_pictures import difference
from typer.testing import CliRunner

from crowd_env import SCENARIOS
from examples import gallery
from validation import cli
from validation.pages import pages_of
from validation.pictures import DATA, IMAGES, commands, remade

COMMANDS = commands()
DRAWN = sorted(path.relative_to(IMAGES).as_posix() for path in IMAGES.rglob("*.*"))
DRAW = "python -c \"from PIL import Image; Image.new('RGB', (64, 64)).save('a.png'); print('drawn')\""
CHROMIUM = any(map(shutil.which, ("chromium", "chromium-browser", "google-chrome")))


def test_every_picture_has_a_command_and_every_command_pictures():
    found = [path for names in COMMANDS.values() for name in names for path in IMAGES.glob(name)]
    assert sorted(path.relative_to(IMAGES).as_posix() for path in found) == DRAWN
    assert all(list(IMAGES.glob(name)) for names in COMMANDS.values() for name in names)


def test_every_picture_is_shown():
    pages = "".join(page.read_text(encoding="utf-8") for page in pages_of())
    assert not [name for name in DRAWN if f"images/{name}" not in pages]


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: COMMANDS[command][0])
def test_commands_are_understood(command):
    for line in command.split(" && "):
        check_command(line)


def test_the_gallery_and_the_sheet_show_all_there_is():
    assert gallery.page() == (ROOT / "docs/gallery.md").read_text(encoding="utf-8"), "run python -m examples.gallery"
    (sheet,) = (command for command, names in COMMANDS.items() if names == ["scenarios.png"])
    assert sheet.split()[2:-2] == list(SCENARIOS)


@pytest.mark.nightly
@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: COMMANDS[command][0])
def test_pictures_are_made_again_as_they_are(command, tmp_path):
    """On another processor, which rounds otherwise, people of a late moment stand elsewhere."""
    data = os.environ.get("CROWD_ENV_DATA")
    if DATA in command and data is None:
        pytest.skip("CROWD_ENV_DATA names no folder with the recordings")
    if "page_picture" in command and not CHROMIUM:
        pytest.skip("there is no chromium to show the page with")
    made = remade(command, COMMANDS[command], tmp_path, data and Path(data))
    differ = {there.name: said for there, new in made.items() if (said := difference(there, new))}
    assert not differ, f"run python -m validation pictures {' '.join(COMMANDS[command])}"


# ---------------------------------------------------------------------------------------------------- the machinery


def picture(path, text, size=(200, 100)):
    image = Image.new("RGB", size, "white")
    ImageDraw.Draw(image).text((20, 40), text, fill="black")
    image.save(path)
    return path


def test_a_digit_that_differs_is_seen_and_a_shade_is_not(tmp_path):
    one, same = (picture(tmp_path / name, "34.4 s") for name in ("one.png", "same.png"))
    assert difference(one, same) == ""
    shade = Image.open(one).point(lambda value: max(value - 20, 0))
    shade.save(tmp_path / "shade.png")
    assert difference(one, tmp_path / "shade.png") == ""
    assert "of the pixels of a square" in difference(one, picture(tmp_path / "other.png", "34.1 s"))
    assert "sizes" in difference(one, picture(tmp_path / "wide.png", "34.4 s", (201, 100)))
    assert difference(one, tmp_path / "none.png") == "there is but one"


def test_films_are_compared_frame_by_frame(tmp_path):
    frames = [Image.open(picture(tmp_path / "a.png", text)).convert("P") for text in ("1 s", "2 s", "8 s")]
    for name, shown in (("one", (0, 1)), ("other", (0, 2)), ("longer", (0, 1, 2))):
        first, *rest = (frames[k] for k in shown)
        first.save(tmp_path / f"{name}.gif", save_all=True, append_images=rest)
    found = {name: difference(tmp_path / "one.gif", tmp_path / f"{name}.gif") for name in ("one", "other", "longer")}
    assert found["one"] == "" and "pixels" in found["other"] and "numbers of frames" in found["longer"]


def test_a_command_is_run_once_and_one_that_makes_nothing_is_named(tmp_path):
    made = remade(DRAW, ["a.png"], tmp_path)
    assert made == {IMAGES / "a.png": (tmp_path / "a/a.png").resolve()}
    before = (tmp_path / "a/a.png").stat().st_mtime_ns
    assert remade(DRAW, ["a.png"], tmp_path) == made and (tmp_path / "a/a.png").stat().st_mtime_ns == before
    (tmp_path / "a/log.txt").unlink()  # as if it had been interrupted
    assert remade(DRAW, ["a.png"], tmp_path) == made and (tmp_path / "a/a.png").stat().st_mtime_ns > before
    with pytest.raises(ValueError, match=r"made no b\.png; it ends with: drawn"):
        remade(DRAW, ["b.png"], tmp_path)


def test_the_command_puts_pictures_in_place_and_says_what_it_leaves_out(tmp_path, monkeypatch):
    monkeypatch.setattr("validation.pictures.IMAGES", tmp_path / "images")
    monkeypatch.setattr(cli, "commands", lambda: {DRAW: ["a.png"], f"python x --data {DATA}": ["b.png"]})

    def called(*words):
        return CliRunner().invoke(cli.app, ["pictures", *words, "--out", str(tmp_path / "out")])

    found = called()
    assert found.exit_code == 0 and (tmp_path / "images/a.png").exists()
    assert "1 of 2: a.png" in found.stderr and "2 of 2: b.png: left out, it needs --data" in found.stderr
    wrong = called("b.png", "--data", str(tmp_path))
    assert wrong.exit_code == 1 and "made no b.png" in wrong.stderr
    unknown = called("c.png")
    assert unknown.exit_code == 2 and "unknown picture 'c.png'; known: a.png, b.png" in unknown.stderr
