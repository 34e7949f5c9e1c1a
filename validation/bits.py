"""Does a change of the program change a bit of what it computes?  Two source trees run the same scenes on the same machine.

Digests of other machines say nothing: processors differ in the last bits, and crowds amplify them.
"""

import contextlib
import io
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from hashlib import sha256
from itertools import zip_longest
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
PROGRAM = Path(__file__).with_name("bits_scenes.py")

Told = Callable[[str, int, str], None]  # side, how many scenes it has run, the last of them
Ran = dict[str, dict[str, Any]]  # scene -> what the program printed of it


def chosen(known: Sequence[str], cases: Sequence[str]) -> list[str]:
    """Return the scenes of these names, or of these groups such as ``doors``, in order; all of them without names.

    Raises
    ------
    ValueError
        If there is none of that name.
    """
    groups = list(dict.fromkeys(name.partition("/")[0] for name in known))
    for case in cases:
        if case not in known and case not in groups:
            raise ValueError(
                f"there is no scene {case!r}; there are {', '.join(groups)}, or one of them, such as {known[0]}"
            )
    return [name for name in known if not cases or name in cases or name.partition("/")[0] in cases]


# -------------------------------------------------------------------------------------------------------- the commit


@contextlib.contextmanager
def tree_of(revision: str, root: Path = ROOT) -> Iterator[tuple[str, Path]]:
    """Unpack the package as a commit has it; give its hash and the folder, which is deleted in the end.

    The folder has the same name each time, since compiled kernels are kept under the paths of their sources.

    Raises
    ------
    ValueError
        If there is no such commit, or git cannot be asked.
    """
    commit = _git(root, "rev-parse", "--verify", "--quiet", f"{revision}^{{commit}}").decode().strip()
    if not commit or revision.startswith("-"):
        raise ValueError(f"there is no commit {revision!r}; give a commit, a branch or a tag, such as HEAD~1")
    packed = _git(root, "archive", "--format=tar", commit, "crowd_env")
    if not packed:
        raise ValueError(f"commit {revision!r} has no folder crowd_env to compare with")
    shelf = root / "build" / "bits"
    shelf.mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as stack:
        folder = shelf / commit[:16]
        try:
            folder.mkdir()
        except FileExistsError:  # of a comparison that runs now, or that was killed
            folder = Path(tempfile.mkdtemp(prefix=f"{commit[:16]}-", dir=shelf))
        stack.callback(_remove, folder)
        _unpack(packed, folder)
        yield commit, folder


def _git(root: Path, *words: str) -> bytes:
    """Return what git prints; nothing if it fails."""
    try:
        return subprocess.run(["git", *words], cwd=root, capture_output=True, check=False).stdout
    except FileNotFoundError:
        raise ValueError("git is not installed; it is needed to read the other commit") from None


def _unpack(packed: bytes, folder: Path) -> None:
    with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
        if hasattr(tarfile, "data_filter"):  # Python 3.12, and later releases of those before
            archive.extractall(folder, filter="data")
        else:
            archive.extractall(folder)


def _remove(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    for parent in (folder.parent, folder.parent.parent):  # build/bits and build, if nothing else is there
        with contextlib.suppress(OSError):
            parent.rmdir()


# ---------------------------------------------------------------------------------------------------------- the runs


def run_both(
    trees: dict[str, Path], names: Sequence[str], told: Told = lambda *_: None, program: Path = PROGRAM
) -> dict[str, Ran]:
    """Run the scenes in two trees side by side, each in a process of its own; return what each printed.

    Raises
    ------
    ValueError
        If the program ends early in one of them, or runs another package than that tree's.
    """
    ran: dict[str, Ran] = {side: {} for side in trees}
    problems: list[str] = []
    running = {side: _start(program, tree, names) for side, tree in trees.items()}

    def follow(side: str, process: "subprocess.Popen[str]") -> None:
        package, last = trees[side] / "crowd_env", "nothing was printed"
        for text in process.stdout or ():
            try:
                line = json.loads(text)
            except ValueError:  # a warning, or an error
                last = text.strip() or last
                continue
            if "package" in line and Path(line["package"]).resolve() != package.resolve():
                problems.append(f"{side}: {line['package']} was imported, not {package}")
            if "scene" in line:
                ran[side][line["scene"]] = line
                told(side, len(ran[side]), line["scene"])
        if process.wait() != 0:
            problems.append(f"{side}: the scenes could not be run to their end: {last}")

    followers = [threading.Thread(target=follow, args=one, daemon=True) for one in running.items()]
    try:
        for follower in followers:
            follower.start()
        for follower in followers:
            follower.join()
    finally:
        for process in running.values():
            process.kill()
            process.wait()
    if problems:
        raise ValueError(problems[0])
    return ran


def _start(program: Path, tree: Path, names: Sequence[str]) -> "subprocess.Popen[str]":
    environment = {**os.environ, "PYTHONPATH": str(tree), "CROWD_ENV_QUIET": "1"}
    command = [sys.executable, "-u", str(program), *names]
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    return subprocess.Popen(command, cwd=tree, env=environment, **pipes)


# ---------------------------------------------------------------------------------------------------- the comparison


def compare(name: str, here: dict[str, Any], there: dict[str, Any]) -> dict[str, Any]:
    """Return a row of the report: what one scene gave in the working tree and in the other commit.

    Fields are compared by their names.  One that only one tree has is paired with one that only the other has if they hold the
    same bits at all steps: it was renamed.  Other fields without a partner are listed, and not compared.
    """
    row: dict[str, Any] = {"scene": name, "equal": False, "first_step": None, "fields": [], "digest": None}
    row |= {"renamed": {}, "only_here": [], "only_there": [], "note": ""}
    for side, ran in (("here", here), ("there", there)):
        if "error" in ran:
            return row | {"note": f"failed {side}: {ran['error']}"}
    if "absent" in there:
        return row | {"equal": None, "note": "the other commit has no such scheme"}
    mine, theirs = _series(here["steps"]), _series(there["steps"])
    renamed = _renamed(mine, theirs)
    theirs = {renamed.get(field, field): values for field, values in theirs.items()}
    common = [field for field in mine if field in theirs]
    row |= {
        "steps": len(here["steps"]),
        "renamed": renamed,
        "only_here": [field for field in mine if field not in theirs],
        "only_there": [field for field in theirs if field not in mine],
        "digest": sha256(json.dumps([mine[field] for field in sorted(common)]).encode()).hexdigest()[:12],
    }
    first = {field: step for field in common if (step := _first_difference(mine[field], theirs[field])) is not None}
    if len(here["steps"]) != len(there["steps"]):
        first.setdefault("number of steps", min(len(here["steps"]), len(there["steps"])))
    if first:
        step = min(first.values())
        return row | {"first_step": step, "fields": [field for field in first if first[field] == step]}
    return row | {"equal": bool(common), "note": "" if common else "no field has the same name in both"}


def _series(steps: list[dict[str, str]]) -> dict[str, list[str | None]]:
    """Return field -> its digest at every step, None where it was not there."""
    names = dict.fromkeys(name for record in steps for name in record)
    return {name: [record.get(name) for record in steps] for name in names}


def _renamed(mine: dict[str, Any], theirs: dict[str, Any]) -> dict[str, str]:
    """Return their name -> my name of the fields that hold the same bits under another name."""
    new = [field for field in mine if field not in theirs]
    pairs = {}
    for old in theirs:
        same = next((field for field in new if old not in mine and mine[field] == theirs[old]), None)
        if same is not None:
            new.remove(same)
            pairs[old] = same
    return pairs


def _first_difference(one: list[Any], other: list[Any]) -> int | None:
    pairs = enumerate(zip_longest(one, other))
    return next((step for step, (mine, theirs) in pairs if mine != theirs), None)


def report(revision: str, names: Sequence[str], told: Told = lambda *_: None) -> dict[str, Any]:
    """Run the scenes in the working tree and as a commit has them; return the rows and whether all are equal.

    Raises
    ------
    ValueError
        If there is no such commit, or the scenes cannot be run in one of the trees.
    """
    with tree_of(revision) as (commit, folder):
        ran = run_both({"here": ROOT, revision: folder}, names, told)
    rows = [compare(name, ran["here"][name], ran[revision][name]) for name in names]
    return {"case": "bits", "against": commit, "equal": all(row["equal"] is not False for row in rows), "rows": rows}
