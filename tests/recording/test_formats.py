"""Every format holds all of a recording, and a file that is none, or half of one, is told from it."""

import re
import sqlite3
import sys

import numpy as np
import pytest
from cases import looped
from recordings import CASES, arrays_of, assert_equal, two_doors
from shapely.geometry import Point, box

from crowd_env import FULL_SPEED, Geometry, Population, Scenario
from crowd_env.envs.rollout import rollout
from crowd_env.recording import FORMATS, Recording, RunRecorder, load, record
from crowd_env.recording.writer import part_of

WRITTEN = [suffix for suffix, one in FORMATS.items() if one.write is not None]


@pytest.fixture(scope="module", params=CASES)
def case(request):
    scenario, run, recorder = CASES[request.param]
    return request.param, scenario, {**run, **recorder, "seed": 3}, record(scenario, **run, **recorder, seed=3)


def written(scenario, path, *, contacts=False, every=None, seed=0, **options):
    """Record an evacuation into a file while it runs."""
    with RunRecorder(path, contacts=contacts, every=every, seed=seed) as recorder:
        (episode,) = rollout(scenario, 1, seed=seed, recorder=recorder, **options)
    return episode.record


@pytest.mark.parametrize("suffix", WRITTEN)
def test_every_format_brings_everything_back(case, suffix, tmp_path):
    _, scenario, options, kept = case
    path = kept.save(tmp_path / f"run{suffix}")
    assert path == tmp_path / f"run{suffix}"
    assert_equal(load(path), kept)
    grown = written(scenario, tmp_path / f"grown{suffix}", **options)
    assert_equal(load(grown), kept)
    assert sorted(tmp_path.iterdir()) == [grown, path]  # nothing is left of how they were made


@pytest.mark.more
def test_the_cases_hold_what_they_are_for(case):
    name, _, _, kept = case
    out = np.isfinite(kept.exit_time)
    assert kept.cohorts == ("quick", "slow") and set(kept.cohort) == {0, 1}
    assert {name for name, _ in kept.exits} == {"left", "right"} and len(kept.exits) == 3  # the box has two sides
    assert kept.thin_walls.shape == (1, 2, 2) and kept.doors[0][0] == "lock"
    if name == "cohorts":
        assert out.all() and len(set(kept.exit_index)) >= 2 and len(kept.contacts.i) > 10
        assert (kept.contacts.j < 0).any() and (kept.contacts.force[:, 0] > 0).any()
    if name == "left inside":
        assert out.any() and not out.all() and kept.contacts is None
        assert np.diff(kept.times)[:-2] == pytest.approx(0.3) and kept.facts["unfinished"] == int((~out).sum())
    if name == "torso":
        assert kept.outline == "torso" and np.ptp(kept.angle) > 0.1
    assert ("feet" in kept.memory) == (kept.facts.get("balance") == "stepping") == (name == "feet")
    if name == "feet":
        feet = kept.memory["feet"]
        assert (np.hypot(*(feet[:, :2] - kept.position).T) < 1.5).all() and np.ptp(feet) > 1.0
    assert kept.facts["finished"] and kept.facts["scenario"] == "two-doors" and kept.facts["seed"] == 3


@pytest.mark.more
@pytest.mark.parametrize("suffix", WRITTEN)
def test_what_was_there_is_replaced_only_by_a_whole_recording(suffix, tmp_path, monkeypatch):
    path = tmp_path / f"run{suffix}"
    written(two_doors(), path, seed=1)
    before = arrays_of(load(path))
    monkeypatch.setattr("crowd_env.recording.frames.FrameSampler.after_end", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        written(two_doors(time_limit=3.0), path, seed=2)
    np.testing.assert_array_equal(arrays_of(load(path))["position"], before["position"])
    half = load(part_of(path))
    assert not half.facts["finished"] and half.times[-1] == pytest.approx(3.0) and half.facts["seed"] == 2
    monkeypatch.undo()
    written(two_doors(), path, seed=3)  # over what is left
    assert load(path).facts["seed"] == 3 and list(tmp_path.iterdir()) == [path]


@pytest.mark.more
def test_a_missing_library_is_one_sentence_before_the_work(tmp_path, monkeypatch):
    suffix, library = ".h5", "h5py"
    monkeypatch.setitem(sys.modules, library, None)
    for work in (lambda: RunRecorder(tmp_path / f"run{suffix}"), lambda: load(_empty(tmp_path / f"x{suffix}"))):
        with pytest.raises(
            ModuleNotFoundError, match=f"needs {library}, which is not installed: pip install {library}"
        ):
            work()


def _empty(path):
    path.write_bytes(b"")
    return path


@pytest.mark.more
@looped("name", ["run.mp4", "run"])
def test_other_suffixes_are_refused(name, tmp_path):
    for work in (lambda: RunRecorder(tmp_path / name), lambda: load(tmp_path / name)):
        with pytest.raises(ValueError, match=r"it must end in \.sqlite, \.h5"):
            work()
    with pytest.raises(ValueError, match=r"it must end in \.sqlite, \.h5$"):
        RunRecorder(tmp_path / "run.txt")


@pytest.mark.more
@looped("suffix", FORMATS)
def test_what_is_no_recording_is_said_to_be_none(suffix, tmp_path):
    for content in (
        b"",
        b"hello",
        b"SQLite format 3\0" + bytes(5000),
        b"\x89HDF\r\n\x1a\n" + bytes(100),
    ):
        path = tmp_path / f"run{suffix}"
        path.write_bytes(content)
        with pytest.raises(ValueError, match=re.escape(str(path))):
            load(path)


@pytest.mark.more
@pytest.mark.parametrize("suffix", WRITTEN)
def test_a_damaged_file_is_one_sentence(suffix, tmp_path):
    """Cut short, or with some bytes overwritten, it is refused, or (where nobody has looked) read."""
    kept = record(two_doors(time_limit=1.0), contacts=True)
    content = kept.save(tmp_path / f"run{suffix}").read_bytes()
    path, rng = tmp_path / f"bad{suffix}", np.random.default_rng(0)
    for length in np.linspace(0, 0.9 * len(content), 12).astype(int):
        path.write_bytes(content[:length])
        with pytest.raises(ValueError, match=re.escape(str(path))):
            load(path)
    for _ in range(40):
        spoiled, where = bytearray(content), int(rng.integers(len(content) - 64))
        spoiled[where : where + 64] = rng.bytes(64)
        path.write_bytes(spoiled)
        try:
            load(path)
        except ValueError as error:
            assert str(path) in str(error) and "\n" not in str(error)


@pytest.mark.more
def test_other_tables_are_no_recording(tmp_path):
    import h5py

    sqlite3.connect(tmp_path / "a.sqlite").execute("CREATE TABLE t (x)")
    h5py.File(tmp_path / "a.h5", "w").create_dataset("x", data=[1])
    for suffix, words in {".sqlite": "without the tables", ".h5": "no dataset"}.items():
        with pytest.raises(ValueError, match=words):
            load(tmp_path / f"a{suffix}")


@pytest.mark.more
def test_a_missing_file_points_to_what_is_left_of_it(tmp_path):
    with pytest.raises(ValueError, match=r"there is no recording .*run\.h5$"):
        load(tmp_path / "run.h5")
    (tmp_path / "run.part.h5").touch()
    with pytest.raises(ValueError, match=r"run\.part\.h5 holds what was recorded"):
        load(tmp_path / "run.h5")


@pytest.mark.more
def test_a_long_plan_fits_into_every_format(tmp_path):
    """HDF5 keeps attributes of up to 64 kB only, unless told otherwise."""
    place = Geometry.from_polygon(Point(0, 0).buffer(10, quad_segs=1000), exits={"cut": box(9, -2, 11, 2)})
    scenario = Scenario("ring", place, Population(3), time_limit=0.2, **FULL_SPEED)
    for suffix in WRITTEN:
        assert len(load(record(scenario).save(tmp_path / f"run{suffix}")).walkable) > 70_000


def test_a_recording_that_does_not_fit_together_is_refused():
    kept = record(two_doors(time_limit=0.5))
    fine = {name: getattr(kept, name) for name in kept.__dataclass_fields__}
    for name, value, words in (
        ("position", kept.position[:-1], "position"),
        ("times", kept.times[::-1].copy(), "times must increase"),
        ("person", kept.person + 1, r"person\[\d+\] is 12; it must be in 0 to 11"),
        ("frame_start", kept.frame_start + 1, "must ascend from 0"),
    ):
        with pytest.raises(ValueError, match=words):
            Recording(**fine | {name: value})
