"""Recordings in JuPedSim's trajectory format, version 2 (SQLite), with additional tables.

The format: JuPedSim, `SqliteTrajectoryWriter`, tables trajectory_data, metadata, geometry and frame_data, which
JuPedSim's `Recording` reads, and PedPy's `load_trajectory_from_jupedsim_sqlite`.
"""

import hashlib
import json
import os
import re
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints, row_starts
from crowd_env.core.checks import Plain
from crowd_env.recording.content import FrameContacts, Frames
from crowd_env.recording.foreign import recording_of_positions
from crowd_env.recording.writer import (
    PLACE,
    area_with_aprons,
    as_json,
    facing,
    fields_of,
    part_of,
    place_of,
    remove_part,
)

# The tables that JuPedSim and PedPy read.
_JUPEDSIM = """
CREATE TABLE trajectory_data (frame INTEGER NOT NULL, id INTEGER NOT NULL, pos_x REAL NOT NULL, pos_y REAL NOT NULL,
    ori_x REAL NOT NULL, ori_y REAL NOT NULL);
CREATE TABLE metadata (key TEXT NOT NULL UNIQUE PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE geometry (hash INTEGER NOT NULL, wkt TEXT NOT NULL);
CREATE UNIQUE INDEX geometry_hash ON geometry (hash);
CREATE TABLE frame_data (frame INTEGER NOT NULL, geometry_hash INTEGER NOT NULL);
CREATE INDEX frame_id_idx ON trajectory_data (frame, id);
"""
_OURS = """
CREATE TABLE facts (key TEXT NOT NULL PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE exits (number INTEGER PRIMARY KEY, name TEXT NOT NULL, x1 REAL, y1 REAL, x2 REAL, y2 REAL);
CREATE TABLE people (id INTEGER PRIMARY KEY, radius REAL NOT NULL, desired_speed REAL NOT NULL, group_number INTEGER NOT NULL,
    exit_time REAL, exit_number INTEGER, company INTEGER NOT NULL DEFAULT -1);
CREATE TABLE frames (frame INTEGER PRIMARY KEY, time REAL NOT NULL);
CREATE TABLE motion (frame INTEGER NOT NULL, id INTEGER NOT NULL, vel_x REAL NOT NULL, vel_y REAL NOT NULL,
    pressure REAL NOT NULL, angle REAL, PRIMARY KEY (frame, id)) WITHOUT ROWID;
"""
# The rows that behaviors keep of each pedestrian, a table each.
_MEMORY = """
CREATE TABLE "{name}" (frame INTEGER NOT NULL, id INTEGER NOT NULL, {columns}, PRIMARY KEY (frame, id)) WITHOUT ROWID;
"""
_CONTACTS = """
CREATE TABLE contacts (frame INTEGER NOT NULL, i INTEGER NOT NULL, j INTEGER NOT NULL, gap REAL NOT NULL,
    normal_x REAL NOT NULL, normal_y REAL NOT NULL, point_x REAL NOT NULL, point_y REAL NOT NULL,
    force_normal REAL NOT NULL, force_tangential REAL NOT NULL);
"""
_ROWS = "SELECT frame, id, pos_x AS x, pos_y AS y FROM trajectory_data ORDER BY frame, id"
_MOTION = "SELECT vel_x AS vx, vel_y AS vy, pressure, angle FROM motion ORDER BY frame, id"
_PEOPLE = """
SELECT radius, desired_speed, group_number AS "group", exit_time, ifnull(exit_number, -1) AS exit_index, company
FROM people ORDER BY id
"""
_KNOWN = set(re.findall(r"CREATE TABLE (\w+)", _JUPEDSIM + _OURS + _CONTACTS))
_AT_ONCE = 50_000  # rows


class SqliteWriter:
    """Writes a recording into a SQLite file; every append is a transaction."""

    def __init__(self, path: Path, first: Frames) -> None:
        self._path, self._part, self._frames = path, part_of(path), 0
        area = area_with_aprons(first)
        self._hash = int.from_bytes(hashlib.blake2b(area.wkt.encode(), digest_size=8).digest(), "big", signed=True)
        known = {"version": 2, "fps": 1.0 / first.frame_interval}
        known |= dict(zip(("xmin", "ymin", "xmax", "ymax"), area.bounds, strict=True))
        facts = {**first.facts, **{name: one for name, one in place_of(first).items() if name != "exits"}}
        people = _rows(first.radius, first.desired_speed, first.cohort, first.group)
        with _named(self._part):
            remove_part(path)
            self._file = sqlite3.connect(self._part, isolation_level=None, check_same_thread=False)
            # The journal is there for a process that dies, not for the machine.
            self._file.execute("PRAGMA synchronous = OFF")
            optional = "".join(_table_of(name, values) for name, values in first.memory.items())
            optional += "" if first.contacts is None else _CONTACTS
            self._file.executescript("BEGIN;" + _JUPEDSIM + _OURS + optional)
            self._insert("metadata", ((key, str(value)) for key, value in known.items()))
            self._insert("geometry", [(self._hash, area.wkt)])
            self._insert("facts", ((key, as_json(value)) for key, value in facts.items()))
            self._insert("exits", ((k, name, *line.ravel().tolist()) for k, (name, line) in enumerate(first.exits)))
            self._insert("people", ((k, *one, None, None, group) for k, (*one, group) in enumerate(people)))
            self._file.execute("COMMIT")

    def append(self, part: Frames) -> None:
        """Write the next frames in one transaction."""
        frame, person = self._frames + part.frame, part.person
        numbers = range(self._frames, self._frames + len(part.times))
        angle = [None] * len(person) if part.angle is None else part.angle.tolist()
        out = np.flatnonzero(np.isfinite(part.exit_time))
        with _named(self._part):
            self._file.execute("BEGIN")
            self._insert("trajectory_data", _rows(frame, person, *part.position.T, *facing(part).T))
            motion = _rows(frame, person, *part.velocity.T, part.pressure)
            self._insert("motion", ((*row, one) for row, one in zip(motion, angle, strict=True)))
            for name, values in part.memory.items():
                self._insert(name, _rows(frame, person, *values.reshape(len(person), -1).T))
            self._insert("frame_data", ((number, self._hash) for number in numbers))
            self._insert("frames", zip(numbers, part.times.tolist(), strict=True))
            left = _rows(part.exit_time[out], part.exit_index[out], out)
            self._file.executemany("UPDATE people SET exit_time = ?, exit_number = ? WHERE id = ?", left)
            if part.contacts is not None:
                start, i, j, gap, *pairs = part.contacts
                of_frame = np.repeat(np.array(numbers), np.diff(start))
                self._insert("contacts", _rows(of_frame, i, j, gap, *(column for pair in pairs for column in pair.T)))
            self._file.execute("COMMIT")
        self._frames += len(numbers)

    def finish(self, facts: Plain) -> Path:
        """Write the last facts, and move the file to its place."""
        with _named(self._part):
            told = [(key, json.dumps(value)) for key, value in facts.items()]
            self._file.execute("BEGIN")
            self._file.executemany("INSERT OR REPLACE INTO facts VALUES (?, ?)", told)
            self._file.execute("COMMIT")
            self._file.close()
        os.replace(self._part, self._path)
        return self._path

    def abandon(self) -> None:
        """Close the file where it is."""
        self._file.close()

    def _insert(self, table: str, rows: Any) -> None:
        (columns,) = self._file.execute("SELECT count(*) FROM pragma_table_info(?)", (table,)).fetchone()
        self._file.executemany(f'INSERT INTO "{table}" VALUES ({", ".join("?" * columns)})', rows)


def _rows(*columns: np.ndarray) -> Iterator[tuple[Any, ...]]:
    return zip(*(column.tolist() for column in columns), strict=True)


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Name the file in the error if SQLite fails."""
    try:
        yield
    except sqlite3.Error as error:
        raise OSError(f"cannot write {path}: {error}") from error


def read_sqlite(path: Path) -> dict[str, Any]:
    """Return the fields of the recording in a file of this kind, written by this package, finished or not, or by JuPedSim.

    Raises
    ------
    ValueError
        If it is no such file.
    """
    with closing(sqlite3.connect(path)) as file:
        tables = {name for (name,) in file.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if not {"trajectory_data", "metadata", "geometry"} <= tables:
            raise ValueError(f"{path} is an SQLite database without the tables of a trajectory of JuPedSim")
        return _ours(file, tables) if {"facts", "motion"} <= tables else _of_jupedsim(file, path)


def _ours(file: sqlite3.Connection, tables: set[str]) -> dict[str, Any]:
    facts = {key: json.loads(value) for key, value in file.execute("SELECT key, value FROM facts")}
    place = {key: facts.pop(key) for key in PLACE if key != "exits"}
    exits = [(name, [line[:2], line[2:]]) for _, name, *line in file.execute("SELECT * FROM exits ORDER BY number")]
    times, rows = _columns(file, "SELECT time FROM frames ORDER BY frame")["time"], _columns(file, _ROWS)
    return fields_of(
        facts,
        {**place, "exits": exits},
        _columns(file, _PEOPLE),
        rows | _columns(file, _MOTION),
        times=times,
        frame_start=_starts(rows["frame"], len(times)),
        memory={name: _read_memory(file, name) for name in sorted(tables - _KNOWN)},
        contacts=_read_contacts(file, len(times)) if "contacts" in tables else None,
    )


def _table_of(name: str, values: Floats) -> str:
    columns = ", ".join(f"value_{k + 1} REAL NOT NULL" for k in range(values[:1].size or 1))
    return _MEMORY.format(name=name, columns=columns)


def _read_memory(file: sqlite3.Connection, name: str) -> Floats:
    """Return the values of a table that begins with the columns frame and id (R,), or (R, K) of several columns."""
    _, _, *columns = _columns(file, f'SELECT * FROM "{name}" ORDER BY frame, id').values()
    return np.stack(columns, axis=1) if len(columns) > 1 else np.asarray(columns[0])


def _read_contacts(file: sqlite3.Connection, frames: int) -> FrameContacts:
    frame, i, j, gap, *pairs = _columns(file, "SELECT * FROM contacts ORDER BY rowid").values()
    start, of_pairs = _starts(frame, frames), (np.stack(pairs[k : k + 2], axis=1) for k in (0, 2, 4))
    return FrameContacts(start, i, j, gap, *of_pairs)


def _starts(frame: Floats, frames: int) -> Ints:
    """Return the starts of the rows of each frame (F+1,) from the frame of each row."""
    return row_starts(np.bincount(frame.astype(np.int64), minlength=frames))


def _columns(file: sqlite3.Connection, query: str) -> dict[str, Any]:
    """Return the columns of a query as numbers, by name; NULL is nan."""
    cursor = file.execute(query)
    names = [name for name, *_ in cursor.description]
    found = [np.empty((0, len(names)))]
    while rows := cursor.fetchmany(_AT_ONCE):
        found.append(np.array(rows, dtype=np.float64))
    return dict(zip(names, np.ascontiguousarray(np.concatenate(found).T), strict=True))


def _of_jupedsim(file: sqlite3.Connection, path: Path) -> dict[str, Any]:
    fps = file.execute("SELECT value FROM metadata WHERE key = 'fps'").fetchone()
    areas = [wkt for (wkt,) in file.execute("SELECT wkt FROM geometry")]
    if fps is None or not areas:
        raise ValueError(f"{path} has no frame rate or no geometry; a trajectory of JuPedSim has both")
    frame, person, x, y = _columns(file, _ROWS).values()
    numbers = frame.astype(np.int64), person.astype(np.int64)
    return recording_of_positions(path, *numbers, np.stack([x, y], axis=1), float(fps[0]), areas[0])
