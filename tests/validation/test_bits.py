"""The comparison of bits: it sees a change, pairs what was renamed, leaves nothing behind, and takes only commits."""

import ast
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

from crowd_env import SCHEMES
from validation import bits
from validation.bits import ROOT, chosen, compare, run_both, tree_of
from validation.bits_scenes import digests, scenes
from validation.cli import app

# A program like that of the scenes, on a package that takes no time to import.
PROGRAM = """
import json, sys
import crowd_env
print(json.dumps({"package": crowd_env.__path__[0], "scenes": []}), flush=True)
for name in sys.argv[1:]:
    steps = [{"x": str(k * crowd_env.FACTOR), "y": "same"} for k in range(3)]
    print(json.dumps({"scene": name, "steps": steps}), flush=True)
"""


@pytest.fixture
def program(tmp_path):
    path = tmp_path / "program.py"
    path.write_text(PROGRAM)
    return path


def tree(folder, text):
    (folder / "crowd_env").mkdir(parents=True)
    (folder / "crowd_env" / "__init__.py").write_text(text)
    return folder


def ran(*steps):
    return {"scene": "room", "steps": list(steps)}


# ---------------------------------------------------------------------------------------------------------- two trees


def test_two_trees_are_run_and_a_change_is_seen(tmp_path, program):
    trees = {"here": tree(tmp_path / "a", "FACTOR = 1"), "main": tree(tmp_path / "b", "FACTOR = 2")}
    told = []
    found = run_both(trees, ["room", "crowd"], lambda *words: told.append(words), program)
    row = compare("room", found["here"]["room"], found["main"]["room"])
    assert row["equal"] is False and row["first_step"] == 1 and row["fields"] == ["x"]
    assert sorted(told) == [(side, k, name) for side in ("here", "main") for k, name in ((1, "room"), (2, "crowd"))]
    same = run_both(trees | {"main": trees["here"]}, ["room"], program=program)
    assert compare("room", same["here"]["room"], same["main"]["room"])["equal"] is True


def test_a_tree_that_cannot_be_run_is_one_sentence(tmp_path, program):
    trees = {"here": tree(tmp_path / "a", "FACTOR = 1"), "main": tree(tmp_path / "b", "import nothing_of_this_name")}
    said = r"^main: the scenes could not be run to their end: ModuleNotFoundError: .*'nothing_of_this_name'$"
    with pytest.raises(ValueError, match=said):
        run_both(trees, ["room"], program=program)


def test_the_package_has_to_be_that_of_the_tree(tmp_path, program):
    trees = {"here": tree(tmp_path / "a", "FACTOR = 1; __path__ = ['/elsewhere/crowd_env']")}
    with pytest.raises(ValueError, match="/elsewhere/crowd_env was imported, not"):
        run_both(trees, ["room"], program=program)


@pytest.mark.nightly
def test_one_constant_of_the_physics_is_seen_in_its_scheme_alone(tmp_path):
    changed = tmp_path / "changed"
    shutil.copytree(ROOT / "crowd_env", changed / "crowd_env", ignore=shutil.ignore_patterns("__pycache__"))
    law, scheme = "stiffness: float = 1.2e5", "class DEM("
    sources = {path: path.read_text(encoding="utf-8") for path in changed.rglob("*.py")}
    (source,) = [path for path, text in sources.items() if law in text and scheme in text]
    source.write_text(sources[source].replace(law, "stiffness: float = 1.2000000001e5"), encoding="utf-8")
    names = ["room/dem", "room/nsm2"]
    found = run_both({"here": ROOT, "changed": changed}, names)
    rows = {name: compare(name, found["here"][name], found["changed"][name]) for name in names}
    assert rows["room/nsm2"]["equal"] is True
    assert rows["room/dem"]["equal"] is False and rows["room/dem"]["first_step"] < 10
    assert "state.position" in rows["room/dem"]["fields"]


# --------------------------------------------------------------------------------------------------------- comparison


def test_digests_see_every_bit_type_and_shape():
    value = np.array([[1.0, 2.0]])
    near = np.nextafter(value, 3.0)
    found = [digests({"a": one})["a"] for one in (value, near, value.astype(np.float32), value[0], -value)]
    assert len(set(found)) == 5
    assert digests({"a": value.copy()})["a"] == found[0]
    assert digests({"a": 0.0}) != digests({"a": -0.0})
    assert list(digests({"info": {"metrics": {3: {"flow": 1.0}}, "none": None}})) == ["info.metrics.3.flow"]


def test_a_field_under_a_new_name_is_paired_by_its_bits():
    here, there = (
        ran({"inside": "1", "x": "2"}, {"inside": "3", "x": "2"}),
        ran({"active": "1", "x": "2"}, {"active": "3", "x": "2"}),
    )
    row = compare("room", here, there)
    assert row["equal"] is True and row["renamed"] == {"active": "inside"}
    there["steps"][1]["active"] = "4"
    row = compare("room", here, there)
    assert row["renamed"] == {} and row["only_here"] == ["inside"] and row["only_there"] == ["active"]


def test_what_ends_early_or_shows_a_field_later_is_different():
    row = compare("room", ran({"x": "1"}, {"x": "2"}), ran({"x": "1"}))
    assert row["equal"] is False and row["first_step"] == 1
    row = compare("room", ran({"x": "1"}, {"x": "2", "y": "0"}), ran({"x": "1", "y": "0"}, {"x": "2"}))
    assert row["first_step"] == 0 and row["fields"] == ["y"]
    assert compare("room", ran({"x": "1"}), ran({"y": "2"}))["equal"] is False


def test_a_scene_that_fails_is_never_equal():
    failed = {"scene": "room", "steps": [], "error": "ValueError: no"}
    row = compare("room", failed, failed)
    assert row["equal"] is False and row["note"] == "failed here: ValueError: no"
    assert compare("room", ran({"x": "1"}), {"scene": "room", "steps": [], "absent": True})["equal"] is None


# -------------------------------------------------------------------------------------------------------- the commit


def git(folder, *words):
    names = {f"GIT_{role}_{part}": "a@b" for role in ("AUTHOR", "COMMITTER") for part in ("NAME", "EMAIL")}
    subprocess.run(["git", *words], cwd=folder, env={**os.environ, **names}, check=True, capture_output=True)


@pytest.fixture
def repository(tmp_path):
    if shutil.which("git") is None:
        pytest.skip("no git here")
    root = tree(tmp_path / "repository", "FACTOR = 1")
    git(root, "init", "-q")
    git(root, "add", ".")
    git(root, "commit", "-q", "-m", "first")
    (root / "crowd_env" / "__init__.py").write_text("FACTOR = 2")
    return root


def test_the_tree_of_a_commit_is_there_for_a_while(repository):
    with tree_of("HEAD", repository) as (commit, folder):
        assert (folder / "crowd_env" / "__init__.py").read_text() == "FACTOR = 1" and len(commit) == 40
        with tree_of("HEAD", repository) as (_, other):  # a second comparison at once
            assert other != folder
        assert folder.exists()
    assert {path.name for path in repository.iterdir()} == {".git", "crowd_env"}


def test_nothing_is_left_behind_by_ctrl_c(repository):
    with pytest.raises(KeyboardInterrupt), tree_of("HEAD", repository):
        raise KeyboardInterrupt
    assert not (repository / "build").exists()


@pytest.mark.parametrize("revision", ["nonsense", "--all", "HEAD:crowd_env", ""])
def test_what_is_no_commit_is_refused(repository, revision):
    with pytest.raises(ValueError, match="there is no commit"), tree_of(revision, repository):
        pass


def test_a_commit_without_the_package_is_refused(repository):
    git(repository, "rm", "-rq", "--cached", "crowd_env")
    git(repository, "commit", "-q", "--allow-empty", "-m", "empty")
    with pytest.raises(ValueError, match="has no folder crowd_env"), tree_of("HEAD", repository):
        pass


# ------------------------------------------------------------------------------------------------------- the command


def test_a_bad_commit_is_one_clear_sentence():
    result = CliRunner().invoke(app, ["bits", "--against", "no-such-commit"])
    assert result.exit_code == 2 and result.stdout == ""
    assert result.stderr.count("\n") == 1 and "there is no commit 'no-such-commit'" in result.stderr


def test_a_bad_scene_is_one_clear_sentence_that_names_the_others():
    result = CliRunner().invoke(app, ["bits", "--case", "cellar"])
    assert result.exit_code == 2 and "no scene 'cellar'; there are room, crowd" in result.stderr


@pytest.mark.parametrize("equal", [True, False])
def test_the_table_and_the_exit_code_say_it(monkeypatch, equal):
    row = compare("room/dem", ran({"x": "1"}), ran({"x": "1" if equal else "2"}))
    monkeypatch.setattr("validation.cli.report", lambda *_: {"against": "0" * 40, "equal": equal, "rows": [row]})
    result = CliRunner().invoke(app, ["bits"])
    assert result.exit_code == (0 if equal else 1)
    assert ("DIFFERENT" in result.stdout) is not equal and ("from step 0: x" in result.stdout) is not equal


# --------------------------------------------------------------------------------------------------------- the scenes


def test_every_scheme_is_in_every_group_of_scenes():
    names = list(scenes())
    for group in ("room", "crowd", "threads", "batch", "theatre", "doors", "social", "checkpoint", "grains"):
        assert chosen(names, [group]) == [f"{group}/{scheme}" for scheme in SCHEMES]
    assert chosen(names, []) == names
    assert chosen(names, ["gym", "room/dem"]) == ["room/dem", "gym"]


def test_the_scenes_use_public_names_alone():
    """The program runs on trees that are laid out in another way."""
    found = set()
    for node in ast.walk(ast.parse(bits.PROGRAM.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add(node.module)
    ours = {"crowd_env", "crowd_env.envs.settings", "gymnasium", "numpy"}  # the second where a tree has it
    assert {name for name in found if name.partition(".")[0] not in sys.stdlib_module_names} == ours
