"""The rules of the house that no linter knows: what an import loads, how long a file may be, what the wheel ships."""

import os
import re
import subprocess
import sys
import tomllib

import pytest
from cases import looped
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version
from repository import ROOT

pytestmark = pytest.mark.more

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
SOURCES = sorted(path for folder in ("crowd_env", "agents") for path in (ROOT / folder).rglob("*.py"))
TESTED = ROOT / "tests"
TESTS = sorted(TESTED.rglob("*.py"))

# Libraries whose modules are named otherwise.
OTHERWISE_IMPORTED = {
    "import-linter": "importlinter",
    "myst-parser": "myst_parser",
    "pillow": "PIL",
    "pygame-ce": "pygame",
}
EMPTY_WORDS = {"helper", "helpers", "manager", "managers", "util", "utils", "utilities", "handler", "handlers"}


def constraints() -> dict[str, Requirement]:
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pins = [Requirement(line) for line in lines if line.strip() and not line.startswith("#")]
    return {canonicalize_name(pin.name): pin for pin in pins}


def requirements() -> list[Requirement]:
    project = PROJECT["project"]
    groups = [project["dependencies"], *project["optional-dependencies"].values()]
    found = [Requirement(line) for group in groups for line in group]
    return [one for one in found if one.name != project["name"]]  # an extra may contain another one


def pinned_version(pin: Requirement) -> Version:
    (specifier,) = pin.specifier
    assert specifier.operator == "==", f"constraints.txt pins exact versions, not {pin}"
    return Version(specifier.version)


def only_in_extras() -> set[str]:
    """Return the modules of all libraries that no simulation needs: those of the extras alone."""
    core = {Requirement(line).name for line in PROJECT["project"]["dependencies"]}
    extras = {
        Requirement(line).name for group in PROJECT["project"]["optional-dependencies"].values() for line in group
    }
    names = extras - core - {PROJECT["project"]["name"], "scipy"}  # numba loads scipy where it is installed
    return {OTHERWISE_IMPORTED.get(name, name.replace("-", "_")) for name in names}


@looped(
    ("program", "asked"),
    [
        ("import crowd_env", {}),
        ("import sys; sys.argv[1:] = ['--version']; from crowd_env.cli.main import main; main()", {}),
        ("import sys; sys.argv[1:] = ['--help']; from crowd_env.cli.main import main; main()", {}),
        (
            "from crowd_env.cli.main import app; app(prog_name='crowd-env')",
            {"COMP_WORDS": "crowd-env ru", "COMP_CWORD": "1"},
        ),
        (
            "from crowd_env.cli.main import app; app(prog_name='crowd-env')",
            {"COMP_WORDS": "crowd-env run room-v0 --scheme hertz-", "COMP_CWORD": "4"},
        ),
    ],
    ids=["import", "version", "help", "completion of a command", "completion of a name"],
)
def test_what_begins_everything_loads_no_library_of_an_extra(program, asked):
    """Nor does the import load pydantic, which reads files, and which some versions of typer load for themselves."""
    assert {"torch", "stable_baselines3", "matplotlib", "PIL", "pygame", "ray", "ezdxf"} <= only_in_extras()
    text = (
        f"import sys\ntry: exec({program!r})\n"
        "finally: print(*sorted({name.partition('.')[0] for name in sys.modules}), file=sys.stderr)"
    )
    if asked:
        asked = {"_CROWD_ENV_COMPLETE": "complete_bash", **asked}
    options = {"cwd": ROOT, "env": os.environ | asked, "capture_output": True, "text": True}
    result = subprocess.run([sys.executable, "-c", text], **options, check=False)
    assert result.returncode == 0, result.stderr
    loaded = set(result.stderr.splitlines()[-1].split())
    assert "crowd_env" in loaded
    reads_files = {"pydantic"} if program == "import crowd_env" else set()
    assert sorted(loaded & (only_in_extras() | reads_files)) == []


def test_files_are_named_for_what_they_hold():
    assert not [path for path in (*SOURCES, *TESTS) if EMPTY_WORDS & set(path.stem.lower().split("_"))]


def test_tests_mirror_the_rooms():
    rooms = {path.name for path in TESTED.iterdir() if path.is_dir() and list(path.rglob("test_*.py"))}
    known = {path.name for path in (ROOT / "crowd_env").iterdir() if (path / "__init__.py").exists()}
    assert rooms <= known | {"benchmarks", "clients", "docs", "examples", "validation"}
    assert known <= rooms, "a room without a test"


def test_the_same_pythons_are_required_named_and_tried():
    named = [line.rpartition(" ")[2] for line in PROJECT["project"]["classifiers"] if ":: Python :: 3." in line]
    oldest, newest = named[0], named[-1]
    assert PROJECT["project"]["requires-python"] == f">={oldest}"
    assert f'python: ["{oldest}", "{newest}"]' in (ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8")
    for page in ("Makefile", "README.md", "CONTRIBUTING.md", "docs/start.md"):
        told = re.findall(r"(\d\.\d+) or newer", (ROOT / page).read_text(encoding="utf-8"))
        assert set(told) == {oldest}, page


def test_the_wheel_ships_crowd_env_alone():
    found = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert found == {"packages": ["crowd_env"]}


def test_agents_have_one_name():
    """In a checkout as in the wheel: a link, which tools and imports follow."""
    assert (ROOT / "crowd_env" / "agents").readlink().as_posix() == "../agents"
    sources = [
        path
        for folder in ("crowd_env", "validation", "benchmarks", "examples")
        for path in (ROOT / folder).rglob("*.py")
    ]
    wrong = [
        path for path in (*sources, *TESTS) if re.search(r"^\s*(from|import) agents\b", path.read_text(), re.MULTILINE)
    ]
    assert not wrong


def test_torch_stays_in_the_series_with_a_small_build():
    ranges = [requirement for requirement in requirements() if requirement.name == "torch"]
    assert ranges
    for requirement in ranges:
        assert not requirement.specifier.contains("2.14.0")
    assert pinned_version(constraints()["torch"]) < Version("2.14")


def test_every_requirement_has_a_pin_inside_its_range():
    pins = constraints()
    for requirement in requirements():
        pin = pins.get(canonicalize_name(requirement.name))
        assert pin is not None, f"constraints.txt has no pin for {requirement.name}"
        assert requirement.specifier.contains(pinned_version(pin)), f"{pin} is outside {requirement}"


def test_constraints_hold_on_any_machine():
    text = (ROOT / "constraints.txt").read_text(encoding="utf-8")
    pins = [line for line in text.splitlines() if not line.startswith("#")]
    assert not [line for line in pins if re.search(r"[/\\@+]|://", line)]
