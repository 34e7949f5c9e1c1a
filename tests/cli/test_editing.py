"""The plan in the browser, seen from the command: what it understands of a project, saves and runs."""

import http.client
import json
import threading
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest
from commands import call
from late import late
from office_drawing import AREA, EXIT, LAYERS, draw_office
from repository import ROOT
from shapely.geometry import Polygon, box, mapping

from crowd_env import make_scenario
from crowd_env.cli.editing import Editor, Server, look
from crowd_env.scenarios.project import Project, project_in

late("ezdxf")

ROOM = {"walkable": {"box": [0, 0, 6, 5]}, "exits": {"east": [[6, 2], [6, 3]]}}
OFFICE = {
    "geometry": {
        "file": "office.dxf",
        "layers": LAYERS,
        "exits": {"way out": EXIT},
        "regions": {"desks": [[0.5, 3.5], [4, 3.5], [4, 6], [0.5, 6]]},
    },
    "population": {"people": 12, "start_region": "desks"},
}


@pytest.fixture
def project(tmp_path):
    draw_office(tmp_path / "office.dxf")
    return tmp_path / "office.toml"


def test_a_drawing_is_seen_before_it_is_a_plan(project):
    found = look({"geometry": {"file": "office.dxf"}}, project, layers=True)
    assert found["error"].startswith("none of its visible layers says where people walk")
    assert [(one["name"], one["role"], one["count"]) for one in found["layers"]] == [
        ("A-AREA", "", 1), ("A-WALL", "", 7), ("A-FURN", "", 1)]  # fmt: skip
    assert "floor" not in found


def test_floor_is_seen_before_there_is_an_exit(project):
    found = look({"geometry": {"file": "office.dxf", "layers": LAYERS}}, project)
    assert found["error"] == "there is no exit yet: draw one on the edge of the floor"
    assert found["area"] == pytest.approx(AREA) and len(found["floor"]["shells"]) == 1 and not found["people"]


def test_a_whole_project_shows_its_people_and_where_it_is_narrow(project):
    found = look(OFFICE, project, layers=True)
    assert found["error"] is None and found["remarks"] == [] and found["count"] == 12
    people = np.array(found["people"])
    assert len(people) == 12 and (people[:, :2] >= [0.5, 3.5]).all() and (people[:, :2] <= [4, 6]).all()
    (narrow,) = found["narrow"]
    assert narrow["width"] == pytest.approx(0.9, abs=1e-3)
    assert found["exits"]["way out"]["width"] == pytest.approx(1.2)
    # The layers are in the meters of the plan.
    walls = np.concatenate([np.concatenate(shape) for one in found["layers"] for shape in one["shapes"]])
    assert walls.min() == 0.0 and walls.max() == pytest.approx(10.4)
    project.write_text(found["text"])
    assert make_scenario(project).population.people == 12


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"geometry": OFFICE["geometry"] | {"exits": {"a": [[3, 4], [4, 4]]}}}, "exit 'a'"),
        ({"geometry": OFFICE["geometry"] | {"exits": {"a": "east"}}}, "exits.a is 'east', which office.dxf does not have"),
        ({"geometry": OFFICE["geometry"] | {"doors": {"d": [[1, 1], [2, 1]]}}}, "door 'd'"),
        ({"population": {"people": 500, "start_region": "desks"}}, "500"),
        ({"population": {"people": 5, "start_region": "nowhere"}}, "nowhere"),
        ({"zones": [{"region": "desks"}]}, "desks"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_shown_beside_the_floor(project, change, words):
    found = look(OFFICE | change, project)
    assert words in found["error"] and str(project.parent) not in found["error"]
    assert found["area"] == pytest.approx(AREA)


@pytest.mark.parametrize(
    ("size", "levels", "words"),
    [(6, ["0", "1"], "it has 2 levels (0, 1), and people walk on one"), (60000, ["0"], "taken as meters")],
)
def test_a_list_of_the_page_is_named_and_no_option(tmp_path, size, levels, words):
    rooms = [
        {"type": "Feature", "properties": {"kind": "room", "level": level}, "geometry": mapping(box(0, 0, size, size))}
        for level in levels
    ]
    (tmp_path / "house.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": rooms}))
    found = look({"geometry": {"file": "house.geojson"}}, tmp_path / "house.toml", layers=True)
    assert words in found["error"] and found["error"].endswith("choose under “The drawing and its layers”")
    assert not any(word in found["error"] for word in ("unit m", "Python", "house.geojson:"))


def test_an_area_in_parts_is_drawn_whole():
    found = look({"geometry": {"file": "office.dxf"}, "population": {"people": 5}}, ROOT / "examples" / "office.toml")
    for rings in (found["regions"]["offices"], found["drawn"]["regions"]["offices"]):  # ten rooms
        assert len(rings) == 10 and all(Polygon(ring).area == pytest.approx(3.8 * 4.8) for ring in rings)


BROKEN = [
    {},
    {"geometry": None},
    {"geometry": []},
    {"geometry": {}},
    {"geometry": {"file": 3}},
    {"geometry": {"file": "no.dxf"}},
    {"geometry": {"file": "../office.toml"}},
    {"geometry": {"walkable": [[0, 0], [1, 1]]}},
    {"geometry": {"walkable": [[0, 0], ["a", 1], [3, 3]]}},
    {"geometry": ROOM | {"exits": 5}},
    {"geometry": ROOM | {"regions": {"a": [[1, 1], [2, 2], [1, 2], [2, 1]]}}},
    {"geometry": ROOM, "population": 7},
    {"geometry": ROOM, "population": {"people": -1}},
    {"geometry": ROOM, "population": {"people": 4}, "cohorts": [{"people": 3}]},
    {"geometry": ROOM, "population": {"people": 4}, "colour": "red"},
]


@pytest.mark.parametrize("content", BROKEN)
def test_a_broken_project_is_an_answer(project, content):
    found = look(content, project, layers=True)
    assert found["error"] and "\n" not in found["error"]


def test_what_stays_as_it_was_keeps_its_comment(project):
    given = call(f"plan {project.with_suffix('.dxf')} --layers walkable=A-AREA --exit 10300,2000,10300,3200 --save {project} "
                 f"--out {project.with_suffix('.png')}")  # fmt: skip
    assert given.exit_code == 0, given.stderr
    content = tomllib.loads(project.read_text())
    comments = {"geometry.exits.exit-0": "line of 1.20 m", "geometry.unit": "as it was drawn"}
    editor = Editor(Project(tomllib.loads(project.read_text()), comments, ("of us",)), project)
    content["geometry"] |= {"exits": {"exit-0": EXIT, "north": [[2, 6.2], [3, 6.2]]}, "unit": "mm"}
    assert "saved" in editor.answer("save", {"content": content, "revision": editor.revision})
    text = project.read_text()
    assert text.startswith("# of us\n") and "exit-0 = [[10.3, 2.0], [10.3, 3.2]] # line of 1.20 m\n" in text
    assert 'unit = "mm"\n' in text and tomllib.loads(text) == content
    assert "as it was understood" in project.with_name("office.toml~").read_text()  # what was there before


def test_what_was_written_by_hand_is_kept(project):
    hand = '# ours\n[geometry] # a drawing\nfile = "office.dxf" # of May\n# why\n[population]\npeople = 3 # few\n'
    project.write_text(hand)
    for k in range(2):  # two sessions
        editor = Editor(project_in(project.read_text()), project)
        content = {"geometry": {"file": "office.dxf"}, "population": {"people": 4 + k}}
        for again in (False, True):
            answer = editor.answer("save", {"content": content, "revision": editor.revision})
            assert answer["kept"] == ("office.toml~" if not k and not again else "")
    assert project.with_name("office.toml~").read_text() == hand and not project.with_name("office.toml~2").exists()
    assert (
        project.read_text().startswith("# ours\n\n[geometry]") and 'file = "office.dxf" # of May' in project.read_text()
    )


def test_what_another_has_written_meanwhile_is_not_lost(project):
    editor = Editor(Project(OFFICE), project)
    saved = editor.answer("save", {"content": OFFICE, "revision": ""})
    project.write_text(project.read_text().replace("people = 12", "people = 77"))
    other = {**OFFICE, "population": {"people": 5}}
    refused = editor.answer("save", {"content": other, "revision": saved["revision"]})
    assert "has changed since this page has read it" in refused["failed"] and "people = 77" in project.read_text()
    assert "failed" in editor.answer("run", {"content": other, "revision": saved["revision"], "runs": 1})
    assert "saved" in editor.answer("save", {"content": other, "revision": refused["revision"]})
    assert "people = 77" in project.with_name("office.toml~").read_text() and "people = 5" in project.read_text()


def test_a_page_that_is_loaded_again_goes_on(server, project):
    page, other = f"/{server.token}/", {**OFFICE, "population": {"people": 5}}
    ask(server, "POST", f"{page}save", {"content": OFFICE, "revision": ""})
    ask(server, "POST", f"{page}check", {"content": other})
    about = json.loads(ask(server, "GET", page)[1].split('id="about">')[1].split("</script>")[0])
    assert about["content"]["population"] == {"people": 5} and about["saved"]["population"] == OFFICE["population"]
    assert about["revision"] == server.editor.revision and not about["running"]


def test_people_who_are_locked_in_are_a_problem(project):
    locked = {
        **OFFICE,
        "closed_doors": ["d"],
        "geometry": OFFICE["geometry"] | {"doors": {"d": [[5.1, 2.5], [5.1, 3.4]]}},
    }
    found = look(locked, project)
    assert "no exit can be reached from" in found["remarks"][0] and not any(
        "reached" in note for note in found["notes"]
    )


def test_save_keeps_a_project_that_was_there(project):
    project.write_text("# hand notes\n")
    line = f"plan {project.with_suffix('.dxf')} --layers walkable=A-AREA --save {project} --out {project.with_suffix('.png')}"
    said = [call(line) for _ in range(2)]
    assert [one.exit_code for one in said] == [0, 0]
    assert [f"it is kept as {project}~" in " ".join(one.stderr.split()) for one in said] == [True, False]
    assert project.with_name("office.toml~").read_text() == "# hand notes\n"
    assert not project.with_name("office.toml~2").exists()


@pytest.fixture
def server(project):
    serving = Server(Editor(Project(OFFICE), project))
    threading.Thread(target=serving.serve_forever, daemon=True).start()
    yield serving
    serving.editor.stop()
    serving.shutdown()
    serving.server_close()


def ask(server, method, path, content=None, **headers):
    """Return status and body of an answer."""
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=60)
    given = {"Host": server.host, **({} if content is None else {"Content-Type": "application/json"}), **headers}
    connection.request(method, path, content if content is None else json.dumps(content), given)
    answer = connection.getresponse()
    return answer.status, answer.read().decode()


def test_only_who_has_the_token_is_answered(server, project):
    page, check = f"/{server.token}/", f"/{server.token}/check"
    status, text = ask(server, "GET", page)
    assert status == 200 and "<canvas" in text and "http:" not in text and "https:" not in text
    assert json.loads(ask(server, "POST", check, {"content": OFFICE})[1])["error"] is None
    others = {"Host": "evil.example", "Content-Type": "text/plain"}
    assert ask(server, "GET", "/")[0] == ask(server, "GET", "/wrong/")[0] == 404
    assert ask(server, "GET", page, Host=others["Host"])[0] == 404
    assert ask(server, "GET", f"/{server.token}/../office.dxf")[0] == 404
    for name, value in others.items():
        assert ask(server, "POST", check, {"content": OFFICE}, **{name: value})[0] == 400
    assert "cannot ask for" in ask(server, "POST", f"/{server.token}/erase", {})[1]
    assert not project.exists()


@pytest.mark.parametrize("runs", [0, None, "3", 1e9])
def test_a_wrong_number_of_runs_starts_none(server, runs):
    answer = json.loads(ask(server, "POST", f"/{server.token}/run", {"content": OFFICE, "runs": runs})[1])
    assert "runs" in answer["failed"]


@pytest.mark.more
def test_a_run_has_a_replay_and_a_report(server, project):
    late("matplotlib")
    for expected in ("office-runs-1", "office-runs-2"):
        given = {"content": OFFICE, "runs": 2, "revision": server.editor.revision}
        assert "saved" in ask(server, "POST", f"/{server.token}/run", given)[1]
        assert "a run goes on" in ask(server, "POST", f"/{server.token}/run", given)[1]
        found = {"state": "running"}
        while found["state"] == "running":
            time.sleep(0.2)
            found = json.loads(ask(server, "POST", f"/{server.token}/progress", {})[1])
        assert found["state"] == "done" and found["done"] == 2 and found["folder"].endswith(expected)
        assert "evacuation time" in dict(found["rows"]) and isinstance(found["check"], str)
        files = json.loads((project.parent / expected / "config.json").read_text())["files"]
        assert {Path(file).name for file in files} == {"office.toml", "office.dxf"}
    for page in ("replay.html", "report.html"):
        assert ask(server, "GET", f"/{server.token}/{page}")[0] == 200
    assert project.exists()


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("room-v0 --edit", "room-v0 ships with crowd_env"),
        ("{plan} {plan} --edit", "--edit is for one place"),
        ("{plan} --edit --out page.png", "it must be a page, .html"),
        ("none.dxf --edit", "none.dxf"),
    ],
)
def test_what_cannot_be_edited_is_named(project, line, words):
    given = call(f"plan {line.format(plan=project.with_suffix('.dxf'))}")
    assert given.exit_code == 2 and words in given.stderr.replace("\n", " ")


def test_a_page_that_stands_alone_holds_the_drawing(project):
    page = project.with_suffix(".html")
    given = call(f"plan {project.with_suffix('.dxf')} --edit --out {page}")
    assert given.exit_code == 0, given.stderr
    about = json.loads(page.read_text().split('id="about">')[1].split("</script>")[0])
    assert not about["served"] and len(about["shown"]["layers"]) == 3 and not project.exists()


def test_the_project_of_a_drawing_is_gone_on_with(project):
    project.write_text('[geometry]\nfile = "other.dxf"\n')
    given = call(f"plan {project.with_suffix('.dxf')} --edit --out {project.with_suffix('.html')}")
    assert given.exit_code == 2 and "is another project than that of" in given.stderr.replace("\n", " ")
    project.write_text('[geometry]\nfile = "office.dxf"\n[population]\npeople = 9\n')
    given = call(f"plan {project.with_suffix('.dxf')} --edit --out {project.with_suffix('.html')}")
    assert given.exit_code == 0 and "going on with" in given.stderr
    assert '"people":9' in project.with_suffix(".html").read_text()
