"""How kernels are compiled: the note on a cold start, silence on a warm one, and a cache folder that is nobody else's."""

import ast
import importlib
import inspect
import os
import platform
import re
import shutil
import stat
import subprocess
import sys
import time
from pathlib import Path

import grimp
import pytest
from installations import PROJECT
from numba.core.dispatcher import Dispatcher
from repository import ROOT

from crowd_env.core.kernels import jit
from crowd_env.routing.fields.grid import distance_to_segment

pytestmark = pytest.mark.more

STAMP = "0123456789abcdef"
PROGRAM = """
import numpy as np
from crowd_env.geometry.placement import closest_pair
position, radius = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 1.0]]), np.array([0.1, 0.2, 0.3])
assert closest_pair(position, radius)[:2] == (1, 2)
"""


def run(cache, program=PROGRAM, **environment):
    settings = {name: value for name, value in os.environ.items() if name != "CROWD_ENV_QUIET"}
    settings |= {"NUMBA_CACHE_DIR": str(cache), **environment}
    done = subprocess.run(
        [sys.executable, "-c", program], env=settings, cwd=ROOT, capture_output=True, text=True, check=True
    )
    return done.stdout, done.stderr


@pytest.fixture
def clean(tmp_path, monkeypatch):
    """Run with no wish about the cache, and a home of its own."""
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "CROWD_ENV_QUIET"):
        monkeypatch.delenv(name, raising=False)
    (tmp_path / "home").mkdir()
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    return tmp_path


def mode(folder):
    return stat.S_IMODE(folder.stat().st_mode)


def test_a_cold_start_says_once_that_it_compiles_and_a_warm_one_says_nothing(tmp_path):
    out, note = run(tmp_path)
    assert (
        out == "" and note.startswith("crowd_env: compiling kernels, once for this version") and note.count("\n") == 1
    )
    assert run(tmp_path) == ("", "")


def test_the_note_can_be_silenced(tmp_path):
    assert run(tmp_path, CROWD_ENV_QUIET="1") == ("", "")


# ------------------------------------------------------------------------------------------------- what is deleted


def aged(folder, marker=True):
    folder.mkdir(parents=True)
    (folder / "thesis").touch()
    if marker:
        (folder / jit._MARKER).touch()
    long_ago = time.time() - 40 * 24 * 3600
    os.utime(folder, (long_ago, long_ago))
    return folder


def test_only_folders_that_the_package_made_are_deleted(clean, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(clean / "work"))
    stale = aged(clean / "work" / "kernels-fedcba9876543210")
    others = [
        aged(clean / "work" / "kernels-cuda"),
        aged(clean / "work" / "kernels-cuda-marked"),
        aged(clean / "work" / "kernels-0000000000000000", marker=False),
        aged(clean / "elsewhere"),
    ]
    link = clean / "work" / "kernels-1111111111111111"
    link.symlink_to(others[-1])
    assert jit.cache_folder(STAMP) == clean / "work" / f"kernels-{STAMP}"
    assert not stale.exists()
    assert link.is_symlink() and all((one / "thesis").exists() for one in others)


def test_import_deletes_no_folder_of_the_user(tmp_path):
    folder = aged(tmp_path / "kernels-cuda", marker=False)
    run(tmp_path, "import crowd_env.core.kernels.jit")
    assert folder.exists()
    assert [one.name for one in tmp_path.glob("kernels-*") if re.fullmatch("kernels-[0-9a-f]{16}", one.name)]


def test_what_was_used_lately_stays(clean):
    young = aged(clean / "home" / ".cache" / "crowd_env" / "kernels-fedcba9876543210")
    os.utime(young)
    jit.cache_folder(STAMP)
    assert young.exists()


def test_a_folder_that_was_there_gets_no_marker(clean, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(clean))
    (clean / f"kernels-{STAMP}").mkdir(mode=0o700)
    assert jit.cache_folder(STAMP) == clean / f"kernels-{STAMP}"
    assert not list((clean / f"kernels-{STAMP}").iterdir())


# ------------------------------------------------------------------------------------------- whose the folder is


def test_the_folder_is_closed_to_others_whatever_the_umask(clean):
    before = os.umask(0)
    try:
        folder = jit.cache_folder(STAMP)
    finally:
        os.umask(before)
    assert folder == clean / "home" / ".cache" / "crowd_env" / f"kernels-{STAMP}"
    assert mode(folder) == mode(folder.parent) == 0o700


@pytest.mark.parametrize("open_to", [0o770, 0o707, 0o777])
@pytest.mark.parametrize("wish", [False, True], ids=["own cache", "NUMBA_CACHE_DIR"])
def test_a_folder_that_others_can_write_to_is_refused(clean, monkeypatch, capsys, open_to, wish):
    if wish:
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(clean / "home" / ".cache" / "crowd_env"))
    folder = clean / "home" / ".cache" / "crowd_env" / f"kernels-{STAMP}"
    folder.mkdir(parents=True)
    folder.chmod(open_to)
    assert jit.cache_folder(STAMP) is None
    note = capsys.readouterr().err
    assert f"other users can write to {folder}" in note and "NUMBA_CACHE_DIR" in note and note.count("\n") == 1


@pytest.mark.parametrize("whose", ["kernels", "root"])
def test_a_folder_of_another_user_is_refused(clean, monkeypatch, capsys, whose):
    if not hasattr(os, "getuid"):
        pytest.skip("no user ids here")
    root = clean / "home" / ".cache" / "crowd_env"
    folder = root / f"kernels-{STAMP}"
    folder.mkdir(parents=True, mode=0o700)
    theirs = folder if whose == "kernels" else root
    seen = jit.Path.stat

    def owned(path, **options):
        found = seen(path, **options)
        return os.stat_result((*found[:4], 4321, *found[5:])) if path == theirs else found

    monkeypatch.setattr(jit.Path, "stat", owned)
    used = jit.cache_folder(STAMP)
    monkeypatch.undo()
    assert used is None
    assert f"{theirs} belongs to another user" in capsys.readouterr().err


def test_a_link_in_the_place_of_the_folder_is_refused(clean, capsys):
    root = clean / "home" / ".cache" / "crowd_env"
    root.mkdir(parents=True)
    (clean / "trap").mkdir(mode=0o700)
    (root / f"kernels-{STAMP}").symlink_to(clean / "trap")
    assert jit.cache_folder(STAMP) is None
    assert "is not a folder" in capsys.readouterr().err


def test_a_shared_root_will_do_only_if_entries_are_safe_there(clean, monkeypatch):
    shared = clean / "shared"
    shared.mkdir()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(shared))
    shared.chmod(0o777)
    assert jit.cache_folder(STAMP) is None
    shared.chmod(0o1777)
    folder = jit.cache_folder(STAMP)
    assert folder == shared / f"kernels-{STAMP}" and mode(folder) == 0o700


def test_a_folder_above_that_anyone_can_write_to_is_refused(clean, monkeypatch, capsys):
    above = clean / "above"
    above.mkdir()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(above / "own"))
    above.chmod(0o1777)
    assert jit.cache_folder(STAMP) == above / "own" / f"kernels-{STAMP}"
    above.chmod(0o777)
    assert jit.cache_folder(STAMP) is None and f"other users can write to {above}" in capsys.readouterr().err


# ----------------------------------------------------------------------------------------- where there is no place


def homeless(*_):
    raise RuntimeError("Could not determine home directory.")


def test_no_home_is_no_error(clean, monkeypatch, capsys):
    monkeypatch.setattr(jit.Path, "home", homeless)
    assert jit.cache_folder(STAMP) is None
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert jit.cache_folder(STAMP) is None
    monkeypatch.setenv("XDG_CACHE_HOME", str(clean / "cache"))
    assert jit.cache_folder(STAMP) == clean / "cache" / "crowd_env" / f"kernels-{STAMP}"
    assert capsys.readouterr().err == (
        "crowd_env: kernels are not kept: there is no home folder; set NUMBA_CACHE_DIR to a folder that only you can write to\n"
    )


def test_the_home_is_not_asked_for_where_a_folder_is_given(clean, monkeypatch):
    monkeypatch.setattr(jit.Path, "home", homeless)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(clean / "given"))
    assert jit.cache_folder(STAMP) == clean / "given" / f"kernels-{STAMP}"


def test_a_given_folder_stays_where_it_is_when_the_process_moves(clean, monkeypatch):
    monkeypatch.chdir(clean)
    monkeypatch.setenv("NUMBA_CACHE_DIR", "given")
    assert jit.cache_folder(STAMP) == clean / "given" / f"kernels-{STAMP}"


def test_a_root_that_is_a_file_is_no_error(clean, monkeypatch, capsys):
    (clean / "file").touch()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(clean / "file"))
    assert jit.cache_folder(STAMP) is None
    assert "cannot be written" in capsys.readouterr().err


def test_where_nothing_can_be_written_kernels_are_compiled_in_memory(tmp_path):
    (tmp_path / "file").touch()
    report = "\nfrom crowd_env.core.kernels import jit; print(jit.CACHE_FOLDER)"
    out, note = run(tmp_path / "file", PROGRAM + report)
    assert out == "None\n" and "compiling kernels, in every process" in note


def damaged(path, how):
    content = path.read_bytes()
    half, end = len(content) // 2, len(content)
    path.write_bytes({"empty": b"", "half": content[:half], "other": content[:half] + bytes(end - half)}[how])


@pytest.mark.parametrize("how", ["empty", "half", "other"])
@pytest.mark.parametrize("kind", ["nbi", "nbc"])
def test_a_damaged_file_is_compiled_anew_with_a_note(tmp_path, kind, how):
    run(tmp_path)
    for path in tmp_path.glob(f"**/*.{kind}"):
        damaged(path, how)
    _, note = run(tmp_path)
    assert "is damaged, and compiled again" in note and "Traceback" not in note
    assert run(tmp_path) == ("", "")


def test_a_full_disk_is_named_and_ends_nothing(tmp_path):
    full = """
import os
from numba.core.caching import IndexDataCacheFile
def write(*_):
    raise OSError(28, os.strerror(28))
IndexDataCacheFile._open_for_write = write
"""
    _, note = run(tmp_path, full + PROGRAM)
    assert note.count("kernels are not kept: ") == 1 and "No space left on device" in note


def test_kernels_that_can_only_be_read_are_read(tmp_path):
    run(tmp_path)
    denied = """
import os
def deny(*_, **__):
    raise OSError(30, os.strerror(30))
os.utime, os.access = deny, lambda path, mode: mode != os.W_OK
"""
    assert run(tmp_path, denied + PROGRAM) == ("", "")


# -------------------------------------------------------------------------------------------------------- the stamp


def test_the_stamp_changes_with_what_kernels_are_made_of_and_with_nothing_else(tmp_path):
    package = tmp_path / "crowd_env"
    shutil.copytree(ROOT / "crowd_env", package, ignore=shutil.ignore_patterns("__pycache__", "agents"))
    stamp = jit.kernel_stamp(package)
    assert stamp == jit.STAMP and re.fullmatch("[0-9a-f]{16}", stamp)
    sources = {path.relative_to(package).as_posix() for path in jit.kernel_sources(package)}
    # Kernels read constants of view.py, which holds none itself.
    assert {"physics/hertz.py", "envs/observation/view.py", "core/kernels/jit.py"} <= sources
    assert not [file for file in sources if file.startswith(("cli/", "rendering/", "recording/", "reproduce/"))]
    wrong = []
    for path in sorted(package.rglob("*.py")):
        text = path.read_bytes()
        path.write_bytes(text + b"\nSIGHT = 4.0\n")
        if (jit.kernel_stamp(package) != stamp) != (path.relative_to(package).as_posix() in sources):
            wrong.append(path)
        path.write_bytes(text)
    assert not wrong and jit.kernel_stamp(package) == stamp


def test_all_kernels_stand_in_stamped_files_behind_the_border():
    """Whatever way they are compiled, and wherever a kernel is written next."""
    sources = set(jit.kernel_sources(ROOT / "crowd_env"))
    graph = grimp.build_graph("crowd_env", include_external_packages=True, cache_dir=None)
    asking = graph.find_modules_that_directly_import("numba") | graph.find_modules_that_directly_import(jit.__name__)
    things = [thing for name in asking for thing in vars(importlib.import_module(name)).values()]
    kernels = {thing.py_func for thing in things if isinstance(thing, Dispatcher)}
    assert len(kernels) > 200
    assert not [kernel for kernel in kernels if Path(inspect.getfile(kernel)) not in sources]
    (border,) = [one for one in PROJECT["tool"]["importlinter"]["contracts"] if "holds kernels" in one["name"]]
    behind = tuple(f"{name}." for name in border["source_modules"])
    assert not {kernel.__module__ for kernel in kernels if not f"{kernel.__module__}.".startswith(behind)}


def test_stamped_files_import_nothing_that_the_stamp_does_not_see():
    wrong = []
    for path in jit.kernel_sources(ROOT / "crowd_env"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.Import):
                wrong += [(path, one.name) for one in node.names if one.name.startswith("crowd_env")]
            elif isinstance(node, ast.ImportFrom):
                place = ROOT.joinpath(*(node.module or "").split("."))
                modules = [one.name for one in node.names if list(place.glob(f"{one.name}.py"))]
                wrong += [(path, name) for name in modules or ["."] * node.level]
    assert not wrong


def test_a_first_step_asks_for_no_kernel_of_another_scheme():
    program = """
import sys, crowd_env
from numba.core.dispatcher import Dispatcher
env = crowd_env.CrowdEnv("room-v0", physics="nsm2", walking="calm")
env.reset(seed=0)
env.step(None)
for name in ("nsm2", "nsm1", "dem", "hertz", "social_force"):
    kernels = [thing for thing in vars(sys.modules[f"crowd_env.physics.{name}"]).values() if isinstance(thing, Dispatcher)]
    own = [one for one in kernels if one.py_func.__module__ == f"crowd_env.physics.{name}"]
    print(name, sum(len(one.signatures) for one in own))
"""
    found = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    asked = {name: int(count) for name, count in map(str.split, found.splitlines())}
    assert asked.pop("nsm2") and not any(asked.values())


# -------------------------------------------------------------------------------------------- kernels that are installed


@pytest.fixture(scope="module")
def compiled_elsewhere(tmp_path_factory):
    """Return a folder of kernels of `PROGRAM` for processors of a kind."""
    able = jit.get_host_cpu_features()
    if (platform.system(), platform.machine()) != ("Linux", "x86_64") or not all(map(able.get, jit._ABILITIES)):
        pytest.skip("no kernels are installed on such a machine")
    cache = tmp_path_factory.mktemp("elsewhere")
    run(cache, NUMBA_CPU_NAME=jit.PORTABLE[0], NUMBA_CPU_FEATURES=jit.PORTABLE[1])
    return cache / f"kernels-{jit.STAMP}"


@pytest.fixture
def site(compiled_elsewhere, tmp_path):
    """Install them, where only `PYTHONPATH` leads."""
    package = tmp_path / "site" / "crowd_env_kernels"
    for kept in compiled_elsewhere.glob("*/*.nb[ci]"):  # no folder that is empty, as in a wheel
        place = package / jit.folder_of_installed(jit.STAMP) / kept.parent.name
        place.mkdir(parents=True, exist_ok=True)
        shutil.copy(kept, place)
    (package / "__init__.py").touch()
    return package.parent


def contents(folder):
    return {path: (path.stat().st_mtime_ns, path.is_file() and path.read_bytes()) for path in folder.rglob("*")}


@pytest.mark.parametrize("place", ["cache", "nowhere"])
def test_installed_kernels_are_read_and_never_written(site, tmp_path, place):
    (tmp_path / "nowhere").touch()
    before = contents(site)
    program = "import sys; sys.dont_write_bytecode = True\n" + PROGRAM
    out, note = run(tmp_path / place, program, PYTHONPATH=str(site))
    assert out == "" and "compiling" not in note
    assert contents(site) == before and not list(tmp_path.glob("cache/**/*.nbc"))


def test_kernels_of_another_version_are_refused_with_a_note(site, tmp_path):
    (folder,) = site.glob("*/kernels-*")
    folder.rename(folder.with_name(jit.folder_of_installed(STAMP)))
    _, note = run(tmp_path / "cache", PYTHONPATH=str(site))
    refused, compiling = note.splitlines()
    assert "installed kernels are not used" in refused and "compiling" in compiling
    assert list(tmp_path.glob("cache/**/*.nbc"))


def test_who_names_a_processor_gets_kernels_for_it(site, tmp_path):
    assert "compiling" in run(tmp_path / "cache", PYTHONPATH=str(site), NUMBA_CPU_NAME="x86-64-v2")[1]


def test_a_processor_that_cannot_run_them_compiles_its_own(site, monkeypatch, capsys):
    monkeypatch.syspath_prepend(site)
    monkeypatch.delenv("CROWD_ENV_QUIET")
    assert jit.installed_kernels(jit.STAMP) == next(site.glob("*/kernels-*"))
    monkeypatch.setattr(jit, "get_host_cpu_features", lambda: dict.fromkeys(jit._ABILITIES[:-1], True))
    assert jit.installed_kernels(jit.STAMP) is None
    assert jit._ABILITIES[-1] in capsys.readouterr().err


# ---------------------------------------------------------------------------------------------------- what is kept


def test_equal_sources_share_kernels_wherever_they_lie(tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(ROOT / "crowd_env", copy / "crowd_env", ignore=shutil.ignore_patterns("__pycache__", "agents"))
    run(tmp_path / "cache")
    program = f"import sys; sys.path.insert(0, {str(copy)!r})\n{PROGRAM}\nimport crowd_env; print(crowd_env.__file__)"
    out, note = run(tmp_path / "cache", program)
    assert out.startswith(str(copy)) and note == ""


def test_processes_that_keep_one_kernel_at_once_do_not_mix_it_up(tmp_path, monkeypatch):
    monkeypatch.setattr(jit, "CACHE_FOLDER", tmp_path)
    kept = []
    for process in "ab":
        monkeypatch.setattr(jit, "_PROCESS", process)
        kept.append(jit._Cache(distance_to_segment.py_func)._cache_file)
    one, other = kept
    save = one._save_data

    def the_other_comes_between(name, data):
        other.save("of the other", "compiled by the other")
        save(name, data)

    monkeypatch.setattr(other, "_load_index", dict)  # neither has seen what the other writes
    monkeypatch.setattr(one, "_save_data", the_other_comes_between)
    one.save("of one", "compiled by one")
    monkeypatch.undo()
    assert other.load("of the other") == "compiled by the other"
