"""Recordings made by hand, and pages read back by the format that `crowd_env.rendering.replay.page` documents."""

import base64
import gzip
import json
from collections.abc import Mapping
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np

from crowd_env.recording import FrameContacts, Recording

VOID = {"meta", "link", "input", "br", "img"}


def walk_out(
    people: int = 6, *, every: float = 0.1, contacts: bool = False, stays: int = 0, outline: Any = None, **facts: Any
) -> Recording:
    """Return people in rows who walk to the right at 1 m/s through the whole right side of a room of 6 x 4 m.

    The last ``stays`` of them stand still.  Neighbors in a row touch, if contacts are wanted.
    """
    start = np.stack([2.97 + 0.4 * (np.arange(people) % 6), 0.5 + 0.5 * (np.arange(people) // 6)], axis=1)
    speed = np.where(np.arange(people) >= people - stays, 0.0, 1.0)
    exit_time = np.where(speed > 0, 6.0 - start[:, 0], np.nan)
    last = np.nanmax(exit_time, initial=1.0)
    times = np.append(np.arange(0.0, last + 0.3, every), last + 0.35)
    rows = [np.flatnonzero(~(exit_time <= times[max(frame - 1, 0)])) for frame in range(len(times))]
    person, frame = np.concatenate(rows), np.repeat(np.arange(len(times)), [len(row) for row in rows])
    moved = (speed[person] * times[frame])[:, None] * np.array([1.0, 0.0])
    pairs = [(i, i + 1) for i in range(people - 1) if i % 6 < 5]
    touching = [[pair for pair in pairs if set(pair) <= set(row)] for row in rows]
    return Recording(
        facts={"scenario": "hand-made", "scheme": "dem", "seed": 3, "strategy": "shortest", "dt": 0.01} | facts,
        walkable="POLYGON ((0 0, 6 0, 6 4, 0 4, 0 0), (1 1, 1 2, 2 2, 2 1, 1 1))",
        thin_walls=np.array([[[0.5, 3.0], [1.5, 3.0]]]),
        doors=(),
        exits=(("right", np.array([[6.0, 0.0], [6.0, 2.0]])), ("upper right", np.array([[6.0, 2.0], [6.0, 4.0]]))),
        cohorts=("slow", "fast"),
        times=times,
        frame_start=np.concatenate([[0], np.cumsum([len(row) for row in rows])]),
        radius=np.linspace(0.19, 0.25, people),
        desired_speed=np.full(people, 1.3),
        cohort=np.arange(people) % 2,
        exit_time=exit_time,
        exit_index=np.where(np.isnan(exit_time), -1, (start[:, 1] > 2.0).astype(int)),
        person=person,
        position=start[person] + moved,
        velocity=np.stack([speed[person], 0.0 * speed[person]], axis=1),
        pressure=200.0 * person + 10.0 * frame,
        angle=None if outline is None else 0.1 * times[frame] - 3.0,
        outline=outline,
        contacts=_contacts(touching, start, speed, times) if contacts else None,
    )


def _contacts(touching: list[list[tuple[int, int]]], start: Any, speed: Any, times: Any) -> FrameContacts:
    """Return a contact a pair, and one of the first of each frame with the wall."""
    found = [[*pairs, (pairs[0][0], -1)] if pairs else [] for pairs in touching]
    i, j = (np.array([pair[k] for pairs in found for pair in pairs], dtype=int) for k in (0, 1))
    frame = np.repeat(np.arange(len(times)), [len(pairs) for pairs in found])
    point = start[i] + np.stack([speed[i] * times[frame] + 0.2, 0.0 * i], axis=1)
    force = np.stack([100.0 + 50.0 * i, 0.0 * i], axis=1)
    start_of = np.concatenate([[0], np.cumsum([len(pairs) for pairs in found])])
    return FrameContacts(start_of, i, j, -0.01 + 0.0 * i, np.tile([-1.0, 0.0], (len(i), 1)), point, force)


class Parsed(HTMLParser):
    """A page with its elements in balance: the text of each script, and all addresses."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.scripts: list[tuple[dict[str, str | None], str]] = []
        self.texts: dict[str, str] = {}
        self.addresses: list[str] = []
        self.feed(text)
        self.close()
        assert not self.open, f"never closed: {self.open}"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [value or "" for name, value in attrs if name in ("src", "href", "action", "data")]
        if tag == "script":
            self.scripts.append((dict(attrs), ""))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        pass

    def handle_endtag(self, tag: str) -> None:
        assert self.open and self.open.pop() == tag, f"</{tag}> closes nothing"

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "script":
            attributes, text = self.scripts[-1]
            self.scripts[-1] = (attributes, text + data)
        elif self.open:
            self.texts[self.open[-1]] = self.texts.get(self.open[-1], "") + data

    def script(self, name: str) -> str:
        (text,) = (text for attributes, text in self.scripts if attributes.get("id") == name)
        return text

    def about(self) -> dict[str, Any]:
        return dict(json.loads(self.script("about")))


def unpack(about: list[Mapping[str, Any]], text: str) -> dict[str, np.ndarray]:
    """Return the columns of a packed recording by name, as `crowd_env.rendering.replay.page` says they are packed."""
    data, found, start = gzip.decompress(base64.b64decode(text)), {}, 0
    for one in about:
        kind = np.dtype({"steps": "<i2", "whole": "<i4", "real": "<f4"}[one["kind"]])
        values = np.frombuffer(data, kind, one["length"], start)
        start += kind.itemsize * one["length"]
        found[one["name"]] = np.cumsum(values, dtype=np.int16) * one["step"] if one["kind"] == "steps" else values
    assert start == len(data)
    return found


def read_page(path: Path) -> list[dict[str, np.ndarray]]:
    """Return the columns of each recording of a page."""
    parsed = Parsed(path.read_text(encoding="utf-8"))
    about = parsed.about()["recordings"]
    return [unpack(one["columns"], parsed.script(f"recording-{k}")) for k, one in enumerate(about)]
