"""Recordings in the HDF5 format of the Pedestrian Dynamics Data Archive (Juelich), with datasets of our own beside.

The format: https://ped.fz-juelich.de/da/doku.php?id=info, as PedPy's `load_trajectory_from_ped_data_archive_hdf5` reads it and
JuPedSim's `Hdf5TrajectoryWriter` writes it: a dataset ``trajectory`` with the attribute ``fps``, and ``wkt_geometry``.

The file is written in the mode of one writer and many readers (SWMR), in which it is whole after every flush.
"""

import json
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from crowd_env.core.checks import Plain
from crowd_env.core.files.atomic import written
from crowd_env.recording.content import OF_PEOPLE, FrameContacts, Frames
from crowd_env.recording.foreign import recording_of_positions
from crowd_env.recording.writer import (
    area_with_aprons,
    as_json,
    facing,
    fields_of,
    in_files,
    part_of,
    place_of,
    remove_part,
)

_NUMBERS = ("x", "y", "z", "ox", "oy", "vx", "vy", "pressure")
_ROW = [("frame", "<i4"), ("id", "<i4"), *((name, "<f8") for name in _NUMBERS)]
_FRAME = [("time", "<f8"), ("rows", "<i8"), ("contacts", "<i8")]  # rows and contacts of all frames up to this one
_PERSON = [("radius", "<f8"), ("desired_speed", "<f8"), ("group", "<i4"), ("exit_time", "<f8"), ("exit_index", "<i4")]
_PERSON += [("company", "<i4")]
_CONTACT = [("i", "<i4"), ("j", "<i4"), ("gap", "<f8"), ("normal", "<f8", 2), ("point", "<f8", 2), ("force", "<f8", 2)]
_OF_CONTACTS = FrameContacts._fields[1:]
_CHUNK = 4096  # rows


class Hdf5Writer:
    """Writes a recording into an HDF5 file; every append ends with a flush."""

    def __init__(self, path: Path, first: Frames) -> None:
        import h5py

        self._path, self._part, self._facts = path, part_of(path), first.facts
        remove_part(path)
        with _named(self._part):
            self._file = h5py.File(self._part, "w", libver="latest")  # also lets a plan be longer than 64 kB
        with _named(self._part, self._file):
            self._begin(first)

    def _begin(self, first: Frames) -> None:
        optional = [(name, "<f8", values.shape[1:]) for name, values in _optional(first).items()]
        rows = self._table("trajectory", _ROW + optional)
        rows.attrs["fps"] = 1.0 / first.frame_interval
        self._table("frames", _FRAME)
        if first.contacts is not None:
            self._table("contacts", _CONTACT)
        self._file.create_dataset("people", data=_people(first))
        place = as_json(place_of(first))
        self._file.attrs.update(wkt_geometry=area_with_aprons(first).wkt, place=place, facts=as_json(first.facts))
        self._file.attrs.update(producer="crowd_env", fps=1.0 / first.frame_interval)
        self._file.swmr_mode = True

    def _table(self, name: str, kind: list[Any]) -> Any:
        packed: dict[str, Any] = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
        return self._file.create_dataset(name, (0,), np.dtype(kind), maxshape=(None,), chunks=(_CHUNK,), **packed)

    def append(self, part: Frames) -> None:
        """Write the next frames: first their rows, last that they are there."""
        with _named(self._part, self._file):
            self._append(self._file, part)

    def _append(self, file: Any, part: Frames) -> None:
        (x, y), (ox, oy), (vx, vy) = part.position.T, facing(part).T, part.velocity.T
        of_bodies = {"x": x, "y": y, "ox": ox, "oy": oy, "vx": vx, "vy": vy, "pressure": part.pressure}
        if "height" in part.memory:
            of_bodies["z"] = part.memory["height"]
        frame = len(file["frames"]) + part.frame
        rows = _packed(file["trajectory"].dtype, frame=frame, id=part.person, **of_bodies, **_optional(part))
        count = {"time": part.times, "rows": len(file["trajectory"]) + part.frame_start[1:]}
        if part.contacts is not None:
            start, *contacts = part.contacts
            count["contacts"] = len(file["contacts"]) + start[1:]
            self._extend("contacts", _packed(_CONTACT, **dict(zip(_OF_CONTACTS, contacts, strict=True))))
        self._extend("trajectory", rows)
        file["people"][:] = _people(part)
        file["people"].flush()
        self._extend("frames", _packed(_FRAME, **count))

    def _extend(self, name: str, rows: np.ndarray) -> None:
        table = self._file[name]
        begin = len(table)
        table.resize((begin + len(rows),))
        table[begin:] = rows
        table.flush()

    def finish(self, facts: Plain) -> Path:
        """Write all into a file without the gaps of rows that every flush compresses again, with the last facts."""
        import h5py

        self._file.close()
        create = {"mode": "w", "libver": "latest"}
        with (
            written(self._path) as half,
            h5py.File(self._part, "r") as given,
            h5py.File(half, **create) as file,
            _named(half, file),
        ):
            file.attrs.update(given.attrs)
            file.attrs["facts"] = json.dumps({**self._facts, **facts})
            for name in given:
                given.copy(name, file)
            file.flush()
        self._part.unlink()
        return self._path

    def abandon(self) -> None:
        """Close the file where it is."""
        self._file.close()


@contextmanager
def _named(path: Path, file: Any = None) -> Iterator[None]:
    """Name the file in the error if it cannot be written, and release it: HDF5 would try again, and end the process."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        if file is not None:
            null = os.open(os.devnull, os.O_RDWR)
            os.dup2(null, file.id.get_vfd_handle())
            os.close(null)
        why = re.search("error message = '([^']*)'", str(error))
        raise OSError(f"cannot write {path}: {why[1] if why else type(error).__name__}") from error


def _optional(recording: Frames) -> dict[str, np.ndarray]:
    """Return the columns of rows that only some recordings have."""
    return ({} if recording.angle is None else {"angle": recording.angle}) | dict(recording.memory)


def _people(recording: Frames) -> np.ndarray:
    return _packed(_PERSON, **{in_files(name): getattr(recording, name) for name in OF_PEOPLE})


def _packed(kind: Any, **columns: np.ndarray) -> np.ndarray:
    """Return columns as rows of a table; numbers that are left out are 0."""
    rows = np.zeros(len(next(iter(columns.values()))), dtype=kind)
    for name, values in columns.items():
        rows[name] = values
    return rows


def read_hdf5(path: Path) -> dict[str, Any]:
    """Return the fields of the recording in a file of this kind, written by this package, finished or not, or by others.

    Raises
    ------
    ValueError
        If it is no such file.
    """
    import h5py

    try:
        file = h5py.File(path, "r")
    except OSError as error:
        if "already open for write" not in str(error):
            raise  # damaged: in the other mode HDF5 would wait for its writer to mend it
        file = h5py.File(path, "r", libver="latest", swmr=True)  # its writer has not come to the end
    with file:
        if "trajectory" not in file or "fps" not in file["trajectory"].attrs:
            raise ValueError(f"{path} holds no dataset 'trajectory' with a frame rate, as those of the archive do")
        if "frames" not in file or "people" not in file:
            rows, area = file["trajectory"][:], file.attrs.get("wkt_geometry")
            position = np.stack([rows["x"], rows["y"]], axis=1).astype(np.float64)
            frame, person = (rows[name].astype(np.int64) for name in ("frame", "id"))
            fps = float(file["trajectory"].attrs["fps"])
            return recording_of_positions(path, frame, person, position, fps, None if area is None else str(area))
        return _ours(file)


def _ours(file: Any) -> dict[str, Any]:
    count, people = file["frames"][:], file["people"][:]
    rows, contacts = _rows_until(file["trajectory"], count["rows"]), None
    if "contacts" in file:
        found = _rows_until(file["contacts"], count["contacts"])
        contacts = FrameContacts(np.concatenate([[0], count["contacts"]]), *(found[name] for name in _OF_CONTACTS))
    since = count["time"][-1] if len(count) else -np.inf
    later = ~(people["exit_time"] <= since)  # rows written after the last valid frame do not count
    people["exit_time"][later], people["exit_index"][later] = np.nan, -1
    return fields_of(
        json.loads(file.attrs["facts"]),
        json.loads(file.attrs["place"]),
        people,
        rows,
        times=count["time"],
        frame_start=np.concatenate([[0], count["rows"]]),
        memory={name: rows[name] for name in rows.dtype.names[len(_ROW) :] if name != "angle"},
        contacts=contacts,
    )


def _rows_until(table: Any, ends: np.ndarray) -> Any:
    """Return the rows of all frames that are whole, which end at ``ends`` (F,)."""
    return table[: int(ends[-1]) if len(ends) else 0]
