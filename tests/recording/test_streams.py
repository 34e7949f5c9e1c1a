"""Recordings grow with the run: whole up to the last flush when its process is killed, in bounded memory for any crowd."""

import os
import signal
import subprocess
import sys
import tracemalloc
from itertools import product

import numpy as np
import pytest
from cases import looped
from recordings import arrays_of
from repository import ROOT

from crowd_env import make_scenario
from crowd_env.envs.rollout import rollout
from crowd_env.recording import FORMATS, FrameContacts, Recording, load, record
from crowd_env.recording.recorder import RunningRecording
from crowd_env.recording.writer import part_of

pytestmark = pytest.mark.more

WRITTEN = [suffix for suffix, one in FORMATS.items() if one.write is not None]
SCENARIO, OPTIONS = "room-v0", {"scheme": "dem", "seed": 3, "contacts": True}
KILLED = f"""
import os, signal, sys
from crowd_env import make_scenario
from crowd_env.envs.rollout import rollout
from crowd_env.recording import RunRecorder
from crowd_env.recording.frames import FrameSampler

after, frames = FrameSampler.after_step, 0

def dies(self, env, last):
    global frames
    frames += 1
    if frames == 35:
        os.kill(os.getpid(), signal.SIGKILL)
    return after(self, env, last)

FrameSampler.after_step = dies
recorder = RunRecorder(sys.argv[1], contacts=True, seed=3)
list(rollout(make_scenario({SCENARIO!r}), 1, seed=3, scheme="dem", recorder=recorder))
"""

FULL = f"""
import resource, sys
from crowd_env import make_scenario
from crowd_env.envs.rollout import rollout
from crowd_env.recording import RunRecorder
from crowd_env.recording.recorder import RunningRecording

def full(of, *args):
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.RLIM_INFINITY))
    return before[sys.argv[3]](of, *args)

def run(recorder):
    return next(rollout(place, 1, seed=3, scheme="dem", recorder=recorder))

place = make_scenario({SCENARIO!r})
run(RunRecorder(contacts=True))  # what is compiled is kept on the disk while there is room
before = {{"begin": RunRecorder.begin, "finish": RunningRecording.finish}}
setattr(RunRecorder if sys.argv[3] == "begin" else RunningRecording, sys.argv[3], full)
recorder = RunRecorder(sys.argv[1], contacts=True, seed=3)
one = run(recorder)
recorder.close()
print(one.end, one.exit_time.sum())
print(type(one.record).__name__, one.record)
"""


@pytest.mark.parametrize("suffix", WRITTEN)
def test_a_killed_run_leaves_all_but_the_last_second(suffix, tmp_path):
    path = tmp_path / f"run{suffix}"
    done = subprocess.run(
        [sys.executable, "-c", KILLED, path],
        cwd=ROOT,
        check=False,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert done.returncode == -signal.SIGKILL and not path.exists()
    half, whole = load(part_of(path)), record(make_scenario(SCENARIO), **OPTIONS)
    frames = len(half.times)
    assert frames == 31 and not half.facts["finished"]
    np.testing.assert_array_equal(half.times, whole.times[:frames])
    rows, contacts = whole.frame_start[frames], whole.contacts.start[frames]
    for name, array in arrays_of(half).items():
        expected = arrays_of(whole)[name]
        if name in ("person", "position", "velocity", "pressure"):
            np.testing.assert_array_equal(array, expected[:rows])
        if name in ("i", "j", "gap", "normal", "point", "force"):
            np.testing.assert_array_equal(array, expected[:contacts])
    out = whole.exit_time <= half.times[-1]
    assert out.any() and not out.all()
    np.testing.assert_array_equal(half.exit_time, np.where(out, whole.exit_time, np.nan))
    np.testing.assert_array_equal(half.exit_index, np.where(out, whole.exit_index, -1))


@pytest.mark.skipif(os.name != "posix", reason="limits the size of files")
@looped(
    ("suffix", "limit", "at"),
    [*product(WRITTEN, [10, 20_000, 50_000, 120_000], ["begin"]), *product(WRITTEN, [10, 30_000], ["finish"])],
)
def test_a_full_disk_ends_the_recording_and_not_the_run(suffix, limit, at, tmp_path):
    path = tmp_path / f"{at}-{limit}" / f"run{suffix}"
    command = [sys.executable, "-c", FULL, str(path), str(limit), at]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(command, cwd=ROOT, check=False, env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    expected = next(rollout(make_scenario(SCENARIO), 1, seed=3, scheme="dem"))
    end, error = done.stdout.splitlines()
    assert end == f"{expected.end} {expected.exit_time.sum()}"
    assert error.startswith(f"OSError cannot write {path.parent}")
    assert not list(path.parent.iterdir())  # there is room for others


@pytest.mark.parametrize("suffix", WRITTEN)
def test_a_growing_file_can_be_read(suffix, tmp_path):
    path = tmp_path / f"run{suffix}"
    running = RunningRecording(path, Stopped(), large_frame(50, 0))
    for k in range(1, 25):
        running.add(large_frame(50, k))
        if k >= 10:
            assert len(load(part_of(path)).times) >= k - 9
    running.finish({"finished": True})
    kept = load(path)
    assert len(kept.times) == 25 and kept.facts["finished"]
    np.testing.assert_array_equal(kept.position[kept.frame == 13], large_frame(50, 13).position)


class Stopped:
    """In place of what samples an environment."""

    def stop(self):
        pass


def large_frame(count, k):
    """Return frame ``k`` of so many people, each in contact with the next."""
    rng = np.random.default_rng(k)
    pairs = rng.uniform(0, 1000, (5, count, 2))
    i = np.arange(count - 1)
    return Recording(
        facts={"outline": "disc", "finished": False, "people": count, "every": 0.1},
        walkable="POLYGON ((0 0, 1000 0, 1000 1000, 0 1000, 0 0))",
        thin_walls=np.zeros((0, 2, 2)),
        doors=(),
        exits=(),
        cohorts=("",),
        times=np.array([0.1 * k]),
        frame_start=np.array([0, count]),
        radius=np.full(count, 0.2),
        desired_speed=np.full(count, 1.3),
        cohort=np.zeros(count, dtype=np.int64),
        exit_time=np.full(count, np.nan),
        exit_index=np.full(count, -1),
        person=np.arange(count),
        position=pairs[0],
        velocity=pairs[1],
        pressure=pairs[4, :, 0],
        contacts=FrameContacts(np.array([0, count - 1]), i, i + 1, pairs[0, 1:, 0], *(pair[1:] for pair in pairs[1:4])),
    )


def peak_of(suffix, people, frames, folder):
    """Return how much memory [bytes] writing takes at most."""
    tracemalloc.start()
    running = RunningRecording(folder / f"run-{frames}{suffix}", Stopped(), large_frame(people, 0))
    for k in range(1, frames):
        running.add(large_frame(people, k))
    running.finish({})
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


@pytest.mark.parametrize("suffix", WRITTEN)
@pytest.mark.parametrize(
    "people", [pytest.param(6_000, marks=pytest.mark.more), pytest.param(100_000, marks=pytest.mark.nightly)]
)
def test_memory_does_not_grow_with_the_run(suffix, people, tmp_path):
    peak_of(suffix, 100, 2, tmp_path)  # libraries are loaded
    short, long = (peak_of(suffix, people, frames, tmp_path) for frames in (3, 12))
    assert long < 1.3 * short
    assert long < 12 * 200 * people * (2 if people < 10_000 else 1)  # of twelve frames of some 200 bytes a row
