"""Trajectories of others: JuPedSim's SQLite, HDF5 of the Juelich archive, text."""

import sqlite3

import numpy as np
import pytest
from cases import looped

from crowd_env.recording import load

# id, frame, x, y: two people walk along x, the first leaves after frame 2.
ROWS = [(7, 0, 0.0, 1.0), (7, 1, 0.1, 1.0), (7, 2, 0.2, 1.0), *((9, k, 0.3 * k, 2.0) for k in range(5))]
SQUARE = "POLYGON ((0 0, 3 0, 3 3, 0 3, 0 0))"


def jupedsim(path):
    with sqlite3.connect(path) as file:
        file.executescript(
            "CREATE TABLE trajectory_data (frame INTEGER, id INTEGER, pos_x REAL, pos_y REAL, ori_x REAL, ori_y REAL);"
            "CREATE TABLE metadata (key TEXT, value TEXT); CREATE TABLE geometry (hash INTEGER, wkt TEXT)"
        )
        file.executemany("INSERT INTO trajectory_data VALUES (?, ?, ?, ?, 1, 0)", [(f, i, x, y) for i, f, x, y in ROWS])
        file.executemany("INSERT INTO metadata VALUES (?, ?)", [("version", "2"), ("fps", "10.0")])
        file.execute("INSERT INTO geometry VALUES (1, ?)", (SQUARE,))


def archive(path):
    import h5py

    with h5py.File(path, "w") as file:
        kind = [("id", "<i4"), ("frame", "<i4"), ("x", "<f4"), ("y", "<f4"), ("z", "<f4")]
        file["trajectory"] = np.array([(*row, 1.7) for row in ROWS], dtype=kind)
        file["trajectory"].attrs["fps"] = 10.0
        file.attrs["wkt_geometry"] = SQUARE


def text(path):
    head = "# description: by hand\n# framerate: 10.00 fps\n#geometry: nothing\n# id frame x/cm y/cm z/cm\n"
    path.write_text(head + "".join(f"{i} {f} {100 * x:.4f} {100 * y:.4f} 0\n" for i, f, x, y in ROWS))


@looped(("write", "suffix"), [(jupedsim, ".sqlite"), (archive, ".h5"), (text, ".txt")])
def test_positions_are_read_and_what_follows_from_them(write, suffix, tmp_path):
    path = tmp_path / f"theirs{suffix}"
    write(path)
    kept = load(path)
    assert kept.times == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4]) and kept.frame_start.tolist() == [0, 2, 4, 6, 7, 8]
    assert kept.person.tolist() == [0, 1, 0, 1, 0, 1, 1, 1]
    first, second = (kept.person == k for k in (0, 1))
    assert kept.position[second] == pytest.approx(np.array([[0.3 * k, 2.0] for k in range(5)]), abs=1e-6)
    assert kept.velocity[first] == pytest.approx(np.array([[1.0, 0.0]] * 3), abs=1e-5)
    assert kept.velocity[second] == pytest.approx(np.array([[3.0, 0.0]] * 5), abs=1e-5)
    assert kept.exit_time == pytest.approx([0.3, np.nan], nan_ok=True) and not kept.beyond.any()
    assert np.isnan(kept.pressure).all() and kept.radius.tolist() == [0.2, 0.2] and kept.inside(0.35) == 1
    if write is text:
        assert kept.walkable.startswith("POLYGON ((-0.5 0.5, 1.7")
    else:
        assert kept.walkable == SQUARE


@pytest.mark.more
@looped(
    ("content", "words"),
    [
        ("1 0 0 0\n", "no frame rate; a comment must tell it"),
        ("# framerate: 10 fps\n1 0 0 0\n", "no unit; a comment must tell it"),
        ("# framerate: 10 in m\n1 0 x 0\n", "a line is not made of id, frame, x and y"),
        ("# framerate: 10 in m\n1 0 1\n", "a line is not made of id, frame, x and y"),
        ("# framerate: 10 in m\n1 0 nan 0\n", "line 1 of the rows is not finite"),
        ("# framerate: 10 in m\n", "holds no positions"),
        ("# framerate: 0 in m\n1 0 0 0\n", "the frame rate is 0; it must be positive"),
        ("# framerate: 10 in m\n1 0 0 0\n1 0 1 1\n", "1 has two positions in frame 0"),
    ],
)
def test_what_is_wrong_with_a_text_is_said(content, words, tmp_path):
    (tmp_path / "a.txt").write_text(content)
    with pytest.raises(ValueError, match=words):
        load(tmp_path / "a.txt")
