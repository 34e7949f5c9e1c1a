"""Recordings in the HDF5 format of the Pedestrian Dynamics Data Archive (Juelich), with datasets of our own beside.

The format: https://ped.fz-juelich.de/da/doku.php?id=info, as PedPy's `load_trajectory_from_ped_data_archive_hdf5` reads it and
JuPedSim's `Hdf5TrajectoryWriter` writes it: a dataset ``trajectory`` with the attribute ``fps``, and ``wkt_geometry``.

The file is written in the mode of one writer and many readers (SWMR), in which it is whole after every flush.
"""

import json
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from crowd_env.core.files.atomic import written
from crowd_env.recording.foreign import recording_of_positions
from crowd_env.recording.recording import OF_PEOPLE, FrameContacts, Recording
from crowd_env.recording.writer import (
    area_with_aprons,
    as_json,
    facing,
    in_files,
    part_of,
    place_of,
    recording_of,
    remove_part,
)

_NUMBERS = ("x", "y", "z", "ox", "oy", "vx", "vy", "pressure")
_ROW = [("frame", "<i4"), ("id", "<i4"), *((name, "<f8") for name in _NUMBERS)]
_FRAME = [("time", "<f8"), ("rows", "<i8"), ("contacts", "<i8")]  # rows and contacts of all frames up to this one
_PERSON = [("radius", "<f8"), ("desired_speed", "<f8"), ("group", "<i4"), ("exit_time", "<f8"), ("exit_index", "<i4")]
_PERSON += [("company", "<i4")]
_CONTACT = [("i", "<i4"), ("j", "<i4"), ("gap", "<f8"), ("normal", "<f8", 2), ("point", "<f8", 2), ("force", "<f8", 2)]
_CHUNK = 4096  # rows


class Hdf5Writer:
    """Writes a recording into an HDF5 file; every append ends with a flush."""

    def __init__(self, path: Path, first: Recording) -> None:
        import h5py

        self._path, self._part, self._facts = path, part_of(path), first.facts
        remove_part(path)
        with _named(self._part):
            self._file = h5py.File(self._part, "w", libver="latest")  # also lets a plan be longer than 64 kB
        with _named(self._part, self._file):
            self._begin(first)

    def _begin(self, first: Recording) -> None:
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

    def append(self, part: Recording) -> None:
        """Write the next frames: first their rows, last that they are there."""
        with _named(self._part, self._file):
            self._append(self._file, part)

    def _append(self, file: Any, part: Recording) -> None:
        rows = np.zeros(len(part.person), dtype=file["trajectory"].dtype)
        rows["frame"], rows["id"], rows["pressure"] = len(file["frames"]) + part.frame, part.person, part.pressure
        for first, values in {"x": part.position, "ox": facing(part), "vx": part.velocity}.items():
            rows[first], rows[first.replace("x", "y")] = values.T
        for name, values in _optional(part).items():
            rows[name] = values
        count = np.zeros(len(part.times), dtype=_FRAME)
        count["time"], count["rows"] = part.times, len(file["trajectory"]) + part.frame_start[1:]
        if part.contacts is not None:
            count["contacts"] = len(file["contacts"]) + part.contacts.start[1:]
            contacts = np.zeros(len(part.contacts.i), dtype=_CONTACT)
            for name in FrameContacts._fields[1:]:
                contacts[name] = getattr(part.contacts, name)
            self._extend("contacts", contacts)
        self._extend("trajectory", rows)
        file["people"][:] = _people(part)
        file["people"].flush()
        self._extend("frames", count)

    def _extend(self, name: str, rows: np.ndarray) -> None:
        table = self._file[name]
        begin = len(table)
        table.resize((begin + len(rows),))
        table[begin:] = rows
        table.flush()

    def finish(self, facts: Mapping[str, Any]) -> Path:
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


def _optional(recording: Recording) -> dict[str, np.ndarray]:
    """Return the columns of rows that only some recordings have."""
    return ({} if recording.angle is None else {"angle": recording.angle}) | dict(recording.memory)


def _people(recording: Recording) -> np.ndarray:
    people = np.zeros(len(recording.radius), dtype=_PERSON)
    for name in OF_PEOPLE:
        people[in_files(name)] = getattr(recording, name)
    return people


def read_hdf5(path: Path) -> Recording:
    """Return the recording in a file of this kind, written by this package, finished or not, or by others.

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


def _ours(file: Any) -> Recording:
    count, people = file["frames"][:], file["people"][:]
    rows = file["trajectory"][: int(count["rows"][-1]) if len(count) else 0]
    contacts = None
    if "contacts" in file:
        found = file["contacts"][: int(count["contacts"][-1]) if len(count) else 0]
        start = np.concatenate([[0], count["contacts"]])
        contacts = FrameContacts(start, *(found[name] for name in FrameContacts._fields[1:]))
    since = count["time"][-1] if len(count) else -np.inf
    out = people["exit_time"] <= since  # rows written after the last valid frame do not count
    of_people = {name: people[in_files(name)] for name in OF_PEOPLE}
    of_people["exit_time"] = np.where(out, people["exit_time"], np.nan)
    of_people["exit_index"] = np.where(out, people["exit_index"], -1)
    return recording_of(
        json.loads(file.attrs["facts"]),
        json.loads(file.attrs["place"]),
        times=count["time"],
        frame_start=np.concatenate([[0], count["rows"]]),
        **of_people,
        person=rows["id"],
        position=np.stack([rows["x"], rows["y"]], axis=1),
        velocity=np.stack([rows["vx"], rows["vy"]], axis=1),
        pressure=rows["pressure"],
        angle=rows["angle"] if "angle" in rows.dtype.names else None,
        memory={name: rows[name] for name in rows.dtype.names[len(_ROW) :] if name != "angle"},
        contacts=contacts,
    )
