"""A foreign drawing without exits on the page in a browser: from its first sight to a report, by pointer and by keys.

It needs Playwright and Chromium, as the tests of the replay do.
"""

import itertools
import json
import shutil
import threading
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from late import late
from office_drawing import AREA, draw_office
from plan_files import feature, geojson
from shapely.geometry import box

from crowd_env.cli.editing import Editor, Server, look, page_alone
from crowd_env.scenarios.project import Project

sync_api = late("playwright.sync_api")
late("ezdxf")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = [
    pytest.mark.more,
    pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium to show the page with"),
]
BARE = {"geometry": {"file": "office.dxf"}, "population": {"people": 12}}


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        yield chromium
        chromium.close()


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    draw_office(tmp_path / "office.dxf")
    serving = Server(Editor(Project(BARE), tmp_path / "office.toml"))
    threading.Thread(target=serving.serve_forever, daemon=True).start()
    yield serving
    serving.editor.stop()
    serving.shutdown()
    serving.server_close()


class Tab:
    """The page, and what goes wrong on it."""

    def __init__(self, browser: Any, url: str, width: int = 1280, height: int = 800) -> None:
        self.context = browser.new_context(viewport={"width": width, "height": height}, accept_downloads=True)
        self.page = self.context.new_page()
        self.wrong: list[str] = []
        self.requests: list[str] = []
        self.page.on("pageerror", lambda error: self.wrong.append(str(error)))
        self.page.on("console", lambda said: self.wrong.append(said.text) if said.type == "error" else None)
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(url)
        self.page.wait_for_selector("body.ready")
        self.settle()

    def get(self, expression: str) -> Any:
        return self.page.evaluate(expression)

    def wait(self, condition: str) -> None:
        """Wait until a condition holds; the page allows no code from strings, so Playwright's own waiting cannot."""
        while not self.get(condition):
            self.page.wait_for_timeout(20)

    def settle(self) -> None:
        self.wait("!editor.about.served || !byId('state').textContent.startsWith('checking')")

    def click(self, *points: tuple[float, float]) -> None:
        """Click points [m] of the plan."""
        for x, y in points:
            self.page.locator("#canvas").scroll_into_view_if_needed()
            box = self.page.locator("#canvas").bounding_box()
            px, py = self.get(f"[editor.view.px({x}), editor.view.py({y})]")
            self.page.mouse.click(box["x"] + px, box["y"] + py)
            self.page.wait_for_timeout(400)  # two clicks at once are a double click
        self.settle()

    def content(self) -> Any:
        return self.get("editor.project.content")

    def close(self) -> None:
        assert not self.wrong
        self.context.close()


def _give_roles(tab: Tab) -> None:
    assert tab.get("byId('layers-of').open")  # what is needed first
    for layer, role in (("A-AREA", "walkable"), ("A-WALL", "obstacles"), ("A-FURN", "obstacles")):
        tab.page.get_by_label(f"What {layer} is").select_option(role)
        tab.settle()


@pytest.mark.parametrize("size", [(1280, 800), (390, 844)])
def test_from_a_drawing_without_exits_to_a_report(browser: Any, server: Server, size: tuple[int, int]) -> None:
    tab = Tab(browser, server.url, *size)
    assert "says where people walk" in tab.page.locator("#problems").inner_text()
    _give_roles(tab)
    assert tab.get("editor.project.shown.area") == pytest.approx(AREA)
    assert "draw one on the edge" in tab.page.locator("#problems").inner_text()
    tab.page.get_by_role("button", name="Exit", exact=False).first.click()
    tab.click((10.28, 2.03), (10.31, 3.22))  # not quite at the corners
    assert tab.content()["geometry"]["exits"] == {"exit-1": [[10.3, 2], [10.3, 3.2]]}
    tab.page.locator("#name").fill("way out")
    tab.page.locator("#name").press("Enter")
    tab.settle()
    tab.page.locator("#tools button", has_text="People").click()
    tab.click((0.5, 3.5), (4.0, 5.5))
    tab.page.keyboard.press("Enter")
    tab.settle()
    tab.page.locator("#people-start-1").fill("9")
    tab.page.locator("#people-start-1").press("Tab")
    tab.settle()
    assert "Nothing stands in the way of a run" in tab.page.locator("#problems").inner_text()
    people = tab.get("editor.project.shown.people")
    (x0, y0), _, (x1, y1), _ = tab.content()["geometry"]["regions"]["start-1"]
    assert abs(x0 - 0.5) < 0.4 and abs(y1 - 5.5) < 0.4  # corners are snapped to, which is coarse on a small screen
    assert len(people) == 9 and all(x0 <= x <= x1 and y0 <= y <= y1 for x, y, *_ in people)

    tab.page.locator("#tools button", has_text="Count").click()
    tab.click((5.1, 2.5), (5.1, 3.4))
    assert tab.content()["sections"][0]["name"] == "line-1" and tab.get("editor.project.shown.error") is None
    tab.page.locator("#elements button", has_text="start-1").click()
    tab.page.get_by_label("Profile").select_option("imo-male-30-to-50")
    tab.settle()

    tab.page.locator("#runs").fill("2")
    tab.page.locator("#run").click()
    tab.page.wait_for_selector("#answer iframe", timeout=180_000)
    answer = tab.page.locator("#answer table").inner_text()
    assert "evacuation time" in answer and "line-1" in answer
    frame = tab.page.frame_locator("#answer iframe")
    frame.locator("body.ready").wait_for(timeout=30_000)
    tab.page.locator("#answer button", has_text="Report").click()
    frame.locator("h1", has_text="office").wait_for(timeout=30_000)
    tab.page.locator("#answer button", has_text="Back").click()
    assert tab.page.locator("#canvas").is_visible()
    content = tomllib.loads(server.editor.path.read_text())
    assert content["geometry"]["exits"] == {"way out": [[10.3, 2], [10.3, 3.2]]}
    assert content["population"] == {"people": 9, "start_region": "start-1", "profile": "imo-male-30-to-50"}
    assert all(url.startswith((server.url, "data:", "blob:")) for url in tab.requests)
    assert tab.get("document.documentElement.scrollWidth") <= size[0]
    tab.close()


def test_all_by_keys(browser: Any, server: Server) -> None:
    tab = Tab(browser, server.url)
    _give_roles(tab)
    keys = tab.page.keyboard

    def walk_to(x: float, y: float) -> None:
        """Move the cross by arrows, six pixels at a time, until it is there."""
        for _ in range(400):
            tab.page.locator("#canvas").focus()
            at = tab.get("editor.key_at || editor.meters(editor.view.width / 2, editor.view.height / 2)")
            dx, dy = (tab.get("editor.view.scale") * (to - now) for to, now in zip((x, y), at, strict=True))
            if max(abs(dx), abs(dy)) < 4:
                return
            far = max(abs(dx), abs(dy)) > 70
            way = (
                ("ArrowRight" if dx > 0 else "ArrowLeft")
                if abs(dx) > abs(dy)
                else ("ArrowUp" if dy > 0 else "ArrowDown")
            )
            keys.press(f"Shift+{way}" if far else way)
        raise AssertionError("the cross does not get there")

    tab.page.locator("#canvas").focus()
    keys.press("e")
    for point in ((10.3, 2.0), (10.3, 3.2)):
        walk_to(*point)
        keys.press("Enter")
    tab.settle()
    assert tab.content()["geometry"]["exits"] == {"exit-1": [[10.3, 2], [10.3, 3.2]]}
    keys.press("Delete")
    tab.settle()
    assert not tab.content()["geometry"]["exits"]
    keys.press("Control+z")
    tab.settle()
    assert "exit-1" in tab.content()["geometry"]["exits"]
    keys.press("Control+Shift+z")
    tab.settle()
    assert not tab.content()["geometry"]["exits"]
    keys.press("Control+z")
    tab.settle()
    keys.press("Control+s")
    tab.wait("byId('state').textContent.startsWith('saved')")
    assert tomllib.loads(server.editor.path.read_text()) == tab.content()
    tab.close()


def test_a_problem_shows_its_place_and_a_corner_is_dragged(browser: Any, server: Server) -> None:
    tab = Tab(browser, server.url)
    _give_roles(tab)
    tab.page.keyboard.press("Escape")
    tab.page.locator("#canvas").focus()
    tab.page.keyboard.press("e")
    tab.click((7.0, 3.0), (8.0, 3.0))  # in mid-room
    assert "exit 'exit-1'" in tab.page.locator("#problems").inner_text()
    tab.page.locator(".problem").first.click()
    assert tab.get("editor.marks.length") >= 1
    tab.get("editor.view.fit()")
    box = tab.page.locator("#canvas").bounding_box()
    for begin, end in (((7.0, 3.0), (10.3, 2.0)), ((8.0, 3.0), (10.3, 3.2))):
        tab.page.mouse.move(*_pixel(tab, box, *begin))
        tab.page.mouse.down()
        tab.page.mouse.move(*_pixel(tab, box, *end), steps=4)
        tab.page.mouse.up()
        tab.settle()
    assert tab.content()["geometry"]["exits"] == {"exit-1": [[10.3, 2], [10.3, 3.2]]}
    assert "Nothing stands in the way" in tab.page.locator("#problems").inner_text()
    tab.close()


def _pixel(tab: Tab, box: Any, x: float, y: float) -> tuple[float, float]:
    px, py = tab.get(f"[editor.view.px({x}), editor.view.py({y})]")
    return box["x"] + px, box["y"] + py


def test_a_slip_is_named_and_undone(browser: Any, server: Server) -> None:
    tab = Tab(browser, server.url)
    _give_roles(tab)
    tab.page.locator("#canvas").focus()
    tab.page.keyboard.press("p")
    tab.click((1, 4), (4, 5.5), (4, 4), (1, 5.5))  # a bow tie
    tab.page.locator("#canvas").focus()
    tab.page.keyboard.press("Enter")
    tab.settle()
    assert "self-intersection" in tab.page.locator("#problems").inner_text()
    tab.page.keyboard.press("Control+z")
    tab.settle()
    assert "draw one on the edge" in tab.page.locator("#problems").inner_text()
    tab.close()


def test_a_layer_is_chosen_on_the_plan(browser: Any, server: Server) -> None:
    tab = Tab(browser, server.url)
    tab.click((2.0, 2.5))  # an edge of the table
    assert "A-FURN" in tab.page.locator("#selected").inner_text()
    tab.page.locator("#selected button", has_text="left out").click()
    tab.settle()
    assert tab.content()["geometry"]["layers"] == {"left_out": ["A-FURN"]}
    tab.close()


def test_a_level_is_chosen(browser: Any, server: Server) -> None:
    rooms = [feature(box(0, 0, 8 + 4 * k, 6), indoor="room", level=str(k)) for k in range(2)]
    geojson(server.editor.path.with_name("house.geojson"), *rooms)
    server.editor.content = {"geometry": {"file": "house.geojson"}}
    tab = Tab(browser, server.url)
    assert "it has 2 levels" in tab.page.locator("#problems").inner_text()
    tab.page.get_by_label("Level").select_option("1")
    tab.settle()
    assert tab.get("editor.project.shown.area") == 72.0 and tab.content()["geometry"]["level"] == "1"
    tab.page.get_by_label("Unit").select_option("ft")
    tab.settle()
    assert tab.get("editor.project.shown.area") == pytest.approx(72.0 * 0.3048**2)
    assert tab.get("editor.view.bounds[2]") == pytest.approx(12 * 0.3048, abs=1e-3)
    tab.close()


def test_elements_keep_their_ties(browser: Any, server: Server) -> None:
    tab = Tab(browser, server.url)
    _give_roles(tab)
    tab.get(
        """editor.change((content) => {
          content.geometry.exits = { east: [[10.3, 2], [10.3, 3.2]], north: [[7, 6.2], [8, 6.2]] };
          content.geometry.regions = { a: [[1, 4], [2, 4], [2, 5], [1, 5]], b: [[6, 1], [8, 1], [8, 3], [6, 3]] };
          content.geometry.doors = { d: "east" };
          content.cohorts = [{ people: 4, start_region: "a", exits: ["east", "north"] }, { people: 5, start_region: "b" }];
          content.population = { response_time: 3 };
          content.zones = [{ region: "b", factor: 0.5 }];
          content.closed_doors = ["d"];
          content.door_events = [{ door: "d", opens: true, at: 5 }];
        })"""
    )
    tab.settle()
    assert tab.get("editor.project.shown.error") is None
    renames = [("exit", "east", "gate"), ("start", "b", "hall"), ("door", "d", "leaf")]
    for kind, name, to in renames:
        tab.get(f"editor.act(() => editor.project.rename({{kind: '{kind}', name: '{name}'}}, '{to}'))")
    content = tab.content()
    assert content["cohorts"] == [
        {"people": 4, "start_region": "a", "exits": ["gate", "north"]}, {"people": 5, "start_region": "hall"}]  # fmt: skip
    assert content["geometry"]["doors"] == {"leaf": "gate"} and content["closed_doors"] == ["leaf"]
    assert content["zones"][0]["region"] == "hall" and content["door_events"][0]["door"] == "leaf"
    tab.get("""editor.change((content) => {
      content.rules = [{ region: "hall", at_least: 5, below: 2, route: "gate" }];
      content.cohorts[1].route = "gate";
    })""")
    tab.get("editor.act(() => editor.project.rename({kind: 'exit', name: 'gate'}, 'way'))")
    assert tab.content()["rules"][0]["route"] == tab.content()["cohorts"][1]["route"] == "way"
    tab.get("editor.act(() => editor.project.rename({kind: 'exit', name: 'way'}, 'gate'))")
    tab.get("editor.act(() => editor.project.remove({kind: 'start', name: 'hall'}), null)")
    tab.settle()
    content = tab.content()
    assert content["population"] == {"response_time": 3, "people": 4, "start_region": "a", "exits": ["gate", "north"]}
    assert (
        not {"zones", "rules"} & set(content)
        and "cohorts" not in content
        and tab.get("editor.project.shown.error") is None
    )
    tab.get("editor.act(() => editor.project.remove({kind: 'exit', name: 'gate'}), null)")
    tab.get("editor.act(() => editor.project.remove({kind: 'exit', name: 'north'}), null)")
    assert tab.content()["geometry"]["exits"] == {} and "exits" not in tab.content()["population"]
    tab.get("editor.project.undo()")
    content = tab.content()
    assert list(content["geometry"]["exits"]) == ["north"] and content["population"]["exits"] == ["north"]
    assert "doors" not in content["geometry"] and not {"closed_doors", "door_events"} & set(content)
    tab.close()


def test_walls_alone_and_an_exit_are_a_plan(browser: Any, server: Server) -> None:
    tab = Tab(browser, server.url)
    assert "choose under" in tab.page.locator("#problems").inner_text()
    for layer, role in (("A-WALL", "obstacles"), ("A-AREA", "left_out")):
        tab.page.get_by_label(f"What {layer} is").select_option(role)
        tab.settle()
    problems = tab.page.locator("#problems").inner_text()
    assert "enclose no room" in problems and "--" not in problems
    tab.page.locator("#tools button", has_text="Exit").click()
    tab.click((10.4, 2.0), (10.4, 3.2))  # snapped to the corners of the gap
    assert "Nothing stands in the way" in tab.page.locator("#problems").inner_text()
    assert tab.get("editor.project.shown.exits['exit-1'].width") == pytest.approx(1.2)
    tab.close()


def test_what_another_has_or_needs_is_told(browser: Any, server: Server) -> None:
    tab = Tab(browser, server.url)
    _give_roles(tab)
    tab.get(
        """editor.change((content) => {
          content.geometry.exits = { east: [[10.3, 2], [10.3, 3.2]], north: [[7, 6.2], [8, 6.2]] };
          content.geometry.regions = { lounge: [[6, 1], [8, 1], [8, 3], [6, 3]] };
          content.routes = [{ name: "lounge first", via: "lounge", exits: ["east"] }];
          content.population = { people: 5, route: "lounge first" };
        })"""
    )
    tab.settle()
    tab.page.locator("#elements button", has_text="north").click()
    tab.page.locator("#name").fill("east")
    tab.page.locator("#name").press("Enter")
    assert "there is another east" in tab.page.locator("#state").inner_text()
    assert tab.page.locator("#name").input_value() == "north" and list(tab.content()["geometry"]["exits"]) == [
        "east",
        "north",
    ]
    tab.page.locator("#flow").fill("0.5")
    tab.page.locator("#flow").press("Tab")
    tab.settle()
    assert tab.content()["gates"] == [{"door": "door of north", "flow": 0.5}]
    assert tab.get("editor.project.shown.error") is None
    tab.page.locator("#elements button", has_text="lounge").click()
    tab.page.locator("#selected button", has_text="Delete").click()
    tab.settle()
    assert "its routes are gone: lounge first" in tab.page.locator("#state").inner_text()
    assert "routes" not in tab.content() and "route" not in tab.content()["population"]
    assert tab.get("editor.project.shown.error") is None
    tab.close()


@pytest.mark.parametrize("width", [1280, 390])
def test_labels_are_whole_and_apart(browser: Any, server: Server, width: int) -> None:
    tab = Tab(browser, server.url, width, 800)
    _give_roles(tab)
    tab.get(
        """editor.change((content) => {
          content.geometry.exits = { "the way out to the east": [[10.3, 2], [10.3, 3.2]] };
          content.geometry.doors = { "door of the way out": "the way out to the east" };
        })"""
    )
    tab.settle()
    tab.page.wait_for_timeout(100)
    labels, width = tab.get("[editor.view.labels, editor.view.width]")
    assert len(labels) >= 3 and all(one["wide"] / 2 <= one["x"] <= width - one["wide"] / 2 for one in labels)
    for one, other in itertools.combinations(labels, 2):
        assert abs(one["y"] - other["y"]) >= 15 or abs(one["x"] - other["x"]) >= (one["wide"] + other["wide"]) / 2
    tab.close()


def test_a_page_that_stands_alone_hands_back_a_project(browser: Any, tmp_path: Path) -> None:
    draw_office(tmp_path / "office.dxf")
    path = tmp_path / "office.toml"
    roles = {"walkable": ["A-AREA"], "obstacles": ["A-WALL", "A-FURN"]}
    content = {**BARE, "geometry": {**BARE["geometry"], "layers": roles}}
    page = tmp_path / "office.html"
    page.write_text(page_alone(content, path))
    tab = Tab(browser, page.as_uri())
    tab.page.locator("#canvas").focus()
    tab.page.keyboard.press("e")
    tab.click((10.3, 2.0), (10.3, 3.2))
    with tab.page.expect_download() as handed:
        tab.page.locator("#save").click()
    handed.value.save_as(tmp_path / "office.json")
    back = json.loads((tmp_path / "office.json").read_text())
    assert look(back, tmp_path / "office.json")["error"] is None
    assert all(url.startswith(("file:", "data:", "blob:")) for url in tab.requests)
    tab.close()
