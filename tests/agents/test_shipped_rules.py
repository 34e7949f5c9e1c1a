"""What ships of the rules in a task: the figures of an evaluation, as long as task and code are those that made it."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from cases import looped

from crowd_env import make_scheme
from crowd_env.agents.evaluation import shipped
from crowd_env.agents.evaluation.comparison import mean_times
from crowd_env.agents.evaluation.entries import make_entries
from crowd_env.agents.evaluation.evaluation import evaluate_crowd
from crowd_env.agents.evaluation.protocol import task_rows
from crowd_env.agents.tasks import TASKS
from crowd_env.agents.walking import Follow
from crowd_env.core.files.json_file import read_json, write_json
from crowd_env.core.files.store import Store
from crowd_env.envs.tasks.task import HELD_OUT_SEED

ROOM = TASKS["room"]
SHIPPED = shipped.FOLDER
LAW = make_scheme(ROOM.scheme)


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """Return a folder with what ships of three rules in five draws of the room."""
    folder = tmp_path_factory.mktemp("shipped")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(shipped, "FOLDER", folder)
        patch.setattr(shipped, "OF_TASK", ("rule", "rule-best-speed", "follow"))
        patch.setattr("crowd_env.agents.drivers.SHARES", (0.9,))
        shipped.ship(ROOM, runs=5)
    return folder


@pytest.fixture(autouse=True)
def there(room, monkeypatch):
    monkeypatch.setattr(shipped, "FOLDER", room)


def found(task=ROOM, place=None, law=LAW, runs=5):
    return shipped.shipped(task, place or task.place(), law, runs)


def here(name, task, runs, first=0):
    (entry,) = make_entries([name], task.place(), task)
    return evaluate_crowd(entry.driver(task.place()), runs=runs, measure=True, first_seed=HELD_OUT_SEED + first)


def test_what_is_still_good_stays_and_what_is_missing_is_made(room, tmp_path, monkeypatch):
    for name, value in {"FOLDER": tmp_path / "there", "OF_TASK": ("rule", "rule-best-speed", "follow")}.items():
        monkeypatch.setattr(shipped, name, value)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("crowd_env.agents.drivers.SHARES", (0.9,))
    shutil.copytree(room / ROOM.name, tmp_path / "there" / ROOM.name)
    before = {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in (tmp_path / "there").rglob("*.npz")}
    gone = tmp_path / "there" / ROOM.name / "follow.npz"
    gone.unlink()
    shipped.ship(ROOM, runs=5)
    assert gone.exists() and list(found()) == ["rule", "rule-best-speed", "follow"]
    for path, (written, content) in before.items():
        assert path == gone or (path.stat().st_mtime_ns, path.read_bytes()) == (written, content)
    monkeypatch.setattr(shipped, "_does_so", lambda task, result: False)  # as after a change of the code
    shipped.ship(ROOM, runs=5)
    assert all(path.stat().st_mtime_ns > written for path, (written, _) in before.items())


@looped("runs", [2, 5], quick=1)
def test_it_is_what_an_evaluation_finds(runs, monkeypatch):
    monkeypatch.setattr("crowd_env.agents.drivers.SHARES", (0.9,))
    there = found(runs=runs)
    assert list(there) == ["rule", "rule-best-speed", "follow"]
    computed = [here(name, ROOM, runs) for name in there]
    for one, other in zip(there.values(), computed, strict=True):
        np.testing.assert_array_equal(np.array(one.exit_times), np.float32(other.exit_times))
    rows = (task_rows(ROOM, ROOM.place(), results) for results in (list(there.values()), computed))
    for ours, theirs in zip(*rows, strict=True):
        assert ours.keys() == theirs.keys() and ours["credible"] == theirs["credible"]
        for figure, value in theirs.items():
            same(ours[figure], value)


def test_densities_that_took_walls_for_floor_are_unknown(room):
    path = room / "room/follow.npz"
    before = path.read_bytes()
    with np.load(path) as content:
        facts = json.loads(str(content["facts"]))
        assert facts.pop("density")
        np.savez(path, **{**content, "facts": np.array(json.dumps(facts))})
    try:
        older, newer = found()["follow"].row(), found()["rule"].row()
    finally:
        path.write_bytes(before)
    assert older["max_density"]["mean"] is older["max_density"]["max"] is None and older["walked"]["mean"] > 0.0
    assert newer["max_density"]["max"] >= newer["max_density"]["mean"] > 0.0


def same(one, other):
    if isinstance(other, dict):
        assert one.keys() == other.keys()
        one, other = list(one.values()), list(other.values())
    if isinstance(other, list):
        for pair in zip(one, other, strict=True):
            same(*pair)
    else:
        assert one == (pytest.approx(other, rel=1e-4, abs=1e-5) if isinstance(other, float) else other)


def test_nothing_is_taken_for_another_place_law_version_or_number_of_draws(room):
    assert (
        not found(place=replace(ROOM.place(), manner="eager"))
        and not found(law=make_scheme("dem"))
        and not found(runs=6)
    )
    about = room / "room/identity.json"
    identity = read_json(about)
    write_json(about, identity | {"version": 99})
    assert not found()
    write_json(about, identity)
    (room / "room/follow.npz").rename(room / "kept.npz")
    assert list(found()) == ["rule", "rule-best-speed"]
    (room / "kept.npz").rename(room / "room/follow.npz")


def test_nothing_is_taken_where_the_code_does_other_things(monkeypatch, capsys):
    with monkeypatch.context() as patch:
        patch.setattr(Follow.__init__, "__defaults__", (0.56, 0.3, 0.33))
        assert not found()
    assert "other things" in capsys.readouterr().err
    assert found()


@looped(("later", "taken"), [(1e-4, True), (2e-3, False)])
def test_a_millisecond_is_the_limit(room, monkeypatch, tmp_path, later, taken):
    """Computers that round otherwise are as good as this one; contact laws that differ are not."""
    shutil.copytree(room / "room", tmp_path / str(later) / "room")
    monkeypatch.setattr(shipped, "FOLDER", tmp_path / str(later))
    store = Store(shipped.FOLDER / "room", ROOM.identity())
    kept = store.load("rule")
    store.keep("rule", kept | {"exit_times": kept["exit_times"] + np.float32(later)})
    assert bool(found()) == taken


@pytest.mark.more
@looped("task", [path.parent.name for path in sorted(shipped.FOLDER.glob("*/identity.json"))] or ["room"])
def test_what_ships_is_what_the_rules_do(room, task, monkeypatch):
    """Two draws that nothing else looks at: the first people to the millisecond, and all by and large, since rounding grows."""
    monkeypatch.setattr(shipped, "FOLDER", room if task == "room" else SHIPPED)
    task, runs = TASKS[task], 5 if task == "room" else TASKS[task].runs
    kept = found(task, law=make_scheme(task.scheme), runs=runs)
    assert kept
    for name, result in kept.items():
        monkeypatch.setattr("crowd_env.agents.drivers.SHARES", (result.constants.get("share"),))
        now, there = here(name, task, 2, first=3), np.array(result.exit_times)
        np.testing.assert_allclose(np.sort(now.exit_times)[:, :5], np.sort(there)[3:5, :5], rtol=0.0, atol=1e-3)
        times, mean = mean_times(result), mean_times(now)
        assert (times.min() - 1e-3 <= mean).all() and (mean <= times.max() + 1e-3).all()
