"""Recordings as one table in a Parquet file, a row for a person in a frame, for data frames; facts in its metadata.

The index of a Parquet file comes last, so a file that breaks off cannot be read.  Until a recording is finished it is
therefore a folder of small files, each of which appears whole.
"""

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from crowd_env.core.arrays.state import Floats, Ints, row_starts
from crowd_env.core.files.json_file import read_json, write_json
from crowd_env.recording.frames import Frame, Head
from crowd_env.recording.recording import FrameContacts, Recording
from crowd_env.recording.writer import (
    frame_of_rows,
    join_contacts,
    joined,
    nobody_out,
    outline_of,
    part_of,
    plain,
    plain_place,
    read_place,
)

_KEY = b"crowd_env"
_PAIRS = ("normal", "point", "force")
_HEAD, _LEFT = "head.json", "left"
_ROWS_OF_GROUP = 100_000


def _contact_type() -> Any:
    import pyarrow as pa

    fields = [("j", pa.int64()), ("gap", pa.float64())]
    fields += [(f"{name}_{axis}", pa.float64()) for name in ("normal", "point") for axis in "xy"]
    return pa.struct([*fields, ("force_normal", pa.float64()), ("force_tangential", pa.float64())])


class ParquetWriter:
    """Writes a recording as a folder of Parquet files, one an append, and joins them into one file at the end."""

    def __init__(self, path: Path, head: Head) -> None:
        self._path, self._part, self._head = path, part_of(path), head
        self._frames, self._parts = 0, 0
        self._exit_time, self._exit_index = nobody_out(len(head.radius))
        if self._part.is_dir():
            _remove(self._part)
        self._part.mkdir(parents=True, exist_ok=True)
        write_json(self._part / _HEAD, self._told(head.facts))

    def _told(self, facts: Mapping[str, Any]) -> dict[str, Any]:
        head = self._head
        people = {name: getattr(head, name).tolist() for name in ("radius", "desired_speed", "group")}
        out = np.isfinite(self._exit_time)
        people["exit_time"] = [time if gone else None for time, gone in zip(self._exit_time.tolist(), out, strict=True)]
        people["exit_index"] = self._exit_index.tolist()
        return plain({"facts": dict(facts), "place": plain_place(head), "people": people, "contacts": head.contacts})

    def append(self, frames: Sequence[Frame]) -> None:
        """Write the next frames as one file."""
        import pyarrow.parquet as pq

        left = {name: joined(frames, name).tolist() for name in ("left", "exit_time", "exit_index")}
        self._exit_time[left["left"]], self._exit_index[left["left"]] = left["exit_time"], left["exit_index"]
        table = self._table(frames).replace_schema_metadata({_LEFT: json.dumps(left)})
        whole, half = self._part / f"{self._parts:06d}.parquet", self._part / "half"
        pq.write_table(table, half)
        os.replace(half, whole)
        self._frames, self._parts = self._frames + len(frames), self._parts + 1

    def _table(self, frames: Sequence[Frame]) -> Any:
        import pyarrow as pa

        person = joined(frames, "person")
        (x, y), (vx, vy) = joined(frames, "position").T, joined(frames, "velocity").T
        columns: dict[str, Any] = {
            "frame": frame_of_rows(frames, self._frames),
            "time": np.repeat([frame.time for frame in frames], [len(frame.person) for frame in frames]),
            "id": person,
            "x": x,
            "y": y,
            "vx": vx,
            "vy": vy,
            "pressure": joined(frames, "pressure"),
            "inside": joined(frames, "inside"),
        }
        if self._head.outline is not None:
            columns["angle"] = joined(frames, "angle")
        if self._head.contacts:
            columns["contacts"] = self._lists(frames)
        return pa.table({name: column if name == "contacts" else pa.array(column) for name, column in columns.items()})

    def _lists(self, frames: Sequence[Frame]) -> Any:
        """Return the contacts of each row: those of whom the row is, as the first of two."""
        import pyarrow as pa

        found = join_contacts(frames)
        counts = [
            np.bincount(np.searchsorted(frame.person, frame.contacts.i), minlength=len(frame.person))
            for frame in frames
            if frame.contacts is not None
        ]
        columns = [found.j, found.gap, *found.normal.T, *found.point.T, *found.force.T]
        arrays = [pa.array(np.ascontiguousarray(column)) for column in columns]
        values = pa.StructArray.from_arrays(arrays, fields=list(_contact_type()))
        return pa.ListArray.from_arrays(pa.array(row_starts(np.concatenate(counts)), pa.int32()), values)

    def finish(self, facts: Mapping[str, Any]) -> Path:
        """Join the files into one, with all facts, and move it to its place."""
        import pyarrow.parquet as pq

        head = self._head
        told = self._told(head.facts | dict(facts))
        metadata = {_KEY: json.dumps(told), b"wkt_geometry": head.with_aprons, b"fps": repr(1.0 / head.interval)}
        half = self._part / "half"
        schema = pq.read_schema(self._part / "000000.parquet").with_metadata(metadata)
        with pq.ParquetWriter(half, schema) as file:
            for table in _groups(_parts(self._part)):
                file.write_table(table.replace_schema_metadata(metadata))
        os.replace(half, self._path)
        _remove(self._part)
        return self._path

    def abandon(self) -> None:
        """Leave the folder as it is."""


def _parts(folder: Path) -> list[Path]:
    return sorted(folder.glob("[0-9]*.parquet"))


def _remove(folder: Path) -> None:
    """Delete a folder of parts, and nothing that somebody else has put there."""
    for path in (folder / _HEAD, folder / "half", *_parts(folder)):
        path.unlink(missing_ok=True)
    with suppress(OSError):
        folder.rmdir()


def _groups(paths: Sequence[Path]) -> Iterator[Any]:
    """Yield the tables of files, several in one as long as they are short."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    waiting: list[Any] = []
    for path in paths:
        waiting.append(pq.read_table(path).replace_schema_metadata(None))
        if sum(table.num_rows for table in waiting) >= _ROWS_OF_GROUP:
            yield pa.concat_tables(waiting).combine_chunks()
            waiting = []
    if waiting:
        yield pa.concat_tables(waiting).combine_chunks()


def read_parquet(path: Path) -> Recording:
    """Return the recording in a file of this kind, or in the folder of one that is not finished.

    Raises
    ------
    ValueError
        If it is none.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    if not path.is_dir():
        table = pq.read_table(path)
        metadata = table.schema.metadata or {}
        if _KEY not in metadata:
            raise ValueError(f"{path} is a Parquet file without the facts of a recording of crowd_env")
        return _recording(table, json.loads(metadata[_KEY]))
    told, parts = read_json(path / _HEAD), _parts(path)
    if not parts:
        raise ValueError(f"{path} holds no frame yet")
    for part in parts:
        left = json.loads(pq.read_schema(part).metadata[_LEFT.encode()])
        for who, time, row in zip(left["left"], left["exit_time"], left["exit_index"], strict=True):
            told["people"]["exit_time"][who], told["people"]["exit_index"][who] = time, row
    return _recording(pa.concat_tables([pq.read_table(part).replace_schema_metadata(None) for part in parts]), told)


def _recording(table: Any, told: Mapping[str, Any]) -> Recording:
    def column(name: str) -> Any:
        return table.column(name).to_numpy()

    frame, time, people, outline = column("frame"), column("time"), told["people"], outline_of(told["facts"])
    counts = np.bincount(frame)
    start = row_starts(counts)
    return Recording(
        facts=told["facts"],
        **read_place(told["place"]),
        times=time[start[:-1]],
        frame_start=start,
        radius=np.array(people["radius"]),
        desired_speed=np.array(people["desired_speed"]),
        group=np.array(people["group"], dtype=np.int64),
        exit_time=np.array(people["exit_time"], dtype=np.float64),
        exit_index=np.array(people["exit_index"], dtype=np.int64),
        person=column("id"),
        position=np.stack([column("x"), column("y")], axis=1),
        velocity=np.stack([column("vx"), column("vy")], axis=1),
        pressure=column("pressure"),
        angle=None if outline is None else column("angle"),
        outline=outline,
        contacts=_contacts(table, start) if told["contacts"] else None,
    )


def _contacts(table: Any, start: Ints) -> FrameContacts:
    lists = table.column("contacts").combine_chunks()
    number = lists.value_lengths().to_numpy(zero_copy_only=False)
    values, before = lists.flatten(), row_starts(number)

    def field(name: str) -> Floats:
        return np.asarray(values.field(name).to_numpy(zero_copy_only=False))

    pairs = ("x", "y"), ("x", "y"), ("normal", "tangential")
    columns = {
        name: np.stack([field(f"{name}_{part}") for part in parts], axis=1)
        for name, parts in zip(_PAIRS, pairs, strict=True)
    }
    i = np.repeat(table.column("id").to_numpy(), number)
    return FrameContacts(start=before[start], i=i, j=field("j").astype(np.int64), gap=field("gap"), **columns)
