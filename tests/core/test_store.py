"""A store keeps finished pieces of work: stopped at any time, it goes on, and never with what something else decided."""

import os
import signal
import subprocess
import sys

import numpy as np
import pytest

from crowd_env.core.files import store
from crowd_env.core.files.store import Store

# Keeps one piece after the other until it is killed.
KEEPS = """
import sys
from pathlib import Path
from crowd_env.core.files.store import Store
store = Store(Path(sys.argv[1]), {"seed": 1})
with store.alone():
    for k in range(100_000):
        store.keep(f"pieces/{k}", {"number": k, "much": [0.1] * 2000})
        print(k, flush=True)
"""


def test_what_is_killed_goes_on_with_every_piece_that_was_kept(tmp_path):
    with subprocess.Popen(
        [sys.executable, "-c", KEEPS, str(tmp_path / "out")], stdout=subprocess.PIPE, text=True
    ) as it:
        last = [int(it.stdout.readline()) for _ in range(20)][-1]
        with pytest.raises(ValueError, match="another command is writing there"), Store(tmp_path / "out").alone():
            pass
        os.kill(it.pid, signal.SIGKILL)
    store = Store(tmp_path / "out", {"seed": 1})
    with store.alone():
        assert all(store.load(f"pieces/{k}")["number"] == k for k in range(last + 1))
        assert all(len(store.load(path.stem, None) or [0.1]) for path in (tmp_path / "out/pieces").glob("[0-9]*.json"))


def test_a_piece_is_read_back_to_the_last_bit(tmp_path):
    store, numbers = Store(tmp_path), np.random.default_rng(0).normal(size=7)
    store.keep("a/plain", {"list": numbers.tolist(), "none": None}, {"by": [1, 2.5]})
    store.keep("a/arrays", {"array": numbers, "whole": np.arange(3), "text": "x"}, {"by": "me"})
    assert store.load("a/plain", {"by": (1, 2.5)}) == {"list": numbers.tolist(), "none": None}
    read = store.load("a/arrays", {"by": "me"})
    np.testing.assert_array_equal(read["array"], numbers)
    np.testing.assert_array_equal(read["whole"], np.arange(3))
    assert read["text"] == "x" and store.load("a/other") is None


def test_identity_decides_what_may_be_used(tmp_path):
    identity = {"seed": 1, "people": [{"radius": 0.2}], "runs": 3}
    Store(tmp_path, identity).keep("one", {"x": 1}, {"code": "a"})
    assert Store(tmp_path, {**identity, "runs": 9}, free=("runs",)).load("one", {"code": "a"}) == {"x": 1}
    for other, words in (
        ({**identity, "seed": 2}, "seed is 1 there and 2 here"),
        ({**identity, "people": [{"radius": 0.3}]}, "people.radius is 0.2 there and 0.3 here"),
        ({**identity, "more": True}, "more is None there and True here"),
    ):
        with pytest.raises(ValueError, match=f"{words}; name another folder"):
            Store(tmp_path, other)
    store = Store(tmp_path, identity)
    assert store.load("one", {"code": "b"}, redo=True) is None
    with pytest.raises(ValueError, match="code is a there and b here; name another folder, or remove it"):
        store.load("one", {"code": "b"})
    (tmp_path / "identity.json").write_text("[1]")
    with pytest.raises(ValueError, match="does not say what decided the results"):
        Store(tmp_path, identity)


def test_a_damaged_piece_is_as_good_as_none(tmp_path):
    store = Store(tmp_path)
    for name, content in (("json", {"a": 1}), ("npz", {"a": np.ones(50)})):
        store.keep(name, content)
        path = store.path(name)
        whole = path.read_bytes()
        for damaged in (b"", b"[1]", whole[:-3]):
            path.write_bytes(damaged)
            assert store.load(name) is None, (name, damaged)


def test_a_piece_that_unpacks_to_more_than_any_has_is_as_good_as_none(tmp_path, monkeypatch):
    held = Store(tmp_path)
    held.keep("large", {"zeros": np.zeros(100_000)})
    assert held.load("large") is not None
    assert (tmp_path / "large.npz").stat().st_size < 10_000
    monkeypatch.setattr(store, "_MOST", 700_000)  # bytes
    assert held.load("large") is None
