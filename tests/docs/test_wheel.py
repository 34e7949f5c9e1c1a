"""What an index shows of the package and what a wheel holds: built, installed into an empty environment, and used there."""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from email.parser import BytesParser

import pytest
from installations import EXTRAS, PROJECT
from repository import ROOT
from shown import blocks, commands_of

pytestmark = pytest.mark.more

LOCAL = r'src="(?!https?://)|\]\((?!https?://)'


def test_the_description_for_an_index_has_no_picture_or_link_that_leads_nowhere_there():
    """The rules of pyproject.toml, applied as the build applies them; the slow test below looks at what was built."""
    rules = PROJECT["tool"]["hatch"]["metadata"]["hooks"]["fancy-pypi-readme"]
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert re.search(LOCAL, text)
    for rule in rules["substitutions"]:
        text = re.sub(rule["pattern"], rule["replacement"], text)
    assert not re.search(LOCAL, text) and "<img" not in text
    assert text.startswith("# crowd_env\n\nReinforcement learning in crowds") and "## Three doors" in text
    assert "https://doi.org/10.3166/EJCM.20.189-206" in text


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Build the wheel; pip fetches what builds it."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--wheel-dir", folder, ROOT]
    built = subprocess.run(command, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def environment(wheel, tmp_path_factory):
    """Install the wheel into an environment of its own, which sees the libraries of this one, but not this project."""
    folder = tmp_path_factory.mktemp("environment") / "venv"
    venv.create(folder, with_pip=False)
    here = sysconfig.get_path("purelib")
    there = sysconfig.get_path("purelib", vars={"base": str(folder), "platbase": str(folder)})
    pip = [sys.executable, "-m", "pip", "--python", folder / "bin" / "python", "install", "-q", "--no-deps", wheel]
    subprocess.run(pip, check=True)
    # Libraries only: files *.pth of that folder, such as that of this project, are not read from here.
    (folder.parent / "libraries.pth").write_text(here + "\n")
    shutil.move(folder.parent / "libraries.pth", there)
    return folder / "bin"


def called(environment, folder, *words):
    """Run a program of the environment in an empty folder."""
    variables = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    command = [environment / words[0], *words[1:]]
    return subprocess.run(command, cwd=folder, env=variables, capture_output=True, text=True)


@pytest.mark.nightly
def test_the_wheel_tells_an_index_what_it_needs(wheel):
    with zipfile.ZipFile(wheel) as file:
        names = file.namelist()
        (told,) = [name for name in names if name.endswith(".dist-info/METADATA")]
        about = BytesParser().parsebytes(file.read(told))
    assert {name.partition("/")[0] for name in names} == {"crowd_env", told.partition("/")[0]}
    assert set(about.get_all("Provides-Extra")) == set(EXTRAS)
    assert about["Description-Content-Type"] == "text/markdown"
    text = about.get_payload(decode=True).decode()
    assert "# crowd_env" in text and "<img" not in text and not re.search(LOCAL, text)


@pytest.mark.nightly
def test_the_first_commands_of_the_readme_work_where_the_wheel_is_installed(environment, tmp_path):
    """In an empty folder, with the `crowd_env` of the wheel, and `agents` in it; kernels are compiled anew."""
    where = called(environment, tmp_path, "python", "-c", "import crowd_env.agents; print(crowd_env.__file__)")
    assert where.returncode == 0, where.stderr
    assert where.stdout.startswith(str(environment.parent))
    first = next(block for block in blocks("console") if block.page.name == "README.md")
    install, *commands = commands_of(first)
    assert install.words[:2] == ["pip", "install"] and commands
    for command in commands:
        done = called(environment, tmp_path, *command.words, "--film-width", "320", "--film-fps", "1")
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "narrow-door.mp4").stat().st_size > 1000
    version = called(environment, tmp_path, "crowd-env", "--version").stdout.split()[-1]
    assert version == PROJECT["project"]["version"]
