"""A plan as it is edited in the browser: what the page shows of a project, saved, and run."""

import itertools
import json
import os
import re
import secrets
import subprocess
import sys
import threading
import warnings
from collections.abc import Iterable, Mapping
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from crowd_env.analysis.figures import cells
from crowd_env.analysis.plan_check import PlanCheck, check_place, check_plan
from crowd_env.analysis.results.config import file_digest
from crowd_env.analysis.results.folder import KEPT
from crowd_env.core.checks import Plain, Range, table, whole
from crowd_env.core.files.atomic import keep_aside, legible, write_text
from crowd_env.core.files.json_file import read_json
from crowd_env.geometry.parsing import flat_parts
from crowd_env.geometry.parts import NoWayOut
from crowd_env.rendering.editor import editor_page
from crowd_env.rendering.plan import holes_of, shells_of
from crowd_env.scenarios.file import drawing_of, floor_of, scenario_of
from crowd_env.scenarios.plans.floor_plan import FloorPlan, RoleError
from crowd_env.scenarios.plans.reading import drawn_layers, levels_in
from crowd_env.scenarios.population import Population
from crowd_env.scenarios.project import Project, project_text

_FINE = 3  # decimals of meters on the page
_MOST_POINTS = 400_000  # of layers on the page
_CHOOSE = "choose under “The drawing and its layers”"
_PEOPLE = 2000  # that are drawn
_OPTION = re.compile(r"--(?=[a-z])")  # the page has fields for what the options of the command give
_RUNS = Range(1, 1000)
_LARGEST = 20_000_000  # bytes of a project


def look(content: Plain, path: Path, *, layers: bool = False, seed: int = 0) -> Plain:
    """Return what is understood of a project at ``path``, and what is wrong with it: nothing is raised for that.

    Parameters
    ----------
    content : of the scenario file.
    layers : whether to give what its drawing draws, layer by layer.
    """
    content = {key: value for key, value in content.items() if value is not None}
    found: dict[str, Any] = {"error": None, "text": project_text(content)}
    geometry = content.get("geometry")
    given: Plain = geometry if isinstance(geometry, Mapping) else {}
    file = given.get("file") if isinstance(given.get("file"), str) else None
    drawing: FloorPlan | None = None
    check: PlanCheck | None = None
    broken = (ValueError, ModuleNotFoundError, shapely.errors.ShapelyError)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", UserWarning)
        try:
            if file:
                drawing = drawing_of(content, path)
                found |= {"drawn": _drawn(drawing)}
            exits = given.get("exits")
            if drawing is not None and not (drawing.exits if exits is None else exits):
                raise ValueError("there is no exit yet: draw one on the edge of the floor")
            check = check_place(scenario_of(content, path), seed)
        except broken as error:
            found |= {"error": _plainly(error, path, file)}
            try:
                check = check_plan(path.stem, floor_of(content, path), Population(people=1), seed=seed)
            except broken as other:
                found |= {"error": _plainly(other, path, file)}
    notes = {_plainly(one.message, path, file): one.category for one in said}
    if check is not None:
        found |= _shown(check, whole=found["error"] is None)
    locked = [note for note, kind in notes.items() if issubclass(kind, NoWayOut)]  # people: worse than a note
    found |= {"notes": [note for note in notes if note not in locked]}
    found |= {"remarks": [*locked, *found.get("remarks", [])]}
    if layers and file is not None:
        how = {key: given[key] for key in ("unit", "level", "layers", "origin") if given.get(key)}
        with suppress(*broken):
            found |= {"levels": [*levels_in(path.parent / file)]}
            found |= {"layers": _layers(path.parent / file, None if drawing is None else drawing.meters, how)}
    return found


def page_alone(content: Plain, path: Path) -> str:
    """Return the page of a project that needs no server, and hands the project back."""
    return editor_page(content, path, served=False, shown=look(content, path, layers=True))


def _plainly(error: object, path: Path, drawing: str | None) -> str:
    """Return a message without the paths of the project and of its drawing, which are known, and for a page."""
    text = f"{error.lacks}; {_CHOOSE}" if isinstance(error, RoleError) else _OPTION.sub("", str(error))
    for name in (path, path.parent / (drawing or "")):
        text = text.replace(f"{name}: ", "")
    return legible(text)


def _drawn(drawing: FloorPlan) -> Plain:
    """Return the named shapes of a drawing, and where people start there."""
    shapes = {"exits": drawing.exits, "regions": drawing.regions}
    named = {key: {name: _lines_of(shape) for name, shape in group.items()} for key, group in shapes.items()}
    return {
        **named,
        "starts": {name: start.people for name, start in drawing.starts.items()},
        "title": drawing.title,
        "meters": drawing.meters,
    }


def _shown(check: PlanCheck, whole: bool) -> Plain:
    """Return the place for the page; ``whole`` = with exits and people."""
    geometry = check.geometry
    walls = {name: geometry.walls[geometry.door_of_wall == k] for k, name in enumerate(geometry.doors)}
    exits = {name: geometry.exits[[one == name for one in geometry.exit_names]] for name in check.widths}
    narrow = [one.gap for one in check.passages.values() if one is not None and not one.is_exit]
    people = np.column_stack([check.position, check.radius, check.cohort])[: _PEOPLE if whole else 0]
    return {
        "bounds": list(check.bounds),
        "area": geometry.area,
        "floor": {"shells": _rounded(shells_of(geometry.walkable)), "holes": _rounded(holes_of(geometry.walkable))},
        "exits": {name: {"width": check.widths[name], "lines": _rounded(lines)} for name, lines in exits.items()},
        "regions": {name: _lines_of(shape) for name, shape in geometry.regions.items()},
        "doors": {name: _rounded(lines) for name, lines in walls.items()},
        "thin_walls": _rounded(geometry.walls[geometry.two_sided & (geometry.door_of_wall < 0)]),
        "narrow": [{"width": gap.width, "line": _rounded([gap.line])[0]} for gap in narrow],
        "lost": [_lines_of(part) for part, _ in check.unreached],
        "people": people.round(_FINE).tolist(),
        "capacity": check.capacity,
        "count": check.people.people if whole else 0,
        "remarks": list(check.remarks) if whole else [],
    }


def _layers(drawing: Path, meters: float | None, how: Plain) -> list[Plain]:
    """Return name, role, number of shapes and lines of each layer."""
    found: list[Plain] = []
    room = _MOST_POINTS
    for name, layer in drawn_layers(drawing, meters=meters, **how).items():
        lines = [_lines_of(shape) for shape in layer.shapes]
        room -= sum(len(line) for shape in lines for line in shape)
        found.append(
            {
                "name": name,
                "role": layer.role,
                "count": len(layer.shapes),
                "shapes": lines if room > 0 else [],
            }
        )
    return found


def _lines_of(shape: BaseGeometry) -> list[Any]:
    """Return the lines and borders of a shape, each as points; a point is a line of one."""
    flat: list[BaseGeometry] = []
    for part in flat_parts(shape):
        flat.extend(shapely.get_rings(part) if part.geom_type == "Polygon" else [part])
    return _rounded(map(shapely.get_coordinates, flat))


def _rounded(lines: Iterable[Any]) -> list[Any]:
    return [np.asarray(line)[:, :2].round(_FINE).tolist() for line in lines]


class Editor:
    """A project that is edited: where it lies, and the run that was started from its page.

    Parameters
    ----------
    project : as it is at first; a comment stays beside what stays as it is.
    path : where it is saved.
    """

    def __init__(self, project: Project, path: Path) -> None:
        self.project, self.path = project, path
        self.content = project.content  # as it was seen last: a page that is loaded again goes on with it
        self._ours = ""  # digest of what this session has written
        self._run: _Run | None = None

    def answer(self, asked: str, given: Plain) -> Plain:
        """Return what the page asks for: check, save, run or progress.

        Raises
        ------
        ValueError
            If the file cannot be written, or nothing of that name can be asked for.
        """
        content = table("content", given.get("content", {}), "keys and values")
        match asked:
            case "check":
                self.content = content
                return look(content, self.path, layers=given.get("layers") is True)
            case "save":
                return self._save(content, given.get("revision"))
            case "run":
                runs = whole("runs", given.get("runs", 10), _RUNS)
                if self.running:
                    raise ValueError("a run goes on; stop it, or wait for it")
                saved = self._save(content, given.get("revision"))
                self._run = None if "failed" in saved else _Run(self.path, content, runs)
                return saved
            case "stop":
                self.stop()
                return {}
            case "progress":
                return {"state": "none"} if self._run is None else self._run.progress()
        raise ValueError(f"the page cannot ask for {asked!r}")

    def page_of_run(self, name: str) -> bytes | None:
        """Return the replay or the report of the run that has ended."""
        page = None if self._run is None else self._run.folder / name
        return page.read_bytes() if page is not None and page.is_file() else None

    def stop(self) -> None:
        """End the run that is under way."""
        if self._run is not None:
            self._run.stop()

    @property
    def running(self) -> bool:
        """Whether a run that was started from the page goes on."""
        return self._run is not None and self._run.progress()["state"] == "running"

    @property
    def revision(self) -> str:
        """Digest of the file as it is, "" without one; a page sends the one that it knows."""
        return file_digest(self.path) if self.path.is_file() else ""

    def page(self) -> str:
        """Return the page as it goes on."""
        saved, running = self.project.content, self._run is not None
        return editor_page(self.content, self.path, served=True, saved=saved, revision=self.revision, running=running)

    def _text(self) -> str:
        """Return the file as this session writes it."""
        json_file = self.path.suffix.lower() == ".json"
        return json.dumps(self.project.content, indent=2) if json_file else self.project.text

    def _save(self, content: Plain, known: object) -> Plain:
        now = self.revision
        if now != known:
            words = f"{self.path.name} has changed since this page has read it; the next time it is kept aside"
            return {"failed": f"{words} and written", "revision": now}
        before, comments, head = self.project
        foreign = now not in ("", self._ours) and self.path.read_text(encoding="utf-8") != self._text()
        kept = keep_aside(self.path).name if foreign else ""
        same = {name: text for name, text in comments.items() if _at(before, name) == _at(content, name)}
        self.project = Project(content, same, head)
        write_text(self.path, self._text())
        self._ours = self.revision
        return {"saved": str(self.path), "revision": self._ours, "kept": kept}


def _at(content: Any, name: str) -> Any:
    """Return what has the name of a key, such as geometry.exits.north, in the content of a file."""
    for key in name.split(".", 2):
        content = content.get(key) if isinstance(content, Mapping) else None
    return content


PAGES = ("replay.html", "report.html")


class _Run:
    """Runs of a project, its replay and its report, by the commands that anyone can type."""

    def __init__(self, path: Path, content: Plain, runs: int) -> None:
        names = (f"{path.stem}-runs-{k}" for k in itertools.count(1))
        self.folder = next(one for name in names if not (one := path.parent / name).exists())
        self.runs, self._path, self._content = runs, path, content
        self._state, self._said = "running", ""
        self._process: subprocess.Popen[str] | None = None
        threading.Thread(target=self._go, daemon=True).start()

    def _go(self) -> None:
        out = str(self.folder)
        commands = [
            ["run", str(self._path), "--runs", str(self.runs), "--out", out, "--json"],
            ["replay", out, "-o", str(self.folder / PAGES[0])],
            ["report", out, "-o", str(self.folder / PAGES[1])],
        ]
        for command in commands:
            whole = [sys.executable, "-m", "crowd_env", *command]
            environment = {**os.environ, "COLUMNS": "500"}
            streams: Any = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
            self._process = subprocess.Popen(whole, env=environment, **streams)
            _, said = self._process.communicate()
            if self._process.returncode:
                self._state, self._said = (
                    "failed",
                    legible(said.strip().splitlines()[-1] if said.strip() else "stopped"),
                )
                return
        self._state = "done"

    def progress(self) -> Plain:
        """Return how far it is; at the end the table of the answer."""
        kept = self.folder / KEPT
        done = sum(one.stem.isdecimal() for one in kept.iterdir()) if kept.is_dir() else 0
        shown: dict[str, Any] = {"state": self._state, "done": done, "runs": self.runs, "said": self._said}
        if self._state != "done":
            return shown
        place, figures = scenario_of(self._content, self._path), read_json(self.folder / "summary.json")
        rows = list(cells(place, figures).items())
        return {**shown, "rows": rows, "check": figures.get("doubts", ""), "folder": str(self.folder)}

    def stop(self) -> None:
        """End it."""
        if self._process is not None and self._process.poll() is None:
            self._process.terminate()


class Server(ThreadingHTTPServer):
    """Serves one page on the loopback address, under a token that no other page knows.

    Attributes
    ----------
    url : of the page.
    """

    daemon_threads = True

    def __init__(self, editor: Editor, port: int = 0) -> None:
        super().__init__(("127.0.0.1", port), _Handler)
        self.editor, self.token = editor, secrets.token_urlsafe(16)
        self.host = f"127.0.0.1:{self.server_port}"
        self.url = f"http://{self.host}/{self.token}/"
        self.turn = threading.Lock()  # one answer at a time: notes and warnings belong to a process


class _Handler(BaseHTTPRequestHandler):
    server: Server
    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        name = self._asked()
        if name == "":
            with self.server.turn:
                page = self.server.editor.page()
            self._give(page.encode(), "text/html; charset=utf-8")
        elif name in PAGES and (found := self.server.editor.page_of_run(name)) is not None:
            self._give(found, "text/html; charset=utf-8")
        else:
            self._refuse(HTTPStatus.NOT_FOUND)

    def do_POST(self) -> None:
        name = self._asked()
        length = self.headers.get("Content-Length", "")
        typed = self.headers.get("Content-Type", "").partition(";")[0] == "application/json"
        if name is None or not typed or not length.isdecimal() or int(length) > _LARGEST:
            self._refuse(HTTPStatus.BAD_REQUEST)
            return
        try:
            given = table("what the page sends", json.loads(self.rfile.read(int(length))), "keys and values")
            with self.server.turn:
                answer = self.server.editor.answer(name, given)
        except (ValueError, OSError, RecursionError) as error:
            answer = {"failed": legible(str(error))}
        self._give(json.dumps(answer).encode(), "application/json")

    def _asked(self) -> str | None:
        """Return what is asked for, if the token and the name of the host are right: other pages know neither."""
        _, token, *rest = [*self.path.split("/"), "", ""][:4]
        own = secrets.compare_digest(token.encode(), self.server.token.encode())
        return rest[0] if own and self.headers.get("Host") == self.server.host and not rest[1] else None

    def _give(self, content: bytes, kind: str) -> None:
        self.send_response(HTTPStatus.OK)
        for header in (("Content-Type", kind), ("Content-Length", str(len(content))), ("Cache-Control", "no-store")):
            self.send_header(*header)
        with suppress(ConnectionError):  # the tab has been closed
            self.end_headers()
            self.wfile.write(content)

    def _refuse(self, status: HTTPStatus) -> None:
        self.close_connection = True
        self.send_error(status)

    def log_message(self, format: str, *arguments: Any) -> None:
        """Keep the terminal free."""
